// shadow_forward.frag: the answers of shadow_mask.comp for the triangle that a pixel sees, from what the rasteriser
// interpolates instead of from the pixel's ray.
#include "include/frame.glsl"
#include "include/geometry.glsl"
#include "include/visibility.glsl"
#include "include/view_receiver.glsl"
#include "include/answer.glsl"

layout(location = 0) flat in uvec2 ids;
layout(location = 1) in vec3 from_eye;
layout(location = 2) in vec3 position_ls;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    uvec2 seen = texelFetch(view_ids, pixel, 0).xy;
#if CSM_INSTANCES
    if (seen != ids) {
        discard;
    }
#else
    if (seen.x != ids.x) {
        discard;
    }
#endif
    vec4 plane = origin_plane(ids.y, texelFetch(planes, int(ids.x)));
    vec3 normal_origin = plane.xyz;
    vec3 direction = frame.right.w > 0.0 ? -frame.backward.xyz : from_eye;
    receiver point;
    point.normal = dot(normal_origin, direction) > 0.0 ? -normal_origin : normal_origin;
    point.view_depth = clamp(-dot(frame.backward.xyz, from_eye), frame.view.z, frame.view.w);
    point.position = frame.eye_high.xyz + (frame.eye_low.xyz + from_eye);
    point.position_ls = position_ls;
    point.noise = pixel_noise(pixel);
    take_steps(point, pixel, plane, true);
    write_answer(pixel, point, true);
}
