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
        // a share at a time: powers may be as large as their format holds
        sum += moments_of(CSM_REVERSED_DEPTH == 1 ? 1.0 - depth : depth, place.y) / float(CSM_SAMPLES);
    }
    return sum;
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

// In whole steps, so that sums are exact however long they get. The depth has a sign, which sums of 32 bits keep.
uvec4 texel_moments(ivec2 texel)
{
    vec2 steps = floor(mean_moments(texel).xy * frame.bleed.w + 0.5);
    return uvec4(uint(int(steps.x)), uint(steps.y), 0u, 0u);
}

#else

vec4 texel_moments(ivec2 texel)
{
    return mean_moments(min(texel, place.z - 1)); // beyond the map its last texel goes on
}

#endif
