/* hull.c: convex outlines of points in a plane, and the smallest rectangle round them. */
#include "hull.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define DIRECTIONS 16

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

size_t csm_outer_points(double (*points)[2], size_t count) {
    double corners[DIRECTIONS][2], farthest[DIRECTIONS], along[DIRECTIONS][2];
    for (int k = 0; k < DIRECTIONS; k++) {
        const double angle = k * (2.0 * 3.14159265358979323846 / DIRECTIONS);
        along[k][0] = cos(angle);
        along[k][1] = sin(angle);
        farthest[k] = -INFINITY;
    }
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < DIRECTIONS; k++) {
            const double reach = along[k][0] * points[i][0] + along[k][1] * points[i][1];
            if (reach > farthest[k]) {
                farthest[k] = reach;
                memcpy(corners[k], points[i], sizeof corners[k]);
            }
        }
    }
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        bool inside = true;
        for (int k = 0; inside && k < DIRECTIONS; k++) {
            const double *a = corners[k], *b = corners[(k + 1) % DIRECTIONS];
            const bool edge = a[0] != b[0] || a[1] != b[1];
            inside = !edge || right_of(a, points[i], b) < 0.0; /* on an edge counts as outside */
        }
        if (!inside) {
            memmove(points[kept++], points[i], sizeof points[0]);
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
