/* coverage_move.c: what happened to a shadow map's texel grid between two frames.
 *
 * In: two clip matrices, the view before. Out: texel sizes, and how far fixed points of the world
 * moved from their place within a texel and within a depth quantum (docs/numerics.md 23).
 */
#include "light_window.h"
#include "linalg.h"

static double from_whole(double value) {
    return fabs(value - round(value));
}

csm_status csm_coverage_move(const csm_camera *camera, double near_depth, double far_depth,
                             const double before[16], int size_before, const double after[16],
                             int size_after, csm_grid_move *out, csm_error *err) {
    csm_camera at_origin = *camera;
    double corners[CSM_CORNER_COUNT][3], reach = 0.0;
    memset(at_origin.eye, 0, sizeof at_origin.eye);
    csm_frustum_corners(&at_origin, near_depth, far_depth, corners);
    for (int i = 0; i < CSM_CORNER_COUNT; i++) {
        for (int axis = 0; axis < 3; axis++) {
            reach = fmax(reach, fabs(corners[i][axis]));
        }
    }
    memset(out, 0, sizeof *out);
    static const double quanta[3] = {0x1p16 - 1.0, 0x1p24 - 1.0, 0x1p24};
    const double *matrices[2] = {before, after};
    const int sizes[2] = {size_before, size_after};
    light_window windows[2];
    for (int k = 0; k < 2; k++) {
        const csm_status status =
            light_window_make(matrices[k], sizes[k], camera->eye, reach, &windows[k], err);
        if (status != CSM_OK) {
            return status;
        }
        double centre[3], g[2][3];
        light_window_centre(&windows[k], centre);
        light_window_gradients(&windows[k], centre, g);
        for (int axis = 0; axis < 2; axis++) {
            out->texel_size[k][axis] = 1.0 / sqrt(vec3_dot(g[axis], g[axis]));
        }
        out->rounding_texels += windows[k].rounding_texels;
        out->rounding_depth += windows[k].rounding_depth;
    }
    for (int i = 0; i < CSM_CORNER_COUNT; i++) {
        double texels[2][2], clip[2][4];
        if (!light_window_texel(&windows[0], corners[i], texels[0]) ||
            !light_window_texel(&windows[1], corners[i], texels[1])) {
            continue;
        }
        for (int axis = 0; axis < 2; axis++) {
            out->texels = fmax(out->texels, from_whole(texels[1][axis] - texels[0][axis]));
        }
        for (int k = 0; k < 2; k++) {
            light_window_clip(&windows[k], corners[i], clip[k]);
        }
        const double depth =
            clip[1][WINDOW_Z] / clip[1][WINDOW_W] - clip[0][WINDOW_Z] / clip[0][WINDOW_W];
        const double metres =
            clip[1][WINDOW_Z] / windows[1].depth_slope - clip[0][WINDOW_Z] / windows[0].depth_slope;
        out->depth = fmax(out->depth, fabs(metres));
        for (int k = 0; k < 3; k++) {
            out->depth_quanta[k] = fmax(out->depth_quanta[k], from_whole(quanta[k] * depth));
        }
    }
    return CSM_OK;
}
