/* fits.c: what the window of a cascade must hold of its slice of the view.
 *
 * In: camera, splits, axes of light space. Out: a box in light space. A radius comes from tangents
 * and depths alone, never from transformed corners: jitter in its last bit would move the texel
 * grid by a fraction of a texel far from the world origin. The formulas: docs/numerics.md 3 to 5.
 */
#include "placement.h"

#include "linalg.h"

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

static csm_slab fit_slice(const csm_camera *camera, const double light_from_world[16], int fit,
                          double near_depth, double far_depth) {
    if (fit != CSM_FIT_SPHERE) {
        csm_slab out = csm_slice_bounds(camera, light_from_world, near_depth, far_depth);
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
    csm_slab out = {.half = {radius, radius, radius}};
    mat4_rotate(light_from_world, centre, out.centre);
    return out;
}

csm_status csm_fit_slab(const csm_cascades_desc *desc, csm_cascades *out, int i, csm_slab *slab,
                        csm_error *err) {
    const int fit = desc->settings->effects[CSM_EFFECT_FIT];
    if (fit == CSM_FIT_VISIBLE) {
        return csm_fit_visible(desc, out, i, slab, err);
    }
    const double near_depth = fit == CSM_FIT_SCENE ? out->splits[0] : out->splits[i];
    *slab = fit_slice(&desc->camera, out->light_from_world[i], fit, near_depth, out->splits[i + 1]);
    return CSM_OK;
}
