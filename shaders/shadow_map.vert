// shadow_map.vert: casters as the light sees them, in the window of one cascade.
#include "include/frame.glsl"
#include "include/vertex.glsl"

layout(location = 0) uniform int cascade;

void main()
{
    vec3 position_ls = light_position(origin_from_local(instance, position));
    vec4 clip = frame.clip[cascade];
    gl_Position = vec4(turned(position_ls.xy, cascade) * clip.xy + clip.zw, map_depth(position_ls.z, cascade), 1.0);
}
