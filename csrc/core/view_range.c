/* view_range.c: the range of view depths that has shadows, and its cuts.
 *
 * In: camera, settings, bounds of the scene or what is seen of it, what the frame before held. Out:
 * ascending view depths [m]. docs/numerics.md 1, 2, 17.
 */
#include "placement.h"

#include <limits.h>

#include "linalg.h"

/* What a distance set by hand needs behind it: a cascade of no depth has no window. */
#define LEAST_BEHIND (1.0 / 64.0)

static bool by_receivers(const csm_settings *settings) {
    const int split = settings->effects[CSM_EFFECT_SPLIT];
    return split == CSM_SPLIT_SDSM || split == CSM_SPLIT_HISTOGRAM;
}

static double behind(double near_depth, double depth) {
    return depth + LEAST_BEHIND * (depth - near_depth);
}

/* The least far for which distances set by hand stay in the range. */
static double reached_by_hand(const csm_cascades_desc *desc) {
    const csm_settings *settings = desc->settings;
    const double near_depth = desc->camera.near_depth;
    const int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    if (settings->effects[CSM_EFFECT_SPLIT] == CSM_SPLIT_MANUAL && count > 1) {
        return behind(near_depth, settings->manual_splits[count - 2]);
    }
    return settings->first_split > 0.0 ? behind(near_depth, settings->first_split) : near_depth;
}

/* far of the view range, cut to the scene and rounded up, so that it, and with it every texel size,
 * stays constant while the camera moves. An orthographic camera whose near is not positive has no
 * ratio to round by: its far is cut only. */
static void cut_range(const csm_cascades_desc *desc, double *far_depth, int *out_step) {
    const csm_camera *camera = &desc->camera;
    if (!desc->scene_bounds ||
        desc->settings->effects[CSM_EFFECT_VIEW_RANGE] != CSM_VIEW_RANGE_SCENE) {
        return;
    }
    double bounds[6], depth;
    box_widen(desc->scene_bounds, box_rounding(desc->scene_bounds), bounds);
    if (!csm_frustum_depth_of_box(camera, bounds, &depth)) {
        depth = camera->near_depth; /* nothing to see: the smallest range that is one */
    }
    depth = fmax(depth, reached_by_hand(desc));
    if (camera->near_depth > 0.0) {
        const double rounded = csm_range_round_up(
            camera->near_depth, depth, desc->held ? desc->held->range_step : INT_MIN, out_step);
        *far_depth = fmin(*far_depth, rounded);
    } else if (depth > camera->near_depth) {
        *far_depth = fmin(*far_depth, depth);
    }
}

/* The next rung at or beyond a depth, outwards (-1: nearer, +1: farther), or the held one while it
 * is at most one rung too far out. */
static int rung_outwards(const csm_camera *camera, double depth, int outwards, int held) {
    const double place = csm_rung_of(camera, depth);
    int step = (int)(outwards > 0 ? ceil(place) : floor(place));
    /* the logarithm only finds the neighbourhood; the rungs themselves decide */
    while (outwards * (csm_rung_depth(camera, step) - depth) < 0.0) {
        step += outwards;
    }
    return held == step + outwards ? held : step;
}

/* The range of what is seen before `limit`, rounded outwards and held; false if nothing is. */
static bool seen_range(const csm_cascades_desc *desc, double limit, double range[2],
                       uint32_t histogram[CSM_DEPTH_BINS], csm_hold *hold) {
    const csm_camera *camera = &desc->camera;
    double seen[2];
    if (!csm_receivers_depths(desc, seen, histogram) || !(seen[0] < limit)) {
        return false;
    }
    /* A GPU has these depths, and the positions that it compares, in float32. */
    const double rounding = desc->scene_bounds ? box_rounding(desc->scene_bounds) : 0.0;
    const csm_hold none = csm_hold_none(), *held = desc->held ? desc->held : &none;
    const double nearest = seen[0] - (0x1p-20 * fabs(seen[0]) + rounding);
    const double farthest = fmin(seen[1], limit) + (0x1p-20 * fabs(seen[1]) + rounding);
    hold->near_step = hold->far_step = 0;
    range[0] = camera->near_depth;
    if (nearest > camera->near_depth) {
        hold->near_step = rung_outwards(camera, nearest, -1, held->near_step);
        range[0] = fmax(csm_rung_depth(camera, hold->near_step), camera->near_depth);
    }
    hold->far_step = rung_outwards(camera, farthest, 1, held->far_step);
    if (hold->far_step <= hold->near_step) { /* all at one depth, on a rung */
        hold->far_step = hold->near_step + 1;
    }
    range[1] = fmin(csm_rung_depth(camera, hold->far_step), limit);
    return true;
}

static csm_status by_hand(const csm_settings *settings, const double range[2], int count,
                          double *out_splits, csm_error *err) {
    const bool percents = settings->effects[CSM_EFFECT_SPLIT] == CSM_SPLIT_PERCENTAGES;
    out_splits[0] = range[0];
    out_splits[count] = range[1];
    for (int i = 1; i < count; i++) {
        const double given = settings->manual_splits[i - 1];
        out_splits[i] = percents ? range[0] + (range[1] - range[0]) * (given / 100.0) : given;
        if (!percents && !(given > out_splits[i - 1] && given < range[1])) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "manual_splits must ascend between near %g and far %g of the view "
                            "range (got %g after %g)",
                            range[0], range[1], given, out_splits[i - 1]);
        }
    }
    return CSM_OK;
}

static csm_status by_scheme(const csm_cascades_desc *desc, double range_near,
                            const csm_share *share, const uint32_t histogram[CSM_DEPTH_BINS],
                            double *out_splits, csm_hold *hold, csm_error *err) {
    const csm_settings *settings = desc->settings;
    /* one cascade has nothing to cut, so no scheme to ask for a positive near */
    int scheme = share->count == 1 ? CSM_SPLIT_UNIFORM : settings->effects[CSM_EFFECT_SPLIT];
    if (scheme == CSM_SPLIT_RESOLUTION) {
        csm_splits_resolution(desc, range_near, share, out_splits);
        return CSM_OK;
    }
    if (scheme == CSM_SPLIT_HISTOGRAM) {
        return csm_splits_histogram(desc, histogram, share, out_splits, hold, err);
    }
    if (scheme == CSM_SPLIT_SDSM) {
        if (settings->lam > 0.0 && !(desc->camera.near_depth > 0.0)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "near must be > 0 for split sdsm with lam > 0 (got near %g, lam %g)",
                            desc->camera.near_depth, settings->lam);
        }
        scheme = CSM_SPLIT_PRACTICAL;
    }
    return csm_splits_compute(share->near_depth, share->far_depth, share->count, scheme,
                              settings->lam, out_splits, err);
}

/* The first cascade up to first_split, the scheme for the rest; or the scheme for all. */
static csm_status cut(const csm_cascades_desc *desc, const double range[2],
                      const uint32_t histogram[CSM_DEPTH_BINS], csm_cascades *out, csm_error *err) {
    const csm_settings *settings = desc->settings;
    const int split = settings->effects[CSM_EFFECT_SPLIT];
    if (out->count > 1 && (split == CSM_SPLIT_MANUAL || split == CSM_SPLIT_PERCENTAGES)) {
        return by_hand(settings, range, out->count, out->splits, err);
    }
    const double first = settings->first_split;
    csm_share share = {range[0], range[1], 0, out->count};
    if (first > 0.0) {
        const double room = behind(desc->camera.near_depth, first) - first;
        const bool inside = first - range[0] >= room && range[1] - first >= room;
        if (inside || !by_receivers(settings)) {
            out->splits[0] = range[0];
            share = (csm_share){first, range[1], 1, out->count - 1};
        }
    }
    return by_scheme(desc, range[0], &share, histogram, out->splits + share.first, &out->hold, err);
}

/* The farthest view depth that may have a shadow: the camera's far or max_distance. */
static csm_status limit_range(const csm_cascades_desc *desc, double *out_limit, csm_error *err) {
    const csm_camera *camera = &desc->camera;
    const csm_settings *settings = desc->settings;
    const double near_depth = camera->near_depth, first = settings->first_split;
    *out_limit = camera->far_depth;
    if (settings->max_distance > 0.0) {
        *out_limit = fmin(*out_limit, settings->max_distance);
    }
    if (!(*out_limit > near_depth)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "max_distance must be > the camera's near (got max_distance %g, near %g)",
                        settings->max_distance, near_depth);
    }
    if (first > 0.0 && !(first > near_depth && first < *out_limit)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "first_split must lie between the camera's near %g and its far or "
                        "max_distance, %g (got %g)",
                        near_depth, *out_limit, first);
    }
    return CSM_OK;
}

csm_status csm_place_splits(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err) {
    double range[2] = {desc->camera.near_depth, 0.0};
    uint32_t histogram[CSM_DEPTH_BINS] = {0};
    const int split = desc->settings->effects[CSM_EFFECT_SPLIT];
    const bool seen = by_receivers(desc->settings);
    csm_status status = limit_range(desc, &range[1], err);
    if (status != CSM_OK) {
        return status;
    }
    if (seen && !desc->receivers) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "split %s needs receivers, the points that the camera sees",
                        split == CSM_SPLIT_SDSM ? "sdsm" : "histogram");
    }
    uint32_t *counts = split == CSM_SPLIT_HISTOGRAM ? histogram : NULL;
    out->range_step = INT_MIN;
    if (!seen || !seen_range(desc, range[1], range, counts, &out->hold)) {
        cut_range(desc, &range[1], &out->range_step);
        out->hold.range_step = out->range_step;
    }
    status = cut(desc, range, histogram, out, err);
    for (int i = 0; status == CSM_OK && i < out->count; i++) {
        if (!(out->splits[i] < out->splits[i + 1])) {
            status = csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                              "a view range from near %.17g to far %.17g leaves no room for %d "
                              "cascades",
                              range[0], range[1], out->count);
        }
    }
    return status;
}
