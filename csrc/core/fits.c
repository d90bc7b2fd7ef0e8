/* fits.c: what the window of a cascade must hold of its slice of the view.
 *
 * In: camera, splits, axes of light space. Out: a box in light space. The formulas:
 * docs/numerics.md 3 to 5 and 20.
 */
#include "placement.h"

#include "linalg.h"

double csm_fit_diameter(const csm_camera *camera, double near_depth, double far_depth) {
    const double length = far_depth - near_depth;
    const double k = hypot(camera->half_width, camera->half_height);
    if (camera->orthographic) {
        return hypot(2.0 * k, length);
    }
    if (camera->centre[0] == 0.0 && camera->centre[1] == 0.0) {
        return fmax(2.0 * k * far_depth, hypot(length, k * (far_depth + near_depth)));
    }
    /* From the inner near corner to the outer far one. */
    const double across =
        fabs(camera->centre[0]) * length + camera->half_width * (far_depth + near_depth);
    const double along =
        fabs(camera->centre[1]) * length + camera->half_height * (far_depth + near_depth);
    return fmax(2.0 * k * far_depth, hypot(length, hypot(across, along)));
}

/* Light-space box of a slice. Taken relative to the eye, so that its sides depend on the camera's
 * orientation alone and stay equal to the last bit while it only moves. */
csm_slab csm_slice_bounds(const csm_camera *camera, const double light_from_world[16],
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
    csm_slab out;
    for (int axis = 0; axis < 3; axis++) {
        out.half[axis] = 0.5 * (high[axis] - low[axis]);
        out.centre[axis] = eye_ls[axis] + 0.5 * (low[axis] + high[axis]);
    }
    return out;
}

static csm_slab ball_slab(const csm_camera *camera, const double light_from_world[16],
                          double stretch, const csm_ball *ball) {
    double centre[3];
    const double half = stretch * ball->radius; /* a world length takes up to so much */
    for (int axis = 0; axis < 3; axis++) {
        centre[axis] = camera->eye[axis] + camera->right[axis] * ball->centre[0] +
                       camera->up[axis] * ball->centre[1] -
                       camera->backward[axis] * ball->centre[2];
    }
    csm_slab out = {.half = {half, half, half}};
    mat4_rotate(light_from_world, centre, out.centre);
    return out;
}

csm_status csm_fit_slab(const csm_cascades_desc *desc, const csm_rectangle *rectangles,
                        csm_cascades *out, int i, csm_slab *slab, csm_error *err) {
    const csm_camera *camera = &desc->camera;
    const double *basis = out->light_from_world[i];
    const double near_depth = out->splits[i], far_depth = out->splits[i + 1];
    csm_ball balls[CSM_MAX_CASCADES];
    out->served_from[i] = near_depth;
    switch (desc->settings->effects[CSM_EFFECT_FIT]) {
    case CSM_FIT_VISIBLE:
        return csm_fit_visible(desc, rectangles, out, i, slab, err);
    case CSM_FIT_CLIPPED:
    case CSM_FIT_FOCUS:
        csm_fit_clipped(desc, out, i, slab);
        return CSM_OK;
    case CSM_FIT_SPHERE:
        csm_fit_sphere(camera, near_depth, far_depth, balls);
        *slab = ball_slab(camera, basis, out->stretch, balls);
        return CSM_OK;
    case CSM_FIT_SHIFTED:
        csm_fit_shifted_chain(camera, out->splits, out->count, balls);
        *slab = ball_slab(camera, basis, out->stretch, &balls[i]);
        out->served_from[i] = i > 0 ? balls[i - 1].whole[1] : near_depth;
        return CSM_OK;
    case CSM_FIT_SCENE:
        *slab = csm_slice_bounds(camera, basis, out->splits[0], far_depth);
        return CSM_OK;
    default:
        *slab = csm_slice_bounds(camera, basis, near_depth, far_depth);
        break;
    }
    if (desc->settings->effects[CSM_EFFECT_FIT] == CSM_FIT_DIAMETER) {
        /* No side of a box round the slice exceeds its diameter (docs/numerics.md 5). */
        const double half = out->stretch * 0.5 * csm_fit_diameter(camera, near_depth, far_depth);
        slab->half[0] = slab->half[1] = slab->half[2] = half;
    }
    return CSM_OK;
}
