// shadow_map.vert: casters as the light sees them, in the window of one cascade.
#include "include/frame.glsl"
#include "include/geometry.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in uvec2 draw_record; // first triangle, instance

layout(location = 0) uniform int cascade;

void main()
{
    vec3 position_ls = light_position(origin_from_local(draw_record.y, position));
    vec2 texels = lattice_texels(position_ls.xy, cascade) - vec2(frame.lattice[cascade].xy);
    vec2 ndc = texels * (2.0 / float(frame.lattice[cascade].z)) - 1.0;
    gl_Position = vec4(ndc, map_depth(position_ls.z, cascade), 1.0);
}
