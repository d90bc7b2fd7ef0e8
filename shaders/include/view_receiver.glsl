// view_receiver.glsl: the surface that the view pass left at a pixel. Needs frame.glsl, geometry.glsl, receiver.glsl.
#include "include/noise.glsl"

layout(binding = 0) uniform usampler2D view_ids;

layout(binding = 3) uniform samplerBuffer planes; // unit normal and offset of every stored triangle

const uint nothing = 0xffffffffu;

// Plane of the triangle that is seen at a pixel, relative to the scene's origin; some plane where there is none.
vec4 plane_at(ivec2 pixel, out bool seen)
{
    uvec2 ids = texelFetch(view_ids, pixel, 0).xy;
    seen = ids.x != nothing;
    return origin_plane(seen ? ids.y : 0u, texelFetch(planes, seen ? int(ids.x) : 0));
}

// View depth where a ray, eye + start + depth * direction, meets a plane: the ray's parameter is the view depth, as
// direction has unit length along the view axis.
float depth_on_plane(vec4 plane, vec3 eye_high, vec3 eye_low, vec3 start, vec3 direction, vec2 ends)
{
    float towards = dot(plane.xyz, direction);
    // a triangle seen exactly edge-on has no crossing and is taken at its bounds
    float height = plane.w - dot(plane.xyz, eye_high) - dot(plane.xyz, eye_low + start);
    float divisor = abs(towards) > 1e-20 ? towards : 1e-20;
    return clamp(height / divisor, ends.x, ends.y);
}

// The ray through a pixel's centre.
struct view_ray
{
    vec3 start, direction; // relative to the eye; of unit length along the view axis
};

view_ray ray_through(ivec2 pixel)
{
    vec2 ndc = (vec2(pixel) + 0.5) / vec2(frame.image.xy) * 2.0 - 1.0;
    vec2 at = frame.view_centre.xy + ndc * frame.view.xy;
    vec3 side = at.x * frame.right.xyz + at.y * frame.up.xyz;
    bool orthographic = frame.right.w > 0.0;
    return view_ray(orthographic ? side : vec3(0.0),
                    orthographic ? -frame.backward.xyz : side - frame.backward.xyz);
}

// Where the ray through a pixel meets a plane.
float plane_depth(vec4 plane, view_ray ray)
{
    return depth_on_plane(plane, frame.eye_high.xyz, frame.eye_low.xyz, ray.start, ray.direction, frame.view.zw);
}

vec3 towards_camera(vec4 plane, view_ray ray)
{
    return dot(plane.xyz, ray.direction) > 0.0 ? -plane.xyz : plane.xyz;
}

#include "include/pixel_steps.glsl"

// The visible surface at a pixel; seen is false where there is none.
receiver receiver_at(ivec2 pixel, out bool seen)
{
    vec4 plane = plane_at(pixel, seen);
    view_ray ray = ray_through(pixel);
    float depth = plane_depth(plane, ray);

    receiver point;
    point.normal = seen ? towards_camera(plane, ray) : vec3(0.0);
    point.view_depth = seen ? depth : uintBitsToFloat(0x7f800000u); // infinity
    point.position = frame.eye_high.xyz + (frame.eye_low.xyz + ray.start + depth * ray.direction);
    point.noise = pixel_noise(pixel);
    take_steps(point, pixel, plane, seen);
    return point;
}
