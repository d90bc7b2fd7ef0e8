/* coarse_edges.c: where shadow edges run in a coarse picture, and which way.
 *
 * In: which pixels are judged and which of these are lit. Out: the dark pixel of each pair that an
 * edge separates. Its direction is that in which a binomial mean over 5 x 5 pixels grows: of the
 * edge, not of the stairs that pixels make of it. The means are whole numbers of 1/256.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coarse.h"

#define MEAN 256.0 /* weights 1 4 6 4 1 along rows, and along columns */

/* Which pixels of a row make a pair with the next ones: bytes. */
static void mark_pairs(const csm_coarse_picture *picture, size_t first, size_t next, int count,
                       uint8_t *restrict out) {
    const uint8_t *judged = picture->judged + first, *lit = picture->lit + first;
    const uint8_t *next_judged = judged + next, *next_lit = lit + next;
    for (int i = 0; i < count; i++) {
        out[i] = judged[i] & next_judged[i] & (lit[i] ^ next_lit[i]);
    }
}

#define TOGETHER 128 /* pixels of a row that are counted at once, in a byte */

static size_t count_pairs(const csm_coarse_picture *picture, size_t first, size_t next, int count) {
    size_t sum = 0;
    for (int at = 0; at < count; at += TOGETHER) {
        const int some = count - at < TOGETHER ? count - at : TOGETHER;
        uint8_t marked[TOGETHER], here = 0;
        mark_pairs(picture, first + (size_t)at, next, some, marked);
        for (int i = 0; i < some; i++) {
            here = (uint8_t)(here + marked[i]);
        }
        sum += here;
    }
    return sum;
}

size_t csm_coarse_edge_pairs(const csm_coarse_picture *picture) {
    const int width = picture->camera->width, height = picture->camera->height;
    size_t count = 0;
    for (int row = 0; row < height; row++) {
        const size_t first = (size_t)row * (size_t)width;
        count += count_pairs(picture, first, 1, width - 1);
        count += row + 1 < height ? count_pairs(picture, first, (size_t)width, width) : 0;
    }
    return count;
}

size_t csm_coarse_edge_count(size_t pairs) {
    return coarse_looked_at(pairs, CSM_COARSE_EDGES);
}

static int clamped(int place, int count) {
    return place < 0 ? 0 : place < count ? place : count - 1;
}

static void smooth_down(const uint8_t *const rows[5], int count, uint16_t *restrict out) {
    const uint8_t *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4];
    for (int i = 0; i < count; i++) {
        out[i] = (uint16_t)(a[i] + e[i] + 4 * (b[i] + d[i]) + 6 * c[i]);
    }
}

/* sums begins two before the first. */
static void smooth_along(const uint16_t *restrict sums, int count, uint16_t *restrict out) {
    for (int i = 0; i < count; i++) {
        out[i] =
            (uint16_t)(sums[i] + sums[i + 4] + 4 * (sums[i + 1] + sums[i + 3]) + 6 * sums[i + 2]);
    }
}

/* 256 times the mean round every pixel; the picture's border goes on outside. sums is for one row
 * with two more pixels at each end. */
static void smooth(const csm_coarse_picture *picture, uint16_t *sums, uint16_t *out) {
    const int width = picture->camera->width, height = picture->camera->height;
    for (int row = 0; row < height; row++) {
        const uint8_t *rows[5];
        for (int k = 0; k < 5; k++) {
            rows[k] = picture->lit + (size_t)clamped(row + k - 2, height) * (size_t)width;
        }
        smooth_down(rows, width, sums + 2);
        sums[0] = sums[1] = sums[2];
        sums[width + 2] = sums[width + 3] = sums[width + 1];
        smooth_along(sums, width, out + (size_t)row * (size_t)width);
    }
}

/* How it gets lighter along one side of the picture: central differences, one-sided at the ends. */
static double slope(const uint16_t *mean, int place, int count, size_t step) {
    const int before = place > 0, after = place + 1 < count;
    if (before + after == 0) {
        return 0.0;
    }
    const double rise = (double)mean[after * step] - (double)*(mean - before * step);
    return rise / MEAN / (before + after);
}

typedef struct edge_look {
    const csm_coarse_picture *picture;
    const uint16_t *mean;
    double shrink;
    size_t stride;
    const csm_coarse_edge_arrays *out;
} edge_look;

static void add_slope(const edge_look *look, int row, int column, double across[2]) {
    const int width = look->picture->camera->width;
    const uint16_t *mean = look->mean + (size_t)row * (size_t)width + column;
    across[0] += slope(mean, column, width, 1);
    across[1] += slope(mean, row, look->picture->camera->height, (size_t)width);
}

/* The edge between a pixel and the next along a row (axis 0) or down a column (axis 1). */
static void describe(const edge_look *look, int row, int column, int axis, size_t k) {
    const csm_coarse_picture *picture = look->picture;
    const csm_camera *camera = picture->camera;
    double across[2] = {0.0, 0.0};
    add_slope(look, row, column, across);
    add_slope(look, row + axis, column + 1 - axis, across);
    const double length = sqrt(across[0] * across[0] + across[1] * across[1]);
    for (int i = 0; i < 2; i++) {
        across[i] = length > 1e-9 ? across[i] / length : i == axis;
        look->out->across[k][i] = across[i];
    }
    if (picture->lit[(size_t)row * (size_t)camera->width + (size_t)column]) {
        row += axis;
        column += 1 - axis;
    }
    const size_t dark = (size_t)row * (size_t)camera->width + (size_t)column;
    look->out->row[k] = row;
    look->out->column[k] = column;
    look->out->length[k] = look->shrink * fabs(across[axis]) * (double)look->stride;
    coarse_point(camera, coarse_column_x(camera, column), coarse_row_y(camera, row),
                 picture->view_depth[dark], look->out->point[k]);
    for (int i = 0; i < 3; i++) {
        look->out->normal[k][i] = picture->normal[dark][i];
    }
}

/* The first marked pixel from one on; count if there is none. */
static int next_marked(const uint8_t *marked, int from, int count) {
    uint64_t eight = 0;
    while (from + 8 <= count && (memcpy(&eight, marked + from, sizeof eight), !eight)) {
        from += 8;
    }
    while (from < count && !marked[from]) {
        from++;
    }
    return from;
}

csm_status csm_coarse_edges(const csm_coarse_picture *picture, double shrink, size_t pairs,
                            const csm_coarse_edge_arrays *out, csm_error *err) {
    const int width = picture->camera->width, height = picture->camera->height;
    const size_t pixels = (size_t)width * (size_t)height;
    uint16_t *mean = malloc((pixels + (size_t)width + 4) * sizeof *mean);
    if (!mean) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu pixels", pixels);
    }
    uint16_t *sums = mean + pixels;
    smooth(picture, sums, mean);
    const edge_look look = {picture, mean, shrink, coarse_stride(pairs, CSM_COARSE_EDGES), out};
    size_t met = 0, k = 0;
    for (int axis = 0; axis < 2 && pairs; axis++) {
        for (int row = 0; row < height - axis; row++) {
            const int end = width - 1 + axis;
            for (int first = 0; first < end; first += TOGETHER) {
                const int count = end - first < TOGETHER ? end - first : TOGETHER;
                uint8_t marked[TOGETHER];
                mark_pairs(picture, (size_t)row * (size_t)width + (size_t)first,
                           axis ? (size_t)width : 1, count, marked);
                for (int i = next_marked(marked, 0, count); i < count;
                     i = next_marked(marked, i + 1, count)) {
                    if (met++ % look.stride == 0) {
                        describe(&look, row, first + i, axis, k++);
                    }
                }
            }
        }
    }
    free(mean);
    return CSM_OK;
}
