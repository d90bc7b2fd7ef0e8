/* cascades.c: places every cascade: range, light, then a window and its matrices per slice.
 *
 * In: camera, direction to the light, settings, bounds of the scene, what is seen of it. Out:
 * splits, matrices, texel sizes, lattice and depth ranges. The steps are declared in placement.h;
 * the formulas: docs/numerics.md 2 to 8.
 */
#include "placement.h"

#include <limits.h>

#include "frustum.h"
#include "linalg.h"

csm_hold csm_hold_none(void) {
    csm_hold hold = {.range_step = INT_MIN,
                     .near_step = INT_MIN,
                     .far_step = INT_MIN,
                     .light_basis = INT_MIN,
                     .stretch_step = INT_MIN};
    for (int i = 0; i < CSM_MAX_CASCADES; i++) {
        hold.cut_step[i] = INT_MIN;
        hold.span_step[i] = INT_MIN;
        for (int axis = 0; axis < 2; axis++) {
            hold.window_step[i][axis] = hold.level[i][axis] = INT_MIN;
        }
    }
    return hold;
}

int csm_window_padding(const csm_settings *settings, double stretch) {
    const double offset = stretch * csm_settings_bias(settings).normal_offset_texels;
    return csm_settings_kernel_radius(settings) + (int)ceil(fmin(fabs(offset), 65536.0));
}

/* Points, relative to the eye in world axes, whose hull a warped map must hold: the slice, or the
 * part of it in the slab where the fit holds less than the slice. */
static int body_points(const csm_cascades_desc *desc, int i, const csm_cascades *cascades,
                       const csm_slab *slab, double (*out)[3]) {
    const int fit = desc->settings->effects[CSM_EFFECT_FIT];
    const double near_depth = cascades->splits[fit == CSM_FIT_SCENE ? 0 : i];
    const double far_depth = cascades->splits[i + 1];
    const double *light = cascades->light_from_world[i];
    csm_camera camera = desc->camera;
    if (fit == CSM_FIT_VISIBLE || fit == CSM_FIT_CLIPPED || fit == CSM_FIT_FOCUS) {
        /* seen from light space, where the slab lies along the axes */
        mat4_rotate(light, desc->camera.eye, camera.eye);
        mat4_rotate(light, desc->camera.right, camera.right);
        mat4_rotate(light, desc->camera.up, camera.up);
        mat4_rotate(light, desc->camera.backward, camera.backward);
        double bounds[6];
        for (int axis = 0; axis < 3; axis++) {
            bounds[axis] = slab->centre[axis] - slab->half[axis];
            bounds[axis + 3] = slab->centre[axis] + slab->half[axis];
        }
        const int count = csm_frustum_clip_box(&camera, near_depth, far_depth, bounds, out);
        for (int k = 0; k < count; k++) {
            double point[3] = {0.0};
            for (int axis = 0; axis < 3; axis++) {
                for (int row = 0; row < 3; row++) {
                    point[axis] += light[4 * axis + row] * out[k][row];
                }
            }
            memcpy(out[k], point, sizeof point);
        }
        if (count > 0) {
            return count;
        }
        camera = desc->camera; /* nothing there: any window will do */
    }
    memset(camera.eye, 0, sizeof camera.eye);
    csm_frustum_corners(&camera, near_depth, far_depth, out);
    return CSM_CORNER_COUNT;
}

/* The window of a cascade under a warp: basis, texel size, and clip_from_light but for its depth.
 */
static csm_status warp_cascade(const csm_cascades_desc *desc, int i, csm_slab *slab,
                               double out_corner[2], double out_sides[2], csm_cascades *out,
                               csm_error *err) {
    double points[CSM_CLIP_MAX][3], eye_ls[3];
    const csm_settings *settings = desc->settings;
    csm_warp *warp = &out->warp[i];
    const int count = body_points(desc, i, out, slab, points);
    const csm_status status =
        csm_warp_make(settings->effects[CSM_EFFECT_WARP], &desc->camera, out->light_from_world[i],
                      (const double(*)[3])points, count, settings->map_size[i],
                      csm_window_padding(settings, 1.0), warp, err);
    if (status != CSM_OK) {
        return status;
    }
    memcpy(out->light_from_world[i], warp->light_from_world, sizeof out->light_from_world[i]);
    mat4_rotate(warp->light_from_world, desc->camera.eye, eye_ls);
    double local_from_light[16];
    memset(local_from_light, 0, sizeof local_from_light);
    for (int axis = 0; axis < 2; axis++) {
        local_from_light[5 * axis] = 1.0 / warp->extent[axis];
        local_from_light[12 + axis] = -(eye_ls[axis] + warp->origin[axis]) / warp->extent[axis];
    }
    local_from_light[15] = 1.0;
    mat4_mul(warp->clip_from_local, local_from_light, out->clip_from_light[i]);
    double centre[2], window[4], largest;
    csm_warp_unproject(out->clip_from_light[i], (const double[2]){0.0, 0.0}, out->map_size[i],
                       centre, out->texel_size[i]);
    csm_cascade_window(out, i, window, &largest);
    for (int axis = 0; axis < 2; axis++) {
        slab->centre[axis] = 0.5 * (window[axis] + window[axis + 2]);
        slab->half[axis] = 0.5 * (window[axis + 2] - window[axis]);
        out_corner[axis] = window[axis];
        out_sides[axis] = window[axis + 2] - window[axis];
    }
    return CSM_OK;
}

/* The window of any other cascade: texel size and lattice. */
static csm_status snap_cascade(const csm_cascades_desc *desc, int i, const csm_slab *slab,
                               double out_corner[2], double out_sides[2], csm_cascades *out,
                               csm_error *err) {
    const int map_size = out->map_size[i];
    csm_window window;
    memcpy(window.centre, slab->centre, sizeof window.centre);
    memcpy(window.half_extent, slab->half, sizeof window.half_extent);
    const int padding = csm_window_padding(desc->settings, out->stretch);
    csm_status status = csm_snap_sizes(desc, out, i, padding, &window, err);
    if (status == CSM_OK) {
        status =
            csm_snap_window(&window, map_size, padding, desc->settings->effects[CSM_EFFECT_SNAP],
                            out_corner, out->texel_size[i], out->lattice[i], err);
    }
    out_sides[0] = map_size * out->texel_size[i][0];
    out_sides[1] = map_size * out->texel_size[i][1];
    return status;
}

static csm_status fit_cascade(const csm_cascades_desc *desc, const csm_rectangle *rectangles, int i,
                              csm_cascades *out, csm_error *err) {
    csm_slab slice;
    csm_status status = csm_fit_slab(desc, rectangles, out, i, &slice, err);
    if (status != CSM_OK) {
        return status;
    }
    const bool warped = desc->settings->effects[CSM_EFFECT_WARP] != CSM_WARP_NONE;
    double corner[2], sides[2], depth, span;
    out->map_size[i] = desc->settings->map_size[i];
    status = warped ? warp_cascade(desc, i, &slice, corner, sides, out, err)
                    : snap_cascade(desc, i, &slice, corner, sides, out, err);
    if (status != CSM_OK) {
        return status;
    }
    const double *light_from_world = out->light_from_world[i];
    csm_choose_depth_range(desc, out, i, &slice, corner, sides, &depth, &span);
    if (warped) {
        out->clip_from_light[i][10] = -1.0 / span;
        out->clip_from_light[i][14] = -depth / span;
    } else {
        ortho_rh_zo(corner, sides, depth, span, out->clip_from_light[i]);
    }
    mat4_mul(out->clip_from_light[i], light_from_world, out->clip_from_world[i]);
    static const double uvz_from_clip[16] = {0.5, 0, 0, 0, 0,   0.5, 0, 0,
                                             0,   0, 1, 0, 0.5, 0.5, 0, 1};
    mat4_mul(uvz_from_clip, out->clip_from_world[i], out->uvz_from_world[i]);
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
    out->pancake = settings.effects[CSM_EFFECT_PANCAKE];
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
    csm_cascades_desc copy = canonical(desc, &settings);
    csm_receivers turned;
    if (status == CSM_OK && settings.effects[CSM_EFFECT_TURNED] && copy.receivers &&
        !copy.receivers->turned) {
        turned = *copy.receivers;
        status = csm_receivers_turns(&copy, out, turned.turns, err);
        copy.receivers = &turned;
    }
    csm_rectangle rectangles[CSM_MAX_CASCADES];
    if (status == CSM_OK && settings.effects[CSM_EFFECT_FIT] == CSM_FIT_VISIBLE && copy.receivers) {
        csm_receivers_enclose(&copy, out, rectangles);
    }
    for (int i = 0; status == CSM_OK && i < out->count; i++) {
        status = fit_cascade(&copy, rectangles, i, out, err);
    }
    return status;
}
