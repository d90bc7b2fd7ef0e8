/* coarse_thin.c: how much of what casts is at most two texels of a map across.
 *
 * In: maps. Out: a share. Millions of texels, so rows are gone through without a branch, in single
 * precision as the maps are.
 */
#include <math.h>

#include "csm.h"

#define JUMP 4.0 /* texels: something else lies so much farther off */

typedef struct thin_count {
    size_t thin, outline; /* outline: once along u and once along v */
} thin_count;

static inline float farther(float one, float other) {
    return one > other ? one : other;
}

static inline float nearer(float one, float other) {
    return one < other ? one : other;
}

/* Adds up one texel; left to above: the farther of the depths within two texels before and after
 * it, along u and v. */
static inline void count_texel(float depth, float left, float right, float below, float above,
                               float jump, int *thin, int *outline) {
    const float off = depth + jump;
    *thin += farther(nearer(left, right), nearer(below, above)) > off;
    *outline += farther(left, right) > off;
    *outline += farther(below, above) > off;
}

/* rows: the row and its neighbours, from two below to two above; first to end: columns that have
 * two neighbours on either side in the row. */
static void count_inner(const float *const rows[5], int first, int end, float jump, int *thin,
                        int *outline) {
    const float *restrict far_below = rows[0], *restrict below = rows[1], *restrict row = rows[2],
                          *restrict above = rows[3], *restrict far_above = rows[4];
    int here = 0, there = 0;
    for (int i = first; i < end; i++) {
        count_texel(row[i], farther(row[i - 1], row[i - 2]), farther(row[i + 1], row[i + 2]),
                    farther(below[i], far_below[i]), farther(above[i], far_above[i]), jump, &here,
                    &there);
    }
    *thin += here;
    *outline += there;
}

static int wrapped(int place, int size) {
    return ((place % size) + size) % size;
}

static void count_row(const float *depths, int size, int v, float jump, thin_count *count) {
    const float *rows[5];
    for (int k = 0; k < 5; k++) {
        rows[k] = depths + (size_t)wrapped(v + k - 2, size) * (size_t)size;
    }
    int thin = 0, outline = 0;
    count_inner(rows, 2, size - 2, jump, &thin, &outline);
    for (int k = 0; k < 4; k++) { /* the ends, which see each other */
        const int u = k < 2 ? k : size + k - 4;
        const float *row = rows[2];
        count_texel(row[u], farther(row[wrapped(u - 1, size)], row[wrapped(u - 2, size)]),
                    farther(row[wrapped(u + 1, size)], row[wrapped(u + 2, size)]),
                    farther(rows[1][u], rows[0][u]), farther(rows[3][u], rows[4][u]), jump, &thin,
                    &outline);
    }
    count->thin += (size_t)thin;
    count->outline += (size_t)outline;
}

double csm_coarse_thin_share(const csm_coarse_maps *maps) {
    thin_count count = {0, 0};
    for (int i = 0; i < maps->count; i++) {
        const float jump = (float)(JUMP * maps->texel[i] / maps->span[i]);
        for (int v = 0; v < maps->size[i]; v++) {
            count_row(maps->depths[i], maps->size[i], v, jump, &count);
        }
    }
    /* what is thin along one axis alone counts as half outline */
    return count.outline ? fmin(2.0 * (double)count.thin / (double)count.outline, 1.0) : 0.0;
}
