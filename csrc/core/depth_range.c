/* depth_range.c: near and far of a shadow map, light-view depths [m] (docs/numerics.md 8 and 19).
 *
 * In: bounds of the scene, the window, what it must hold of its slice. Out: the depth of z = 0 and
 * the span to z = 1. What moves with the camera is quantised, so that a static point keeps its
 * stored depth: the span to steps, near to whole depth quanta.
 */
#include "placement.h"

#include <limits.h>

#include "linalg.h"

/* Spans that change with the camera are 2^(k / 4) m: at most 19 % too long, 41 % while a held step
 * is kept. */
#define STEPS_PER_OCTAVE 4

/* Corners of a quadrilateral clipped by four lines. */
#define CLIPPED_MAX 8

/* Depth range that holds the whole scene: it depends on nothing that moves with the camera, so the
 * stored depth of a static point is the same in every frame. */
static void scene_depth_range(const double bounds[6], const double light_from_world[16],
                              double stretch, double *out_near, double *out_span) {
    double centre = 0.0, half = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double to_light = light_from_world[4 * axis + 2];
        centre += to_light * 0.5 * (bounds[axis] + bounds[axis + 3]);
        half += fabs(to_light) * 0.5 * (bounds[axis + 3] - bounds[axis]);
    }
    /* Nothing may touch the ends, where it would be clipped, and a scene seen edge-on has a range
     * too: the last term is for a scene that is one point at the origin. */
    half += 1e-6 * half + stretch * box_rounding(bounds) + 1e-30;
    *out_near = -centre - half;
    *out_span = 2.0 * half;
}

/* Near moves by 1 / this of the span. 255 divides 2^16 - 1 and 2^24 - 1, so that it moves by whole
 * quanta of either format; a float32 depth keeps its digits when a power of two is added. */
static double near_steps(const csm_settings *settings) {
    return settings->effects[CSM_EFFECT_DEPTH_FORMAT] == CSM_DEPTH_D32F ? 256.0 : 255.0;
}

/* The next span up, or the held one while it is one step too long. */
static double round_span(double span, int held, int *out_step) {
    int step = (int)ceil(STEPS_PER_OCTAVE * log2(span));
    while (exp2((double)step / STEPS_PER_OCTAVE) < span) {
        step++;
    }
    if (held == step + 1) {
        step = held;
    }
    *out_step = step;
    return exp2((double)step / STEPS_PER_OCTAVE);
}

/* A range of at least this span, near at or before this depth. A constant span stays what it is. */
static void quantise(const csm_cascades_desc *desc, csm_cascades *out, int i, bool constant,
                     double *near_depth, double *span) {
    const csm_settings *settings = desc->settings;
    if (settings->effects[CSM_EFFECT_SNAP] == CSM_SNAP_NONE) {
        return;
    }
    const double steps = near_steps(settings);
    *span *= steps / (steps - 1.0); /* one step pays for rounding near down */
    if (!constant) {
        const int held = desc->held ? desc->held->span_step[i] : INT_MIN;
        *span = round_span(*span, held, &out->hold.span_step[i]);
    }
    const double step = *span / steps;
    *near_depth = floor(*near_depth / step) * step;
}

/* Whether the depth of a slab depends on the camera's lens alone, not on where it looks. */
static bool constant_depth(int fit) {
    return fit == CSM_FIT_SPHERE || fit == CSM_FIT_DIAMETER || fit == CSM_FIT_SHIFTED;
}

static void slice_depth_range(const csm_cascades_desc *desc, csm_cascades *out, int i,
                              const csm_slab *slice, double margin, double *out_near,
                              double *out_span) {
    const double half = slice->half[2] * (1.0 + 1e-6) + margin;
    *out_near = -slice->centre[2] - half;
    *out_span = 2.0 * half;
    if (!desc->scene_bounds) {
        *out_near -= *out_span; /* room for casters that nobody knows of */
        *out_span *= 2.0;
    }
    quantise(desc, out, i, constant_depth(desc->settings->effects[CSM_EFFECT_FIT]), out_near,
             out_span);
}

/* One step of Sutherland and Hodgman: the part of a polygon where sign * (p[axis] - edge) >= 0. */
static int clip_half_plane(const double (*polygon)[3], int count, int axis, double sign,
                           double edge, double (*out)[3]) {
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const double *a = polygon[i], *b = polygon[(i + 1) % count];
        const double inside_a = sign * (a[axis] - edge), inside_b = sign * (b[axis] - edge);
        if (inside_a >= 0.0) {
            memcpy(out[kept++], a, sizeof out[0]);
        }
        if ((inside_a >= 0.0) != (inside_b >= 0.0)) {
            const double share = inside_a / (inside_a - inside_b);
            for (int k = 0; k < 3; k++) {
                out[kept][k] = a[k] + (b[k] - a[k]) * share;
            }
            kept++;
        }
    }
    return kept;
}

/* Least and largest light z of a box inside a window; false if they do not meet. Window and box
 * meet in a body whose every corner lies on a face of the box. */
static bool box_in_window(const double bounds[6], const double light_from_world[16],
                          const double low[2], const double high[2], double out_z[2]) {
    double corners[8][3];
    for (int i = 0; i < 8; i++) {
        const double corner[3] = {bounds[i & 1 ? 3 : 0], bounds[i & 2 ? 4 : 1],
                                  bounds[i & 4 ? 5 : 2]};
        mat4_rotate(light_from_world, corner, corners[i]);
    }
    out_z[0] = INFINITY;
    out_z[1] = -INFINITY;
    for (int face = 0; face < 6; face++) {
        const int across = 1 << face / 2, u = 1 << (face / 2 + 1) % 3, v = 1 << (face / 2 + 2) % 3;
        const int first = face % 2 ? across : 0;
        const int ring[4] = {first, first + u, first + u + v, first + v};
        double polygons[2][CLIPPED_MAX][3];
        int count = 4;
        for (int i = 0; i < count; i++) {
            memcpy(polygons[0][i], corners[ring[i]], sizeof polygons[0][i]);
        }
        for (int edge = 0; edge < 4 && count > 0; edge++) {
            const int axis = edge / 2;
            count = clip_half_plane((const double(*)[3])polygons[edge % 2], count, axis,
                                    edge % 2 ? -1.0 : 1.0, edge % 2 ? high[axis] : low[axis],
                                    polygons[(edge + 1) % 2]);
        }
        for (int i = 0; i < count; i++) {
            out_z[0] = fmin(out_z[0], polygons[0][i][2]);
            out_z[1] = fmax(out_z[1], polygons[0][i][2]);
        }
    }
    return out_z[0] <= out_z[1];
}

/* Depth range of the scene's box inside the window, whose casters and receivers it holds. One texel
 * on each side is for the rasteriser, which moves corners of triangles. */
static bool window_depth_range(const csm_cascades_desc *desc, csm_cascades *out, int i,
                               const double corner[2], const double sides[2], double *out_near,
                               double *out_span) {
    const double rounding = out->stretch * box_rounding(desc->scene_bounds);
    double bounds[6], low[2], high[2], z[2];
    box_widen(desc->scene_bounds, box_rounding(desc->scene_bounds), bounds);
    for (int axis = 0; axis < 2; axis++) {
        const double margin = out->texel_size[i][axis] + rounding;
        low[axis] = corner[axis] - margin;
        high[axis] = corner[axis] + sides[axis] + margin;
    }
    if (!box_in_window(bounds, out->light_from_world[i], low, high, z)) {
        return false;
    }
    const double margin = 0.5e-6 * (z[1] - z[0]) + rounding + 1e-30;
    *out_near = -z[1] - margin;
    *out_span = z[1] - z[0] + 2.0 * margin;
    quantise(desc, out, i, false, out_near, out_span);
    return true;
}

void csm_choose_depth_range(const csm_cascades_desc *desc, csm_cascades *out, int i,
                            const csm_slab *slice, const double corner[2], const double sides[2],
                            double *out_near, double *out_span) {
    const csm_settings *settings = desc->settings;
    const double *bounds = desc->scene_bounds;
    const int mode = settings->effects[CSM_EFFECT_DEPTH_RANGE];
    if (mode == CSM_DEPTH_RANGE_MANUAL) {
        *out_near = settings->manual_depth_range[0];
        *out_span = settings->manual_depth_range[1] - settings->manual_depth_range[0];
        return;
    }
    if (!bounds) {
        const double margin =
            0x1p-44 * (fabs(slice->centre[2]) + slice->half[2] + desc->camera.far_depth);
        slice_depth_range(desc, out, i, slice, margin, out_near, out_span);
        return;
    }
    scene_depth_range(bounds, out->light_from_world[i], out->stretch, out_near, out_span);
    double near_depth, span = INFINITY;
    if (settings->effects[CSM_EFFECT_PANCAKE]) {
        const double margin = out->stretch * box_rounding(bounds);
        slice_depth_range(desc, out, i, slice, margin, &near_depth, &span);
    } else if (mode == CSM_DEPTH_RANGE_WINDOW &&
               !window_depth_range(desc, out, i, corner, sides, &near_depth, &span)) {
        span = INFINITY; /* no scene there: any range will do, so one that does not move */
    }
    /* The spans decide, not the ends: a choice that moves with the camera would change the quantum
     * from frame to frame. */
    if (span < *out_span) {
        *out_near = near_depth;
        *out_span = span;
    }
}
