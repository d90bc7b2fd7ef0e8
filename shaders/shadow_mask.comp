// shadow_mask.comp: visibility and what else is asked for, at every pixel.
#include "include/frame.glsl"
#include "include/geometry.glsl"
#include "include/visibility.glsl"

layout(local_size_x = 32, local_size_y = 8) in;

layout(binding = 0) uniform usampler2D view_ids;

layout(std430, binding = 1) readonly buffer plane_block
{
    vec4 planes[]; // unit normal and offset of every stored triangle
};

#if CSM_OUT_MASK
layout(std430, binding = 2) writeonly buffer mask_block
{
    float mask[];
};
#endif
#if CSM_OUT_VALID || CSM_OUT_CASCADE_INDEX
layout(std430, binding = 3) writeonly buffer index_block
{
    uint cascade_index[]; // valid in bit 8
};
#endif
#if CSM_OUT_VIEW_DEPTH
layout(std430, binding = 4) writeonly buffer view_depth_block
{
    float view_depth[];
};
#endif
#if CSM_OUT_NORMAL
layout(std430, binding = 5) writeonly buffer normal_block
{
    float normal[];
};
#endif

const uint nothing = 0xffffffffu;
const float facing_limit = 1e-5; // an edge-on wall is not decided by rounding

// Plane of a triangle relative to the scene's origin.
vec4 plane_of(uvec2 ids)
{
    vec4 plane = planes[ids.x];
    if (ids.y == 0u) {
        return plane;
    }
    // normals go with the cofactors of the linear part; a point of the plane goes with the whole
    instance_rows rows = instances[ids.y];
    mat3 linear = transpose(mat3(rows.x.xyz, rows.y.xyz, rows.z.xyz));
    mat3 cofactors = mat3(cross(linear[1], linear[2]), cross(linear[2], linear[0]),
                          cross(linear[0], linear[1]));
    vec3 n = normalize(cofactors * plane.xyz);
    return vec4(n, dot(n, origin_from_local(ids.y, plane.xyz * plane.w)));
}

void main()
{
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, frame.image.z);
    if (pixel.x >= frame.image.x || pixel.y >= frame.image.y) {
        return;
    }
    // row 0 is on top outside, at the bottom in GL
    int place = (frame.image.y - 1 - pixel.y) * frame.image.x + pixel.x;
    uvec2 ids = texelFetch(view_ids, pixel, 0).xy;
    bool seen = ids.x != nothing;
    vec2 ndc = (vec2(pixel) + 0.5) / vec2(frame.image.xy) * 2.0 - 1.0;
    vec3 side = ndc.x * frame.view.x * frame.right.xyz + ndc.y * frame.view.y * frame.up.xyz;

    bool orthographic = frame.right.w > 0.0;
    receiver point;
    point.position = vec3(0.0);
    point.normal = vec3(0.0);
    point.view_depth = uintBitsToFloat(0x7f800000u); // infinity
    if (seen) {
        vec4 plane = plane_of(ids);
        vec3 start = orthographic ? side : vec3(0.0);
        vec3 direction = orthographic ? -frame.backward.xyz : side - frame.backward.xyz;
        float towards = dot(plane.xyz, direction);
        point.normal = towards > 0.0 ? -plane.xyz : plane.xyz;
        // the ray's parameter is the view depth, as direction has unit length along the view axis;
        // a triangle seen exactly edge-on has no crossing and is taken at its bounds
        float height = plane.w - dot(plane.xyz, frame.eye_high.xyz) -
                       dot(plane.xyz, frame.eye_low.xyz + start);
        towards = abs(towards) > 1e-20 ? towards : 1e-20;
        point.view_depth = clamp(height / towards, frame.view.z, frame.view.w);
        point.position = frame.eye_high.xyz + (frame.eye_low.xyz + start +
                                               point.view_depth * direction);
    }
    int cascade = 255;
#if CSM_OUT_MASK
    float visibility = 1.0;
    if (seen) {
        bool facing = dot(point.normal, frame.to_light.xyz) > facing_limit;
        visibility = receiver_visibility(point, cascade);
        visibility = facing ? visibility : 0.0;
    }
    mask[place] = visibility;
#elif CSM_OUT_CASCADE_INDEX
    if (seen) {
        cascade = receiver_cascade(point);
    }
#endif
#if CSM_OUT_VALID || CSM_OUT_CASCADE_INDEX
    cascade_index[place] = uint(cascade) | (seen ? 256u : 0u);
#endif
#if CSM_OUT_VIEW_DEPTH
    view_depth[place] = point.view_depth;
#endif
#if CSM_OUT_NORMAL
    normal[3 * place] = point.normal.x;
    normal[3 * place + 1] = point.normal.y;
    normal[3 * place + 2] = point.normal.z;
#endif
}
