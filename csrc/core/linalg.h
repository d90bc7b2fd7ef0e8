/* linalg.h: the little linear algebra that core needs, in doubles.
 *
 * Vectors are double[3]. Matrices are double[16], column-major for column vectors: element
 * (row, column) is at [4 * column + row]. Names carry the convention: rh is right-handed, zo has
 * clip z in [0, 1]. Boxes are {min x y z, max x y z}.
 */
#ifndef CSM_LINALG_H
#define CSM_LINALG_H

#include <math.h>
#include <stdbool.h>
#include <string.h>

static inline double vec3_dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void vec3_cross(const double a[3], const double b[3], double out[3]) {
    const double x = a[1] * b[2] - a[2] * b[1];
    const double y = a[2] * b[0] - a[0] * b[2];
    const double z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

static inline bool vec3_finite(const double a[3]) {
    return isfinite(a[0]) && isfinite(a[1]) && isfinite(a[2]);
}

/* Rotation whose rows are x, y, z: target_from_source for axes given in source coordinates. */
static inline void mat4_from_rows(const double x[3], const double y[3], const double z[3],
                                  double out[16]) {
    memset(out, 0, 16 * sizeof *out);
    for (int column = 0; column < 3; column++) {
        out[4 * column] = x[column];
        out[4 * column + 1] = y[column];
        out[4 * column + 2] = z[column];
    }
    out[15] = 1.0;
}

/* out = a * b; out is neither a nor b. */
static inline void mat4_mul(const double a[16], const double b[16], double out[16]) {
    for (int column = 0; column < 4; column++) {
        for (int row = 0; row < 4; row++) {
            double sum = 0.0;
            for (int k = 0; k < 4; k++) {
                sum += a[4 * k + row] * b[4 * column + k];
            }
            out[4 * column + row] = sum;
        }
    }
}

/* The rotation part applied to a vector; out may be v. */
static inline void mat4_rotate(const double m[16], const double v[3], double out[3]) {
    const double x = m[0] * v[0] + m[4] * v[1] + m[8] * v[2];
    const double y = m[1] * v[0] + m[5] * v[1] + m[9] * v[2];
    const double z = m[2] * v[0] + m[6] * v[1] + m[10] * v[2];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

/* View depth near to 0, far to 1; half_width and half_height are tangents of the half angles,
 * centre the tangents at which the picture's centre is seen. */
static inline void perspective_rh_zo(double half_width, double half_height, const double centre[2],
                                     double near_depth, double far_depth, double out[16]) {
    memset(out, 0, 16 * sizeof *out);
    out[0] = 1.0 / half_width;
    out[5] = 1.0 / half_height;
    out[8] = centre[0] / half_width;
    out[9] = centre[1] / half_height;
    out[10] = -far_depth / (far_depth - near_depth);
    out[11] = -1.0;
    out[14] = -far_depth / (far_depth - near_depth) * near_depth;
}

/* View depth near to 0, near + span to 1; the window from its lower corner and its sides. Sides and
 * span are taken as they are, never as a difference of two far-off ends: that would cost their low
 * digits, and the scale would change as the window moves. */
static inline void ortho_rh_zo(const double corner[2], const double sides[2], double near_depth,
                               double span, double out[16]) {
    memset(out, 0, 16 * sizeof *out);
    for (int axis = 0; axis < 2; axis++) {
        const double scale = 2.0 / sides[axis];
        out[5 * axis] = scale;
        out[12 + axis] = -(corner[axis] * scale) - 1.0;
    }
    out[10] = -1.0 / span;
    out[14] = -near_depth / span;
    out[15] = 1.0;
}

static inline double box_largest_extent(const double bounds[6]) {
    return fmax(bounds[3] - bounds[0], fmax(bounds[4] - bounds[1], bounds[5] - bounds[2]));
}

/* How far [m] rounding may carry a point of a scene. First term: positions reach the GPU as float32
 * relative to the scene, and one float32 transform of them is six roundings of sums that stay below
 * 1.8 extents, with rounded matrix elements: less than 14 * 2^-24 extents. Second term: our own
 * doubles, far from the world origin. */
static inline double box_rounding(const double bounds[6]) {
    double largest = 0.0;
    for (int i = 0; i < 6; i++) {
        largest = fmax(largest, fabs(bounds[i]));
    }
    return 0x1p-20 * box_largest_extent(bounds) + 0x1p-44 * largest;
}

static inline void box_widen(const double bounds[6], double margin, double out[6]) {
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = bounds[axis] - margin;
        out[axis + 3] = bounds[axis + 3] + margin;
    }
}

#endif
