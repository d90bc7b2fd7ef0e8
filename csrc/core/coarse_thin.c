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

/* Adds up one texel: whether what lies within two texels before and after it, along u and v, is
 * farther off. Sums of comparisons, not choices between depths: of those GCC 13 makes branches, and
 * the loop takes seven times as long. */
static inline void count_texel(float off, const float left[2], const float right[2],
                               const float below[2], const float above[2], int *thin,
                               int *outline) {
    const int before = (left[0] > off) | (left[1] > off);
    const int after = (right[0] > off) | (right[1] > off);
    const int under = (below[0] > off) | (below[1] > off);
    const int over = (above[0] > off) | (above[1] > off);
    *thin += (before & after) | (under & over);
    *outline += (before | after) + (under | over);
}

/* rows: the row and its neighbours, from two below to two above; first to end: columns that have
 * two neighbours on either side in the row. */
static void count_inner(const float *const rows[5], int first, int end, float jump, int *thin,
                        int *outline) {
    const float *restrict far_below = rows[0], *restrict below = rows[1], *restrict row = rows[2],
                          *restrict above = rows[3], *restrict far_above = rows[4];
    int here = 0, there = 0;
    for (int i = first; i < end; i++) {
        count_texel(row[i] + jump, (const float[]){row[i - 1], row[i - 2]},
                    (const float[]){row[i + 1], row[i + 2]},
                    (const float[]){below[i], far_below[i]},
                    (const float[]){above[i], far_above[i]}, &here, &there);
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
        count_texel(row[u] + jump,
                    (const float[]){row[wrapped(u - 1, size)], row[wrapped(u - 2, size)]},
                    (const float[]){row[wrapped(u + 1, size)], row[wrapped(u + 2, size)]},
                    (const float[]){rows[1][u], rows[0][u]},
                    (const float[]){rows[3][u], rows[4][u]}, &thin, &outline);
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
