/* cull.c: which chunks of the scene a pass must draw.
 *
 * In: world boxes, and a cascade's volume or a camera. Out: the boxes that may matter. What can
 * throw a shadow into the picture through a cascade lies above the visible part of the view, seen
 * from the light: inside its outline in light x, y, inside the cascade's window, and not wholly
 * below it (docs/numerics.md 10). Every test errs towards drawing.
 */
#include "frustum.h"
#include "hull.h"
#include "linalg.h"

/* A lookup compares depths on the plane of its receiver, up to margin away from it, where that
 * plane lies deeper by its slope times margin. 1000 is where shadow_bias.glsl stops following it,
 * 0.06 degrees from edge-on to the light. */
#define STEEPEST_RECEIVER 1000.0

/* Outline and lowest light z of what the camera sees between two depths inside the bounds. */
static void outline_visible(const csm_cascades *cascades, const csm_camera *camera,
                            double near_depth, double far_depth, csm_cull_volume *out) {
    double points[CSM_CLIP_MAX][3], flat[CSM_CLIP_MAX][2], eye_ls[3];
    int count;
    if (cascades->bounded) {
        double bounds[6];
        box_widen(cascades->bounds, box_rounding(cascades->bounds), bounds);
        count = csm_frustum_clip_box(camera, near_depth, far_depth, bounds, points);
    } else {
        csm_camera at_origin = *camera;
        memset(at_origin.eye, 0, sizeof at_origin.eye);
        csm_frustum_corners(&at_origin, near_depth, far_depth, points);
        count = CSM_CORNER_COUNT;
    }
    if (count == 0) {
        out->window[0] = out->window[1] = INFINITY;
        out->window[2] = out->window[3] = -INFINITY;
        return;
    }
    double lowest = INFINITY, largest = 0.0;
    mat4_rotate(out->light_from_world, camera->eye, eye_ls);
    for (int i = 0; i < count; i++) {
        double point_ls[3];
        mat4_rotate(out->light_from_world, points[i], point_ls);
        memcpy(flat[i], point_ls, sizeof flat[i]);
        lowest = fmin(lowest, point_ls[2]);
        largest = fmax(largest, fmax(fabs(flat[i][0]), fabs(flat[i][1])));
    }
    /* Clipping finds a vertex several times, apart by rounding. */
    out->hull_count =
        (int)csm_convex_hull(flat, (size_t)count, 0x1p-48 * largest, CSM_HULL_MAX, out->hull);
    for (int i = 0; i < out->hull_count; i++) {
        out->hull[i][0] += eye_ls[0];
        out->hull[i][1] += eye_ls[1];
    }
    out->lowest_z = eye_ls[2] + lowest - STEEPEST_RECEIVER * out->margin;
}

/* Least view depth of what a cascade is looked up for. Rims of finer windows, where they blend into
 * it, may lie at any depth. */
static double served_from(const csm_cascades *cascades, int cascade, int select, double band) {
    const double *splits = cascades->splits;
    if (band == 0.0 || cascade == 0) {
        return cascades->served_from[cascade];
    }
    if (select != CSM_SELECT_INTERVAL) {
        return splits[0];
    }
    /* float32 depths on either side of the band's start */
    const double start = splits[cascade] - band * (splits[cascade] - splits[cascade - 1]);
    return fmax(start - 0x1p-20 * fmax(fabs(splits[cascade - 1]), fabs(splits[cascade])),
                splits[0]);
}

void csm_cull_volume_make(const csm_cascades *cascades, int cascade, const csm_camera *camera,
                          int select, double band, double margin_texels, bool whole_window,
                          csm_cull_volume *out) {
    memset(out, 0, sizeof *out);
    memcpy(out->light_from_world, cascades->light_from_world[cascade],
           sizeof out->light_from_world);
    double texel;
    csm_cascade_window(cascades, cascade, out->window, &texel);
    /* One texel more: half of it to the centre of the texel that a lookup falls into, the rest for
     * the rasteriser's own snapping. */
    out->stretch = cascades->stretch;
    out->margin = (margin_texels * out->stretch + 1.0) * texel;
    out->lowest_z = -INFINITY;
    if (!whole_window) {
        /* By window, a cascade also serves what its own holds of the slices behind, and of those
         * before it what finer maps leave. */
        const int last = select == CSM_SELECT_INTERVAL ? cascade + 1 : cascades->count;
        outline_visible(cascades, camera, served_from(cascades, cascade, select, band),
                        cascades->splits[last], out);
    }
}

void csm_cull_volume_exclude(const csm_cascades *cascades, int cascade, double border_texels,
                             double band, csm_cull_volume *volume) {
    const double *own_range = cascades->depth_range[cascade];
    for (int i = 0; i < cascade; i++) {
        const double *range = cascades->depth_range[i];
        if (range[0] > own_range[0] || range[1] < own_range[1]) {
            continue; /* what lies outside the finer map's range falls to the coarser one */
        }
        csm_cull_rectangle *out = &volume->finer[volume->finer_count++];
        memcpy(out->light_from_world, cascades->light_from_world[i], sizeof out->light_from_world);
        double largest;
        csm_cascade_window(cascades, i, out->window, &largest);
        /* the margin is a square along the coarser cascade's axes */
        const bool along =
            !memcmp(out->light_from_world, volume->light_from_world, sizeof out->light_from_world);
        const double margin = volume->margin * (along ? 1.0 : sqrt(2.0));
        for (int axis = 0; axis < 2; axis++) {
            const double texels =
                cascades->stretch * border_texels + 0.5 * band * cascades->map_size[i];
            const double shrink = margin + texels * cascades->texel_size[i][axis];
            out->window[axis] += shrink;
            out->window[axis + 2] -= shrink;
        }
    }
}

/* Centre of a box in light space, and the half extents of its bounds there. */
static void box_in_light(const double *m, const double bounds[6], double out_centre[3],
                         double out_half[3]) {
    double half[3], world_centre[3];
    for (int axis = 0; axis < 3; axis++) {
        half[axis] = 0.5 * (bounds[axis + 3] - bounds[axis]);
        world_centre[axis] = bounds[axis] + half[axis];
    }
    mat4_rotate(m, world_centre, out_centre);
    for (int row = 0; row < 3; row++) {
        out_half[row] =
            fabs(m[row]) * half[0] + fabs(m[4 + row]) * half[1] + fabs(m[8 + row]) * half[2];
    }
}

bool csm_cull_in_finer(const csm_cull_volume *volume, const double bounds[6]) {
    for (int i = 0; i < volume->finer_count; i++) {
        const double *window = volume->finer[i].window;
        double centre[3], half[3];
        box_in_light(volume->finer[i].light_from_world, bounds, centre, half);
        bool inside = true;
        for (int axis = 0; axis < 2; axis++) {
            inside = inside && centre[axis] - half[axis] > window[axis] &&
                     centre[axis] + half[axis] < window[axis + 2];
        }
        if (inside) {
            return true;
        }
    }
    return false;
}

bool csm_cull_keep_box(const csm_cull_volume *volume, const double bounds[6]) {
    const double *m = volume->light_from_world;
    double centre[3], half_ls[3];
    box_in_light(m, bounds, centre, half_ls);
    if (centre[2] + half_ls[2] < volume->lowest_z) {
        return false;
    }
    double low[2], high[2];
    for (int axis = 0; axis < 2; axis++) {
        const double reach = half_ls[axis] + volume->margin;
        low[axis] = centre[axis] - reach;
        high[axis] = centre[axis] + reach;
        if (high[axis] < volume->window[axis] || low[axis] > volume->window[axis + 2]) {
            return false;
        }
    }
    if (volume->hull_count == 0) {
        return true;
    }
    /* Separating axes: light x and y against the hull, then each edge of the hull against the
     * outline of the box, widened by the square that the margin is. */
    bool beyond[4] = {true, true, true, true};
    for (int i = 0; i < volume->hull_count; i++) {
        const double *a = volume->hull[i];
        const double *b = volume->hull[(i + 1) % volume->hull_count];
        for (int axis = 0; axis < 2; axis++) {
            beyond[axis] = beyond[axis] && a[axis] < low[axis];
            beyond[axis + 2] = beyond[axis + 2] && a[axis] > high[axis];
        }
        const double inward[2] = {a[1] - b[1], b[0] - a[0]};
        double reach = volume->margin * (fabs(inward[0]) + fabs(inward[1]));
        for (int axis = 0; axis < 3; axis++) {
            reach += fabs(inward[0] * m[4 * axis] + inward[1] * m[4 * axis + 1]) * 0.5 *
                     (bounds[axis + 3] - bounds[axis]);
        }
        if (inward[0] * (centre[0] - a[0]) + inward[1] * (centre[1] - a[1]) + reach < 0.0) {
            return false;
        }
    }
    return !beyond[0] && !beyond[1] && !beyond[2] && !beyond[3];
}

/* The volume for boxes and receivers that float32 has rounded. */
static csm_cull_volume allow_for_rounding(const csm_cull_volume *volume, double rounding) {
    csm_cull_volume out = *volume;
    out.margin += rounding;
    out.lowest_z -= rounding;
    for (int i = 0; i < out.finer_count; i++) {
        for (int axis = 0; axis < 2; axis++) {
            out.finer[i].window[axis] += 2.0 * rounding;
            out.finer[i].window[axis + 2] -= 2.0 * rounding;
        }
    }
    return out;
}

size_t csm_cull_items(const csm_geometry *geometry, const csm_cull_volume *volume,
                      uint32_t *out_items, size_t *out_in_finer) {
    csm_cull_volume rounded = {0};
    if (volume) {
        rounded = allow_for_rounding(volume, volume->stretch * box_rounding(geometry->bounds));
    }
    size_t kept = 0, in_finer = 0;
    for (size_t i = 0; i < geometry->item_count; i++) {
        const double *bounds = geometry->items[i].bounds;
        if (volume && !csm_cull_keep_box(&rounded, bounds)) {
            continue;
        }
        if (volume && csm_cull_in_finer(&rounded, bounds)) {
            in_finer++;
            continue;
        }
        out_items[kept++] = (uint32_t)i;
    }
    if (out_in_finer) {
        *out_in_finer = in_finer;
    }
    return kept;
}

size_t csm_cull_list(const csm_geometry *geometry, const csm_cull_volume *volume,
                     const uint32_t *items, size_t item_count, uint32_t *out_items) {
    const csm_cull_volume rounded =
        allow_for_rounding(volume, volume->stretch * box_rounding(geometry->bounds));
    size_t kept = 0;
    for (size_t i = 0; i < item_count; i++) {
        if (csm_cull_keep_box(&rounded, geometry->items[items[i]].bounds)) {
            out_items[kept++] = items[i];
        }
    }
    return kept;
}

size_t csm_cull_items_view(const csm_geometry *geometry, const csm_camera *camera,
                           uint32_t *out_items) {
    double planes[CSM_PLANE_COUNT][4];
    csm_camera at_origin = *camera;
    memset(at_origin.eye, 0, sizeof at_origin.eye);
    csm_frustum_planes(&at_origin, camera->near_depth, camera->far_depth, planes);
    const double rounding = box_rounding(geometry->bounds);
    size_t kept = 0;
    for (size_t i = 0; i < geometry->item_count; i++) {
        if (csm_planes_meet_box((const double(*)[4])planes, camera->eye, geometry->items[i].bounds,
                                rounding)) {
            out_items[kept++] = (uint32_t)i;
        }
    }
    return kept;
}
