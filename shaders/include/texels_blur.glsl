// texels_blur.glsl: moments blurred along one axis; the same along the other gives a square kernel.
#include "include/frame.glsl"
#include "include/weights.glsl"

layout(location = 0) uniform ivec4 place; // cascade, layer read from, texels along a side
layout(location = 1) uniform ivec2 along;

layout(binding = 4) uniform sampler2DArray source;

vec4 blurred(ivec2 texel)
{
    float half_width = frame.kernel[place.x].x;
    int radius = int(half_width);
    ivec2 own = min(texel, place.z - 1); // beyond the map its last texel goes on
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int offset = -radius; offset <= radius; offset++) {
        float weight = kernel_weight(offset, 0.5, half_width);
        ivec2 from = clamp(own + offset * along, ivec2(0), ivec2(place.z - 1));
        sum += weight * texelFetch(source, ivec3(from, place.y), 0);
        total += weight;
    }
    return sum / total;
}
