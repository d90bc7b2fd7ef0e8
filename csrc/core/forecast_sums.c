/* forecast_sums.c: what texels of many sizes miss, summed up over the points of a view.
 *
 * In: what a map of one texel makes of each point, and sides of maps. Out: a number a size. Sizes
 * are the inner loop: each has a sum of its own, in the order of the points.
 */
#include "csm.h"

#include <stdlib.h>

/* Sides' inverses, the sizes of a column one behind the other; NULL without memory. */
static double *inverses_of(const csm_sized *sized, csm_error *err) {
    const size_t sizes = sized->size_count, columns = sized->columns;
    double *out = malloc((sizes * columns + 1) * sizeof *out);
    if (!out) {
        csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu sizes of maps", sizes);
        return NULL;
    }
    for (size_t k = 0; k < sizes; k++) {
        for (size_t column = 0; column < columns; column++) {
            out[column * sizes + k] = 1.0 / sized->sides[k * columns + column];
        }
    }
    return out;
}

/* The same, and sums of nothing yet. */
static double *begin_sums(const csm_sized *sized, double *out, csm_error *err) {
    for (size_t k = 0; k < sized->size_count; k++) {
        out[k] = 0.0;
    }
    return inverses_of(sized, err);
}

static const double *column_of(const csm_sized *sized, const double *inverses, size_t point) {
    return sized->columns == 1 ? inverses
                               : inverses + (size_t)sized->window[point] * sized->size_count;
}

csm_status csm_sum_capped(const csm_sized *sized, const double *values, const double *weights,
                          double most, double *out, csm_error *err) {
    double *inverses = begin_sums(sized, out, err);
    if (!inverses) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    for (size_t i = 0; i < sized->point_count; i++) {
        const double *inverse = column_of(sized, inverses, i);
        const double value = values[i], weight = weights[i];
        for (size_t k = 0; k < sized->size_count; k++) {
            const double one = value * inverse[k];
            out[k] += weight * (one < most ? one : most);
        }
    }
    free(inverses);
    return CSM_OK;
}

csm_status csm_sum_missing(const csm_sized *sized, const double *values, const double *wide,
                           const double *weights, double *out, csm_error *err) {
    double *inverses = begin_sums(sized, out, err);
    if (!inverses) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    for (size_t i = 0; i < sized->point_count; i++) {
        const double *inverse = column_of(sized, inverses, i);
        const double value = values[i], width = wide[i], weight = weights[i];
        for (size_t k = 0; k < sized->size_count; k++) {
            const double missing = width - value * inverse[k];
            out[k] += weight * (missing > 0.0 ? missing : 0.0);
        }
    }
    free(inverses);
    return CSM_OK;
}

csm_status csm_count_less(const csm_sized *sized, const double *gaps, const double *values,
                          int64_t *out, csm_error *err) {
    double *inverses = inverses_of(sized, err);
    if (!inverses) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    double largest = 0.0;
    for (size_t k = 0; k < sized->size_count * sized->columns; k++) {
        largest = inverses[k] > largest ? inverses[k] : largest;
    }
    for (size_t k = 0; k < sized->size_count; k++) {
        out[k] = 0;
    }
    for (size_t i = 0; i < sized->point_count; i++) {
        const double value = values[i], gap = gaps[i];
        if (!(gap < value * largest)) { /* most: what is lit has no gap */
            continue;
        }
        const double *inverse = column_of(sized, inverses, i);
        for (size_t k = 0; k < sized->size_count; k++) {
            out[k] += gap < value * inverse[k];
        }
    }
    free(inverses);
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
