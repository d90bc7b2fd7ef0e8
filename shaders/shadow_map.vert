// shadow_map.vert: casters as the light sees them, in the window of one cascade.
#include "include/frame.glsl"
#include "include/vertex.glsl"
#if CSM_WARPED
#include "include/warp.glsl"

layout(location = 0) out float depth;
#endif

layout(location = 0) uniform int cascade;

#if CSM_BIAS_SIDE == CSM_BIAS_SIDE_CASTER && !CSM_WARPED
layout(location = 2) uniform vec2 bias; // depth that casters are pushed back by; the rest is the rasteriser's
#endif

void main()
{
    vec3 position_ls = light_position(origin_from_local(instance, position));
#if CSM_WARPED
    depth = map_depth(position_ls.z, cascade);
    gl_Position = warp_clip(warp_local(position_ls.xy, cascade), depth, cascade);
#if CSM_REVERSED_DEPTH
    gl_Position.z = gl_Position.w - gl_Position.z;
#endif
#else
    vec4 clip = frame.clip[cascade];
    float z = map_depth(position_ls.z, cascade);
#if CSM_BIAS_SIDE == CSM_BIAS_SIDE_CASTER
    gl_ClipDistance[0] = z; // what lies before the range is left out, whatever the bias
    z += bias.x;
#endif
    gl_Position = vec4(turned(position_ls.xy, cascade) * clip.xy + clip.zw, CSM_REVERSED_DEPTH == 1 ? 1.0 - z : z, 1.0);
#endif
#if CSM_ALPHA_TEST
    pass_cutout();
#endif
}
