/* splits.c: where the view range is cut into cascades.
 *
 * In: near and far view depth [m], cascade count, scheme. Out: count + 1 view depths, ascending.
 * Practical scheme: Zhang, Sun, Xu, Lun 2006, "Parallel-split shadow maps for large-scale virtual
 * environments"; lambda 0 is uniform, 1 is logarithmic.
 */
#include "placement.h"

#include <float.h>
#include <math.h>

static csm_status check_arguments(double near_depth, double far_depth, int count, int scheme,
                                  double lam, csm_error *err) {
    if (scheme != CSM_SPLIT_PRACTICAL && scheme != CSM_SPLIT_UNIFORM &&
        scheme != CSM_SPLIT_LOGARITHMIC) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "scheme must be practical, uniform or logarithmic (got number %d)", scheme);
    }
    if (count < 1 || count > CSM_MAX_CASCADES) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT, "count must be 1 to %d (got %d)",
                        CSM_MAX_CASCADES, count);
    }
    if (!isfinite(near_depth) || !isfinite(far_depth)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "near and far must be finite (got near %g, far %g)", near_depth, far_depth);
    }
    if (!(far_depth > near_depth)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT, "far must be > near (got near %g, far %g)",
                        near_depth, far_depth);
    }
    const bool linear =
        scheme == CSM_SPLIT_UNIFORM || (scheme == CSM_SPLIT_PRACTICAL && lam == 0.0);
    if (!linear && !(near_depth > 0.0)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "near must be > 0 for split %s (got near %g); uniform and manual splits "
                        "take any near",
                        scheme == CSM_SPLIT_PRACTICAL ? "practical" : "logarithmic", near_depth);
    }
    if (!(lam >= 0.0 && lam <= 1.0)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT, "lam must be 0 to 1 (got %g)", lam);
    }
    return CSM_OK;
}

csm_status csm_splits_compute(double near_depth, double far_depth, int count, int scheme,
                              double lam, double *out_splits, csm_error *err) {
    const csm_status status = check_arguments(near_depth, far_depth, count, scheme, lam, err);
    if (status != CSM_OK) {
        return status;
    }
    const double weight = scheme == CSM_SPLIT_UNIFORM       ? 0.0
                          : scheme == CSM_SPLIT_LOGARITHMIC ? 1.0
                                                            : lam;
    /* The log of the quotient: a difference of logs loses digits where far is close to near. */
    const double log_ratio = weight > 0.0 ? log(far_depth / near_depth) : 0.0;
    for (int i = 1; i < count; i++) {
        const double share = (double)i / count;
        const double uniform = near_depth + (far_depth - near_depth) * share;
        const double logarithmic = weight > 0.0 ? near_depth * exp(share * log_ratio) : 0.0;
        out_splits[i] = weight * logarithmic + (1.0 - weight) * uniform;
    }
    out_splits[0] = near_depth;
    out_splits[count] = far_depth;
    for (int i = 0; i < count; i++) {
        if (!(out_splits[i] < out_splits[i + 1])) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "near and far leave no room for count = %d different distances in "
                            "double precision (got near %.17g, far %.17g)",
                            count, near_depth, far_depth);
        }
    }
    return CSM_OK;
}

static double range_of_step(double near_depth, int step) {
    return near_depth * exp2(step / 4.0);
}

double csm_range_round_up(double near_depth, double depth, int held_step, int *out_step) {
    /* The logarithm only finds the neighbourhood; the powers themselves decide. Step 1 is the
     * least, so that far stays beyond near. */
    const double steps = ceil(4.0 * log2(fmax(depth, near_depth) / near_depth));
    int step = (int)fmin(fmax(steps, 1.0), 4.0 * (DBL_MAX_EXP - DBL_MIN_EXP + DBL_MANT_DIG));
    while (range_of_step(near_depth, step) < depth) {
        step++;
    }
    while (step > 1 && range_of_step(near_depth, step - 1) >= depth) {
        step--;
    }
    if (held_step == step + 1) {
        step = held_step;
    }
    *out_step = step;
    return range_of_step(near_depth, step);
}

double csm_rung_depth(const csm_camera *camera, double rung) {
    const double near_depth = camera->near_depth;
    return near_depth > 0.0 ? near_depth * exp2(rung / 4.0)
                            : near_depth + (camera->far_depth - near_depth) * (rung / 64.0);
}

double csm_rung_of(const csm_camera *camera, double depth) {
    const double near_depth = camera->near_depth;
    return near_depth > 0.0 ? 4.0 * log2(depth / near_depth)
                            : 64.0 * (depth - near_depth) / (camera->far_depth - near_depth);
}
