// shadow_points.comp: visibility of any points, whose surface is not known.
#include "include/frame.glsl"
#include "include/visibility.glsl"

layout(local_size_x = 256) in;

layout(std430, binding = 1) readonly buffer point_block
{
    float points[]; // x, y, z relative to the scene's origin
};

layout(std430, binding = 6) writeonly buffer visibility_block
{
    vec2 answers[]; // visibility, cascade
};

void main()
{
    int i = int(gl_GlobalInvocationID.x) + frame.image.z;
    if (i >= frame.image.w) {
        return;
    }
    receiver point;
    point.position = vec3(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
    point.normal = vec3(0.0);
    vec3 from_eye = (point.position - frame.eye_high.xyz) - frame.eye_low.xyz;
    point.view_depth = -dot(frame.backward.xyz, from_eye);
    int cascade;
    float visibility = receiver_visibility(point, cascade);
    answers[i] = vec2(visibility, float(cascade));
}
