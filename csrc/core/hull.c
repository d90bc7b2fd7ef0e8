/* hull.c: convex outlines of points in a plane, and the smallest rectangle round them. */
#include "hull.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define DIRECTIONS 16
#define BLOCK 32 /* points that are looked at at once */
#define MANY 256 /* points, of which every STRIDE-th says well enough where the outermost are */
#define STRIDE 4

static int compare_points(const void *left, const void *right) {
    const double *a = left, *b = right;
    for (int axis = 0; axis < 2; axis++) {
        if (a[axis] != b[axis]) {
            return a[axis] < b[axis] ? -1 : 1;
        }
    }
    return 0;
}

/* How far b lies to the right of the line from a to c, times its length. */
static double right_of(const double a[2], const double b[2], const double c[2]) {
    return (c[1] - a[1]) * (b[0] - a[0]) - (c[0] - a[0]) * (b[1] - a[1]);
}

/* Points that rounding alone sets apart along x would be met in the order of that rounding, and a
 * corner far up the same edge be taken for a spike: they share one x. */
static void sort_points(double (*points)[2], size_t count, double tolerance) {
    qsort(points, count, sizeof *points, compare_points);
    double column = points[0][0];
    for (size_t i = 1; i < count; i++) {
        if (points[i][0] - column > 16.0 * tolerance) {
            column = points[i][0];
        }
        points[i][0] = column;
    }
    qsort(points, count, sizeof *points, compare_points);
}

/* Andrew's monotone chain. */
size_t csm_convex_hull(double (*points)[2], size_t count, double tolerance, size_t max,
                       double (*out)[2]) {
    if (count == 0) {
        return 0;
    }
    sort_points(points, count, tolerance);
    size_t size = 0;
    for (int half = 0; half < 2; half++) {
        const size_t start = size; /* lower chain left to right, then the upper one back */
        for (size_t i = 0; i < count; i++) {
            const double *point = points[half == 0 ? i : count - 1 - i];
            while (size - start >= 2) {
                const double length =
                    hypot(point[0] - out[size - 2][0], point[1] - out[size - 2][1]);
                if (right_of(out[size - 2], out[size - 1], point) > tolerance * length) {
                    break;
                }
                size--;
            }
            if (size == max) {
                return 0;
            }
            memcpy(out[size++], point, sizeof out[0]);
        }
        size--; /* the last point begins the other chain */
    }
    return size;
}

/* Half planes a x + b y < c. */
typedef struct half_planes {
    double a[DIRECTIONS], b[DIRECTIONS], c[DIRECTIONS];
} half_planes;

/* How far points of a block lie beyond any of them: positive where they do. Without a branch, point
 * by point in the inner loop, so that several are looked at at once. */
static void beyond_any(const half_planes *planes, const double (*points)[2], size_t count,
                       size_t stride, double out[BLOCK]) {
    double x[BLOCK] = {0.0}, y[BLOCK] = {0.0};
    for (size_t i = 0; i < count; i++) {
        x[i] = points[i * stride][0];
        y[i] = points[i * stride][1];
    }
    for (int i = 0; i < BLOCK; i++) {
        out[i] = -INFINITY;
    }
    for (int k = 0; k < DIRECTIONS; k++) {
        const double a = planes->a[k], b = planes->b[k], c = planes->c[k];
        for (int i = 0; i < BLOCK; i++) {
            const double over = a * x[i] + b * y[i] - c;
            out[i] = over > out[i] ? over : out[i];
        }
    }
}

static size_t block_at(size_t begin, size_t count) {
    return count - begin < BLOCK ? count - begin : BLOCK;
}

/* Points far out in all directions: of many, the farthest of some. */
static void far_points(const double (*points)[2], size_t count, double out[DIRECTIONS][2]) {
    half_planes nearer;
    double beyond[BLOCK];
    for (int k = 0; k < DIRECTIONS; k++) {
        const double angle = k * (2.0 * 3.14159265358979323846 / DIRECTIONS);
        nearer.a[k] = cos(angle);
        nearer.b[k] = sin(angle);
        nearer.c[k] = nearer.a[k] * points[0][0] + nearer.b[k] * points[0][1];
        memcpy(out[k], points[0], sizeof out[k]);
    }
    const size_t stride = count < MANY ? 1 : STRIDE, looked_at = (count + stride - 1) / stride;
    for (size_t begin = 0; begin < looked_at; begin += BLOCK) {
        const size_t some = block_at(begin, looked_at);
        beyond_any(&nearer, points + begin * stride, some, stride, beyond);
        for (size_t i = 0; i < some; i++) {
            const double *point = points[(begin + i) * stride];
            for (int k = 0; beyond[i] > 0.0 && k < DIRECTIONS; k++) {
                const double reach = nearer.a[k] * point[0] + nearer.b[k] * point[1];
                if (reach > nearer.c[k]) {
                    nearer.c[k] = reach;
                    memcpy(out[k], point, sizeof out[k]);
                }
            }
        }
    }
}

/* The inside of the polygon of points that are its corners in order, a corner may be there twice:
 * nothing where it has no area. */
static half_planes inside_of(const double (*corners)[2]) {
    half_planes out;
    double most = 0.0;
    for (int k = 0; k < DIRECTIONS; k++) {
        most = fmax(most, fmax(fabs(corners[k][0]), fabs(corners[k][1])));
    }
    for (int k = 0; k < DIRECTIONS; k++) {
        const double *from = corners[k], *to = corners[(k + 1) % DIRECTIONS];
        out.a[k] = to[1] - from[1];
        out.b[k] = from[0] - to[0];
        /* what rounding alone moves in from an edge is outside, as is what lies on it */
        const double rounding = 8.0 * DBL_EPSILON * most * (fabs(out.a[k]) + fabs(out.b[k]));
        const bool point = out.a[k] == 0.0 && out.b[k] == 0.0;
        out.c[k] = point ? DBL_MAX : out.a[k] * from[0] + out.b[k] * from[1] - rounding;
    }
    return out;
}

size_t csm_outer_points(double (*points)[2], size_t count) {
    double corners[DIRECTIONS][2];
    if (count == 0) {
        return 0;
    }
    far_points((const double(*)[2])points, count, corners);
    bool one = true; /* what lies on one point has no inside */
    for (int k = 1; k < DIRECTIONS; k++) {
        one = one && corners[k][0] == corners[0][0] && corners[k][1] == corners[0][1];
    }
    const half_planes inside = inside_of((const double(*)[2])corners);
    size_t kept = 0;
    for (size_t begin = 0; begin < count; begin += BLOCK) {
        double beyond[BLOCK];
        const size_t some = block_at(begin, count);
        beyond_any(&inside, (const double(*)[2])points + begin, some, 1, beyond);
        for (size_t i = 0; i < some; i++) {
            if (one || beyond[i] >= 0.0) {
                memmove(points[kept++], points[begin + i], sizeof points[0]);
            }
        }
    }
    return kept;
}

double csm_smallest_rectangle(const double (*hull)[2], size_t count) {
    double best_area = INFINITY, best_angle = 0.0;
    for (size_t i = 0; i < count && count >= 2; i++) {
        const double *a = hull[i], *b = hull[(i + 1) % count];
        const double length = hypot(b[0] - a[0], b[1] - a[1]);
        if (!(length > 0.0)) {
            continue;
        }
        const double along[2] = {(b[0] - a[0]) / length, (b[1] - a[1]) / length};
        double low = INFINITY, high = -INFINITY, height = 0.0;
        for (size_t k = 0; k < count; k++) {
            const double x = hull[k][0] - a[0], y = hull[k][1] - a[1];
            low = fmin(low, along[0] * x + along[1] * y);
            high = fmax(high, along[0] * x + along[1] * y);
            height = fmax(height, fabs(along[0] * y - along[1] * x));
        }
        if ((high - low) * height < best_area) {
            best_area = (high - low) * height;
            best_angle = atan2(along[1], along[0]);
        }
    }
    /* quarter turns only exchange the sides */
    const double quarter = 0.5 * 3.14159265358979323846;
    best_angle = fmod(best_angle, quarter);
    return best_angle < 0.0 ? best_angle + quarter : best_angle;
}
