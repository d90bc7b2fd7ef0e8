// shadow_map.frag: what the rasteriser's own depth does not serve: warped maps and casters with a cut-out.
#if CSM_ALPHA_TEST
#include "include/cutout.glsl"
#endif
#if CSM_WARPED
#include "include/frame.glsl"
#include "include/warp.glsl"

layout(location = 0) uniform int cascade;
layout(location = 1) uniform ivec2 corner; // of the map in what it is drawn into, lower left

#if CSM_BIAS_SIDE == CSM_BIAS_SIDE_CASTER
layout(location = 2) uniform vec2 bias; // constant and slope [texels]
#endif

layout(location = 0) in float depth; // share of the depth range, free of the divisor
#endif

void main()
{
#if CSM_WARPED
    // The divisor is known where the texel is (docs/numerics.md 21): interpolated from corners far outside the map,
    // where it is thousands of times larger, it would keep none of its digits here.
    float texels = frame.centre[cascade].z; // of half the map's side
    vec2 place = (gl_FragCoord.xy - vec2(corner)) / texels - 1.0;
    float w = warp_divisor(place.y, cascade);
    float divided = depth / w;
#if CSM_BIAS_SIDE == CSM_BIAS_SIDE_CASTER
    // of the slope the map's own tilt is no part: receivers follow it (warp_select.glsl)
    float tilt = warp_tilt(divided, place.y, cascade);
    float steepest = max(abs(dFdx(divided)), abs(dFdy(divided) - tilt));
    vec2 texel = warp_texel(place, w, cascade);
    float metres = bias.x * max(texel.x, texel.y);
    divided = clamp(divided - metres * frame.depth[cascade].x / w + bias.y * steepest, 0.0, 1.0);
#endif
    gl_FragDepth = CSM_REVERSED_DEPTH == 1 ? 1.0 - divided : divided;
#endif
#if CSM_ALPHA_TEST
    if (cut_out()) { // last: neighbours are needed for differences
        discard;
    }
#endif
}
