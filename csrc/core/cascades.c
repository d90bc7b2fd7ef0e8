/* cascades.c: places every cascade: range, light, then a window and its matrices per slice.
 *
 * In: camera, direction to the light, settings, bounds of the scene, what is seen of it. Out:
 * splits, matrices, texel sizes, lattice and depth ranges. The steps are declared in placement.h;
 * the formulas: docs/numerics.md 2 to 8.
 */
#include "placement.h"

#include <limits.h>

#include "linalg.h"

csm_hold csm_hold_none(void) {
    csm_hold hold = {.range_step = INT_MIN, .near_step = INT_MIN, .far_step = INT_MIN};
    for (int i = 0; i < CSM_MAX_CASCADES; i++) {
        for (int axis = 0; axis < 2; axis++) {
            hold.window_step[i][axis] = hold.level[i][axis] = INT_MIN;
        }
    }
    return hold;
}

int csm_window_padding(const csm_settings *settings) {
    const double offset = csm_settings_bias(settings).normal_offset_texels;
    return csm_settings_kernel_radius(settings) + (int)ceil(fmin(fabs(offset), 65536.0));
}

static csm_status fit_cascade(const csm_cascades_desc *desc, int i, csm_cascades *out,
                              csm_error *err) {
    csm_slab slice;
    csm_status status = csm_fit_slab(desc, out, i, &slice, err);
    if (status != CSM_OK) {
        return status;
    }
    const int map_size = desc->settings->map_size[i];
    csm_window window;
    memcpy(window.centre, slice.centre, sizeof window.centre);
    memcpy(window.half_extent, slice.half, sizeof window.half_extent);
    double corner[2];
    status = csm_snap_window(&window, map_size, csm_window_padding(desc->settings),
                             desc->settings->effects[CSM_EFFECT_SNAP], corner, out->texel_size[i],
                             out->lattice[i], err);
    if (status != CSM_OK) {
        return status;
    }
    const double *light_from_world = out->light_from_world[i];
    const double sides[2] = {map_size * out->texel_size[i][0], map_size * out->texel_size[i][1]};
    double depth, span;
    csm_choose_depth_range(desc, light_from_world, &slice, corner, sides, &depth, &span);

    ortho_rh_zo(corner, sides, depth, span, out->clip_from_light[i]);
    mat4_mul(out->clip_from_light[i], light_from_world, out->clip_from_world[i]);
    static const double uvz_from_clip[16] = {0.5, 0, 0, 0, 0,   0.5, 0, 0,
                                             0,   0, 1, 0, 0.5, 0.5, 0, 1};
    mat4_mul(uvz_from_clip, out->clip_from_world[i], out->uvz_from_world[i]);
    out->map_size[i] = map_size;
    out->depth_range[i][0] = depth;
    out->depth_range[i][1] = depth + span;
    return CSM_OK;
}

static csm_status check_bounds(const double bounds[6], csm_error *err) {
    for (int axis = 0; axis < 3; axis++) {
        const double low = bounds[axis], high = bounds[axis + 3];
        if (!isfinite(low) || !isfinite(high) || !(low <= high)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "scene bounds must be finite with min <= max (got %g to %g along %c)",
                            low, high, "xyz"[axis]);
        }
    }
    return CSM_OK;
}

/* A copy of desc whose settings say nothing that others make meaningless. */
static csm_cascades_desc canonical(const csm_cascades_desc *desc, csm_settings *settings) {
    csm_cascades_desc copy = *desc;
    *settings = *desc->settings;
    csm_settings_canonical_placement(settings);
    copy.settings = settings;
    return copy;
}

csm_status csm_cascades_place(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err) {
    memset(out, 0, sizeof *out);
    out->hold = csm_hold_none();
    csm_settings settings;
    csm_status status = csm_settings_validate(desc->settings, err);
    if (status == CSM_OK) {
        status = csm_camera_validate(&desc->camera, err);
    }
    if (status == CSM_OK && desc->scene_bounds) {
        status = check_bounds(desc->scene_bounds, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    const csm_cascades_desc copy = canonical(desc, &settings);
    out->count = settings.effects[CSM_EFFECT_CASCADE_COUNT];
    out->bounded = desc->scene_bounds != NULL;
    if (out->bounded) {
        memcpy(out->bounds, desc->scene_bounds, sizeof out->bounds);
    }
    status = csm_place_light(&copy, out, err);
    return status == CSM_OK ? csm_place_splits(&copy, out, err) : status;
}

csm_status csm_cascades_fit(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err) {
    csm_settings settings;
    csm_status status = csm_cascades_place(desc, out, err);
    const csm_cascades_desc copy = canonical(desc, &settings);
    for (int i = 0; status == CSM_OK && i < out->count; i++) {
        status = fit_cascade(&copy, i, out, err);
    }
    return status;
}
