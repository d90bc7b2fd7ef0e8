/* clipped.c: windows round what a slice of the view can hold of the scene.
 *
 * In: a slice, bounds of the scene, bounds of its parts. Out: a box in light space round the slice
 * cut to the scene's bounds (Stone 2012, "Cascaded perspective variance shadow mapping"), for fit =
 * focus cut further to the parts that meet the slice. docs/numerics.md 20.
 */
#include "placement.h"

#include "frustum.h"
#include "hull.h"
#include "linalg.h"

/* Round the part of the slice inside bounds. */
static csm_rectangle round_slice(const csm_camera *camera, const double light_from_world[16],
                                 double near_depth, double far_depth, const double bounds[6]) {
    double points[CSM_CLIP_MAX][3];
    const int count = csm_frustum_clip_box(camera, near_depth, far_depth, bounds, points);
    csm_rectangle out = csm_rectangle_nothing();
    for (int i = 0; i < count; i++) {
        double point_ls[3];
        mat4_rotate(light_from_world, points[i], point_ls);
        csm_rectangle_grow(&out, point_ls, point_ls);
    }
    return out;
}

/* Round what the parts that meet the slice have in the rectangle within. Whatever throws a shadow
 * that is seen stands over one of them: casters outside are drawn, but need no texels of their
 * own. */
static csm_rectangle round_parts(const csm_cascades_desc *desc, const double light_from_world[16],
                                 double near_depth, double far_depth, double margin,
                                 const csm_rectangle *within) {
    const csm_camera *camera = &desc->camera;
    const double *m = light_from_world;
    double planes[CSM_PLANE_COUNT][4];
    csm_camera at_origin = *camera;
    memset(at_origin.eye, 0, sizeof at_origin.eye);
    csm_frustum_planes(&at_origin, near_depth, far_depth, planes);
    csm_rectangle out = csm_rectangle_nothing();
    for (size_t i = 0; i < desc->box_count; i++) {
        const double *box = (const double *)((const char *)desc->boxes + i * desc->box_stride);
        if (!csm_planes_meet_box((const double(*)[4])planes, camera->eye, box, margin)) {
            continue;
        }
        double from_eye[3], centre[3], low[2], high[2];
        for (int axis = 0; axis < 3; axis++) {
            from_eye[axis] = 0.5 * (box[axis] + box[axis + 3]) - camera->eye[axis];
        }
        mat4_rotate(m, from_eye, centre);
        for (int axis = 0; axis < 2; axis++) {
            double reach = margin;
            for (int side = 0; side < 3; side++) {
                reach += fabs(m[4 * side + axis]) * 0.5 * (box[side + 3] - box[side]);
            }
            low[axis] = fmax(centre[axis] - reach, within->low[axis]);
            high[axis] = fmin(centre[axis] + reach, within->high[axis]);
        }
        if (low[0] <= high[0] && low[1] <= high[1]) {
            csm_rectangle_grow(&out, low, high);
        }
    }
    return out;
}

void csm_fit_clipped(const csm_cascades_desc *desc, csm_cascades *out, int i, csm_slab *slab) {
    const double *basis = out->light_from_world[i];
    const double near_depth = out->splits[i], far_depth = out->splits[i + 1];
    *slab = csm_slice_bounds(&desc->camera, basis, near_depth, far_depth);
    if (!desc->scene_bounds) {
        return;
    }
    const double rounding = out->stretch * box_rounding(desc->scene_bounds);
    double bounds[6], eye_ls[3];
    box_widen(desc->scene_bounds, rounding, bounds);
    csm_rectangle held = round_slice(&desc->camera, basis, near_depth, far_depth, bounds);
    if (desc->settings->effects[CSM_EFFECT_FIT] == CSM_FIT_FOCUS && desc->boxes) {
        const csm_rectangle parts =
            round_parts(desc, basis, near_depth, far_depth, rounding, &held);
        held = parts.low[0] <= parts.high[0] ? parts : held;
    }
    if (held.low[0] > held.high[0]) {
        return; /* nothing is there: the slice's own window will do */
    }
    mat4_rotate(basis, desc->camera.eye, eye_ls);
    for (int axis = 0; axis < 2; axis++) {
        /* No texel finer than the rounding of positions; a scene may be seen edge-on. */
        const double least = 0.5 * desc->settings->map_size[i] * rounding + 1e-30;
        const double half = fmax(0.5 * (held.high[axis] - held.low[axis]) + rounding, least);
        slab->centre[axis] = eye_ls[axis] + 0.5 * (held.low[axis] + held.high[axis]);
        slab->half[axis] = csm_settle_half(desc, i, axis, half, out);
    }
}
