/* receivers.c: ranges and windows from what is seen: the visible surfaces that face the sun.
 *
 * In: world points, or the sums of a pass over the pixels. Out: depths for the splits, and for each
 * cascade the csm_rectangle of its receivers in light x, y (docs/numerics.md 22): what Lauritzen,
 * Salvi and Lefohn 2011, "Sample distribution shadow maps", call tight light-space bounds.
 */
#include "placement.h"

#include <stdlib.h>

#include "hull.h"
#include "linalg.h"
#include "runs.h"

static double view_depth(const csm_camera *camera, const double point[3]) {
    double from_eye[3];
    for (int axis = 0; axis < 3; axis++) {
        from_eye[axis] = point[axis] - camera->eye[axis];
    }
    return -vec3_dot(camera->backward, from_eye);
}

static int depth_bin(const csm_camera *camera, double depth) {
    const double near_depth = camera->near_depth, far_depth = camera->far_depth;
    const double share = near_depth > 0.0 ? log(depth / near_depth) / log(far_depth / near_depth)
                                          : (depth - near_depth) / (far_depth - near_depth);
    const int bin = (int)(share * CSM_DEPTH_BINS);
    return bin < 0 ? 0 : bin < CSM_DEPTH_BINS ? bin : CSM_DEPTH_BINS - 1;
}

static void sum_up_points(const csm_cascades_desc *desc, double range[2], uint32_t *histogram) {
    const csm_receivers *seen = desc->receivers;
    const csm_camera *camera = &desc->camera;
    for (size_t i = 0; i < seen->point_count; i++) {
        const double depth = view_depth(camera, seen->points + 3 * i);
        if (!(depth >= camera->near_depth && depth <= camera->far_depth)) {
            continue;
        }
        range[0] = depth < range[0] ? depth : range[0];
        range[1] = depth > range[1] ? depth : range[1];
        if (histogram) {
            histogram[depth_bin(camera, depth)]++;
        }
    }
}

/* The same of points in order: the ends of what is in range tell all but the histogram. */
static void sum_up_runs(const csm_cascades_desc *desc, double range[2], uint32_t *histogram) {
    const csm_receivers *seen = desc->receivers;
    const csm_camera *camera = &desc->camera;
    size_t begin = 0;
    for (int run = 0; run < seen->run_count; begin = seen->run_ends[run++]) {
        const size_t end = seen->run_ends[run];
        const size_t first = first_beyond(seen->depths, begin, end, camera->near_depth, true);
        const size_t last = first_beyond(seen->depths, first, end, camera->far_depth, false);
        if (first < last) {
            range[0] = fmin(range[0], seen->depths[first]);
            range[1] = fmax(range[1], seen->depths[last - 1]);
        }
        for (size_t i = first; histogram && i < last; i++) {
            histogram[depth_bin(camera, seen->depths[i])]++;
        }
    }
}

bool csm_receivers_depths(const csm_cascades_desc *desc, double out_range[2],
                          uint32_t histogram[CSM_DEPTH_BINS]) {
    const csm_receivers *seen = desc->receivers;
    if (!seen->points) {
        memcpy(out_range, seen->depth_range, 2 * sizeof *out_range);
        if (histogram) {
            memcpy(histogram, seen->depth_histogram, CSM_DEPTH_BINS * sizeof *histogram);
        }
        return seen->seen;
    }
    out_range[0] = INFINITY;
    out_range[1] = -INFINITY;
    if (histogram) {
        memset(histogram, 0, CSM_DEPTH_BINS * sizeof *histogram);
    }
    if (seen->depths) {
        sum_up_runs(desc, out_range, histogram);
    } else {
        sum_up_points(desc, out_range, histogram);
    }
    return out_range[0] <= out_range[1];
}

static void relative_to_eye(const csm_cascades_desc *desc, size_t k, double out[3]) {
    const double *point = desc->receivers->points + 3 * k;
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = point[axis] - desc->camera.eye[axis];
    }
}

#define NO_CASCADE CSM_MAX_CASCADES

/* The cascade whose receiver a point of that view depth is. */
static int cascade_at(const csm_cascades *cascades, double depth) {
    for (int i = 0; i < cascades->count; i++) {
        if (depth <= cascades->splits[i + 1]) {
            return i;
        }
    }
    return NO_CASCADE;
}

/* The cascade of a point in any order. */
static int cascade_of(const csm_cascades_desc *desc, const csm_cascades *cascades, size_t k) {
    return cascade_at(cascades, view_depth(&desc->camera, desc->receivers->points + 3 * k));
}

/* The end of the points in a row from begin on that are receivers of one cascade, *out. */
static size_t next_receivers(const csm_cascades_desc *desc, const csm_cascades *cascades,
                             size_t begin, int *out) {
    const csm_receivers *seen = desc->receivers;
    if (!seen->depths) {
        size_t end = begin + 1;
        *out = cascade_of(desc, cascades, begin);
        while (end < seen->point_count && cascade_of(desc, cascades, end) == *out) {
            end++;
        }
        return end;
    }
    int run = 0;
    while (seen->run_ends[run] <= begin) {
        run++;
    }
    *out = cascade_at(cascades, seen->depths[begin]);
    return *out == NO_CASCADE ? seen->run_ends[run]
                              : first_beyond(seen->depths, begin, seen->run_ends[run],
                                             cascades->splits[*out + 1], false);
}

/* Light axes x and y turned by an angle about light z. */
static void turn_basis(double light_from_world[16], double cosine, double sine) {
    for (int column = 0; column < 3; column++) {
        const double x = light_from_world[4 * column], y = light_from_world[4 * column + 1];
        light_from_world[4 * column] = cosine * x + sine * y;
        light_from_world[4 * column + 1] = cosine * y - sine * x;
    }
}

/* What the receivers' boxes of cascade i span in light x, y, relative to the boxes' origin. */
static csm_rectangle enclose_boxes(const csm_receivers *seen, int i, int cascades) {
    csm_rectangle out = csm_rectangle_nothing();
    for (size_t k = 0; k < seen->box_count; k++) {
        const float *box = seen->boxes + 4 * (k * (size_t)cascades + (size_t)i);
        if (box[0] <= box[2]) {
            csm_rectangle_grow(&out, (double[2]){box[0], box[1]}, (double[2]){box[2], box[3]});
        }
    }
    return out;
}

void csm_receivers_enclose(const csm_cascades_desc *desc, const csm_cascades *cascades,
                           csm_rectangle out[CSM_MAX_CASCADES]) {
    const csm_receivers *seen = desc->receivers;
    double axes[CSM_MAX_CASCADES][16];
    for (int i = 0; i < cascades->count; i++) {
        memcpy(axes[i], cascades->light_from_world[i], sizeof axes[i]);
        if (desc->settings->effects[CSM_EFFECT_TURNED]) {
            turn_basis(axes[i], cos(seen->turns[i]), sin(seen->turns[i]));
        }
        out[i] = seen->points ? csm_rectangle_nothing() : enclose_boxes(seen, i, cascades->count);
    }
    size_t k = 0;
    while (seen->points && k < seen->point_count) {
        int i;
        const size_t end = next_receivers(desc, cascades, k, &i);
        csm_rectangle own = i == NO_CASCADE ? csm_rectangle_nothing() : out[i];
        for (; k < end; k++) {
            double from_eye[3], at[3];
            relative_to_eye(desc, k, from_eye);
            mat4_rotate(axes[i == NO_CASCADE ? 0 : i], from_eye, at);
            csm_rectangle_grow(&own, at, at);
        }
        if (i != NO_CASCADE) {
            out[i] = own;
        }
    }
}

/* Corners of the receivers' boxes of cascade i in light x, y; room for four for each box. */
static size_t corners_of_boxes(const csm_receivers *seen, int cascades, int i, double (*out)[2]) {
    size_t count = 0;
    for (size_t k = 0; k < seen->box_count; k++) {
        const float *box = seen->boxes + 4 * (k * (size_t)cascades + (size_t)i);
        for (int corner = 0; corner < 4 && box[0] <= box[2]; corner++) {
            out[count][0] = box[corner & 1 ? 2 : 0];
            out[count++][1] = box[corner & 2 ? 3 : 1];
        }
    }
    return count;
}

/* The receivers of cascade i in light x, y; room for all of them. */
static size_t points_of(const csm_cascades_desc *desc, const csm_cascades *cascades, int i,
                        const uint8_t *taken, double (*out)[2]) {
    size_t count = 0;
    for (size_t k = 0; k < desc->receivers->point_count; k++) {
        if (taken[k] == i) {
            double from_eye[3], at[3];
            relative_to_eye(desc, k, from_eye);
            mat4_rotate(cascades->light_from_world[i], from_eye, at);
            memcpy(out[count++], at, sizeof out[0]);
        }
    }
    return count;
}

/* The cascade of every point. */
static void class_points(const csm_cascades_desc *desc, const csm_cascades *cascades,
                         uint8_t *out) {
    size_t k = 0;
    while (k < desc->receivers->point_count) {
        int taken;
        const size_t begin = k;
        k = next_receivers(desc, cascades, k, &taken);
        memset(out + begin, taken, k - begin);
    }
}

csm_status csm_receivers_turns(const csm_cascades_desc *desc, const csm_cascades *cascades,
                               double out_turns[CSM_MAX_CASCADES], csm_error *err) {
    const csm_receivers *seen = desc->receivers;
    const size_t most = seen->points ? seen->point_count : 4 * seen->box_count;
    double(*points)[2] = malloc((2 * most + 1) * sizeof *points);
    uint8_t *taken = malloc(seen->points ? seen->point_count + 1 : 1);
    if (!points || !taken) {
        free(points);
        free(taken);
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to turn windows");
    }
    if (seen->points) {
        class_points(desc, cascades, taken);
    }
    for (int i = 0; i < cascades->count; i++) {
        size_t count = seen->points ? points_of(desc, cascades, i, taken, points)
                                    : corners_of_boxes(seen, cascades->count, i, points);
        count = csm_outer_points(points, count);
        double(*hull)[2] = points + count;
        const size_t corners = csm_convex_hull(points, count, 0.0, most + 1, hull);
        out_turns[i] = csm_smallest_rectangle((const double(*)[2])hull, corners);
    }
    free(points);
    free(taken);
    return CSM_OK;
}

csm_status csm_fit_visible(const csm_cascades_desc *desc, const csm_rectangle *rectangles,
                           csm_cascades *out, int i, csm_slab *slab, csm_error *err) {
    const csm_settings *settings = desc->settings;
    const csm_receivers *receivers = desc->receivers;
    if (!receivers) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "fit visible needs receivers, the points that the camera sees");
    }
    if (settings->effects[CSM_EFFECT_TURNED]) {
        const double turn = receivers->turns[i];
        turn_basis(out->light_from_world[i], cos(turn), sin(turn));
    }
    double origin[3];
    mat4_rotate(out->light_from_world[i],
                receivers->points ? desc->camera.eye : receivers->box_origin, origin);
    const csm_rectangle seen = rectangles[i];
    *slab = csm_slice_bounds(&desc->camera, out->light_from_world[i], out->splits[i],
                             out->splits[i + 1]);
    /* Receivers are float32: a texel finer than their rounding tells nothing more, and a window
     * must be wider than it, or what lies on its rim would fall out. */
    double extent[6];
    for (int axis = 0; axis < 3; axis++) {
        extent[axis] = slab->centre[axis] - slab->half[axis];
        extent[axis + 3] = slab->centre[axis] + slab->half[axis];
    }
    const double rounding =
        out->stretch * box_rounding(desc->scene_bounds ? desc->scene_bounds : extent);
    const double least = 0.5 * settings->map_size[i] * rounding + 1e-30; /* a scene of one point */
    for (int axis = 0; axis < 2; axis++) {
        const bool empty = seen.low[axis] > seen.high[axis];
        double half = empty ? 0.0 : 0.5 * (seen.high[axis] - seen.low[axis]);
        if (!empty) {
            slab->centre[axis] = origin[axis] + 0.5 * (seen.low[axis] + seen.high[axis]);
        }
        slab->half[axis] = csm_settle_half(desc, i, axis, fmax(half + rounding, least), out);
    }
    return CSM_OK;
}
