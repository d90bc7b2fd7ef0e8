// shadow_mask.comp: visibility and what else is asked for, at every pixel.
#include "include/frame.glsl"
#include "include/geometry.glsl"
#include "include/visibility.glsl"

layout(local_size_x = 16, local_size_y = 8) in;

layout(binding = 0) uniform usampler2D view_ids;

layout(binding = 3) uniform samplerBuffer planes; // unit normal and offset of every stored triangle

#include "include/answer.glsl"

const uint nothing = 0xffffffffu;

// Neighbours in a row that one invocation answers for, so that uniforms are read once for all of them.
const int run_length = 8;

// The visible surface at a pixel; seen is false where there is none.
receiver receiver_at(ivec2 pixel, out bool seen)
{
    uvec2 ids = texelFetch(view_ids, pixel, 0).xy;
    seen = ids.x != nothing;
    vec4 plane = origin_plane(seen ? ids.y : 0u, texelFetch(planes, seen ? int(ids.x) : 0));
    vec2 ndc = (vec2(pixel) + 0.5) / vec2(frame.image.xy) * 2.0 - 1.0;
    vec2 at = frame.view_centre.xy + ndc * frame.view.xy;
    vec3 side = at.x * frame.right.xyz + at.y * frame.up.xyz;
    bool orthographic = frame.right.w > 0.0;
    vec3 start = orthographic ? side : vec3(0.0);
    vec3 direction = orthographic ? -frame.backward.xyz : side - frame.backward.xyz;
    float towards = dot(plane.xyz, direction);
    // the ray's parameter is the view depth, as direction has unit length along the view axis;
    // a triangle seen exactly edge-on has no crossing and is taken at its bounds
    float height = plane.w - dot(plane.xyz, frame.eye_high.xyz) -
                   dot(plane.xyz, frame.eye_low.xyz + start);
    float divisor = abs(towards) > 1e-20 ? towards : 1e-20;
    float depth = clamp(height / divisor, frame.view.z, frame.view.w);

    receiver point;
    point.normal = seen ? (towards > 0.0 ? -plane.xyz : plane.xyz) : vec3(0.0);
    point.view_depth = seen ? depth : uintBitsToFloat(0x7f800000u); // infinity
    point.position = frame.eye_high.xyz + (frame.eye_low.xyz + start + depth * direction);
    return point;
}

void answer(ivec2 pixel)
{
    // the last run of a row may be cut: its surplus writes the last pixel's answer again
    pixel.x = min(pixel.x, frame.image.x - 1);
    bool seen;
    receiver point = receiver_at(pixel, seen);
    write_answer(pixel, point, seen);
}

void main()
{
    ivec2 first = ivec2(gl_GlobalInvocationID.xy) * ivec2(run_length, 1) + ivec2(0, frame.image.z);
    if (first.y >= frame.image.y) {
        return;
    }
    // written out: as a loop it reads every uniform again for each pixel
    answer(first);
    answer(first + ivec2(1, 0));
    answer(first + ivec2(2, 0));
    answer(first + ivec2(3, 0));
    answer(first + ivec2(4, 0));
    answer(first + ivec2(5, 0));
    answer(first + ivec2(6, 0));
    answer(first + ivec2(7, 0));
}
