// visibility.glsl: from a receiver to its visibility and cascade; the only file that branches on FILTER.
#include "include/receiver.glsl"

#if CSM_FILTER != CSM_FILTER_NONE

layout(binding = 1) uniform sampler2DArray shadow_maps;
layout(binding = 2) uniform sampler2DArrayShadow shadow_compare;

#include "include/shadow_bias.glsl"
#include "include/cascade_select.glsl"

#if CSM_FILTER == CSM_FILTER_HARD
#include "include/filter_hard.glsl"
#elif CSM_FILTER == CSM_FILTER_PCF
#include "include/filter_pcf.glsl"
#endif

float receiver_visibility(receiver point, out int cascade)
{
    ivec2 texel;
    vec2 fraction;
    float z;
    cascade = select_cascade(point, texel, fraction, z);
    if (cascade == no_cascade) {
        return 1.0;
    }
    map_receiver at;
    at.cascade = cascade;
    at.texel = texel;
    at.fraction = fraction;
    vec2 gradient = depth_gradient(point.normal);
    at.z = z - depth_bias(point, gradient, cascade);
#if CSM_RECEIVER_PLANE
    // light-view depth grows with -z of light space, as the map's depth does
    at.slope = point.normal == vec3(0.0)
                   ? vec2(0.0)
                   : -gradient * frame.depth[cascade].zw * frame.depth[cascade].x;
#else
    at.slope = vec2(0.0);
#endif
    return filter_visibility(at);
}

int receiver_cascade(receiver point)
{
    ivec2 texel;
    vec2 fraction;
    float z;
    return select_cascade(point, texel, fraction, z);
}

#else

float receiver_visibility(receiver point, out int cascade)
{
    cascade = 255;
    return 1.0;
}

int receiver_cascade(receiver point)
{
    return 255;
}

#endif
