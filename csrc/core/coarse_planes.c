/* coarse_planes.c: where planes end between the pixels of a coarse picture.
 *
 * In: depths and which pixels face the sun. Out: pixels of the full picture past the planes' last
 * coarse ones, and the part of the picture in which planes reach their horizon.
 *
 * Between the last pixel of a plane and the centre of the next coarse one, which shows something
 * else, the full picture has pixels of its own: towards a horizon these lie many times as far off.
 * They count as far as the scene's box reaches, and before what is seen next.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coarse.h"

#define FLAT 0.02 /* of the step from pixel to pixel, that the next may differ by on a plane */
#define WAYS 4 /* down, up, right, left: bit 1 is the axis, 0 along columns; bit 0 is backwards */

/* One plane's last pixel. Places count along the way, from the border where it starts. */
typedef struct plane_end {
    int place, crossing;
    double last, step, after; /* linear values: of it, from pixel to pixel, of the next pixel */
    bool seen;                /* whether the next shows anything; past the border nothing is seen */
} plane_end;

typedef struct planes {
    const csm_camera *full;
    const csm_coarse_picture *picture;
    double bounds[6], slack;
    double *linear; /* what is linear in the picture on a plane: the inverse of depth, or depth */
    uint8_t *ways;  /* bits: along which ways a plane ends at a pixel */
    plane_end *ends;
    size_t count[WAYS];
} planes;

static int way_axis(int way) {
    return way >> 1;
}

static bool way_back(int way) {
    return way & 1;
}

static int side(const csm_camera *camera, int axis) {
    return axis ? camera->width : camera->height;
}

static void make_linear(planes *p) {
    const csm_camera *camera = p->picture->camera;
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    for (size_t i = 0; i < pixels; i++) {
        const double depth = p->picture->valid[i] ? (double)p->picture->view_depth[i] : 1.0;
        p->linear[i] = camera->orthographic ? depth : 1.0 / depth;
    }
}

/* Whether the plane of a pixel and the two before it ends there; next is 0 past the border. */
static bool ends_at(const planes *p, size_t i, ptrdiff_t next, bool border) {
    const uint8_t *facing = p->picture->facing + i;
    if (!(facing[0] & *(facing - next) & *(facing - 2 * next))) {
        return false;
    }
    const double *linear = p->linear + i;
    const double before = *(linear - next), step = linear[0] - before;
    const double allowed = FLAT * fabs(step);
    if (!(fabs(step - (before - *(linear - 2 * next))) <= allowed)) {
        return false;
    }
    return border || !p->picture->valid[(ptrdiff_t)i + next] ||
           !(fabs(linear[next] - linear[0] - step) <= allowed);
}

static void find_ends(planes *p, int way) {
    const csm_camera *camera = p->picture->camera;
    const int width = camera->width, height = camera->height, axis = way_axis(way);
    const ptrdiff_t next = (axis ? 1 : width) * (way_back(way) ? -1 : 1);
    const int last = way_back(way) ? 0 : side(camera, axis) - 1;
    const int first[2] = {axis == 0 && !way_back(way) ? 2 : 0, axis == 1 && !way_back(way) ? 2 : 0};
    const int end[2] = {height - (axis == 0 && way_back(way) ? 2 : 0),
                        width - (axis == 1 && way_back(way) ? 2 : 0)};
    for (int row = first[0]; row < end[0]; row++) {
        for (int column = first[1]; column < end[1]; column++) {
            const size_t i = (size_t)row * (size_t)width + (size_t)column;
            if (ends_at(p, i, next, (axis ? column : row) == last)) {
                p->ways[i] |= (uint8_t)(1 << way);
                p->count[way]++;
            }
        }
    }
}

/* The ends of one way, place by place. */
static size_t gather(planes *p, int way) {
    const csm_camera *camera = p->picture->camera;
    const int axis = way_axis(way), length = side(camera, axis), wide = side(camera, !axis);
    const ptrdiff_t next = (axis ? 1 : camera->width) * (way_back(way) ? -1 : 1);
    size_t count = 0;
    for (int place = 0; place < length && count < p->count[way]; place++) {
        const int along = way_back(way) ? length - 1 - place : place;
        for (int crossing = 0; crossing < wide; crossing++) {
            const int row = axis ? crossing : along, column = axis ? along : crossing;
            const size_t i = (size_t)row * (size_t)camera->width + (size_t)column;
            if (!(p->ways[i] & 1 << way)) {
                continue;
            }
            const bool inside = place + 1 < length;
            const double *linear = p->linear + i;
            p->ends[count++] = (plane_end){
                .place = place,
                .crossing = crossing,
                .last = linear[0],
                .step = linear[0] - *(linear - next),
                .after = inside ? linear[next] : 0.0,
                .seen = inside && p->picture->valid[(ptrdiff_t)i + next],
            };
        }
    }
    return count;
}

/* The depth at which a pixel of the full picture sees the plane go on, ahead of its last coarse
 * pixel by a part of one; false where it does not. */
static bool goes_on(const planes *p, const plane_end *end, double ahead, double *depth) {
    const bool straight = p->full->orthographic;
    const double value = end->last + end->step * ahead;
    if (!(ahead < 1.0 && value > 0.0)) {
        return false;
    }
    *depth = straight ? value : 1.0 / value;
    const double behind = straight ? end->after : 1.0 / end->after;
    return (!end->seen || *depth <= behind) && *depth <= p->full->far_depth;
}

static bool in_bounds(const planes *p, const double point[3]) {
    for (int i = 0; i < 3; i++) {
        if (!(point[i] >= p->bounds[i] - p->slack && point[i] <= p->bounds[3 + i] + p->slack)) {
            return false;
        }
    }
    return true;
}

/* Pixels of the full picture along a side, per pixel of the coarse one. */
static double ratio_along(const planes *p, int axis) {
    return (double)side(p->full, axis) / side(p->picture->camera, axis);
}

static void add_points(const planes *p, int way, size_t count, csm_plane_ends *out) {
    const int axis = way_axis(way), length = side(p->full, axis);
    const double ratio = ratio_along(p, axis);
    for (int k = 1; k <= (int)ceil(ratio); k++) {
        for (size_t i = 0; i < count; i++) {
            const plane_end *end = &p->ends[i];
            const double centre = (end->place + 0.5) * ratio;
            const int pixel = (int)floor(centre - 0.5) + k;
            double depth;
            if (pixel >= length || !goes_on(p, end, (pixel + 0.5 - centre) / ratio, &depth)) {
                continue;
            }
            const int along = way_back(way) ? length - 1 - pixel : pixel;
            const double x = axis ? coarse_column_x(p->full, along)
                                  : coarse_column_x(p->picture->camera, end->crossing);
            const double y = axis ? coarse_row_y(p->picture->camera, end->crossing)
                                  : coarse_row_y(p->full, along);
            coarse_point(p->full, x, y, depth, out->points[out->count]);
            out->count += in_bounds(p, out->points[out->count]);
        }
    }
}

static void hold(csm_plane_ends *out, int row, int column) {
    int *box = out->horizon_box;
    if (!out->horizon) {
        out->horizon = true;
        box[0] = box[2] = row;
        box[1] = box[3] = column;
    }
    box[0] = row < box[0] ? row : box[0];
    box[1] = column < box[1] ? column : box[1];
    box[2] = row + 1 > box[2] ? row + 1 : box[2];
    box[3] = column + 1 > box[3] ? column + 1 : box[3];
}

/* The last pixels of planes whose inverse depth comes to 0 before the next, and these. */
static void add_horizon(const planes *p, int way, size_t count, csm_plane_ends *out) {
    const int axis = way_axis(way), length = side(p->picture->camera, axis);
    for (size_t i = 0; i < count; i++) {
        const plane_end *end = &p->ends[i];
        if (end->seen || !(end->last + end->step <= 0.0)) {
            continue;
        }
        for (int ahead = 0; ahead < 2; ahead++) {
            const int place = end->place + ahead < length ? end->place + ahead : length - 1;
            const int along = way_back(way) ? length - 1 - place : place;
            hold(out, axis ? end->crossing : along, axis ? along : end->crossing);
        }
    }
}

static csm_status find(planes *p, csm_plane_ends *out, csm_error *err) {
    make_linear(p);
    size_t most = 0, room = 0;
    for (int way = 0; way < WAYS; way++) {
        find_ends(p, way);
        most = p->count[way] > most ? p->count[way] : most;
        room += p->count[way] * (size_t)ceil(ratio_along(p, way_axis(way)));
    }
    p->ends = malloc((most + 1) * sizeof *p->ends);
    out->points = malloc((room + 1) * sizeof *out->points);
    if (!p->ends || !out->points) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu ends of planes", room);
    }
    for (int way = 0; way < WAYS; way++) {
        const size_t count = gather(p, way);
        add_points(p, way, count, out);
        if (!p->full->orthographic) {
            add_horizon(p, way, count, out);
        }
    }
    return CSM_OK;
}

csm_status csm_coarse_plane_ends(const csm_camera *full, const csm_coarse_picture *picture,
                                 const double bounds[6], csm_plane_ends *out, csm_error *err) {
    memset(out, 0, sizeof *out);
    const size_t pixels = (size_t)picture->camera->width * (size_t)picture->camera->height;
    planes p = {.full = full,
                .picture = picture,
                .linear = malloc(pixels * sizeof *p.linear),
                .ways = calloc(pixels, 1)};
    for (int i = 0; i < 6; i++) {
        p.bounds[i] = bounds[i];
        p.slack = fmax(p.slack, 1e-6 * fabs(bounds[i])); /* of depths in single precision */
    }
    const csm_status status = p.linear && p.ways ? find(&p, out, err)
                                                 : csm_fail(err, CSM_ERROR_OUT_OF_MEMORY,
                                                            "no memory for %zu pixels", pixels);
    free(p.linear);
    free(p.ways);
    free(p.ends);
    if (status != CSM_OK) {
        csm_plane_ends_free(out);
    }
    return status;
}

void csm_plane_ends_free(csm_plane_ends *ends) {
    free(ends->points);
    ends->points = NULL;
    ends->count = 0;
}
