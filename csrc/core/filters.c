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
    [CSM_FILTER_PCSS] = {CSM_LOOKS_AT_DEPTHS, 2, HAS_SIZE | HAS_DISC | HAS_FORMAT | HAS_LEAK},
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

bool csm_filter_follows_plane(const csm_settings *settings) {
    return kind_of(settings) == CSM_LOOKS_AT_DEPTHS ||
           settings->effects[CSM_EFFECT_FILTER] == CSM_FILTER_EVSM4;
}

static bool logarithmic(const csm_settings *settings) {
    return settings->effects[CSM_EFFECT_FILTER] == CSM_FILTER_ESM &&
           settings->effects[CSM_EFFECT_LOG_FILTER];
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
        /* sums wrap around; differences are right while those of the texels that a kernel covers
         * whole, and of each of its edges apart, fit 32 bits with a sign. More than the 24 bits of
         * a float are none: depths have no more, and numbers of steps are exact in shaders */
        const double inner = effects[CSM_EFFECT_FILTER_SIZE] - 1.0;
        const double fitting = floor((ldexp(1.0, 31) - 1.0) / fmax(inner * inner, 1.0));
        moments.channels = 2;
        moments.slices = 1;
        moments.format = "rg32ui";
        moments.texel_bytes = 8;
        moments.sum_steps = fmin(2.0 * fitting, ldexp(1.0, 24));
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
    const bool levels = settings->effects[CSM_EFFECT_LOOKUP] != CSM_LOOKUP_BILINEAR;
    switch (settings->effects[CSM_EFFECT_FILTER]) {
    case CSM_FILTER_HARD:
    case CSM_FILTER_NONE:
        return 0;
    case CSM_FILTER_PCF:
        return size / 2;
    case CSM_FILTER_POISSON:
    case CSM_FILTER_SAVSM:
        return (size + 1) / 2;
    case CSM_FILTER_PCSS: /* levels of moments reach two texels of theirs beyond the outer taps */
        return prefiltered_pcss(settings) && kind_of(settings) == CSM_LOOKS_AT_MOMENTS
                   ? size + 2
                   : (size + 1) / 2;
    default: /* blurred, then looked up between texels, at worst those of the coarsest level: a
              * lookup between texels reaches one and a half of them */
        return size / 2 + (levels && !logarithmic(settings) ? 3 << (CSM_MAX_LEVEL - 1) : 1);
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

static bool exponential(int filter) {
    return filter == CSM_FILTER_EVSM2 || filter == CSM_FILTER_EVSM4 || filter == CSM_FILTER_ESM;
}

double csm_exponent_limit(const csm_settings *settings) {
    if (logarithmic(settings)) {
        return INFINITY;
    }
    /* exp(c) must be held, and where variances are made its square; a shader's exp() is off by some
     * c 2^-24, which cutting off after two digits leaves room for. Blurs hold no sum that is larger
     * than its mean; who makes smaller levels may first add up four texels. */
    const bool half = settings->effects[CSM_EFFECT_MOMENT_FORMAT] == CSM_MOMENTS_FLOAT16;
    const double largest = log(half ? 65504.0 : 3.4028e38) -
                           (csm_settings_moments(settings).mipmapped ? log(4.0) : 0.0);
    const bool squared = settings->effects[CSM_EFFECT_FILTER] != CSM_FILTER_ESM;
    return floor(100.0 * (squared ? 0.5 * largest : largest)) / 100.0;
}

/* How often moments are rounded on their way: when they are made, by either half of the blur, by
 * every level, and by the lookup between texels. */
static double times_rounded(const csm_settings *settings) {
    const csm_moments moments = csm_settings_moments(settings);
    return 2.0 + (moments.blurred ? 2.0 : 0.0) + (moments.mipmapped ? CSM_MAX_LEVEL : 0.0);
}

/* Rounding of a number: of floats a share of it, of unorm16 and sums a share of the range. Drivers
 * may cut off what 16 bits do not hold instead of rounding it (llvmpipe does): a whole unit. */
static double format_rounding(const csm_settings *settings) {
    switch (settings->effects[CSM_EFFECT_MOMENT_FORMAT]) {
    case CSM_MOMENTS_FLOAT16: {
        const int filter = settings->effects[CSM_EFFECT_FILTER];
        if (!exponential(filter) || filter == CSM_FILTER_ESM) {
            return ldexp(1.0, -10);
        }
        double exponents[2];
        csm_settings_exponents(settings, exponents);
        /* steps no longer shrink below 2^-14, where squares of the nearest depths may lie */
        const double smallest = exp(-2.0 * fmax(exponents[0], exponents[1]));
        return fmax(ldexp(1.0, -10), ldexp(1.0, -24) / smallest);
    }
    case CSM_MOMENTS_UNORM16:
        return 0.5 / 65535.0;
    default:
        return ldexp(1.0, -24);
    }
}

/* Let every number be off by u of itself: m2 - m1^2 is off by up to 3 u m^2. Centred depths have
 * m^2
 * <= 1/4; those of exponential warps are as large as they are, so theirs is a share of m^2. Where
 * steps are equal m1 is off by u, which makes 2 |m1| u <= u of m1^2, and m2 by u / 4 in unorm16,
 * where it is stored fourfold, by u in sums. */
double csm_settings_least_variance(const csm_settings *settings) {
    const csm_moments moments = csm_settings_moments(settings);
    if (moments.kind == CSM_LOOKS_AT_SUMS) {
        /* half a step of the depths, at most 1/2 from the middle, an eighth of their squares', and
         * the roundings of their means to floats */
        return 0.625 / moments.sum_steps + 1.5 * ldexp(1.0, -24);
    }
    const double rounding = format_rounding(settings) * times_rounded(settings);
    if (exponential(settings->effects[CSM_EFFECT_FILTER])) {
        return 3.0 * rounding;
    }
    const bool floats = settings->effects[CSM_EFFECT_MOMENT_FORMAT] != CSM_MOMENTS_UNORM16;
    return (floats ? 0.75 : 1.25) * rounding;
}

double csm_settings_mean_rounding(const csm_settings *settings) {
    const int *effects = settings->effects;
    const csm_moments moments = csm_settings_moments(settings);
    if (moments.kind == CSM_LOOKS_AT_DEPTHS) {
        return 0.0;
    }
    if (moments.kind == CSM_LOOKS_AT_SUMS) {
        return 0.5 / moments.sum_steps;
    }
    const double rounding = format_rounding(settings) * times_rounded(settings);
    if (logarithmic(settings) || !exponential(effects[CSM_EFFECT_FILTER])) {
        const bool floats = effects[CSM_EFFECT_MOMENT_FORMAT] != CSM_MOMENTS_UNORM16;
        const double length = effects[CSM_EFFECT_FILTER] == CSM_FILTER_LVSM
                                  ? fmin(2.0 / effects[CSM_EFFECT_LAYER_COUNT], 1.0)
                                  : 1.0; /* a layer has half of its neighbours too */
        return (floats ? 0.5 : 1.0) * rounding * length; /* floats: of a centred depth */
    }
    double exponents[2];
    csm_settings_exponents(settings, exponents);
    /* d exp(c z) / exp(c z) = c dz; warps of evsm run from -1 to 1 */
    return rounding / ((effects[CSM_EFFECT_FILTER] == CSM_FILTER_ESM ? 1.0 : 2.0) *
                       fmin(exponents[0], exponents[1]));
}

/* Measured to lose least on made scenes (docs/numerics.md 27); a logarithm that is off by less than
 * 1/20 keeps light right to 5 %. */
#define LOG_EXPONENT 640.0
#define LOG_ROUNDING 0.05

void csm_settings_exponents(const csm_settings *settings, double out[2]) {
    out[0] = settings->exponent;
    if (out[0] == 0.0) {
        out[0] = logarithmic(settings)
                     ? fmin(LOG_EXPONENT, LOG_ROUNDING / csm_settings_mean_rounding(settings))
                     : 0.9 * csm_exponent_limit(settings);
    }
    out[1] = settings->negative_exponent > 0.0 ? settings->negative_exponent : out[0];
}

double csm_settings_moment_bias(const csm_settings *settings) {
    /* measured (docs/numerics.md 28): the least that bounds every distribution of one to three
     * depths, after a rounding by the moments and one by each direction of the blur */
    return settings->effects[CSM_EFFECT_MOMENT_FORMAT] == CSM_MOMENTS_UNORM16 ? 1.5e-4 : 2e-6;
}

double csm_filter_slope_texels(const csm_settings *settings) {
    const double size = settings->effects[CSM_EFFECT_FILTER_SIZE];
    switch (settings->effects[CSM_EFFECT_FILTER]) {
    case CSM_FILTER_MSM:
        /* four moments leave nothing before a receiver that is a standard deviation before the mean
         * of an even spread; a box is the widest of the weights, and the mean of two neighbours
         * adds at most a quarter to the variance */
        return sqrt((size * size - 1.0) / 12.0 + 0.25);
    case CSM_FILTER_FOURIER:
        return 0.5 * (size + 1.0); /* all that blur and lookup see of the receiver's own plane */
    default:
        return 0.0;
    }
}

double csm_filter_depth_offset(const csm_settings *settings) {
    /* the series is one half at the occluder's own depth, and first 1 where Si(2 pi M x) = pi/2 */
    return settings->effects[CSM_EFFECT_FILTER] == CSM_FILTER_FOURIER
               ? 0.3066 / settings->effects[CSM_EFFECT_FOURIER_TERMS]
               : 0.0;
}

/* -- validation and canonical form ----------------------------------------------------------------
 */

static void check_format(const csm_settings *settings, csm_error *err) {
    const int filter = settings->effects[CSM_EFFECT_FILTER];
    if (filter == CSM_FILTER_MSM &&
        settings->effects[CSM_EFFECT_MOMENT_FORMAT] == CSM_MOMENTS_FLOAT16) {
        csm_fail_more(err, "moment_format must be float32 or unorm16 for msm (got float16): in as "
                           "many bytes unorm16 rounds four moments sixteen times finer");
    }
    if (!exponential(filter) || logarithmic(settings)) {
        return;
    }
    if (settings->effects[CSM_EFFECT_MOMENT_FORMAT] == CSM_MOMENTS_UNORM16) {
        csm_fail_more(err, "moment_format must be float32 or float16 for evsm, and for esm without "
                           "log_filter (got unorm16): they store more than 1");
        return;
    }
    const double limit = csm_exponent_limit(settings);
    const struct {
        const char *name;
        double value;
    } exponents[] = {
        {"exponent", settings->exponent},
        {"negative_exponent", filter == CSM_FILTER_EVSM4 ? settings->negative_exponent : 0.0}};
    for (size_t i = 0; i < 2; i++) {
        if (exponents[i].value > limit) {
            csm_fail_more(err,
                          "%s must be at most %.2f for this filter, moment_format and lookup "
                          "(got %g)",
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
    const bool in_disc = filters[filter].has & HAS_DISC && kind_of(settings) == CSM_LOOKS_AT_DEPTHS;
    const int taps = effects[CSM_EFFECT_TAP_COUNT];
    if (in_disc && effects[CSM_EFFECT_DISC] == CSM_DISC_POISSON && taps != 8 && taps != 16) {
        csm_fail_more(err,
                      "tap_count must be 8 or 16 with disc poisson (got %d); disc vogel takes "
                      "any number",
                      taps);
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
    keep_if(settings, (has & HAS_FORMAT) && moments, CSM_EFFECT_MOMENT_FORMAT);
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
    if (!(has & HAS_LEAK) || tapped) {
        settings->bleed_step = 0.0;
        settings->bleed_power = 1.0;
    }
    effects[CSM_EFFECT_BLEEDING] = settings->bleed_step != 0.0 || settings->bleed_power != 1.0;
    effects[CSM_EFFECT_PREFILTERED] = kind == CSM_LOOKS_AT_MOMENTS || kind == CSM_LOOKS_AT_SUMS;
    effects[CSM_EFFECT_SUMMED] = kind == CSM_LOOKS_AT_SUMS;
    effects[CSM_EFFECT_KERNEL_SIZE] =
        filter == CSM_FILTER_PCF ? effects[CSM_EFFECT_FILTER_SIZE] : 0;
}
