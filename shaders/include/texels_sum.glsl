// texels_sum.glsl: one step towards summed areas [Crow 1984] in whole numbers: the sum of eight texels a stride apart.
// Sums may wrap around: what a kernel covers is a difference of them, which is right again.

layout(location = 0) uniform ivec4 place; // cascade, layer read from, texels along a side
layout(location = 1) uniform ivec2 stride;

layout(binding = 4) uniform usampler2DArray source;

uvec4 summed(ivec2 texel)
{
    uvec4 sum = uvec4(0u);
    for (int i = 0; i < 8; i++) {
        ivec2 from = texel - i * stride;
        if (min(from.x, from.y) >= 0) {
            sum += texelFetch(source, ivec3(from, place.y), 0);
        }
    }
    return sum;
}
