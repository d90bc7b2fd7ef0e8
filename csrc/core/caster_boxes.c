/* caster_boxes.c: what casters lay on shadow maps: how often they cover them, with how many
 * triangles.
 *
 * In: triangles as boxes across the light, windows as matrices. Out: layers, outlines and counts of
 * each map.
 */
#include "linalg.h"

#include "csm.h"

/* A window seen from the plane of the casters' axes. */
typedef struct box_window {
    double turn[2][2], shift[2]; /* u and v of a place in the plane */
    double scale;                /* maps that make a square metre */
} box_window;

/* The part of a box that a map holds. */
typedef struct held_box {
    double sides[2]; /* parts of the map's */
    double share;    /* of the box */
    bool whole;
} held_box;

static box_window window_of(const csm_casters *casters, const double uvz[16]) {
    box_window out;
    for (int row = 0; row < 2; row++) {
        const double gradient[3] = {uvz[row], uvz[row + 4], uvz[row + 8]};
        for (int axis = 0; axis < 2; axis++) {
            out.turn[row][axis] = vec3_dot(gradient, casters->axes[axis]);
        }
        out.shift[row] = uvz[row + 12];
    }
    out.scale = fabs(out.turn[0][0] * out.turn[1][1] - out.turn[0][1] * out.turn[1][0]);
    return out;
}

/* What of a box a map holds along u or v, below 0 of one beyond it; and the whole of the box. */
static inline double held_side(const box_window *window, int row, const double centre[2],
                               const double half[2], double *out_whole) {
    const double *turn = window->turn[row];
    const double at = turn[0] * centre[0] + turn[1] * centre[1] + window->shift[row];
    const double reach = fabs(turn[0]) * half[0] + fabs(turn[1]) * half[1];
    const double low = at - reach > 0.0 ? at - reach : 0.0;
    const double high = at + reach < 1.0 ? at + reach : 1.0;
    *out_whole = 2.0 * reach;
    return high - low;
}

static held_box held_by(const box_window *window, const double centre[2], const double half[2]) {
    held_box out = {.share = 1.0, .whole = true};
    for (int row = 0; row < 2; row++) {
        double whole;
        const double side = held_side(window, row, centre, half, &whole);
        if (side < 0.0) {
            return (held_box){.share = 0.0};
        }
        if (side < whole) { /* by rounding it may be more; of what is seen edge on, both are 0 */
            out.share *= side / whole;
        }
        out.whole = out.whole && side >= whole * (1.0 - 1e-12);
        out.sides[row] = side;
    }
    return out;
}

static void add_box(const csm_casters *casters, size_t k, const held_box *box,
                    csm_caster_load *out) {
    const double weight = casters->weight[k], area = casters->area[k];
    const int kind = 2 * (area < 0.0) + casters->cut[k];
    out->layers[kind] += weight * box->share * fabs(area);
    /* a triangle that is cut off keeps no more outline than goes round what is left of its box */
    out->lines[kind] +=
        weight * 2.0 * sqrt(box->sides[0] * box->sides[0] + box->sides[1] * box->sides[1]);
    out->triangles += weight;
}

void csm_casters_load(const csm_casters *casters, int count, const double (*uvz_from_world)[16],
                      csm_caster_load *out) {
    box_window windows[CSM_MAX_CASCADES];
    memset(out, 0, (size_t)count * sizeof *out);
    for (int i = 0; i < count; i++) {
        windows[i] = window_of(casters, uvz_from_world[i]);
    }
    for (size_t k = 0; k < casters->count; k++) {
        bool earlier = false;
        for (int i = 0; i < count; i++) {
            const held_box box =
                held_by(&windows[i], casters->centre + 2 * k, casters->half + 2 * k);
            if (box.share > 0.0) {
                add_box(casters, k, &box, &out[i]);
                out[i].needed += earlier ? 0.0 : casters->weight[k];
            }
            earlier = earlier || box.whole;
        }
    }
    for (int i = 0; i < count; i++) {
        for (int kind = 0; kind < 4; kind++) {
            out[i].layers[kind] *= windows[i].scale;
        }
    }
}

#define TOGETHER 64 /* casters that are gone through at once */

/* Boxes by their numbers: of many at once packed numbers are quicker than pairs. */
typedef struct box_lanes {
    double centre[2][TOGETHER], half[2][TOGETHER];
} box_lanes;

/* Whether a map holds something of a box along one side, by the box's middle there and how far it
 * reaches. Edge on a box has no width. */
static inline bool meets_along(double at, double reach) {
    const double low = at - reach > 0.0 ? at - reach : 0.0;
    const double high = at + reach < 1.0 ? at + reach : 1.0;
    return (high > low) | ((high == low) & !(reach > 0.0));
}

/* A value where boxes are held in part: by `held_by`, without its divisions and without a branch,
 * since which it is varies. */
static void put_where_met(const box_window *window, const box_lanes *boxes, int count, double value,
                          double *restrict out) {
    const double *u = window->turn[0], *v = window->turn[1];
    const double size_u[2] = {fabs(u[0]), fabs(u[1])}, size_v[2] = {fabs(v[0]), fabs(v[1])};
    for (int i = 0; i < count; i++) {
        const double x = boxes->centre[0][i], y = boxes->centre[1][i];
        const double wide = boxes->half[0][i], high = boxes->half[1][i];
        const bool along_u = meets_along(u[0] * x + u[1] * y + window->shift[0],
                                         size_u[0] * wide + size_u[1] * high);
        const bool along_v = meets_along(v[0] * x + v[1] * y + window->shift[1],
                                         size_v[0] * wide + size_v[1] * high);
        out[i] = along_u & along_v ? value : out[i];
    }
}

void csm_casters_first(const csm_casters *casters, int count, const double (*uvz_from_world)[16],
                       int *out) {
    box_window windows[CSM_MAX_CASCADES];
    for (int i = 0; i < count; i++) {
        windows[i] = window_of(casters, uvz_from_world[i]);
    }
    for (size_t first = 0; first < casters->count; first += TOGETHER) {
        const size_t left = casters->count - first;
        const int some = left < TOGETHER ? (int)left : TOGETHER;
        box_lanes boxes;
        double met[TOGETHER]; /* as numbers, which compilers pack */
        for (int k = 0; k < some; k++) {
            for (int axis = 0; axis < 2; axis++) {
                boxes.centre[axis][k] = casters->centre[2 * (first + (size_t)k) + (size_t)axis];
                boxes.half[axis][k] = casters->half[2 * (first + (size_t)k) + (size_t)axis];
            }
            met[k] = count;
        }
        for (int i = count - 1; i >= 0; i--) {
            put_where_met(&windows[i], &boxes, some, i, met);
        }
        for (int k = 0; k < some; k++) {
            out[first + (size_t)k] = (int)met[k];
        }
    }
}
