/* bias.c: what the biases of the settings are in metres.
 *
 * In: canonical settings and the map of one cascade. Out: its terms as lengths along the light, and
 * the least that theory asks for (docs/numerics.md 11 and 30).
 */
#include "csm.h"

#include <math.h>

double csm_settings_reach(const csm_settings *settings) {
    const int *effects = settings->effects;
    const bool two_by_two =
        effects[CSM_EFFECT_FILTER] == CSM_FILTER_PCF && effects[CSM_EFFECT_FILTER_SIZE] == 2;
    /* the hardware's compare takes the centres of all four texels around the point */
    return two_by_two ? 1.0 : csm_settings_kernel_radius(settings) + 0.5;
}

csm_bias_metres csm_bias_in_metres(const csm_settings *settings, const double clip_from_light[16],
                                   int map_size, const double depth_range[2]) {
    const csm_bias bias = csm_settings_bias(settings);
    const double centre[2] = {0.0, 0.0}, *m = clip_from_light;
    double position[2], sides[2];
    csm_warp_unproject(clip_from_light, centre, map_size, position, sides);
    const double texel = fmax(sides[0], sides[1]);
    /* a warped map stores depth divided by w */
    const double w = m[3] * position[0] + m[7] * position[1] + m[15];
    const double quantum = csm_depth_quantum(settings->effects[CSM_EFFECT_DEPTH_FORMAT]) *
                           (depth_range[1] - depth_range[0]) * w;
    return (csm_bias_metres){
        .on_casters = bias.caster_constant_texels != 0.0 || bias.caster_slope_texels != 0.0,
        .receiver_plane = bias.receiver_plane,
        .texel = texel,
        .quantum = quantum,
        .constant =
            (bias.constant_texels + bias.caster_constant_texels) * texel + bias.quanta * quantum,
        .slope = (bias.slope_texels + bias.caster_slope_texels) * texel,
        .normal_offset = bias.normal_offset_texels * texel,
        .needed_constant = 0.5 * quantum,
        .needed_slope = bias.receiver_plane ? 0.0 : csm_settings_reach(settings) * texel,
    };
}
