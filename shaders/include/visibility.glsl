// visibility.glsl: from a receiver to its visibility and cascade; with moments.glsl the only file that branches on
// FILTER.
#include "include/receiver.glsl"

struct verdict
{
    float visibility;
    float single;      // of the one cascade, without blend or fade
    float next_weight; // of the next cascade in visibility
    int cascade;       // no_cascade beyond the shadow range
};

#if CSM_FILTER != CSM_FILTER_NONE

#include "include/shadow_bias.glsl"
#include "include/cascade_select.glsl"
#include "include/seams.glsl"

// An include is resolved once, whatever #if surrounds it: what several filters share stands here.
#include "include/kernel.glsl"
#if CSM_PREFILTERED
#include "include/depth_warps.glsl"
#include "include/chebyshev.glsl"
#endif
#if CSM_SUMMED
#include "include/sums_lookup.glsl"
#elif CSM_PREFILTERED
#include "include/moments_lookup.glsl"
#else
#include "include/shadow_storage.glsl"
#include "include/tap.glsl"
#endif
#if CSM_FILTER == CSM_FILTER_POISSON || CSM_FILTER == CSM_FILTER_PCSS && CSM_PCSS_MAP == CSM_PCSS_MAP_DEPTH
#include "include/disc.glsl"
#endif

#if CSM_FILTER == CSM_FILTER_HARD
#include "include/filter_hard.glsl"
#elif CSM_FILTER == CSM_FILTER_PCF
#include "include/weights.glsl"
#include "include/filter_pcf.glsl"
#elif CSM_FILTER == CSM_FILTER_POISSON
#include "include/filter_poisson.glsl"
#elif CSM_FILTER == CSM_FILTER_VSM
#include "include/filter_vsm.glsl"
#elif CSM_FILTER == CSM_FILTER_EVSM2
#include "include/filter_evsm2.glsl"
#elif CSM_FILTER == CSM_FILTER_EVSM4
#include "include/filter_evsm4.glsl"
#elif CSM_FILTER == CSM_FILTER_ESM
#include "include/filter_esm.glsl"
#elif CSM_FILTER == CSM_FILTER_LVSM
#include "include/filter_lvsm.glsl"
#elif CSM_FILTER == CSM_FILTER_PCSS && CSM_PCSS_MAP == CSM_PCSS_MAP_DEPTH
#include "include/filter_pcss.glsl"
#elif CSM_FILTER == CSM_FILTER_MSM
#include "include/filter_msm.glsl"
#elif CSM_FILTER == CSM_FILTER_SAVSM
#include "include/filter_savsm.glsl"
#elif CSM_FILTER == CSM_FILTER_FOURIER
#include "include/filter_fourier.glsl"
#elif CSM_FILTER == CSM_FILTER_PCSS && CSM_PCSS_MAP != CSM_PCSS_MAP_DEPTH
#include "include/filter_pcss_moments.glsl"
#endif

float map_visibility(map_receiver at)
{
#if CSM_PREFILTERED == 0
    choose_map(at.cascade);
#endif
    return filter_visibility(at);
}

#if CSM_BLEND != CSM_BLEND_NONE

// Weight of the next cascade by the kind of transition.
float transition(float next_weight, float noise)
{
#if CSM_BLEND == CSM_BLEND_SMOOTH
    return next_weight * next_weight * (3.0 - 2.0 * next_weight);
#elif CSM_BLEND == CSM_BLEND_DITHER
    return noise < next_weight ? 1.0 : 0.0;
#else
    return next_weight;
#endif
}

#endif

verdict receiver_verdict(receiver point)
{
    choice chosen = choose_for_pixel(point);
    verdict found;
    found.cascade = chosen.own.cascade;
    found.next_weight = 0.0;
#if CSM_BLEND == CSM_BLEND_DITHER && !CSM_OUT_MASK_SINGLE
    found.next_weight = transition(chosen.next_weight, point.noise);
    if (found.next_weight > 0.0) {
        chosen.own = chosen.next;
    }
#endif
    found.single = map_visibility(in_map(point, chosen.own));
    found.visibility = found.single;
#if CSM_BLEND != CSM_BLEND_NONE && (CSM_BLEND != CSM_BLEND_DITHER || CSM_OUT_MASK_SINGLE)
    found.next_weight = transition(chosen.next_weight, point.noise);
    if (found.next_weight > 0.0) {
        float next = map_visibility(in_map(point, chosen.next));
        found.visibility = min(mix(found.single, next, found.next_weight), 1.0);
    }
#endif
#if CSM_FADE
    float left = clamp((frame.blend.y - point.view_depth) * frame.blend.z, 0.0, 1.0);
    found.visibility = 1.0 - (1.0 - found.visibility) * left;
#endif
    if (found.cascade == no_cascade) {
        found = verdict(1.0, 1.0, 0.0, no_cascade);
    }
    return found;
}

int receiver_cascade(receiver point)
{
    return choose_for_pixel(point).own.cascade;
}

#else

verdict receiver_verdict(receiver point)
{
    return verdict(1.0, 1.0, 0.0, no_cascade);
}

int receiver_cascade(receiver point)
{
    return no_cascade;
}

#endif
