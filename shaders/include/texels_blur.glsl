// texels_blur.glsl: moments blurred along one axis; the same along the other gives a square kernel.
#include "include/frame.glsl"
#include "include/weights.glsl"

layout(location = 0) uniform ivec4 place; // cascade, layer read from, texels along a side
layout(location = 1) uniform ivec2 along;

layout(binding = 4) uniform sampler2DArray source;

vec4 neighbour(ivec2 texel, int offset)
{
    ivec2 own = min(texel, place.z - 1); // beyond the map its last texel goes on
    ivec2 from = clamp(own + offset * along, ivec2(0), ivec2(place.z - 1));
    return texelFetch(source, ivec3(from, place.y), 0);
}

// Differences to the texel itself are averaged, with weights whose sum is 1: what is level stays so to the bit,
// however long the kernel, and no sum is larger than what it is the mean of.
vec4 blurred(ivec2 texel)
{
    vec2 half_widths = frame.kernel[place.x].xy;
    float half_width = along.x > 0 ? half_widths.x : half_widths.y;
    int radius = int(ceil(half_width + 0.5)) - 1;
    vec4 own = neighbour(texel, 0);
    float total = 0.0;
#if CSM_LOG_FILTER
    float deepest = own.x;
#endif
    for (int offset = -radius; offset <= radius; offset++) {
        total += kernel_weight(offset, 0.5, half_width);
#if CSM_LOG_FILTER
        deepest = max(deepest, neighbour(texel, offset).x);
#endif
    }
    float share = 1.0 / total;
    vec4 sum = vec4(0.0);
    for (int offset = -radius; offset <= radius; offset++) {
        float weight = kernel_weight(offset, 0.5, half_width) * share;
#if CSM_LOG_FILTER
        // powers by the largest of them
        sum.x += weight * (exp(frame.moments.x * (neighbour(texel, offset).x - deepest)) - 1.0);
#else
        sum += weight * (neighbour(texel, offset) - own);
#endif
    }
#if CSM_LOG_FILTER
    return vec4(deepest + log(1.0 + sum.x) / frame.moments.x);
#else
    return own + sum;
#endif
}
