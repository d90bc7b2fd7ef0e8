/* effects.c: the effect table, validation, canonical form, what a pass sees of it.
 *
 * In: csm_settings. Out: the same with meaningless values zeroed, the #define list and the cache
 * key of a pass, and the bias in the terms the shader knows.
 */
#include "filters.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const csm_effect_info effect_table[CSM_EFFECT_COUNT] = {
#define CSM_EFFECT(id, name, type, default_value, min, max, passes, choices, help)                 \
    {#id, name, CSM_TYPE_##type, default_value, min, max, passes, choices, help},
#include "csm_effects.def"
};

static const csm_number_info number_table[] = {
#define CSM_NUMBER(name, default_value, min, max, help)                                            \
    {#name, default_value, min, max, help, offsetof(csm_settings, name)},
#include "csm_effects.def"
};

#define MAX_MAP_SIZE 65536

const csm_effect_info *csm_effect_describe(int effect) {
    return &effect_table[effect];
}

const csm_number_info *csm_number_describe(int number) {
    const int count = (int)(sizeof number_table / sizeof *number_table);
    return number < count ? &number_table[number] : NULL;
}

static double *number_of(csm_settings *settings, const csm_number_info *row) {
    return (double *)((char *)settings + row->offset);
}

csm_settings csm_settings_default(void) {
    csm_settings settings = {0};
    const csm_number_info *row;
    for (int i = 0; (row = csm_number_describe(i)); i++) {
        *number_of(&settings, row) = row->default_value;
    }
    for (int i = 0; i < CSM_EFFECT_COUNT; i++) {
        settings.effects[i] = effect_table[i].default_value;
    }
    for (int i = 0; i < CSM_MAX_CASCADES; i++) {
        settings.map_size[i] = 2048;
    }
    return settings;
}

static void check_number(csm_error *err, const char *name, double value, double low, double high) {
    if (!(value >= low && value <= high)) {
        csm_fail_more(err, "%s must be a number from %g to %g (got %g)", name, low, high, value);
    }
}

static void check_manual_splits(const csm_settings *settings, int count, csm_error *err) {
    const bool percents = settings->effects[CSM_EFFECT_SPLIT] == CSM_SPLIT_PERCENTAGES;
    double before = percents ? 0.0 : -INFINITY;
    for (int i = 0; i < count - 1; i++) {
        double here = settings->manual_splits[i];
        if (!isfinite(here) || !(here > before) || (percents && !(here < 100.0))) {
            csm_fail_more(err, "manual_splits must be %d ascending %s (number %d is %g after %g)",
                          count - 1, percents ? "percents between 0 and 100" : "view depths [m]",
                          i + 1, here, before);
            return;
        }
        before = here;
    }
}

static bool splits_by_hand(const csm_settings *settings) {
    const int split = settings->effects[CSM_EFFECT_SPLIT];
    return split == CSM_SPLIT_MANUAL || split == CSM_SPLIT_PERCENTAGES;
}

static void check_depth_range(const csm_settings *settings, csm_error *err) {
    const double *range = settings->manual_depth_range;
    if (settings->effects[CSM_EFFECT_DEPTH_RANGE] == CSM_DEPTH_RANGE_MANUAL &&
        !(isfinite(range[0]) && isfinite(range[1]) && range[0] < range[1])) {
        csm_fail_more(err,
                      "manual_depth_range must be two ascending light-view depths [m] (got %g, %g)",
                      range[0], range[1]);
    }
}

static void check_storage(const csm_settings *settings, csm_error *err) {
    const int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    if (settings->effects[CSM_EFFECT_STORAGE] != CSM_STORAGE_CUBE) {
        return;
    }
    if (count > 6) {
        csm_fail_more(err, "cascade_count must be 1 to 6 under storage cube (got %d)", count);
    }
    for (int i = 1; i < count && i < CSM_MAX_CASCADES; i++) {
        if (settings->map_size[i] != settings->map_size[0]) {
            csm_fail_more(err,
                          "map_size must be the same for all cascades under storage cube (got %d "
                          "and %d)",
                          settings->map_size[0], settings->map_size[i]);
            return;
        }
    }
}

csm_status csm_settings_validate(const csm_settings *settings, csm_error *err) {
    csm_error problems = {0};
    for (int i = 0; i < CSM_EFFECT_COUNT; i++) {
        const csm_effect_info *row = &effect_table[i];
        int value = settings->effects[i];
        if (value < row->min || value > row->max) {
            csm_fail_more(&problems, "%s must be %d to %d (got %d)", row->name, row->min, row->max,
                          value);
        }
    }
    int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    for (int i = 0; i < count && i < CSM_MAX_CASCADES; i++) {
        if (settings->map_size[i] < 1 || settings->map_size[i] > MAX_MAP_SIZE) {
            csm_fail_more(&problems, "map_size must be 1 to %d texels (got %d)", MAX_MAP_SIZE,
                          settings->map_size[i]);
            break;
        }
    }
    const csm_number_info *row;
    for (int i = 0; (row = csm_number_describe(i)); i++) {
        const double value = *(const double *)((const char *)settings + row->offset);
        check_number(&problems, row->name, value, row->min, row->max);
    }
    check_depth_range(settings, &problems);
    csm_filter_validate(settings, &problems);
    check_storage(settings, &problems);
    if (splits_by_hand(settings) && count >= 1 && count <= CSM_MAX_CASCADES) {
        check_manual_splits(settings, count, &problems);
    }
    if (problems.status != CSM_OK && err) {
        *err = problems;
    }
    return problems.status;
}

static void reset(csm_settings *settings, csm_effect effect) {
    settings->effects[effect] = effect_table[effect].default_value;
}

static void canonical_splits(csm_settings *settings) {
    int *effects = settings->effects;
    if (effects[CSM_EFFECT_CASCADE_COUNT] == 1) {
        /* of what is seen one cascade still takes its range */
        int *split = &effects[CSM_EFFECT_SPLIT];
        const bool seen = *split == CSM_SPLIT_SDSM || *split == CSM_SPLIT_HISTOGRAM;
        *split = seen ? CSM_SPLIT_SDSM : CSM_SPLIT_PRACTICAL;
        settings->lam = 0.5;
        settings->first_split = 0.0;
    }
    const int split = effects[CSM_EFFECT_SPLIT];
    if (split != CSM_SPLIT_PRACTICAL && split != CSM_SPLIT_SDSM) {
        settings->lam = 0.5;
    }
    if (!splits_by_hand(settings)) {
        memset(settings->manual_splits, 0, sizeof settings->manual_splits);
    } else {
        settings->first_split = 0.0;
    }
}

void csm_settings_canonical_placement(csm_settings *settings) {
    int *effects = settings->effects;
    canonical_splits(settings);
    /* a shifted sphere leaves corners of its slice to the next map, and a warp bends the slice */
    if (effects[CSM_EFFECT_FIT] == CSM_FIT_SHIFTED &&
        (effects[CSM_EFFECT_SELECT] == CSM_SELECT_INTERVAL ||
         effects[CSM_EFFECT_WARP] != CSM_WARP_NONE)) {
        effects[CSM_EFFECT_FIT] = CSM_FIT_SPHERE;
    }
    if (effects[CSM_EFFECT_FIT] != CSM_FIT_VISIBLE) {
        reset(settings, CSM_EFFECT_TURNED);
    }
    if (effects[CSM_EFFECT_WARP] != CSM_WARP_NONE) {
        reset(settings, CSM_EFFECT_TURNED); /* a warp turns its windows itself */
    }
    if (effects[CSM_EFFECT_TURNED] || effects[CSM_EFFECT_WARP] != CSM_WARP_NONE) {
        /* their texels are not the world's */
        effects[CSM_EFFECT_SNAP] = CSM_SNAP_NONE;
        reset(settings, CSM_EFFECT_LIGHT_BASIS);
    }
    if (effects[CSM_EFFECT_SNAP] != CSM_SNAP_APPROXIMATE) {
        reset(settings, CSM_EFFECT_LEVEL_SPACING);
        reset(settings, CSM_EFFECT_LEVEL_COUNT);
        reset(settings, CSM_EFFECT_LEVEL_HYSTERESIS);
    }
    if (effects[CSM_EFFECT_PANCAKE]) {
        reset(settings, CSM_EFFECT_DEPTH_RANGE);
    }
    if (effects[CSM_EFFECT_DEPTH_RANGE] != CSM_DEPTH_RANGE_MANUAL) {
        memset(settings->manual_depth_range, 0, sizeof settings->manual_depth_range);
    }
    /* a finer map answers for its whole rectangle only if the choice is by rectangle, the light's
     * rays are parallel in it, and its depth range leaves out nothing that a coarser one holds */
    if (effects[CSM_EFFECT_CULL] == CSM_CULL_EXCLUSIVE &&
        (effects[CSM_EFFECT_SELECT] == CSM_SELECT_INTERVAL || effects[CSM_EFFECT_PANCAKE] ||
         effects[CSM_EFFECT_DEPTH_RANGE] == CSM_DEPTH_RANGE_WINDOW ||
         effects[CSM_EFFECT_WARP] != CSM_WARP_NONE || effects[CSM_EFFECT_CASCADE_COUNT] == 1)) {
        effects[CSM_EFFECT_CULL] = CSM_CULL_INCLUSIVE;
    }
    effects[CSM_EFFECT_WARPED] = effects[CSM_EFFECT_WARP] != CSM_WARP_NONE;
    effects[CSM_EFFECT_SKEWED] = effects[CSM_EFFECT_LIGHT_BASIS] == CSM_LIGHT_BASIS_WORLD;
}

static void canonical_storage(csm_settings *settings) {
    int *effects = settings->effects;
    if (effects[CSM_EFFECT_SAMPLES] > 1) {
        /* casters are drawn into a texture of samples, from which nothing but moments is made */
        effects[CSM_EFFECT_STORAGE] = CSM_STORAGE_ARRAY;
    }
    if (effects[CSM_EFFECT_STORAGE] != CSM_STORAGE_ATLAS) {
        reset(settings, CSM_EFFECT_TILE_BORDER);
        reset(settings, CSM_EFFECT_COPIED_TILES);
    }
}

static void canonical_bias(csm_settings *settings) {
    int *effects = settings->effects;
    const bool two_by_two =
        effects[CSM_EFFECT_FILTER] == CSM_FILTER_PCF && effects[CSM_EFFECT_FILTER_SIZE] == 2;
    const bool no_plane = two_by_two || !csm_filter_follows_plane(settings);
    if (effects[CSM_EFFECT_BIAS] == CSM_BIAS_AUTO) {
        settings->constant_bias_texels = 0.0;
        settings->slope_bias = 0.0;
        settings->normal_offset_texels = 0.0;
        effects[CSM_EFFECT_RECEIVER_PLANE] = 1;
    }
    if (no_plane) {
        effects[CSM_EFFECT_RECEIVER_PLANE] = 0;
    }
    if (!effects[CSM_EFFECT_RECEIVER_PLANE]) {
        reset(settings, CSM_EFFECT_PLANE);
    }
    if (settings->constant_bias_texels == 0.0 && settings->slope_bias == 0.0) {
        reset(settings, CSM_EFFECT_BIAS_SIDE);
    }
    effects[CSM_EFFECT_NORMAL_OFFSET] = settings->normal_offset_texels != 0.0;
}

/* Steps to neighbours are for footprints that are not analytic, and for planes through them. */
static void canonical_steps(csm_settings *settings) {
    int *effects = settings->effects;
    const bool looked_up = effects[CSM_EFFECT_LOOKUP] != CSM_LOOKUP_BILINEAR;
    const bool analytic = effects[CSM_EFFECT_GRADIENTS] == CSM_GRADIENTS_ANALYTIC;
    const bool planes = effects[CSM_EFFECT_PLANE] == CSM_PLANE_DERIVATIVES;
    const bool footprints = looked_up && analytic;
    effects[CSM_EFFECT_STEPS] = planes && footprints                 ? CSM_STEPS_BOTH
                                : planes || (looked_up && !analytic) ? CSM_STEPS_DIFFERENCES
                                : footprints                         ? CSM_STEPS_ANALYTIC
                                                                     : CSM_STEPS_NONE;
}

static void canonical_transitions(csm_settings *settings) {
    int *effects = settings->effects;
    if (effects[CSM_EFFECT_CASCADE_COUNT] == 1 || settings->blend_width == 0.0) {
        reset(settings, CSM_EFFECT_BLEND);
    }
    if (effects[CSM_EFFECT_BLEND] == CSM_BLEND_NONE) {
        settings->blend_width = 0.1;
    }
    effects[CSM_EFFECT_FADE] = settings->fade_width != 0.0;
}

void csm_settings_canonical(csm_settings *settings) {
    int *effects = settings->effects;
    if (effects[CSM_EFFECT_FILTER] == CSM_FILTER_NONE) {
        csm_settings plain = csm_settings_default();
        plain.effects[CSM_EFFECT_FILTER] = CSM_FILTER_NONE;
        plain.effects[CSM_EFFECT_INSTANCES] = effects[CSM_EFFECT_INSTANCES];
        plain.effects[CSM_EFFECT_STAGE] = effects[CSM_EFFECT_STAGE];
        plain.effects[CSM_EFFECT_ALPHA_TEST] = effects[CSM_EFFECT_ALPHA_TEST];
        *settings = plain;
        return;
    }
    csm_filter_canonical(settings);
    csm_settings_canonical_placement(settings);
    for (int i = effects[CSM_EFFECT_CASCADE_COUNT]; i < CSM_MAX_CASCADES; i++) {
        settings->map_size[i] = 0;
    }
    canonical_storage(settings);
    canonical_bias(settings);
    canonical_steps(settings);
    canonical_transitions(settings);
    if (effects[CSM_EFFECT_SELECT] == CSM_SELECT_FRUSTUM &&
        csm_settings_kernel_radius(settings) == 0) {
        effects[CSM_EFFECT_SELECT] = CSM_SELECT_MAP; /* they differ by the kernel's border */
    }
}

double csm_settings_band(const csm_settings *settings) {
    return settings->effects[CSM_EFFECT_BLEND] == CSM_BLEND_NONE ? 0.0 : settings->blend_width;
}

double csm_depth_quantum(int depth_format) {
    /* 32F holds [0.5, 1) in steps of 2^-24, the same as 24 bits over the whole range */
    return depth_format == CSM_DEPTH_D16 ? 1.0 / 65535.0 : ldexp(1.0, -24);
}

csm_bias csm_settings_bias(const csm_settings *settings) {
    const int *effects = settings->effects;
    if (effects[CSM_EFFECT_BIAS] == CSM_BIAS_MANUAL) {
        const bool casters = effects[CSM_EFFECT_BIAS_SIDE] == CSM_BIAS_CASTER;
        return (csm_bias){
            .receiver_plane = effects[CSM_EFFECT_RECEIVER_PLANE] != 0,
            .constant_texels = casters ? 0.0 : settings->constant_bias_texels,
            .slope_texels = casters ? 0.0 : settings->slope_bias,
            .normal_offset_texels = settings->normal_offset_texels,
            .caster_constant_texels = casters ? settings->constant_bias_texels : 0.0,
            .caster_slope_texels = casters ? settings->slope_bias : 0.0,
        };
    }
    /* docs/numerics.md 11: at the fetched texel's centre the receiver's plane is exact but for half
     * a quantum and float32 rounding (4 ulp of the range); a whole quantum, because a GPU's stored
     * 16 bits were measured up to 0.83 quanta off. A quarter texel of slope covers meshes, whose
     * facet at the texel's centre may be another. Far from the eye or the origin the
     * receiver's own float32 position is coarser than a quantum. The hardware's 2x2 compare has one
     * reference depth for four texels, up to a whole texel away along each axis. */
    const bool two_by_two =
        effects[CSM_EFFECT_FILTER] == CSM_FILTER_PCF && effects[CSM_EFFECT_FILTER_SIZE] == 2;
    double quantum = csm_depth_quantum(effects[CSM_EFFECT_DEPTH_FORMAT]);
    return (csm_bias){
        .receiver_plane = !two_by_two && csm_filter_follows_plane(settings),
        .slope_texels = (two_by_two ? 1.25 : 0.25) + csm_filter_slope_texels(settings),
        .quanta = 1.0 + (4.0 * ldexp(1.0, -24) + csm_settings_mean_rounding(settings) +
                         csm_filter_depth_offset(settings)) /
                            quantum,
        .roundings = 1.0,
    };
}
