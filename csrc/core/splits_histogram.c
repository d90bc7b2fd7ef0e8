/* splits_histogram.c: cuts that give every cascade as many of the receivers.
 *
 * In: counts of the visible receivers over bins of depth, a part of the view range, the cuts of the
 * frame before. Out: splits at quantiles of the counts, rounded to rungs and held, so that they do
 * not wander with every frame. Partitions from the depth histogram: Lauritzen, Salvi, Lefohn 2011,
 * "Sample distribution shadow maps". docs/numerics.md 17.
 */
#include "placement.h"

#include <limits.h>
#include <math.h>

/* Cuts lie on rungs and half-way between: 2^(k / 8). */
#define CUTS_PER_RUNG 2

/* Receivers up to a place counted in bins, those of a bin spread evenly over it. */
static double count_up_to(const uint32_t histogram[CSM_DEPTH_BINS], double place) {
    double sum = 0.0;
    for (int bin = 0; bin < CSM_DEPTH_BINS && bin < place; bin++) {
        sum += histogram[bin] * fmin(place - bin, 1.0);
    }
    return sum;
}

/* The first place with that many receivers before it: a gap is left to the cascade behind it. */
static double place_of_count(const uint32_t histogram[CSM_DEPTH_BINS], double wanted) {
    double sum = 0.0;
    for (int bin = 0; bin < CSM_DEPTH_BINS; bin++) {
        if (histogram[bin] > 0 && sum + histogram[bin] >= wanted) {
            return bin + (wanted - sum) / histogram[bin];
        }
        sum += histogram[bin];
    }
    return CSM_DEPTH_BINS;
}

/* Whole steps for the inner cuts, ascending between the least and the greatest. */
static void put_in_order(int *steps, int count, int least, int greatest) {
    for (int i = 0; i < count; i++) {
        const int low = i == 0 ? least : steps[i - 1] + 1;
        steps[i] = steps[i] < low ? low : steps[i];
    }
    for (int i = count - 1; i >= 0; i--) {
        const int high = i == count - 1 ? greatest : steps[i + 1] - 1;
        steps[i] = steps[i] > high ? high : steps[i];
    }
}

csm_status csm_splits_histogram(const csm_cascades_desc *desc,
                                const uint32_t histogram[CSM_DEPTH_BINS], const csm_share *share,
                                double *out_splits, csm_hold *hold, csm_error *err) {
    const csm_camera *camera = &desc->camera;
    const double bins_per_cut =
        CSM_DEPTH_BINS / (CUTS_PER_RUNG * csm_rung_of(camera, camera->far_depth));
    const double low = CUTS_PER_RUNG * csm_rung_of(camera, share->near_depth);
    const double high = CUTS_PER_RUNG * csm_rung_of(camera, share->far_depth);
    /* ends that lie on a rung may come back a rounding beside it */
    const int least = (int)floor(low + 1e-6) + 1, greatest = (int)ceil(high - 1e-6) - 1;
    const double before = count_up_to(histogram, low * bins_per_cut);
    const double within = count_up_to(histogram, high * bins_per_cut) - before;
    const int inner = share->count - 1;
    if (!(within > 0.0) || greatest - least + 1 < inner) {
        const int scheme = camera->near_depth > 0.0 ? CSM_SPLIT_LOGARITHMIC : CSM_SPLIT_UNIFORM;
        return csm_splits_compute(share->near_depth, share->far_depth, share->count, scheme, 0.0,
                                  out_splits, err);
    }
    int *steps = hold->cut_step + share->first;
    for (int i = 0; i < inner; i++) {
        const double wanted = before + within * (i + 1) / share->count;
        const double cut = place_of_count(histogram, wanted) / bins_per_cut;
        const int held = desc->held ? desc->held->cut_step[share->first + i] : INT_MIN;
        steps[i] = fabs(held - cut) <= 1.0 ? held : (int)round(cut);
    }
    put_in_order(steps, inner, least, greatest);
    for (int i = 0; i < inner; i++) {
        out_splits[i + 1] = csm_rung_depth(camera, (double)steps[i] / CUTS_PER_RUNG);
    }
    out_splits[0] = share->near_depth;
    out_splits[share->count] = share->far_depth;
    return CSM_OK;
}
