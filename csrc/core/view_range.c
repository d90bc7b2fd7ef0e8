/* view_range.c: the range of view depths that has shadows, and its cuts.
 *
 * In: camera, settings, bounds of the scene. Out: ascending view depths [m]. docs/numerics.md 1, 2.
 */
#include "placement.h"

#include <limits.h>

#include "linalg.h"

/* far of the view range, cut to the scene and rounded up, so that it, and with it every texel size,
 * stays constant while the camera moves. An orthographic camera whose near is not positive has no
 * ratio to round by: its far is cut only. */
static void cut_range(const csm_cascades_desc *desc, double *out_far, int *out_step) {
    const csm_camera *camera = &desc->camera;
    const csm_settings *settings = desc->settings;
    *out_far = camera->far_depth;
    *out_step = INT_MIN;
    if (!desc->scene_bounds || settings->effects[CSM_EFFECT_VIEW_RANGE] != CSM_VIEW_RANGE_SCENE) {
        return;
    }
    double bounds[6], depth;
    box_widen(desc->scene_bounds, box_rounding(desc->scene_bounds), bounds);
    if (!csm_frustum_depth_of_box(camera, bounds, &depth)) {
        depth = camera->near_depth; /* nothing to see: the smallest range that is one */
    }
    const int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    if (settings->effects[CSM_EFFECT_SPLIT] == CSM_SPLIT_MANUAL && count > 1) {
        depth = fmax(depth, nextafter(settings->manual_splits[count - 2], INFINITY));
    }
    if (camera->near_depth > 0.0) {
        const double far_depth = csm_range_round_up(
            camera->near_depth, depth, desc->held ? desc->held->range_step : INT_MIN, out_step);
        *out_far = fmin(*out_far, far_depth);
    } else if (depth > camera->near_depth) {
        *out_far = fmin(*out_far, depth);
    }
}

static csm_status place_splits(const csm_cascades_desc *desc, double far_depth, double *out_splits,
                               csm_error *err) {
    const csm_settings *settings = desc->settings;
    const double near_depth = desc->camera.near_depth;
    const int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    /* one cascade has nothing to cut, so no scheme to ask for a positive near */
    const int scheme = count == 1 ? CSM_SPLIT_UNIFORM : settings->effects[CSM_EFFECT_SPLIT];
    if (scheme != CSM_SPLIT_MANUAL) {
        return csm_splits_compute(near_depth, far_depth, count, scheme, settings->lam, out_splits,
                                  err);
    }
    out_splits[0] = near_depth;
    out_splits[count] = far_depth;
    for (int i = 1; i < count; i++) {
        out_splits[i] = settings->manual_splits[i - 1];
        if (!(out_splits[i] > out_splits[i - 1]) || !(out_splits[i] < far_depth)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "manual_splits must ascend between the camera's near %g and far %g "
                            "(got %g after %g)",
                            near_depth, desc->camera.far_depth, out_splits[i], out_splits[i - 1]);
        }
    }
    return CSM_OK;
}

csm_status csm_place_splits(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err) {
    double far_depth;
    cut_range(desc, &far_depth, &out->range_step);
    out->hold.range_step = out->range_step;
    return place_splits(desc, far_depth, out->splits, err);
}
