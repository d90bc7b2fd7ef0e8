/* caster_boxes.c: what casters lay on shadow maps: how often they cover them, with how many
 * triangles.
 *
 * In: triangles as boxes across the light, windows as matrices. Out: layers, outlines and counts of
 * each map.
 */
#include <float.h>
#include <stdlib.h>

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

static void take_block(const csm_casters *casters, size_t first, box_block *out) {
    const size_t rest = casters->count - first;
    out->first = first;
    out->count = rest < BLOCK ? (int)rest : BLOCK;
    for (int j = 0; j < out->count; j++) {
        for (int axis = 0; axis < 2; axis++) {
            out->centre[axis][j] = casters->centre[2 * (first + j) + axis];
            out->half[axis][j] = casters->half[2 * (first + j) + axis];
        }
        out->needed[j] = casters->weight[first + j];
    }
}

/* `held_side` of a whole block along one side of the map; -1 of what lies beyond it, or touches it
 * from without. What is seen edge on has no width, and is held all the same. */
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
    for (int j = 0; j < count; j++) {
        const double rest_u = u[j] >= whole_u[j] * (1.0 - 1e-12) ? 0.0 : 1.0;
        const double rest_v = v[j] >= whole_v[j] * (1.0 - 1e-12) ? 0.0 : 1.0;
        out->rest[j] = rest_u > rest_v ? rest_u : rest_v;
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

/* Whether a box is held in part. */
static bool meets(const box_window *window, const double *centre, const double *half) {
    bool out = true;
    for (int row = 0; row < 2; row++) {
        double whole;
        const double side = held_side(window, row, centre, half, &whole);
        out &= (side > 0.0) | ((side == 0.0) & !(whole > 0.0)); /* edge on there is no width */
    }
    return out;
}

void csm_casters_first(const csm_casters *casters, int count, const double (*uvz_from_world)[16],
                       int *out) {
    for (size_t k = 0; k < casters->count; k++) {
        out[k] = count;
    }
    for (int i = count - 1; i >= 0; i--) { /* all windows, without a branch: which it is varies */
        const box_window window = window_of(casters, uvz_from_world[i]);
        for (size_t k = 0; k < casters->count; k++) {
            out[k] = meets(&window, casters->centre + 2 * k, casters->half + 2 * k) ? i : out[k];
        }
    }
}

#define DIGIT 11 /* bits */
#define DIGITS 6
#define VALUES (1 << DIGIT)

typedef struct sorted_caster {
    uint64_t key;
    size_t number;
} sorted_caster;

static size_t digit_of(uint64_t key, int digit) {
    return key >> (DIGIT * digit) & (VALUES - 1);
}

/* Larger areas first. Bits of a positive number grow as it does. */
static uint64_t area_key(double area) {
    const double size = fabs(area);
    uint64_t bits;
    memcpy(&bits, &size, sizeof bits);
    return ~bits;
}

/* By places of counts, which are used up; those of one place stay in order. */
static void deal(const sorted_caster *from, size_t count, int digit, uint32_t counts[VALUES],
                 sorted_caster *to) {
    uint32_t sum = 0;
    for (int i = 0; i < VALUES; i++) {
        const uint32_t here = counts[i];
        counts[i] = sum;
        sum += here;
    }
    for (size_t k = 0; k < count; k++) {
        to[counts[digit_of(from[k].key, digit)]++] = from[k];
    }
}

csm_status csm_casters_order(size_t count, const double *area, const int *kind, int kinds,
                             int64_t *out, csm_error *err) {
    sorted_caster *from = malloc((2 * count + 1) * sizeof *from);
    uint32_t(*counts)[VALUES] = calloc(DIGITS, sizeof *counts);
    if (!from || !counts) {
        free(from);
        free(counts);
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu casters", count);
    }
    sorted_caster *const first = from, *to = from + count;
    size_t starts[CSM_MAX_CASCADES + 2] = {0};
    for (size_t k = 0; k < count; k++) {
        from[k] = (sorted_caster){area_key(area[k]), k};
        for (int digit = 0; digit < DIGITS; digit++) {
            counts[digit][digit_of(from[k].key, digit)]++;
        }
        starts[kind[k] + 1]++;
    }
    for (int digit = 0; digit < DIGITS; digit++) {
        if (count && counts[digit][digit_of(from[0].key, digit)] < count) { /* else all share it */
            deal(from, count, digit, counts[digit], to);
            sorted_caster *other = from;
            from = to;
            to = other;
        }
    }
    for (int i = 1; i < kinds; i++) {
        starts[i] += starts[i - 1];
    }
    for (size_t k = 0; k < count; k++) {
        out[starts[kind[from[k].number]]++] = (int64_t)from[k].number;
    }
    free(first);
    free(counts);
    return CSM_OK;
}
