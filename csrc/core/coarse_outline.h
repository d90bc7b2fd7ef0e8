/* coarse_outline.h: the outermost points that were met so far, and how pixels are asked. */
#ifndef CSM_COARSE_OUTLINE_H
#define CSM_COARSE_OUTLINE_H

#include <string.h>

#include "coarse.h"
#include "linalg.h"

#define DIRECTIONS CSM_OUTLINE_DIRECTIONS
#define SLICES CSM_OUTLINE_SLICES
#define TOGETHER 64 /* columns that are gone through at once */

typedef struct outer_point {
    size_t number; /* in the order in which points are met */
    double point[3];
} outer_point;

typedef struct outline {
    const double (*axes)[3];
    double along[2][DIRECTIONS];
    double borders[SLICES];           /* between the slices [m], and INFINITY */
    double least[SLICES][DIRECTIONS]; /* the outermost reach no less; -INFINITY: unknown */
    double reach[SLICES][DIRECTIONS]; /* -INFINITY where there is none yet */
    outer_point outermost[SLICES][DIRECTIONS];
} outline;

static inline int slice_of(const outline *o, double depth) {
    int slice = 0;
    for (int k = 0; k < SLICES - 1; k++) {
        slice += o->borders[k] < depth;
    }
    return slice;
}

/* The greatest. By halves, which compilers pack. */
static inline double most_of(double values[DIRECTIONS]) {
    for (int k = 0; k < DIRECTIONS / 2; k++) {
        const double other = values[k + DIRECTIONS / 2];
        values[k] = values[k] > other ? values[k] : other;
    }
    for (int k = 0; k < DIRECTIONS / 4; k++) {
        const double other = values[k + DIRECTIONS / 4];
        values[k] = values[k] > other ? values[k] : other;
    }
    double most = values[0];
    for (int k = 1; k < DIRECTIONS / 4; k++) {
        most = values[k] > most ? values[k] : most;
    }
    return most;
}

/* How far out a point lies, and whether, a margin farther out, it may be outermost anywhere in its
 * slice. Hardly a point is, so all directions are asked at once. */
static inline bool reaches_out(const outline *o, const double point[3], int slice, double margin,
                               double here[DIRECTIONS]) {
    const double u = vec3_dot(point, o->axes[0]), v = vec3_dot(point, o->axes[1]);
    const double *least = o->least[slice];
    double beyond[DIRECTIONS];
    for (int k = 0; k < DIRECTIONS; k++) {
        here[k] = u * o->along[0][k] + v * o->along[1][k];
        beyond[k] = here[k] - least[k];
    }
    return most_of(beyond) + margin >= 0.0; /* a reach of -INFINITY is beaten by all */
}

static inline void pixel_point(const csm_coarse_picture *picture, int row, int column, double depth,
                               double out[3]) {
    const csm_camera *camera = picture->camera;
    coarse_point(camera, coarse_column_x(camera, column), coarse_row_y(camera, row), depth, out);
}

/* Depths of count pixels of a row, NAN where they do not face the sun: no comparison holds. */
static inline void facing_depths(const csm_coarse_picture *picture, size_t first, int count,
                                 float out[TOGETHER]) {
    for (int i = 0; i < count; i++) {
        const float depth = picture->view_depth[first + (size_t)i];
        out[i] = picture->facing[first + (size_t)i] ? depth : NAN;
    }
}

/* Lanes hold what was least and greatest. */
static inline void widen(const float *values, int count, float *restrict low,
                         float *restrict high) {
    for (int i = 0; i < count; i++) {
        low[i] = values[i] < low[i] ? values[i] : low[i];
        high[i] = values[i] > high[i] ? values[i] : high[i];
    }
}

/* The range of all lanes; low > high of none. */
static inline void range_of(const float *low, const float *high, int count, double out[2]) {
    float least = INFINITY, most = -INFINITY;
    for (int i = 0; i < count; i++) {
        least = low[i] < least ? low[i] : least;
        most = high[i] > most ? high[i] : most;
    }
    out[0] = least;
    out[1] = most;
}

static inline void empty_lanes(float *low, float *high, int count) {
    for (int i = 0; i < count; i++) {
        low[i] = INFINITY;
        high[i] = -INFINITY;
    }
}

/* Of points that lie equally far out the first counts, in whichever order they come. */
void csm_outline_add(outline *o, const double point[3], double depth, size_t number);

/* coarse_outline_blocks.c: all pixels of a picture, numbered from first on. */
void csm_outline_add_picture(outline *o, const csm_coarse_picture *picture, size_t first);

#endif
