/* coverage.c: what any set of cascades does to a view, as measured quantities.
 *
 * In: a camera, splits, clip matrices of whatever origin; bounds or visible points. Out: what
 * sticks out of a map and by how much, what no map holds, how well maps are used (docs/numerics.md
 * 23).
 */
#include "coverage.h"

#include <stdlib.h>

#include "linalg.h"

/* Share of a depth range: what half a quantum of 16 bits cannot show is no miss. */
#define DEPTH_TOLERANCE 0x1p-17

static void keep_worst(csm_coverage_worst *worst, double amount, const double point[3]) {
    if (amount > worst->amount) {
        worst->amount = amount;
        memcpy(worst->point, point, sizeof worst->point);
    }
}

static double depth_of(const csm_camera *camera, const double p[3]) {
    return -vec3_dot(camera->backward, p);
}

void coverage_judge_depth(view *v, int slice, const double p[3]) {
    double clip[4];
    const double slope = v->windows[slice].depth_slope;
    light_window_clip(&v->windows[slice], p, clip);
    keep_worst(&v->out[slice].before, -clip[WINDOW_Z] / slope, p);
    keep_worst(&v->out[slice].behind, (clip[WINDOW_Z] - clip[WINDOW_W]) / slope, p);
}

/* Pixel over texel at a point, by the larger side of the texel's cross-section. */
static void judge_density(view *v, int slice, const double p[3]) {
    double g[2][3], texel[2];
    const light_window *window = &v->windows[slice];
    if (!light_window_texel(window, p, texel)) {
        return;
    }
    light_window_gradients(window, p, g);
    const double a = vec3_dot(g[0], g[0]), b = vec3_dot(g[0], g[1]), c = vec3_dot(g[1], g[1]);
    const double larger = 0.5 * (a + c) + hypot(0.5 * (a - c), b);
    const double texels_per_metre = sqrt(fmax(a * c - b * b, 0.0) / larger);
    const csm_camera *camera = &v->desc->camera;
    const double pixel = v->pixel * (camera->orthographic ? 1.0 : depth_of(camera, p));
    double *range = v->out[slice].texels_per_pixel;
    range[0] = fmin(range[0], texels_per_metre * pixel);
    range[1] = fmax(range[1], texels_per_metre * pixel);
}

void coverage_judge_point(view *v, int slice, const double p[3]) {
    keep_worst(&v->out[slice].overflow,
               light_window_outside(&v->windows[slice], p, v->desc->border_texels), p);
    if (!v->desc->first_map) {
        coverage_judge_depth(v, slice, p);
    }
    judge_density(v, slice, p);
}

void coverage_widen_gap(view *v, int slice, const double p[3]) {
    const double outside = light_window_outside(&v->windows[slice], p, v->desc->border_texels);
    v->out[slice].gap_texels = fmax(v->out[slice].gap_texels, outside);
}

void coverage_add_gap(view *v, int slice, const double p[3], double size) {
    csm_coverage *out = &v->out[slice];
    double *sizes = v->gap_sizes[slice];
    int place = out->gap_point_count;
    if (place == CSM_GAP_POINTS) {
        place = 0;
        for (int i = 1; i < CSM_GAP_POINTS; i++) {
            place = sizes[i] < sizes[place] ? i : place;
        }
        if (size <= sizes[place]) {
            return;
        }
    } else {
        out->gap_point_count++;
    }
    sizes[place] = size;
    memcpy(out->gap_points[place], p, sizeof out->gap_points[place]);
}

/* ------------------------------------------------------------------------------------------------
 * Receivers
 */

typedef struct receiver_maps {
    unsigned char *used[CSM_MAX_CASCADES]; /* one byte per texel that a receiver falls into */
    size_t held[CSM_MAX_CASCADES][CSM_MAX_CASCADES], lost[CSM_MAX_CASCADES];
} receiver_maps;

static void mark_texel(const view *v, receiver_maps *maps, int i, const double p[3]) {
    double texel[2];
    const double size = v->windows[i].size;
    if (light_window_texel(&v->windows[i], p, texel) && texel[0] >= 0.0 && texel[0] < size &&
        texel[1] >= 0.0 && texel[1] < size) {
        maps->used[i][(size_t)texel[1] * (size_t)size + (size_t)texel[0]] = 1;
    }
}

static bool inside_planes(const double (*planes)[4], int count, const double p[3], double slack) {
    for (int i = 0; i < count; i++) {
        if (vec3_dot(planes[i], p) + planes[i][3] < -slack) {
            return false;
        }
    }
    return true;
}

/* What no map answers for: beyond the last split, or under selection by the first map that holds a
 * point. What its own map holds across but not in depth is a matter of depth. */
static bool judge_hole(view *v, int slice, bool beyond, bool held, const double p[3]) {
    if (!beyond && (held || !v->desc->first_map)) {
        return false;
    }
    if (!beyond && inside_planes((const double(*)[4])v->planes[slice], WINDOW_SIDES, p, 0.0)) {
        coverage_judge_depth(v, slice, p);
        return false;
    }
    coverage_widen_gap(v, slice, p);
    coverage_add_gap(v, slice, p, depth_of(&v->desc->camera, p));
    return true;
}

/* The highest caster that the bounds allow over a point: where its column leaves them. */
static void judge_column(view *v, int slice, const double p[3]) {
    const light_window *window = &v->windows[slice];
    const double *bounds = v->desc->scene_bounds, *eye = v->desc->camera.eye;
    double up = INFINITY, highest[3], clip[4];
    for (int axis = 0; axis < 3; axis++) {
        const double speed = window->to_light[axis];
        const double end = bounds[speed > 0.0 ? axis + 3 : axis] - eye[axis];
        if (speed != 0.0) {
            up = fmin(up, (end - p[axis]) / speed);
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        highest[axis] = p[axis] + up * window->to_light[axis];
    }
    light_window_clip(window, highest, clip);
    keep_worst(&v->out[slice].caster, -clip[WINDOW_Z] / window->depth_slope, highest);
}

/* The slice that a view depth belongs to, count beyond the last split. */
static int slice_of(const csm_coverage_desc *desc, double depth) {
    int slice = 0;
    while (slice < desc->count && depth > desc->splits[slice + 1]) {
        slice++;
    }
    return slice;
}

static void judge_receiver(view *v, receiver_maps *maps, const double p[3]) {
    const int count = v->desc->count;
    const double *eye = v->desc->camera.eye;
    const double depth = depth_of(&v->desc->camera, p);
    /* A depth on a split, but for its rounding, may be counted to either side. */
    const double farthest = fmax(fabs(eye[0]), fmax(fabs(eye[1]), fabs(eye[2])));
    const double slack = 0x1p-40 * fabs(depth) + 0x1p-49 * farthest;
    const int behind = slice_of(v->desc, depth + slack);
    int slice = slice_of(v->desc, depth - slack);
    if (slice != behind &&
        !inside_planes((const double(*)[4])v->planes[slice], WINDOW_PLANES, p, 0.0)) {
        slice = slice_of(v->desc, depth);
        if (slice == count) {
            return;
        }
    }
    const bool beyond = slice == count;
    slice = beyond ? count - 1 : slice;
    v->out[slice].receiver_count++;
    bool held = false;
    for (int i = 0; i < count; i++) {
        const bool holds = inside_planes((const double(*)[4])v->planes[i], WINDOW_PLANES, p, 0.0);
        maps->held[slice][i] += holds;
        held = held || holds;
    }
    maps->lost[slice] += judge_hole(v, slice, beyond, held, p);
    if (!beyond) {
        coverage_judge_point(v, slice, p);
        if (v->desc->scene_bounds) {
            judge_column(v, slice, p);
        }
        for (int i = v->desc->first_map ? 0 : slice; i <= slice; i++) {
            mark_texel(v, maps, i, p);
        }
    }
}

static csm_status measure_receivers(view *v, csm_error *err) {
    const csm_coverage_desc *desc = v->desc;
    receiver_maps maps = {0};
    csm_status status = CSM_OK;
    for (int i = 0; i < desc->count && status == CSM_OK; i++) {
        const size_t size = (size_t)desc->map_size[i];
        maps.used[i] = calloc(size * size, 1);
        status = maps.used[i] ? CSM_OK
                              : csm_fail(err, CSM_ERROR_OUT_OF_MEMORY,
                                         "no memory for %zu x %zu texels", size, size);
    }
    csm_camera at_origin = desc->camera;
    double planes[CSM_PLANE_COUNT][4];
    memset(at_origin.eye, 0, sizeof at_origin.eye);
    csm_frustum_planes(&at_origin, desc->camera.near_depth, desc->camera.far_depth, planes);
    for (size_t i = 0; i < desc->receiver_count && status == CSM_OK; i++) {
        double p[3], reach = 0.0;
        for (int axis = 0; axis < 3; axis++) {
            p[axis] = desc->receivers[3 * i + (size_t)axis] - desc->camera.eye[axis];
            reach = fmax(reach, fabs(p[axis]));
        }
        /* On the frustum's edge is in the picture. */
        if (inside_planes((const double(*)[4])planes, CSM_PLANE_COUNT, p, 1e-9 * reach)) {
            judge_receiver(v, &maps, p);
        }
    }
    for (int i = 0; i < desc->count && status == CSM_OK; i++) {
        csm_coverage *out = &v->out[i];
        const size_t texels = (size_t)desc->map_size[i] * (size_t)desc->map_size[i];
        size_t used = 0;
        for (size_t texel = 0; texel < texels; texel++) {
            used += maps.used[i][texel];
        }
        out->utilisation = (double)used / (double)texels;
        const double all = fmax((double)out->receiver_count, 1.0);
        out->gap_share = (double)maps.lost[i] / all;
        for (int j = 0; j < desc->count; j++) {
            out->overlap[j] = (double)maps.held[i][j] / all;
        }
    }
    for (int i = 0; i < desc->count; i++) {
        free(maps.used[i]);
    }
    return status;
}

/* ------------------------------------------------------------------------------------------------
 * A set of cascades
 */

static csm_status check_desc(const csm_coverage_desc *desc, csm_error *err) {
    if (desc->count < 1 || desc->count > CSM_MAX_CASCADES) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT, "there must be 1 to %d cascades (got %d)",
                        CSM_MAX_CASCADES, desc->count);
    }
    for (int i = 0; i < desc->count; i++) {
        const double low = desc->splits[i], high = desc->splits[i + 1];
        if (!isfinite(low) || !isfinite(high) || !(high > low)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "splits must be finite and ascend (got %g after %g)", high, low);
        }
        if (desc->map_size[i] < 1 || desc->map_size[i] > 65536) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "map_size must be from 1 to 65536 texels (got %d)", desc->map_size[i]);
        }
        if (!(2.0 * desc->border_texels < desc->map_size[i])) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "border_texels must be less than half of every map (got %g of %d)",
                            desc->border_texels, desc->map_size[i]);
        }
    }
    return csm_camera_validate(&desc->camera, err);
}

/* What a window says of itself, before anything is held against it. */
static void describe_window(view *v, int i, const double middle[3]) {
    const light_window *window = &v->windows[i];
    csm_coverage *out = &v->out[i];
    double centre[3], clip[4], g[2][3], across[3];
    light_window_centre(window, centre);
    light_window_clip(window, centre, clip);
    light_window_gradients(window, centre, g);
    for (int axis = 0; axis < 2; axis++) {
        out->texel_size[axis] = 1.0 / sqrt(vec3_dot(g[axis], g[axis]));
    }
    out->depth_span = clip[WINDOW_W] / window->depth_slope;
    light_window_gradients(window, middle, g);
    vec3_cross(g[0], g[1], across);
    out->mirrored = vec3_dot(across, window->to_light) < 0.0;
    memcpy(out->to_light, window->to_light, sizeof out->to_light);
    out->tolerance_texels = v->desc->tolerance_texels + window->rounding_texels;
    const double depth_slack = DEPTH_TOLERANCE + window->rounding_depth;
    out->tolerance_depth = depth_slack * out->depth_span;
    light_window_planes(window, v->desc->border_texels - out->tolerance_texels, depth_slack,
                        v->planes[i]);
    out->texels_per_pixel[0] = INFINITY;
    out->texels_per_pixel[1] = -INFINITY;
    csm_coverage_worst *worst[4] = {&out->overflow, &out->before, &out->behind, &out->caster};
    for (int k = 0; k < 4; k++) {
        worst[k]->amount = -INFINITY;
    }
}

static void add_eye(const double eye[3], double point[3]) {
    for (int axis = 0; axis < 3; axis++) {
        point[axis] += eye[axis];
    }
}

csm_status csm_coverage_measure(const csm_coverage_desc *desc, csm_coverage out[CSM_MAX_CASCADES],
                                csm_error *err) {
    csm_status status = check_desc(desc, err);
    if (status != CSM_OK) {
        return status;
    }
    const csm_camera *camera = &desc->camera;
    view v = {.desc = desc, .out = out, .pixel = 2.0 * camera->half_height / camera->height};
    memset(out, 0, CSM_MAX_CASCADES * sizeof *out);
    csm_camera at_origin = *camera;
    memset(at_origin.eye, 0, sizeof at_origin.eye);
    for (int i = 0; i < desc->count && status == CSM_OK; i++) {
        double corners[CSM_CORNER_COUNT][3], middle[3] = {0.0}, reach = 0.0;
        csm_frustum_corners(&at_origin, desc->splits[i], desc->splits[i + 1], corners);
        for (int corner = 0; corner < CSM_CORNER_COUNT; corner++) {
            for (int axis = 0; axis < 3; axis++) {
                reach = fmax(reach, fabs(corners[corner][axis]));
                middle[axis] += corners[corner][axis] / CSM_CORNER_COUNT;
            }
        }
        status = light_window_make(desc->clip_from_world[i], desc->map_size[i], camera->eye, reach,
                                   &v.windows[i], err);
        if (status == CSM_OK) {
            describe_window(&v, i, middle);
        }
    }
    if (status == CSM_OK && desc->receivers) {
        status = measure_receivers(&v, err);
    }
    for (int i = 0; i < desc->count && status == CSM_OK; i++) {
        if (!desc->receivers) {
            status = coverage_measure_slice(&v, i, err);
        }
        csm_coverage_worst *worst[4] = {&out[i].overflow, &out[i].before, &out[i].behind,
                                        &out[i].caster};
        for (int k = 0; k < 4; k++) {
            add_eye(camera->eye, worst[k]->point);
        }
        for (int k = 0; k < out[i].gap_point_count; k++) {
            add_eye(camera->eye, out[i].gap_points[k]);
        }
    }
    return status;
}
