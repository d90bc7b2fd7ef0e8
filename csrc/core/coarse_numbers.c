/* coarse_numbers.c: percentiles and histograms of what was read, and how surfaces lie in a picture.
 *
 * In: some thousands of numbers or points. Out: a few numbers, or four of each point.
 */
#include <math.h>
#include <stdlib.h>

#include "csm.h"
#include "linalg.h"

#define FEW 16 /* numbers that are sorted by insertion */

static void sort_few(double *values, size_t count) {
    for (size_t i = 1; i < count; i++) {
        const double value = values[i];
        size_t at = i;
        for (; at > 0 && values[at - 1] > value; at--) {
            values[at] = values[at - 1];
        }
        values[at] = value;
    }
}

static double middle_of(double a, double b, double c) {
    const double low = a < b ? a : b, high = a < b ? b : a;
    return c < low ? low : c > high ? high : c;
}

/* Those below a pivot (or that are no more than it) first, without a branch; returns how many. */
static size_t part(double *values, size_t count, double pivot, bool equal) {
    size_t below = 0;
    for (size_t i = 0; i < count; i++) {
        const double value = values[i];
        values[i] = values[below];
        values[below] = value;
        below += (value < pivot) | (equal & (value == pivot));
    }
    return below;
}

/* Numbers in order at a rank: no smaller one after it, no greater one before. None is NAN. */
static void select_rank(double *values, size_t count, size_t rank) {
    while (count > FEW) {
        const double pivot = middle_of(values[0], values[count / 2], values[count - 1]);
        size_t below = part(values, count, pivot, false);
        if (rank >= below) { /* there the pivot is, maybe many times */
            values += below;
            count -= below;
            rank -= below;
            below = part(values, count, pivot, true);
            if (rank < below) {
                return;
            }
            values += below;
            count -= below;
            rank -= below;
        } else {
            count = below;
        }
    }
    sort_few(values, count);
}

/* Those that are numbers first; returns how many. */
static size_t copy_numbers(const double *values, size_t count, double *out) {
    size_t numbers = 0;
    for (size_t i = 0; i < count; i++) {
        out[numbers] = values[i];
        numbers += values[i] == values[i];
    }
    for (size_t i = numbers; i < count; i++) {
        out[i] = NAN;
    }
    return numbers;
}

/* The least of some; NAN of none. */
static double least_of(const double *values, size_t count) {
    double least = count ? values[0] : NAN;
    for (size_t i = 1; i < count; i++) {
        least = values[i] < least ? values[i] : least;
    }
    return least;
}

csm_status csm_percentiles(size_t count, const double *values, size_t at_count, const double *at,
                           double *out, csm_error *err) {
    double *ordered = malloc((count + 1) * sizeof *ordered);
    if (!ordered) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu numbers", count);
    }
    const size_t numbers = copy_numbers(values, count, ordered);
    size_t from = 0; /* none before it is greater than any from it on */
    for (size_t i = 0; i < at_count; i++) {
        const double place = count ? at[i] / 100.0 * (double)(count - 1) : 0.0;
        const size_t below = (size_t)place;
        const double share = place - (double)below;
        from = below < from ? 0 : from;
        if (below < numbers) {
            select_rank(ordered + from, numbers - from, below - from);
            from = below;
        }
        const double low = count ? ordered[below] : 0.0;
        /* from the nearer of both, so that none leaves their range */
        const double high =
            below + 1 < count
                ? least_of(ordered + below + 1, below + 1 < numbers ? numbers - below - 1 : 0)
                : low;
        out[i] = share < 0.5 ? low + (high - low) * share : high - (high - low) * (1.0 - share);
    }
    free(ordered);
    return CSM_OK;
}

/* How many are no less than each of some edges. */
static void count_from(const double *values, size_t count, const double *edges, int edge_count,
                       int64_t *out) {
    for (int k = 0; k < edge_count; k++) {
        int64_t sum = 0;
        for (size_t i = 0; i < count; i++) {
            sum += values[i] >= edges[k];
        }
        out[k] = sum;
    }
}

void csm_depth_histogram(size_t count, const double *depths, double edges[CSM_COARSE_BINS + 1],
                         int64_t counts[CSM_COARSE_BINS]) {
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        low = depths[i] < low ? depths[i] : low;
        high = depths[i] > high ? depths[i] : high;
    }
    low = count ? low : 1.0;
    high = fmax(count ? high : 1.0, low * (1.0 + 1e-9)); /* a range, of one depth too */
    const double from = log10(low), step = (log10(high) - from) / CSM_COARSE_BINS;
    edges[0] = low;
    edges[CSM_COARSE_BINS] = high;
    for (int k = 1; k < CSM_COARSE_BINS; k++) {
        edges[k] = pow(10.0, k * step + from);
    }
    int64_t beyond[CSM_COARSE_BINS];
    count_from(depths, count, edges + 1, CSM_COARSE_BINS - 1, beyond);
    for (int k = 0; k < CSM_COARSE_BINS; k++) {
        counts[k] =
            (k ? beyond[k - 1] : (int64_t)count) - (k < CSM_COARSE_BINS - 1 ? beyond[k] : 0);
    }
}

/* How two steps along a surface move a point in the picture, in units of the picture plane. */
static void move_in_plane(const csm_camera *camera, const double point[3], double step[2][3],
                          double out[2][2]) {
    const double *across[2] = {camera->right, camera->up};
    for (int a = 0; a < 2; a++) {
        for (int k = 0; k < 2; k++) {
            out[a][k] = vec3_dot(across[a], step[k]);
        }
    }
    if (camera->orthographic) {
        return;
    }
    /* d(x / z) = (dx - (x / z) dz) / z */
    double relative[3];
    for (int i = 0; i < 3; i++) {
        relative[i] = point[i] - camera->eye[i];
    }
    const double depth = -vec3_dot(relative, camera->backward);
    for (int a = 0; a < 2; a++) {
        const double slant = vec3_dot(relative, across[a]) / depth;
        for (int k = 0; k < 2; k++) {
            out[a][k] = (out[a][k] + slant * vec3_dot(step[k], camera->backward)) / depth;
        }
    }
}

void csm_surface_steps(const csm_camera *camera, size_t count, const double (*points)[3],
                       const double (*normals)[3], const double gradients[2][3],
                       double (*out)[2][2]) {
    const double pixels[2] = {0.5 * camera->width / camera->half_width,
                              -0.5 * camera->height / camera->half_height};
    for (size_t i = 0; i < count; i++) {
        double step[2][3], moved[2][2];
        vec3_cross(gradients[1], normals[i], step[0]);
        vec3_cross(normals[i], gradients[0], step[1]);
        double volume = vec3_dot(gradients[0], step[0]);
        volume = volume == 0.0 ? 1e-300 : volume; /* seen edge on from there: endlessly far */
        for (int k = 0; k < 6; k++) {
            step[k / 3][k % 3] /= volume;
        }
        move_in_plane(camera, points[i], step, moved);
        for (int k = 0; k < 4; k++) {
            out[i][k / 2][k % 2] = pixels[k / 2] * moved[k / 2][k % 2];
        }
    }
}
