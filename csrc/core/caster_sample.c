/* caster_sample.c: triangles of a scene across the light, and few of them that say as much.
 *
 * In: where corners of some thousands of triangles lie, windows as matrices. Out: their boxes;
 * numbers of those that are kept, and how many each of them stands for.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "csm.h"

static inline double least_of(double a, double b, double c) {
    const double low = a < b ? a : b;
    return low < c ? low : c;
}

static inline double most_of(double a, double b, double c) {
    const double high = a > b ? a : b;
    return high > c ? high : c;
}

/* Boxes of triangles along one axis, from where their corners lie; two numbers are one box. */
static void boxes_along(const double *along, size_t count, double *restrict centre,
                        double *restrict half) {
    const double *a = along, *b = along + count, *c = along + 2 * count;
    for (size_t i = 0; i < count; i++) {
        const double low = least_of(a[i], b[i], c[i]), high = most_of(a[i], b[i], c[i]);
        centre[2 * i] = 0.5 * (low + high);
        half[2 * i] = 0.5 * (high - low);
    }
}

void csm_casters_across(const csm_sample *sample, double (*centre)[2], double (*half)[2],
                        double *area) {
    const size_t count = sample->count;
    if (!count) {
        return;
    }
    for (int axis = 0; axis < 2; axis++) {
        boxes_along(sample->along[axis], count, *centre + axis, *half + axis);
    }
    /* the axes and the way to the light are a right-handed basis */
    const double *x = sample->along[0], *y = sample->along[1], *side = sample->side;
    for (size_t i = 0; i < count; i++) {
        const double x1 = x[count + i] - x[i], y1 = y[count + i] - y[i];
        const double x2 = x[2 * count + i] - x[i], y2 = y[2 * count + i] - y[i];
        area[i] = 0.5 * side[i] * (x1 * y2 - y1 * x2);
    }
}

#define DIGIT 11 /* bits */
#define DIGITS 3
#define VALUES (1 << DIGIT)
#define SHORT 64 /* casters that are sorted by insertion */

typedef struct sorted_caster {
    uint32_t key, number;
} sorted_caster;

/* Larger areas first: bits of a positive number grow as it does. The sign's bit is left out. */
static uint64_t area_key(double area) {
    uint64_t bits;
    memcpy(&bits, &area, sizeof bits);
    return ~(bits << 1);
}

static size_t digit_of(uint32_t key, int digit) {
    return key >> (DIGIT * digit) & (VALUES - 1);
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

/* By their keys, equal ones in order; other is as long. */
static void sort_keys(sorted_caster *casters, size_t count, sorted_caster *other) {
    uint32_t counts[DIGITS][VALUES] = {{0}};
    sorted_caster *from = casters, *to = other;
    for (size_t k = 0; k < count; k++) {
        for (int digit = 0; digit < DIGITS; digit++) {
            counts[digit][digit_of(casters[k].key, digit)]++;
        }
    }
    for (int digit = 0; digit < DIGITS; digit++) {
        if (counts[digit][digit_of(casters[0].key, digit)] < count) { /* else all share it */
            deal(from, count, digit, counts[digit], to);
            sorted_caster *swapped = from;
            from = to;
            to = swapped;
        }
    }
    if (from != casters) {
        memcpy(casters, from, count * sizeof *casters);
    }
}

/* Those whose keys, the upper half of their areas', are equal, by the lower half. */
static void sort_equals(const double *area, sorted_caster *casters, size_t count,
                        sorted_caster *other) {
    for (size_t k = 0; k < count; k++) {
        casters[k].key = (uint32_t)area_key(area[casters[k].number]);
    }
    if (count > SHORT) {
        sort_keys(casters, count, other);
        return;
    }
    for (size_t k = 1; k < count; k++) {
        const sorted_caster caster = casters[k];
        size_t at = k;
        for (; at > 0 && casters[at - 1].key > caster.key; at--) {
            casters[at] = casters[at - 1];
        }
        casters[at] = caster;
    }
}

/* Their numbers, kind by kind (0 to kinds - 1 <= CSM_MAX_CASCADES), of each the largest areas
 * first, equal ones in order. */
static csm_status order_casters(size_t count, const double *area, const int *kind, int kinds,
                                int64_t *out, csm_error *err) {
    sorted_caster *all = count > UINT32_MAX ? NULL : malloc((2 * count + 1) * sizeof *all);
    if (!all) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu casters", count);
    }
    size_t starts[CSM_MAX_CASCADES + 2] = {0};
    for (size_t k = 0; k < count; k++) {
        all[k] = (sorted_caster){(uint32_t)(area_key(area[k]) >> 32), (uint32_t)k};
        starts[kind[k] + 1]++;
    }
    for (int i = 1; i < kinds; i++) {
        starts[i] += starts[i - 1];
    }
    if (count) {
        sort_keys(all, count, all + count);
    }
    for (size_t k = 0; k < count;) { /* a run of equal keys each; keys behind it stay */
        size_t end = k + 1;
        while (end < count && all[end].key == all[k].key) {
            end++;
        }
        if (end - k > 1) {
            sort_equals(area, all + k, end - k, all + count);
        }
        k = end;
    }
    for (size_t k = 0; k < count; k++) {
        out[starts[kind[all[k].number]]++] = all[k].number;
    }
    free(all);
    return CSM_OK;
}

/* The few of one class, all of them in order. */
static size_t keep_all(const int *kind, size_t count, int class, csm_kept *out, size_t held) {
    for (size_t k = 0; k < count; k++) {
        if (kind[k] == class) {
            out->number[held] = (int64_t)k;
            out->weight[held++] = 1.0;
        }
    }
    return held;
}

/* The largest of one class, and of the others every so manieth. */
static size_t keep_some(const int64_t *among, size_t count, csm_kept *out, size_t held) {
    for (size_t k = 0; k < CSM_KEPT_LARGEST; k++) {
        out->number[held] = among[k];
        out->weight[held++] = 1.0;
    }
    const size_t others = count - CSM_KEPT_LARGEST, wanted = CSM_KEPT_MOST - CSM_KEPT_LARGEST;
    const size_t step = (others + wanted - 1) / wanted, first = step / 2;
    const size_t some = (others - first + step - 1) / step;
    for (size_t k = 0; k < some; k++) {
        out->number[held] = among[CSM_KEPT_LARGEST + first + k * step];
        out->weight[held++] = (double)others / (double)some;
    }
    return held;
}

csm_status csm_casters_thinned(const csm_casters *casters, int count,
                               const double (*uvz_from_world)[16], csm_kept *out, csm_error *err) {
    int *kind = malloc((casters->count + 1) * sizeof *kind);
    int64_t *order = malloc((casters->count + 1) * sizeof *order);
    csm_status status = CSM_OK;
    out->count = 0;
    if (!kind || !order) {
        status =
            csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu casters", casters->count);
    } else {
        csm_casters_first(casters, count, uvz_from_world, kind);
        status = order_casters(casters->count, casters->area, kind, count + 1, order, err);
    }
    size_t sizes[CSM_MAX_CASCADES + 1] = {0}, start = 0;
    for (size_t k = 0; status == CSM_OK && k < casters->count; k++) {
        sizes[kind[k]]++;
    }
    for (int class = 0; status == CSM_OK && class <= count; class ++) {
        out->count = sizes[class] <= CSM_KEPT_MOST
                         ? keep_all(kind, sizes[class] ? casters->count : 0, class, out, out->count)
                         : keep_some(order + start, sizes[class], out, out->count);
        start += sizes[class];
    }
    free(kind);
    free(order);
    return status;
}
