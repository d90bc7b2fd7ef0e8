/* filters.c: what each filter looks at, what it needs, and which settings have a meaning under it.
 *
 * In: csm_settings. Out: the maps a prefiltered filter is made from, kernel radii, exponents and
 * floors by the rounding of a format (docs/numerics.md 27). One row a filter; its code is
 * shaders/include/filter_<name>.glsl.
 */
#include "filters.h"

#include <math.h>
#include <string.h>

/* Settings of filters, each a bit: which of them mean something under a filter. */
enum {
    HAS_SIZE = 1,
    HAS_WEIGHTS = 2,
    HAS_FETCH = 4,
    HAS_DISC = 8,
    HAS_FORMAT = 16,
    HAS_LOOKUP = 32,
    HAS_EXPONENT = 64,
    HAS_LEAK = 128, /* bleeds, so that bleeding can be taken off */
    HAS_KERNEL = 256
};
#define BLURRED (HAS_SIZE | HAS_WEIGHTS | HAS_KERNEL | HAS_LOOKUP)

static const struct {
    int kind, channels;
    unsigned has;
} filters[CSM_FILTER_COUNT] = {
    [CSM_FILTER_HARD] = {CSM_LOOKS_AT_DEPTHS, 0, 0},
    [CSM_FILTER_NONE] = {CSM_LOOKS_AT_NOTHING, 0, 0},
    [CSM_FILTER_PCF] = {CSM_LOOKS_AT_DEPTHS, 0, HAS_SIZE | HAS_WEIGHTS | HAS_FETCH | HAS_KERNEL},
    [CSM_FILTER_POISSON] = {CSM_LOOKS_AT_DEPTHS, 0, HAS_SIZE | HAS_DISC | HAS_KERNEL},
    [CSM_FILTER_VSM] = {CSM_LOOKS_AT_MOMENTS, 2, BLURRED | HAS_FORMAT | HAS_LEAK},
    [CSM_FILTER_EVSM2] = {CSM_LOOKS_AT_MOMENTS, 2, BLURRED | HAS_FORMAT | HAS_EXPONENT | HAS_LEAK},
    [CSM_FILTER_EVSM4] = {CSM_LOOKS_AT_MOMENTS, 4, BLURRED | HAS_FORMAT | HAS_EXPONENT | HAS_LEAK},
    [CSM_FILTER_ESM] = {CSM_LOOKS_AT_MOMENTS, 1, BLURRED | HAS_FORMAT | HAS_EXPONENT},
    [CSM_FILTER_MSM] = {CSM_LOOKS_AT_MOMENTS, 4, BLURRED | HAS_FORMAT | HAS_LEAK},
    [CSM_FILTER_LVSM] = {CSM_LOOKS_AT_MOMENTS, 4, BLURRED | HAS_FORMAT | HAS_LEAK},
    [CSM_FILTER_SAVSM] = {CSM_LOOKS_AT_SUMS, 2, HAS_SIZE | HAS_KERNEL | HAS_LEAK},
    [CSM_FILTER_FOURIER] = {CSM_LOOKS_AT_MOMENTS, 4, BLURRED | HAS_FORMAT},
    [CSM_FILTER_PCSS] = {CSM_LOOKS_AT_DEPTHS, 2, HAS_SIZE | HAS_DISC},
};

static bool two_by_two(const csm_settings *settings) {
    return settings->effects[CSM_EFFECT_FILTER] == CSM_FILTER_PCF &&
           settings->effects[CSM_EFFECT_FILTER_SIZE] == 2;
}

static bool prefiltered_pcss(const csm_settings *settings) {
    return settings->effects[CSM_EFFECT_FILTER] == CSM_FILTER_PCSS &&
           settings->effects[CSM_EFFECT_PCSS_MAP] != CSM_PCSS_DEPTH;
}

static int kind_of(const csm_settings *settings) {
    if (prefiltered_pcss(settings)) {
        return settings->effects[CSM_EFFECT_PCSS_MAP] == CSM_PCSS_SUMMED ? CSM_LOOKS_AT_SUMS
                                                                         : CSM_LOOKS_AT_MOMENTS;
    }
    return filters[settings->effects[CSM_EFFECT_FILTER]].kind;
}

static int slices_of(const csm_settings *settings) {
    switch (settings->effects[CSM_EFFECT_FILTER]) {
    case CSM_FILTER_LVSM:
        return settings->effects[CSM_EFFECT_LAYER_COUNT] / 2; /* two moments a layer */
    case CSM_FILTER_FOURIER:
        return settings->effects[CSM_EFFECT_FOURIER_TERMS] / 2; /* sine and cosine a term */
    default:
        return 1;
    }
}

static int log2_above(int value) {
    int bits = 0;
    while (1 << bits < value) {
        bits++;
    }
    return bits;
}

csm_moments csm_settings_moments(const csm_settings *settings) {
    static const struct {
        const char *names[4]; /* by channels; three have none */
        int channel_bytes;
    } formats[] = {
        [CSM_MOMENTS_FLOAT32] = {{"r32f", "rg32f", NULL, "rgba32f"}, 4},
        [CSM_MOMENTS_FLOAT16] = {{"r16f", "rg16f", NULL, "rgba16f"}, 2},
        [CSM_MOMENTS_UNORM16] = {{"r16", "rg16", NULL, "rgba16"}, 2},
    };
    const int *effects = settings->effects;
    csm_moments moments = {.kind = kind_of(settings)};
    if (moments.kind == CSM_LOOKS_AT_SUMS) {
        /* sums wrap around; differences are right while the kernel's own sum fits 32 bits */
        moments.channels = 2;
        moments.slices = 1;
        moments.format = "rg32ui";
        moments.texel_bytes = 8;
        moments.sum_bits = 32 - 2 * log2_above(effects[CSM_EFFECT_FILTER_SIZE] + 2);
    } else if (moments.kind == CSM_LOOKS_AT_MOMENTS) {
        const int format = effects[CSM_EFFECT_MOMENT_FORMAT];
        moments.channels = filters[effects[CSM_EFFECT_FILTER]].channels;
        moments.slices = slices_of(settings);
        moments.format = formats[format].names[moments.channels - 1];
        moments.texel_bytes = moments.channels * formats[format].channel_bytes;
        moments.blurred = effects[CSM_EFFECT_FILTER_SIZE] > 1 && !prefiltered_pcss(settings);
        moments.mipmapped =
            effects[CSM_EFFECT_LOOKUP] != CSM_LOOKUP_BILINEAR || prefiltered_pcss(settings);
    }
    return moments;
}

int csm_settings_kernel_radius(const csm_settings *settings) {
    const int size = settings->effects[CSM_EFFECT_FILTER_SIZE];
    const int lookup = settings->effects[CSM_EFFECT_LOOKUP];
    switch (settings->effects[CSM_EFFECT_FILTER]) {
    case CSM_FILTER_HARD:
    case CSM_FILTER_NONE:
        return 0;
    case CSM_FILTER_PCF:
        return size / 2;
    case CSM_FILTER_POISSON:
    case CSM_FILTER_SAVSM:
    case CSM_FILTER_PCSS:
        return (size + 1) / 2;
    default: /* blurred, then looked up between texels, at worst those of the coarsest level */
        /* a lookup between texels reaches one and a half of them */
        return size / 2 + (lookup == CSM_LOOKUP_BILINEAR ? 1 : 3 << (CSM_MAX_LEVEL - 1));
    }
}

int csm_settings_taps(const csm_settings *settings) {
    const int *effects = settings->effects;
    switch (effects[CSM_EFFECT_FILTER]) {
    case CSM_FILTER_PCF:
        return effects[CSM_EFFECT_FILTER_SIZE] * effects[CSM_EFFECT_FILTER_SIZE];
    case CSM_FILTER_POISSON:
        return effects[CSM_EFFECT_TAP_COUNT];
    case CSM_FILTER_PCSS:
        return 2 * effects[CSM_EFFECT_TAP_COUNT];
    default:
        return effects[CSM_EFFECT_LOOKUP] == CSM_LOOKUP_ANISOTROPIC ? effects[CSM_EFFECT_ANISOTROPY]
                                                                    : 1;
    }
}

/* -- numbers by the rounding of a format ----------------------------------------------------------
 */

double csm_exponent_limit(int filter, int moment_format) {
    /* ln of the largest number, less what it takes to hold a filter's sum of 64 unscaled taps, and
     * halved where the square is stored too */
    const double largest = moment_format == CSM_MOMENTS_FLOAT16 ? log(65504.0) : log(3.4028e38);
    return filter == CSM_FILTER_ESM ? largest : 0.5 * largest;
}

void csm_settings_exponents(const csm_settings *settings, double out[2]) {
    const int filter = settings->effects[CSM_EFFECT_FILTER];
    const int format = settings->effects[CSM_EFFECT_MOMENT_FORMAT];
    out[0] =
        settings->exponent > 0.0 ? settings->exponent : 0.9 * csm_exponent_limit(filter, format);
    out[1] = settings->negative_exponent > 0.0 ? settings->negative_exponent : out[0];
}

static double format_rounding(const csm_settings *settings) {
    const csm_moments moments = csm_settings_moments(settings);
    if (moments.kind == CSM_LOOKS_AT_SUMS) {
        return ldexp(1.0, -moments.sum_bits);
    }
    switch (settings->effects[CSM_EFFECT_MOMENT_FORMAT]) {
    case CSM_MOMENTS_FLOAT16:
        return ldexp(1.0, -10);
    case CSM_MOMENTS_UNORM16:
        return 1.0 / 65535.0;
    default:
        return ldexp(1.0, -23);
    }
}

double csm_settings_least_variance(const csm_settings *settings) {
    return 1.5 * format_rounding(settings); /* of m2 - m1^2 on [0, 1] */
}

double csm_settings_moment_bias(const csm_settings *settings) {
    switch (settings->effects[CSM_EFFECT_MOMENT_FORMAT]) {
    case CSM_MOMENTS_FLOAT16:
        return 0.1;
    case CSM_MOMENTS_UNORM16:
        return 6e-5;
    default:
        return 1e-5;
    }
}

/* -- validation and canonical form ----------------------------------------------------------------
 */

static void check_format(const csm_settings *settings, csm_error *err) {
    const int filter = settings->effects[CSM_EFFECT_FILTER];
    const int format = settings->effects[CSM_EFFECT_MOMENT_FORMAT];
    const bool exponential =
        filter == CSM_FILTER_EVSM2 || filter == CSM_FILTER_EVSM4 || filter == CSM_FILTER_ESM;
    if (!exponential) {
        return;
    }
    if (format == CSM_MOMENTS_UNORM16) {
        csm_fail_more(err, "moment_format must be float32 or float16 for esm and evsm (got "
                           "unorm16): they store more than 1");
        return;
    }
    const bool logarithmic = filter == CSM_FILTER_ESM && settings->effects[CSM_EFFECT_LOG_FILTER];
    const double limit = csm_exponent_limit(filter, format);
    const struct {
        const char *name;
        double value;
    } exponents[] = {
        {"exponent", settings->exponent},
        {"negative_exponent", filter == CSM_FILTER_EVSM4 ? settings->negative_exponent : 0.0}};
    for (size_t i = 0; i < 2 && !logarithmic; i++) {
        if (exponents[i].value > limit) {
            csm_fail_more(err, "%s must be at most %.2f in this moment_format (got %g)",
                          exponents[i].name, limit, exponents[i].value);
        }
    }
}

void csm_filter_validate(const csm_settings *settings, csm_error *err) {
    const int *effects = settings->effects;
    const int filter = effects[CSM_EFFECT_FILTER], size = effects[CSM_EFFECT_FILTER_SIZE];
    const int samples = effects[CSM_EFFECT_SAMPLES];
    if (filter < 0 || filter >= CSM_FILTER_COUNT) {
        return; /* told already */
    }
    if (size % 2 == 0 && (size != 2 || !(filter == CSM_FILTER_PCF || !filters[filter].has))) {
        csm_fail_more(err, "filter_size must be odd, or for pcf 2 (got %d)", size);
    }
    if (samples != 1 && samples != 2 && samples != 4 && samples != 8) {
        csm_fail_more(err, "samples must be 1, 2, 4 or 8 (got %d)", samples);
    }
    if (effects[CSM_EFFECT_LAYER_COUNT] % 2) {
        csm_fail_more(err, "layer_count must be even (got %d)", effects[CSM_EFFECT_LAYER_COUNT]);
    }
    if (effects[CSM_EFFECT_FOURIER_TERMS] % 2) {
        csm_fail_more(err, "fourier_terms must be even (got %d)",
                      effects[CSM_EFFECT_FOURIER_TERMS]);
    }
    check_format(settings, err);
}

static void keep_if(csm_settings *settings, bool meaningful, csm_effect effect) {
    if (!meaningful) {
        settings->effects[effect] = csm_effect_describe(effect)->default_value;
    }
}

void csm_filter_canonical(csm_settings *settings) {
    int *effects = settings->effects;
    if (effects[CSM_EFFECT_FILTER] == CSM_FILTER_PCF && effects[CSM_EFFECT_FILTER_SIZE] == 1) {
        effects[CSM_EFFECT_FILTER] = CSM_FILTER_HARD; /* a 1 x 1 kernel is one nearest compare */
    }
    const int filter = effects[CSM_EFFECT_FILTER];
    const unsigned has = filters[filter].has;
    keep_if(settings, filter == CSM_FILTER_PCSS, CSM_EFFECT_PCSS_MAP);
    const int kind = kind_of(settings);
    const bool moments = kind == CSM_LOOKS_AT_MOMENTS;
    const bool tapped = kind == CSM_LOOKS_AT_DEPTHS;
    keep_if(settings, has & HAS_SIZE, CSM_EFFECT_FILTER_SIZE);
    const bool kernel = effects[CSM_EFFECT_FILTER_SIZE] > 1 && !two_by_two(settings);
    keep_if(settings, (has & HAS_WEIGHTS) && kernel, CSM_EFFECT_FILTER_WEIGHTS);
    keep_if(settings, (has & HAS_FETCH) && kernel, CSM_EFFECT_FILTER_FETCH);
    keep_if(settings, (has & HAS_KERNEL) && kernel, CSM_EFFECT_KERNEL);
    if (effects[CSM_EFFECT_CASCADE_COUNT] == 1 && effects[CSM_EFFECT_KERNEL] == CSM_KERNEL_WORLD) {
        effects[CSM_EFFECT_KERNEL] = CSM_KERNEL_TEXELS; /* there is nothing to keep it equal to */
    }
    if (moments && effects[CSM_EFFECT_KERNEL] == CSM_KERNEL_SCREEN) {
        effects[CSM_EFFECT_KERNEL] = CSM_KERNEL_TEXELS; /* a map has one blur for all its pixels */
    }
    keep_if(settings, (has & HAS_DISC) && tapped, CSM_EFFECT_DISC);
    keep_if(settings, (has & HAS_DISC) && tapped, CSM_EFFECT_TAP_COUNT);
    keep_if(settings, (has & HAS_DISC) && tapped, CSM_EFFECT_ROTATED);
    keep_if(settings, has & HAS_FORMAT, CSM_EFFECT_MOMENT_FORMAT);
    keep_if(settings, has & HAS_LOOKUP, CSM_EFFECT_LOOKUP);
    keep_if(settings, !tapped, CSM_EFFECT_SAMPLES);
    keep_if(settings, filter == CSM_FILTER_ESM, CSM_EFFECT_LOG_FILTER);
    if (effects[CSM_EFFECT_LOG_FILTER]) {
        keep_if(settings, false, CSM_EFFECT_LOOKUP); /* logarithms have no mean */
    }
    keep_if(settings, filter == CSM_FILTER_MSM, CSM_EFFECT_MSM_BOUND);
    keep_if(settings, filter == CSM_FILTER_LVSM, CSM_EFFECT_LAYER_COUNT);
    keep_if(settings, filter == CSM_FILTER_FOURIER, CSM_EFFECT_FOURIER_TERMS);
    const int lookup = effects[CSM_EFFECT_LOOKUP];
    keep_if(settings, lookup != CSM_LOOKUP_BILINEAR, CSM_EFFECT_GRADIENTS);
    if (effects[CSM_EFFECT_CASCADE_COUNT] == 1 &&
        effects[CSM_EFFECT_GRADIENTS] == CSM_GRADIENTS_QUAD) {
        effects[CSM_EFFECT_GRADIENTS] = CSM_GRADIENTS_HARDWARE; /* a quad has one cascade anyway */
    }
    keep_if(settings, lookup == CSM_LOOKUP_ANISOTROPIC, CSM_EFFECT_ANISOTROPY);
    if (!(has & HAS_EXPONENT)) {
        settings->exponent = 0.0;
    }
    if (filter != CSM_FILTER_EVSM4) {
        settings->negative_exponent = 0.0;
    }
    if (!(has & HAS_LEAK)) {
        settings->bleed_step = 0.0;
        settings->bleed_power = 1.0;
    }
    effects[CSM_EFFECT_BLEEDING] = settings->bleed_step != 0.0 || settings->bleed_power != 1.0;
    effects[CSM_EFFECT_PREFILTERED] = kind == CSM_LOOKS_AT_MOMENTS || kind == CSM_LOOKS_AT_SUMS;
    effects[CSM_EFFECT_SUMMED] = kind == CSM_LOOKS_AT_SUMS;
    effects[CSM_EFFECT_KERNEL_SIZE] =
        filter == CSM_FILTER_PCF ? effects[CSM_EFFECT_FILTER_SIZE] : 0;
}
