// shadow_map.frag: what the rasteriser's own depth does not serve: warped maps and casters with a cut-out.
#if CSM_ALPHA_TEST
#include "include/cutout.glsl"
#endif
#if CSM_WARPED
#include "include/frame.glsl"
#include "include/warp.glsl"

layout(location = 0) uniform int cascade;
layout(location = 1) uniform int lowest_row; // of the map in what it is drawn into

layout(location = 0) in float depth; // share of the depth range, free of the divisor
#endif

void main()
{
#if CSM_ALPHA_TEST
    if (cut_out()) {
        discard;
    }
#endif
#if CSM_WARPED
    // The divisor is known where the texel is (docs/numerics.md 21): interpolated from corners far outside the map,
    // where it is thousands of times larger, it would keep none of its digits here.
    float texels = frame.centre[cascade].z; // of half the map's side
    float divided = depth / warp_divisor((gl_FragCoord.y - float(lowest_row)) / texels - 1.0, cascade);
    gl_FragDepth = CSM_REVERSED_DEPTH == 1 ? 1.0 - divided : divided;
#endif
}
