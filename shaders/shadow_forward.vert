// shadow_forward.vert: surfaces as the camera sees them, with their light-space position at each vertex
// (docs/numerics.md 24).
#include "include/frame.glsl"
#include "include/vertex.glsl"

layout(location = 0) flat out uvec2 ids; // as in view.vert
layout(location = 1) out vec3 from_eye;
layout(location = 2) out vec3 position_ls;

invariant gl_Position; // the view pass's own, so that the same pixels are covered

void main()
{
    vec3 place = origin_from_local(instance, position);
    precise vec3 away = (place - frame.eye_high.xyz) - frame.eye_low.xyz;
    gl_Position = frame.clip_from_eye * vec4(away, 1.0);
    ids = uvec2(uint(gl_VertexID), instance);
    from_eye = away;
    position_ls = light_position(place);
}
