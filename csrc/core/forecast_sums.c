/* forecast_sums.c: what texels of many sizes miss, summed up over the points of a view.
 *
 * In: what a map of one texel makes of each point, and sides of maps. Out: a number a size. Some
 * sizes at a time are the inner loop: each has a sum of its own, in the order of the points, so
 * that none hangs on what other sizes are asked about.
 */
#include "csm.h"

#include <math.h>
#include <stdlib.h>

enum { LANES = 6 }; /* sizes at a time, whose sums stay in registers */

/* Sides' inverses: of LANES sizes the columns one behind the other, then of the next ones; and the
 * largest and the least of them. */
typedef struct inverse_sides {
    double *values;
    double most, least;
} inverse_sides;

static csm_status invert_sides(const csm_sized *sized, inverse_sides *out, csm_error *err) {
    const size_t sizes = sized->size_count, columns = sized->columns;
    const size_t blocks = (sizes + LANES - 1) / LANES;
    *out = (inverse_sides){calloc(blocks * LANES * columns + 1, sizeof(double)), 0.0, INFINITY};
    if (!out->values) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu sizes of maps", sizes);
    }
    for (size_t k = 0; k < sizes; k++) {
        double *row = out->values + k / LANES * LANES * columns + k % LANES;
        for (size_t column = 0; column < columns; column++) {
            const double inverse = 1.0 / sized->sides[k * columns + column];
            row[column * LANES] = inverse;
            out->most = inverse > out->most ? inverse : out->most;
            out->least = inverse < out->least ? inverse : out->least;
        }
    }
    return CSM_OK;
}

/* Those of sizes `k` and following under which a point lies. */
static const double *inverses_at(const csm_sized *sized, const inverse_sides *from, size_t k,
                                 size_t point) {
    const size_t column = sized->columns == 1 ? 0 : (size_t)sized->window[point];
    return from->values + k * sized->columns + column * LANES;
}

/* Sums of sizes `k` and following to where they belong. */
static void put_sums(const csm_sized *sized, const double sums[LANES], size_t k, double *out) {
    for (size_t lane = 0; lane < LANES && k + lane < sized->size_count; lane++) {
        out[k + lane] = sums[lane];
    }
}

csm_status csm_sum_capped(const csm_sized *sized, const double *values, const double *weights,
                          double most, double *out, csm_error *err) {
    inverse_sides sides;
    if (invert_sides(sized, &sides, err) != CSM_OK) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    for (size_t k = 0; k < sized->size_count; k += LANES) {
        double sums[LANES] = {0.0};
        for (size_t i = 0; i < sized->point_count; i++) {
            const double *inverse = inverses_at(sized, &sides, k, i);
            const double value = weights[i] * values[i], cap = weights[i] * most;
            for (int lane = 0; lane < LANES; lane++) {
                const double one = value * inverse[lane];
                sums[lane] += one < cap ? one : cap;
            }
        }
        put_sums(sized, sums, k, out);
    }
    free(sides.values);
    return CSM_OK;
}

csm_status csm_sum_missing(const csm_sized *sized, const double *values, const double *wide,
                           const double *weights, double *out, csm_error *err) {
    inverse_sides sides;
    if (invert_sides(sized, &sides, err) != CSM_OK) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    for (size_t k = 0; k < sized->size_count; k += LANES) {
        double sums[LANES] = {0.0};
        for (size_t i = 0; i < sized->point_count; i++) {
            if (!(wide[i] > values[i] * sides.least)) { /* most: kernels hold what is wide */
                continue;
            }
            const double *inverse = inverses_at(sized, &sides, k, i);
            const double value = values[i], width = wide[i], weight = weights[i];
            for (int lane = 0; lane < LANES; lane++) {
                const double missing = width - value * inverse[lane];
                sums[lane] += weight * (missing > 0.0 ? missing : 0.0);
            }
        }
        put_sums(sized, sums, k, out);
    }
    free(sides.values);
    return CSM_OK;
}

csm_status csm_count_less(const csm_sized *sized, const double *gaps, const double *values,
                          int64_t *out, csm_error *err) {
    inverse_sides sides;
    if (invert_sides(sized, &sides, err) != CSM_OK) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    for (size_t k = 0; k < sized->size_count; k++) {
        out[k] = 0;
    }
    for (size_t i = 0; i < sized->point_count; i++) {
        const double value = values[i], gap = gaps[i];
        if (!(gap < value * sides.most)) { /* most: what is lit has no gap */
            continue;
        }
        for (size_t k = 0; k < sized->size_count; k++) {
            out[k] += gap < value * inverses_at(sized, &sides, k / LANES * LANES, i)[k % LANES];
        }
    }
    free(sides.values);
    return CSM_OK;
}

/* The sum falls along straight lines that get ever flatter, so that a tangent meets `allowed`
 * before the sum does: Newton's steps from 0 never pass the answer, and end on its line. */
double csm_least_part(size_t count, const double *values, const double *wide, const double *weights,
                      double allowed) {
    double part = 0.0;
    for (;;) {
        double left = 0.0, slope = 0.0;
        for (size_t i = 0; i < count; i++) {
            const double value = values[i] > 1e-12 ? values[i] : 1e-12;
            const double missing = wide[i] - part * value;
            if (missing > 0.0) {
                left += weights[i] * missing;
                slope += weights[i] * value;
            }
        }
        const double next = left > allowed ? part + (left - allowed) / slope : part;
        if (!(next > part * (1.0 + 0x1p-50))) { /* there, but for rounding */
            return next;
        }
        part = next;
    }
}
