/* forecast_sums.c: what texels of many sizes miss, summed up over the points of a view.
 *
 * In: what a map of one texel makes of each point, and sides of maps. Out: a number a size. What a
 * point adds has a bend, on one side of which it goes with the inverse of the side. Most points lie
 * on the same side of it under all sizes: their factors are summed up, once for all sizes.
 */
#include "csm.h"

#include <math.h>
#include <stdlib.h>

/* Of one column: inverses of its sides, the largest and the least of them, and the sums of points
 * that no size bends: `constant` + `linear` times the inverse. */
typedef struct size_column {
    const double *inverses;
    double most, least, constant, linear;
} size_column;

/* A column for each of `sized`, over inverses that lie behind them; NULL without memory. */
static size_column *columns_of(const csm_sized *sized, csm_error *err) {
    const size_t sizes = sized->size_count, columns = sized->columns;
    size_column *out = malloc(columns * sizeof *out + (sizes * columns + 1) * sizeof(double));
    if (!out) {
        csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu sizes of maps", sizes);
        return NULL;
    }
    double *inverses = (double *)(out + columns);
    for (size_t column = 0; column < columns; column++, inverses += sizes) {
        out[column] = (size_column){.inverses = inverses, .least = INFINITY};
        for (size_t k = 0; k < sizes; k++) {
            const double inverse = 1.0 / sized->sides[k * columns + column];
            inverses[k] = inverse;
            out[column].most = inverse > out[column].most ? inverse : out[column].most;
            out[column].least = inverse < out[column].least ? inverse : out[column].least;
        }
    }
    return out;
}

static size_column *column_of(const csm_sized *sized, size_column *columns, size_t point) {
    return sized->columns == 1 ? columns : columns + sized->window[point];
}

static void clear_sums(const csm_sized *sized, double *out) {
    for (size_t k = 0; k < sized->size_count; k++) {
        out[k] = 0.0;
    }
}

/* Adds what no size bends, and lets go of the columns. */
static csm_status finish_sums(const csm_sized *sized, size_column *columns, double *out) {
    for (size_t column = 0; column < sized->columns; column++) {
        const size_column *from = &columns[column];
        for (size_t k = 0; k < sized->size_count; k++) {
            const double whole = from->constant + from->linear * from->inverses[k];
            out[k] += whole > 0.0 ? whole : 0.0; /* below by rounding */
        }
    }
    free(columns);
    return CSM_OK;
}

csm_status csm_sum_capped(const csm_sized *sized, const double *values, const double *weights,
                          double most, double *out, csm_error *err) {
    size_column *columns = columns_of(sized, err);
    if (!columns) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    clear_sums(sized, out);
    for (size_t i = 0; i < sized->point_count; i++) {
        size_column *column = column_of(sized, columns, i);
        const double value = values[i], weight = weights[i];
        if (value * column->most <= most) {
            column->linear += weight * value;
            continue;
        }
        for (size_t k = 0; k < sized->size_count; k++) {
            const double one = value * column->inverses[k];
            out[k] += weight * (one < most ? one : most);
        }
    }
    return finish_sums(sized, columns, out);
}

csm_status csm_sum_missing(const csm_sized *sized, const double *values, const double *wide,
                           const double *weights, double *out, csm_error *err) {
    size_column *columns = columns_of(sized, err);
    if (!columns) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    clear_sums(sized, out);
    for (size_t i = 0; i < sized->point_count; i++) {
        size_column *column = column_of(sized, columns, i);
        const double value = values[i], width = wide[i], weight = weights[i];
        if (!(width > value * column->least)) { /* not under any size */
            continue;
        }
        if (width >= value * column->most) {
            column->constant += weight * width;
            column->linear -= weight * value;
            continue;
        }
        for (size_t k = 0; k < sized->size_count; k++) {
            const double missing = width - value * column->inverses[k];
            out[k] += weight * (missing > 0.0 ? missing : 0.0);
        }
    }
    return finish_sums(sized, columns, out);
}

csm_status csm_count_less(const csm_sized *sized, const double *gaps, const double *values,
                          int64_t *out, csm_error *err) {
    size_column *columns = columns_of(sized, err);
    if (!columns) {
        return CSM_ERROR_OUT_OF_MEMORY;
    }
    for (size_t k = 0; k < sized->size_count; k++) {
        out[k] = 0;
    }
    for (size_t i = 0; i < sized->point_count; i++) {
        const size_column *column = column_of(sized, columns, i);
        const double value = values[i], gap = gaps[i];
        if (!(gap < value * column->most)) { /* most: what is lit has no gap */
            continue;
        }
        for (size_t k = 0; k < sized->size_count; k++) {
            out[k] += gap < value * column->inverses[k];
        }
    }
    free(columns);
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
