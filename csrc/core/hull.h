/* hull.h: outlines of points in a plane. */
#ifndef CSM_HULL_H
#define CSM_HULL_H

#include <math.h>

#include "csm.h"

/* Empty where low > high. */
typedef struct csm_rectangle {
    double low[2], high[2];
} csm_rectangle;

static inline csm_rectangle csm_rectangle_nothing(void) {
    return (csm_rectangle){{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
}

static inline void csm_rectangle_grow(csm_rectangle *out, const double low[2],
                                      const double high[2]) {
    for (int axis = 0; axis < 2; axis++) {
        /* not fmin and fmax: called for every point seen, they would be calls of the library */
        out->low[axis] = low[axis] < out->low[axis] ? low[axis] : out->low[axis];
        out->high[axis] = high[axis] > out->high[axis] ? high[axis] : out->high[axis];
    }
}

/* Convex hull, counter-clockwise, into out (room for max corners). Points are sorted in place. A
 * point within tolerance of the line between its neighbours is left out. Returns the number of
 * corners, 0 if there are more than max. */
size_t csm_convex_hull(double (*points)[2], size_t count, double tolerance, size_t max,
                       double (*out)[2]);

/* Drops points that lie inside a polygon of some that are far out in 16 directions: they cannot be
 * corners of the hull. Works in place; returns how many are left. */
size_t csm_outer_points(double (*points)[2], size_t count);

/* Angle [rad], 0 to pi / 2, of the rectangle of smallest area round a convex polygon: one of its
 * sides lies along an edge [Freeman and Shapira 1975]. 0 for fewer than two corners. */
double csm_smallest_rectangle(const double (*hull)[2], size_t count);

#endif
