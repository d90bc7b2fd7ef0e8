// texels_moments.glsl: what is stored of the depths in a texel.
#include "include/frame.glsl"
#include "include/moments.glsl"

layout(location = 0) uniform ivec4 place; // cascade, slice, texels along a side; map among those bound

#if CSM_SAMPLES > 1

layout(binding = 5) uniform sampler2DMS shadow_samples;

// Moments are means over depths: a texel of several samples is filtered already.
vec4 mean_moments(ivec2 texel)
{
    vec4 sum = vec4(0.0);
    for (int i = 0; i < CSM_SAMPLES; i++) {
        float depth = texelFetch(shadow_samples, texel, i).r;
        sum += moments_of(CSM_REVERSED_DEPTH == 1 ? 1.0 - depth : depth, place.y);
    }
    return sum / float(CSM_SAMPLES);
}

#else

#include "include/shadow_storage.glsl"

vec4 mean_moments(ivec2 texel)
{
    choose_map(place.w);
    return moments_of(map_depth_at(place.w, texel), place.y);
}

#endif

#if CSM_SUMMED

// In whole steps, so that sums are exact however long they get.
uvec4 texel_moments(ivec2 texel)
{
    return uvec4(mean_moments(texel) * frame.bleed.w + 0.5);
}

#else

vec4 texel_moments(ivec2 texel)
{
    return mean_moments(min(texel, place.z - 1)); // beyond the map its last texel goes on
}

#endif
