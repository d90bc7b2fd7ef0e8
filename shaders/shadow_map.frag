// shadow_map.frag: depth of a caster in a warped map (docs/numerics.md 21); without a warp the rasteriser's own serves.
//
// The divisor is known where the texel is: interpolated from corners far outside the map, where it is thousands of
// times larger, it would keep none of its digits here.
#include "include/frame.glsl"
#include "include/warp.glsl"

layout(location = 0) uniform int cascade;

layout(location = 0) in float depth; // share of the depth range, free of the divisor

void main()
{
    float texels = frame.centre[cascade].z; // of half the map's side
    gl_FragDepth = depth / warp_divisor(gl_FragCoord.y / texels - 1.0, cascade);
}
