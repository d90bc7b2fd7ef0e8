/* depth_range.c: near and far of a shadow map, light-view depths [m] (docs/numerics.md 8). */
#include "placement.h"

#include "linalg.h"

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
static void slice_depth_range(const csm_slab *slice, double margin, bool towards_light, int snap,
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

void csm_choose_depth_range(const csm_cascades_desc *desc, const double light_from_world[16],
                            const csm_slab *slice, const double corner[2], const double sides[2],
                            double *out_near, double *out_span) {
    (void)corner;
    (void)sides;
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
