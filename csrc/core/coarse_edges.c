/* coarse_edges.c: where shadow edges run in a coarse picture, and which way.
 *
 * In: which pixels are judged and which of these are lit. Out: the dark pixel of each pair that an
 * edge separates. Its direction is that in which a binomial mean over 5 x 5 pixels grows: of the
 * edge, not of the stairs that pixels make of it. The means are whole numbers of 1/256.
 */
#include <math.h>
#include <stdlib.h>

#include "coarse.h"

#define MEAN 256.0 /* weights 1 4 6 4 1 along rows, and along columns */

static bool pair(const csm_coarse_picture *picture, size_t one, size_t other) {
    return picture->judged[one] & picture->judged[other] &
           (picture->lit[one] != picture->lit[other]);
}

size_t csm_coarse_edge_pairs(const csm_coarse_picture *picture) {
    const size_t width = (size_t)picture->camera->width, height = (size_t)picture->camera->height;
    size_t count = 0;
    for (size_t row = 0; row < height; row++) {
        unsigned pairs = 0;
        for (size_t i = row * width; i + 1 < (row + 1) * width; i++) {
            pairs += pair(picture, i, i + 1);
        }
        for (size_t i = row * width; row + 1 < height && i < (row + 1) * width; i++) {
            pairs += pair(picture, i, i + width);
        }
        count += pairs;
    }
    return count;
}

/* Every how many pairs one is looked at. */
static size_t edge_stride(size_t pairs) {
    const size_t stride = (pairs + CSM_COARSE_EDGES - 1) / CSM_COARSE_EDGES;
    return stride > 1 ? stride : 1;
}

size_t csm_coarse_edge_count(size_t pairs) {
    const size_t stride = edge_stride(pairs);
    return (pairs + stride - 1) / stride;
}

static int clamped(int place, int count) {
    return place < 0 ? 0 : place < count ? place : count - 1;
}

/* 256 times the mean round every pixel; the picture's border goes on outside. rows is for one row
 * with two more pixels at each end. */
static void smooth(const csm_coarse_picture *picture, uint16_t *rows, uint16_t *out) {
    const int width = picture->camera->width, height = picture->camera->height;
    for (int row = 0; row < height; row++) {
        const uint8_t *above[5];
        for (int k = 0; k < 5; k++) {
            above[k] = picture->lit + (size_t)clamped(row + k - 2, height) * (size_t)width;
        }
        uint16_t *sums = rows + 2;
        for (int i = 0; i < width; i++) {
            sums[i] = (uint16_t)(above[0][i] + above[4][i] + 4 * (above[1][i] + above[3][i]) +
                                 6 * above[2][i]);
        }
        sums[-1] = sums[-2] = sums[0];
        sums[width] = sums[width + 1] = sums[width - 1];
        uint16_t *mean = out + (size_t)row * (size_t)width;
        for (int i = 0; i < width; i++) {
            mean[i] = (uint16_t)(rows[i] + rows[i + 4] + 4 * (rows[i + 1] + rows[i + 3]) +
                                 6 * rows[i + 2]);
        }
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

csm_status csm_coarse_edges(const csm_coarse_picture *picture, double shrink, size_t pairs,
                            const csm_coarse_edge_arrays *out, csm_error *err) {
    const int width = picture->camera->width, height = picture->camera->height;
    const size_t pixels = (size_t)width * (size_t)height;
    uint16_t *mean = malloc((pixels + (size_t)width + 4) * sizeof *mean);
    if (!mean) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu pixels", pixels);
    }
    smooth(picture, mean + pixels, mean);
    const edge_look look = {picture, mean, shrink, edge_stride(pairs), out};
    size_t met = 0, k = 0;
    for (int axis = 0; axis < 2; axis++) {
        const size_t next = axis ? (size_t)width : 1;
        for (int row = 0; row < height - axis; row++) {
            for (int column = 0; column < width - 1 + axis; column++) {
                const size_t i = (size_t)row * (size_t)width + (size_t)column;
                if (pair(picture, i, i + next) && met++ % look.stride == 0) {
                    describe(&look, row, column, axis, k++);
                }
            }
        }
    }
    free(mean);
    return CSM_OK;
}
