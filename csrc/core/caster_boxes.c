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

static held_box held_by(const box_window *window, const double centre[2], const double half[2]) {
    held_box out = {.share = 1.0, .whole = true};
    for (int row = 0; row < 2; row++) {
        const double *turn = window->turn[row];
        const double at = turn[0] * centre[0] + turn[1] * centre[1] + window->shift[row];
        const double reach = fabs(turn[0]) * half[0] + fabs(turn[1]) * half[1];
        const double low = at - reach > 0.0 ? at - reach : 0.0;
        const double high = at + reach < 1.0 ? at + reach : 1.0;
        const double side = high - low, whole = 2.0 * reach;
        if (side < 0.0) {
            out.share = 0.0;
        } else if (whole > 0.0) { /* of what is seen edge on, boxes have no width */
            out.share *= (side < whole ? side : whole) / whole; /* by rounding it may be more */
        }
        out.whole = out.whole && side >= whole * (1.0 - 1e-12);
        out.sides[row] = side > 0.0 ? side : 0.0;
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

void csm_casters_first(const csm_casters *casters, int count, const double (*uvz_from_world)[16],
                       int *out) {
    box_window windows[CSM_MAX_CASCADES];
    for (int i = 0; i < count; i++) {
        windows[i] = window_of(casters, uvz_from_world[i]);
    }
    for (size_t k = 0; k < casters->count; k++) {
        int first = 0;
        while (first < count &&
               !(held_by(&windows[first], casters->centre + 2 * k, casters->half + 2 * k).share >
                 0.0)) {
            first++;
        }
        out[k] = first;
    }
}
