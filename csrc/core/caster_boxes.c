/* caster_boxes.c: what casters lay on shadow maps: how often they cover them, with how many
 * triangles.
 *
 * In: triangles as boxes across the light, windows as matrices. Out: layers, outlines and counts of
 * each map.
 */
#include <float.h>

#include "linalg.h"

#include "csm.h"

/* A window seen from the plane of the casters' axes. */
typedef struct box_window {
    double turn[2][2], shift[2]; /* u and v of a place in the plane */
    double scale;                /* maps that make a square metre */
} box_window;

enum { BLOCK = 128 };

/* Some boxes at a time, their numbers side by side so that loops over them are vectorised; and what
 * a map holds of them along u and v, below 0 of one beyond it. */
typedef struct box_block {
    size_t first;
    int count;
    double centre[2][BLOCK], half[2][BLOCK];
    double held[2][BLOCK], whole[2][BLOCK]; /* parts of the map's sides; the whole of the box */
    double needed[BLOCK];                   /* triangles that no earlier map holds wholly */
} box_block;

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

static void take_block(const csm_casters *casters, size_t first, box_block *out) {
    const size_t rest = casters->count - first;
    out->first = first;
    out->count = rest < BLOCK ? (int)rest : BLOCK;
    for (int j = 0; j < out->count; j++) {
        for (int axis = 0; axis < 2; axis++) {
            out->centre[axis][j] = casters->centre[2 * (first + j) + axis];
            out->half[axis][j] = casters->half[2 * (first + j) + axis];
        }
    }
}

/* What a map holds of the boxes of a block along u or v, and the whole of each box: -1 of what lies
 * beyond the map, or touches it from without. What is seen edge on has no width, and is held all
 * the same. */
static void hold_block(const box_window *window, int row, const box_block *block,
                       double *restrict held, double *restrict whole) {
    const double u = window->turn[row][0], v = window->turn[row][1], shift = window->shift[row];
    const double *x = block->centre[0], *y = block->centre[1];
    const double *half_x = block->half[0], *half_y = block->half[1];
    for (int j = 0; j < BLOCK; j++) { /* beyond `count` what lies there, which nobody reads */
        const double at = u * x[j] + v * y[j] + shift;
        const double reach = fabs(u) * half_x[j] + fabs(v) * half_y[j];
        const double low = at - reach > 0.0 ? at - reach : 0.0;
        const double high = at + reach < 1.0 ? at + reach : 1.0;
        const double least = reach > 0.0 ? DBL_TRUE_MIN : 0.0;
        held[j] = high - low >= least ? high - low : -1.0;
        whole[j] = 2.0 * reach;
    }
}

/* Numbers of the boxes that a map holds in part. */
static int held_in_part(const box_block *block, int out[BLOCK]) {
    int count = 0;
    for (int j = 0; j < block->count; j++) {
        out[count] = j; /* without a branch: which they are varies */
        count += (block->held[0][j] >= 0.0) & (block->held[1][j] >= 0.0);
    }
    return count;
}

/* Of boxes that a map holds in part: the part, once round it by a half, and whether it is all. */
typedef struct held_boxes {
    double sides[2][BLOCK], whole[2][BLOCK], share[BLOCK], line[BLOCK], rest[BLOCK];
} held_boxes;

/* `rest`: 0 where the map holds all of a box, else 1. */
static void measure_held(const box_block *block, const int *among, int count, held_boxes *out) {
    for (int j = 0; j < count; j++) {
        for (int row = 0; row < 2; row++) {
            out->sides[row][j] = block->held[row][among[j]];
            out->whole[row][j] = block->whole[row][among[j]];
        }
    }
    const double *u = out->sides[0], *v = out->sides[1];
    const double *whole_u = out->whole[0], *whole_v = out->whole[1];
    for (int j = 0; j < count; j++) { /* by rounding a part may be more; edge on both are 0 */
        const double share_u = u[j] < whole_u[j] ? u[j] / whole_u[j] : 1.0;
        const double share_v = v[j] < whole_v[j] ? v[j] / whole_v[j] : 1.0;
        out->share[j] = share_u * share_v;
    }
    for (int j = 0; j < count; j++) {
        out->line[j] = 2.0 * sqrt(u[j] * u[j] + v[j] * v[j]);
    }
    for (int j = 0; j < count; j++) { /* by comparisons, of which GCC 13 makes no branches */
        const int rest_u = u[j] < whole_u[j] * (1.0 - 1e-12);
        const int rest_v = v[j] < whole_v[j] * (1.0 - 1e-12);
        out->rest[j] = rest_u | rest_v ? 1.0 : 0.0;
    }
}

static void add_held(const csm_casters *casters, box_block *block, const int *among, int count,
                     csm_caster_load *out) {
    held_boxes held;
    measure_held(block, among, count, &held);
    for (int j = 0; j < count; j++) {
        const size_t k = block->first + (size_t)among[j];
        const double weight = casters->weight[k], area = casters->area[k];
        const int kind = 2 * (area < 0.0) + casters->cut[k];
        out->layers[kind] += weight * held.share[j] * fabs(area);
        /* a triangle that is cut off keeps no more outline than goes round what is left of its
         * box */
        out->lines[kind] += weight * held.line[j];
        out->triangles += weight;
        out->needed += block->needed[among[j]];
        block->needed[among[j]] *= held.rest[j];
    }
}

void csm_casters_load(const csm_casters *casters, int count, const double (*uvz_from_world)[16],
                      csm_caster_load *out) {
    box_window windows[CSM_MAX_CASCADES];
    box_block block = {0};
    memset(out, 0, (size_t)count * sizeof *out);
    for (int i = 0; i < count; i++) {
        windows[i] = window_of(casters, uvz_from_world[i]);
    }
    for (size_t first = 0; first < casters->count; first += BLOCK) {
        take_block(casters, first, &block);
        memcpy(block.needed, casters->weight + first, (size_t)block.count * sizeof *block.needed);
        for (int i = 0; i < count; i++) {
            int among[BLOCK];
            for (int row = 0; row < 2; row++) {
                hold_block(&windows[i], row, &block, block.held[row], block.whole[row]);
            }
            const int met = held_in_part(&block, among);
            add_held(casters, &block, among, met, &out[i]);
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
    box_block block = {0};
    for (int i = 0; i < count; i++) {
        windows[i] = window_of(casters, uvz_from_world[i]);
    }
    for (size_t first = 0; first < casters->count; first += BLOCK) {
        double met[BLOCK]; /* numbers like those that they hang on: in vectors */
        take_block(casters, first, &block);
        for (int j = 0; j < BLOCK; j++) {
            met[j] = count;
        }
        for (int i = count - 1; i >= 0; i--) {
            for (int row = 0; row < 2; row++) {
                hold_block(&windows[i], row, &block, block.held[row], block.whole[row]);
            }
            for (int j = 0; j < BLOCK; j++) {
                const double held =
                    block.held[0][j] < block.held[1][j] ? block.held[0][j] : block.held[1][j];
                met[j] = held >= 0.0 ? i : met[j];
            }
        }
        for (int j = 0; j < block.count; j++) {
            out[first + (size_t)j] = (int)met[j];
        }
    }
}
