/* coarse.h: pixels of pictures as points of the world, also past the ends of planes. */
#ifndef CSM_COARSE_H
#define CSM_COARSE_H

#include <math.h>

#include "csm.h"

/* Where the centres of a column and of a row are seen: tangents, or metres if orthographic. */
static inline double coarse_column_x(const csm_camera *camera, int column) {
    return camera->centre[0] + (2.0 * (column + 0.5) / camera->width - 1.0) * camera->half_width;
}

static inline double coarse_row_y(const csm_camera *camera, int row) {
    return camera->centre[1] + (1.0 - 2.0 * (row + 0.5) / camera->height) * camera->half_height;
}

/* What is seen there in a view depth. */
static inline void coarse_point(const csm_camera *camera, double x, double y, double depth,
                                double out[3]) {
    for (int i = 0; i < 3; i++) {
        const double across = x * camera->right[i] + y * camera->up[i];
        out[i] = camera->orthographic ? camera->eye[i] + across - depth * camera->backward[i]
                                      : camera->eye[i] + depth * (across - camera->backward[i]);
    }
}

static inline double depth_of(const csm_camera *camera, const double point[3]) {
    double depth = 0.0;
    for (int i = 0; i < 3; i++) {
        depth -= (point[i] - camera->eye[i]) * camera->backward[i];
    }
    return depth;
}

/* Ways that planes end along: down, up, right, left. Places count from the border where they start.
 */
static inline int way_axis(int way) {
    return way >> 1;
}

static inline bool way_back(int way) {
    return way & 1;
}

static inline int camera_side(const csm_camera *camera, int axis) {
    return axis ? camera->width : camera->height;
}

/* What all ends of one way share. */
typedef struct coarse_way {
    const csm_camera *full, *small;
    int axis, length; /* pixels of the full picture along it */
    bool back;
    double ratio; /* of them along a coarse one */
    int most;     /* that lie between two coarse ones */
} coarse_way;

static inline coarse_way coarse_way_of(const csm_camera *full, const csm_camera *small, int way) {
    const int axis = way_axis(way), length = camera_side(full, axis);
    const double ratio = (double)length / camera_side(small, axis);
    return (coarse_way){full, small, axis, length, way_back(way), ratio, (int)ceil(ratio)};
}

/* A place along a way, in pixels of the full picture. */
typedef struct coarse_place {
    double centre;
    int before; /* the last whose centre lies no farther */
} coarse_place;

static inline coarse_place coarse_place_of(const coarse_way *way, int place) {
    const double centre = (place + 0.5) * way->ratio;
    return (coarse_place){centre, (int)floor(centre - 0.5)};
}

/* How far ahead the k-th pixel past a place is, in coarse ones; 1 past the border. */
static inline double coarse_ahead(const coarse_way *way, const coarse_place *place, int k) {
    const int pixel = place->before + k;
    return pixel < way->length ? (pixel + 0.5 - place->centre) / way->ratio : 1.0;
}

/* The point that it sees in a depth. */
static inline void coarse_point_past(const coarse_way *way, const coarse_place *place, int k,
                                     int crossing, double depth, double out[3]) {
    const int pixel = place->before + k, along = way->back ? way->length - 1 - pixel : pixel;
    const double x =
        way->axis ? coarse_column_x(way->full, along) : coarse_column_x(way->small, crossing);
    const double y =
        way->axis ? coarse_row_y(way->small, crossing) : coarse_row_y(way->full, along);
    coarse_point(way->full, x, y, depth, out);
}

/* Its depth, if the plane goes on there. */
static inline double coarse_depth_past(const coarse_way *way, double last, double step,
                                       double ahead) {
    const double value = last + step * ahead;
    return way->full->orthographic ? value : 1.0 / value;
}

/* The point that the k-th pixel of the full picture past an end sees. */
static inline void coarse_end_point(const coarse_way *way, const coarse_place *place,
                                    const csm_plane_end *end, int k, double out[3]) {
    const double ahead = coarse_ahead(way, place, k);
    coarse_point_past(way, place, k, end->crossing,
                      coarse_depth_past(way, end->last, end->step, ahead), out);
}

/* Every how many of a count one is looked at, so that they are at most so many; and how many. */
static inline size_t coarse_stride(size_t count, size_t most) {
    const size_t stride = (count + most - 1) / most;
    return stride > 1 ? stride : 1;
}

static inline size_t coarse_looked_at(size_t count, size_t most) {
    const size_t stride = coarse_stride(count, most);
    return (count + stride - 1) / stride;
}

#endif
