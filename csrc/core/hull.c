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

/* The corners of the polygon of the points farthest out in all directions, each once, in order. */
static int farthest_points(const double (*points)[2], size_t count, double (*out)[2]) {
    double farthest[DIRECTIONS], at[DIRECTIONS], along[2][DIRECTIONS];
    for (int k = 0; k < DIRECTIONS; k++) {
        const double angle = k * (2.0 * 3.14159265358979323846 / DIRECTIONS);
        along[0][k] = cos(angle);
        along[1][k] = sin(angle);
        farthest[k] = -INFINITY;
        at[k] = 0.0;
    }
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < DIRECTIONS; k++) { /* doubles without a branch: in vectors */
            const double reach = along[0][k] * points[i][0] + along[1][k] * points[i][1];
            at[k] = reach > farthest[k] ? (double)i : at[k];
            farthest[k] = reach > farthest[k] ? reach : farthest[k];
        }
    }
    int size = 0;
    for (int k = 0; k < DIRECTIONS; k++) {
        const double *corner = points[(size_t)at[k]];
        const double *next = points[(size_t)at[(k + 1) % DIRECTIONS]];
        if (corner[0] != next[0] || corner[1] != next[1]) {
            memcpy(out[size++], corner, sizeof out[0]);
        }
    }
    return size;
}

size_t csm_outer_points(double (*points)[2], size_t count) {
    double corners[DIRECTIONS][2];
    const int size = count ? farthest_points((const double(*)[2])points, count, corners) : 0;
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        bool inside = true; /* of one point or of copies of it, every point is */
        for (int k = 0; inside && k < size; k++) { /* on an edge counts as outside */
            inside = right_of(corners[k], points[i], corners[(k + 1) % size]) < 0.0;
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
