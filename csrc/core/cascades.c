/* cascades.c: fits a light window to each slice of the view.
 *
 * In: camera, direction to the light, settings, bounds of the scene. Out: splits, matrices, texel
 * sizes, lattice and depth ranges. The formulas: docs/numerics.md 2 to 8. A radius comes from
 * tangents and depths alone, never from transformed corners: jitter in its last bit would move
 * the texel grid by a fraction of a texel far from the world origin.
 */
#include "csm.h"

#include <limits.h>

#include "linalg.h"

/* What a window must hold, in light space: x, y, z [m]. */
typedef struct slab {
    double centre[3], half[3];
} slab;

void csm_fit_sphere(const csm_camera *camera, double near_depth, double far_depth,
                    double *out_centre_depth, double *out_radius) {
    const double n = near_depth, f = far_depth;
    const double k = hypot(camera->half_width, camera->half_height);
    if (camera->orthographic) {
        *out_centre_depth = n + 0.5 * (f - n);
        *out_radius = hypot(k, 0.5 * (f - n));
        return;
    }
    const double k2 = k * k;
    if (k2 * (f + n) >= f - n) {
        /* So wide that the far corners alone decide: centred on the far plane. */
        *out_centre_depth = f;
        *out_radius = k * f;
        return;
    }
    *out_centre_depth = 0.5 * (n + f) * (1.0 + k2);
    *out_radius = hypot(f - *out_centre_depth, k * f);
}

double csm_fit_diameter(const csm_camera *camera, double near_depth, double far_depth) {
    const double length = far_depth - near_depth;
    const double k = hypot(camera->half_width, camera->half_height);
    if (camera->orthographic) {
        return hypot(2.0 * k, length);
    }
    return fmax(2.0 * k * far_depth, hypot(length, k * (far_depth + near_depth)));
}

/* Light-space box of a slice. Taken relative to the eye, so that its sides depend on the camera's
 * orientation alone and stay equal to the last bit while it only moves. */
static slab slice_bounds(const csm_camera *camera, const double light_from_world[16],
                         double near_depth, double far_depth) {
    csm_camera at_origin = *camera;
    memset(at_origin.eye, 0, sizeof at_origin.eye);
    double corners[CSM_CORNER_COUNT][3];
    csm_frustum_corners(&at_origin, near_depth, far_depth, corners);

    double low[3] = {INFINITY, INFINITY, INFINITY};
    double high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int i = 0; i < CSM_CORNER_COUNT; i++) {
        double corner_ls[3];
        mat4_rotate(light_from_world, corners[i], corner_ls);
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = fmin(low[axis], corner_ls[axis]);
            high[axis] = fmax(high[axis], corner_ls[axis]);
        }
    }
    double eye_ls[3];
    mat4_rotate(light_from_world, camera->eye, eye_ls);
    slab out;
    for (int axis = 0; axis < 3; axis++) {
        out.half[axis] = 0.5 * (high[axis] - low[axis]);
        out.centre[axis] = eye_ls[axis] + 0.5 * (low[axis] + high[axis]);
    }
    return out;
}

static slab fit_slice(const csm_camera *camera, const double light_from_world[16], int fit,
                      double near_depth, double far_depth) {
    if (fit != CSM_FIT_SPHERE) {
        slab out = slice_bounds(camera, light_from_world, near_depth, far_depth);
        if (fit == CSM_FIT_DIAMETER) {
            /* No side of a box round the slice exceeds its diameter (docs/numerics.md 5). */
            const double half = 0.5 * csm_fit_diameter(camera, near_depth, far_depth);
            out.half[0] = out.half[1] = out.half[2] = half;
        }
        return out;
    }
    double centre_depth, radius, centre[3];
    csm_fit_sphere(camera, near_depth, far_depth, &centre_depth, &radius);
    for (int axis = 0; axis < 3; axis++) {
        centre[axis] = camera->eye[axis] - camera->backward[axis] * centre_depth;
    }
    slab out = {.half = {radius, radius, radius}};
    mat4_rotate(light_from_world, centre, out.centre);
    return out;
}

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
        const double far_depth =
            csm_range_round_up(camera->near_depth, depth, desc->held_range_step, out_step);
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
    const int scheme = settings->effects[CSM_EFFECT_SPLIT];
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

/* Depth range that holds the whole scene: it depends on nothing that moves with the camera, so the
 * stored depth of a static point is the same in every frame. */
static void scene_depth_range(const double bounds[6], const double light_from_world[16],
                              double *out_near, double *out_span) {
    double centre = 0.0, half = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double to_light = light_from_world[4 * axis + 2];
        centre += to_light * 0.5 * (bounds[axis] + bounds[axis + 3]);
        half += fabs(to_light) * 0.5 * (bounds[axis + 3] - bounds[axis]);
    }
    /* Nothing may touch the ends, where it would be clipped, and a scene seen edge-on has a range
     * too: the last term is for a scene that is one point at the origin. */
    half += 1e-6 * half + box_rounding(bounds) + 1e-30;
    *out_near = -centre - half;
    *out_span = 2.0 * half;
}

/* Depth range that moves with a slice. Its span is constant where the slab's is, and near lies on a
 * lattice of 1/255 of the span: 255 divides 2^16 - 1 and 2^24 - 1, so that near moves by whole
 * quanta of either format and a static point keeps its decoded depth (docs/numerics.md 8). */
static void slice_depth_range(const slab *slice, double margin, bool towards_light, int snap,
                              double *out_near, double *out_span) {
    const double half = slice->half[2] * (1.0 + 1e-6) + margin;
    double near_depth = -slice->centre[2] - half;
    double span = 2.0 * half;
    if (towards_light) {
        near_depth -= span;
        span *= 2.0;
    }
    if (snap == CSM_SNAP_EXACT) {
        span *= 255.0 / 254.0;
        const double step = span / 255.0;
        near_depth = floor(near_depth / step) * step;
    }
    *out_near = near_depth;
    *out_span = span;
}

static void choose_depth_range(const csm_cascades_desc *desc, const double light_from_world[16],
                               const slab *slice, double *out_near, double *out_span) {
    const int *effects = desc->settings->effects;
    if (!desc->scene_bounds) {
        const double margin =
            0x1p-44 * (fabs(slice->centre[2]) + slice->half[2] + desc->camera.far_depth);
        slice_depth_range(slice, margin, true, effects[CSM_EFFECT_SNAP], out_near, out_span);
        return;
    }
    scene_depth_range(desc->scene_bounds, light_from_world, out_near, out_span);
    if (effects[CSM_EFFECT_PANCAKE]) {
        double near_depth, span;
        slice_depth_range(slice, box_rounding(desc->scene_bounds), false, effects[CSM_EFFECT_SNAP],
                          &near_depth, &span);
        /* The spans decide, not the ends: a choice that moves with the camera would change the
         * quantum from frame to frame. */
        if (span < *out_span) {
            *out_near = near_depth;
            *out_span = span;
        }
    }
}

static csm_status fit_cascade(const csm_cascades_desc *desc, const double light_from_world[16],
                              int i, csm_cascades *out, csm_error *err) {
    const int *effects = desc->settings->effects;
    const int fit = effects[CSM_EFFECT_FIT];
    const double near_depth = fit == CSM_FIT_SCENE ? out->splits[0] : out->splits[i];
    const slab slice =
        fit_slice(&desc->camera, light_from_world, fit, near_depth, out->splits[i + 1]);

    const int map_size = desc->settings->map_size[i];
    csm_window window;
    memcpy(window.centre, slice.centre, sizeof window.centre);
    memcpy(window.half_extent, slice.half, sizeof window.half_extent);
    double corner[2];
    const csm_status status =
        csm_snap_window(&window, map_size, csm_settings_kernel_radius(desc->settings),
                        effects[CSM_EFFECT_SNAP], corner, out->texel_size[i], out->lattice[i], err);
    if (status != CSM_OK) {
        return status;
    }
    double depth, span;
    choose_depth_range(desc, light_from_world, &slice, &depth, &span);

    const double sides[2] = {map_size * out->texel_size[i][0], map_size * out->texel_size[i][1]};
    ortho_rh_zo(corner, sides, depth, span, out->clip_from_light[i]);
    memcpy(out->light_from_world[i], light_from_world, sizeof out->light_from_world[i]);
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

csm_status csm_cascades_fit(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err) {
    memset(out, 0, sizeof *out);
    double light_from_world[16], far_depth;
    csm_status status = csm_settings_validate(desc->settings, err);
    if (status == CSM_OK) {
        status = csm_camera_validate(&desc->camera, err);
    }
    if (status == CSM_OK && desc->scene_bounds) {
        status = check_bounds(desc->scene_bounds, err);
    }
    if (status == CSM_OK) {
        status = csm_light_basis_orthonormal(desc->to_light, light_from_world, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    cut_range(desc, &far_depth, &out->range_step);
    status = place_splits(desc, far_depth, out->splits, err);
    out->count = desc->settings->effects[CSM_EFFECT_CASCADE_COUNT];
    out->bounded = desc->scene_bounds != NULL;
    if (out->bounded) {
        memcpy(out->bounds, desc->scene_bounds, sizeof out->bounds);
    }
    for (int i = 0; status == CSM_OK && i < out->count; i++) {
        status = fit_cascade(desc, light_from_world, i, out, err);
    }
    return status;
}
