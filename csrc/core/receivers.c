/* receivers.c: ranges and windows from what is seen: the visible surfaces that face the sun.
 *
 * In: world points, or the sums of a pass over the pixels. Out: depths for the splits, and for each
 * cascade the rectangle of its receivers in light x, y (docs/numerics.md 22): what Lauritzen, Salvi
 * and Lefohn 2011, "Sample distribution shadow maps", call tight light-space bounds.
 */
#include "placement.h"

#include "linalg.h"

/* Turned windows are tried every 90 / 32 degrees: the best of them is at most 2.5 % wider than the
 * best of all. */
#define TURNS 32

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

bool csm_receivers_depths(const csm_cascades_desc *desc, double out_range[2],
                          uint32_t histogram[CSM_DEPTH_BINS]) {
    const csm_receivers *seen = desc->receivers;
    const csm_camera *camera = &desc->camera;
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
    for (size_t i = 0; i < seen->point_count; i++) {
        const double depth = view_depth(camera, seen->points + 3 * i);
        if (!(depth >= camera->near_depth && depth <= camera->far_depth)) {
            continue;
        }
        out_range[0] = fmin(out_range[0], depth);
        out_range[1] = fmax(out_range[1], depth);
        if (histogram) {
            histogram[depth_bin(camera, depth)]++;
        }
    }
    return out_range[0] <= out_range[1];
}

/* Light-space box of receivers: {min x, y, max x, y}, empty where min > max. */
typedef struct rectangle {
    double low[2], high[2];
} rectangle;

static const rectangle nothing = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};

/* A box that light space turned by an angle encloses: its centre turned, its sides projected. */
static void grow(rectangle *out, const double low[2], const double high[2], double cosine,
                 double sine) {
    const double centre[2] = {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])};
    const double half[2] = {0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1])};
    const double at[2] = {cosine * centre[0] + sine * centre[1],
                          cosine * centre[1] - sine * centre[0]};
    const double reach[2] = {cosine * half[0] + sine * half[1], cosine * half[1] + sine * half[0]};
    for (int axis = 0; axis < 2; axis++) {
        out->low[axis] = fmin(out->low[axis], at[axis] - reach[axis]);
        out->high[axis] = fmax(out->high[axis], at[axis] + reach[axis]);
    }
}

/* The rectangle round the receivers of cascade i in light space turned by an angle of 0 to 90
 * degrees, relative to *out_origin, a point in light x, y of the turned axes. */
static rectangle enclose(const csm_cascades_desc *desc, const csm_cascades *cascades, int i,
                         double cosine, double sine, double out_origin[2]) {
    const csm_receivers *seen = desc->receivers;
    const double *basis = cascades->light_from_world[i];
    rectangle out = nothing;
    double origin_ls[3];
    mat4_rotate(basis, seen->points ? desc->camera.eye : seen->box_origin, origin_ls);
    out_origin[0] = cosine * origin_ls[0] + sine * origin_ls[1];
    out_origin[1] = cosine * origin_ls[1] - sine * origin_ls[0];
    for (size_t k = 0; !seen->points && k < seen->box_count; k++) {
        const float *box = seen->boxes + 4 * (k * (size_t)cascades->count + (size_t)i);
        if (box[0] <= box[2]) {
            grow(&out, (double[2]){box[0], box[1]}, (double[2]){box[2], box[3]}, cosine, sine);
        }
    }
    for (size_t k = 0; seen->points && k < seen->point_count; k++) {
        double from_eye[3], at[3];
        const double depth = view_depth(&desc->camera, seen->points + 3 * k);
        if ((i > 0 && depth <= cascades->splits[i]) || depth > cascades->splits[i + 1]) {
            continue;
        }
        for (int axis = 0; axis < 3; axis++) {
            from_eye[axis] = seen->points[3 * k + (size_t)axis] - desc->camera.eye[axis];
        }
        mat4_rotate(basis, from_eye, at);
        grow(&out, at, at, cosine, sine);
    }
    return out;
}

/* Light axes x and y turned by an angle about light z. */
static void turn_basis(double light_from_world[16], double cosine, double sine) {
    for (int column = 0; column < 3; column++) {
        const double x = light_from_world[4 * column], y = light_from_world[4 * column + 1];
        light_from_world[4 * column] = cosine * x + sine * y;
        light_from_world[4 * column + 1] = cosine * y - sine * x;
    }
}

static rectangle enclose_turned(const csm_cascades_desc *desc, csm_cascades *out, int i,
                                double out_origin[2]) {
    rectangle best = nothing;
    double best_area = INFINITY, best_cosine = 1.0, best_sine = 0.0;
    for (int turn = 0; turn < TURNS; turn++) {
        const double angle = turn * (0.5 * 3.14159265358979323846 / TURNS);
        const double cosine = cos(angle), sine = sin(angle);
        double origin[2];
        const rectangle here = enclose(desc, out, i, cosine, sine, origin);
        const double area = (here.high[0] - here.low[0]) * (here.high[1] - here.low[1]);
        if (here.low[0] <= here.high[0] && area < best_area) {
            best = here;
            best_area = area;
            best_cosine = cosine;
            best_sine = sine;
            memcpy(out_origin, origin, sizeof origin);
        }
    }
    turn_basis(out->light_from_world[i], best_cosine, best_sine);
    return best;
}

csm_status csm_fit_visible(const csm_cascades_desc *desc, csm_cascades *out, int i, csm_slab *slab,
                           csm_error *err) {
    const csm_settings *settings = desc->settings;
    if (!desc->receivers) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "fit visible needs receivers, the points that the camera sees");
    }
    double origin[2];
    const rectangle seen = settings->effects[CSM_EFFECT_TURNED]
                               ? enclose_turned(desc, out, i, origin)
                               : enclose(desc, out, i, 1.0, 0.0, origin);
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
    const double least = 0.5 * settings->map_size[i] * rounding;
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
