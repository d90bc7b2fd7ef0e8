/* coarse.h: pixels of pictures as points of the world. */
#ifndef CSM_COARSE_H
#define CSM_COARSE_H

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

#endif
