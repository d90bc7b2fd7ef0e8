// shadow_points.comp: visibility of any points, with or without the normal of their surface.
#include "include/frame.glsl"
#include "include/noise.glsl"
#include "include/visibility.glsl"

layout(local_size_x = 256) in;

layout(std430, binding = 1) readonly buffer point_block
{
    float points[]; // x, y, z relative to the scene's origin, then the normal, zero if unknown
};

layout(std430, binding = 6) writeonly buffer visibility_block
{
    vec4 answers[]; // visibility, cascade, weight of the next cascade
};

void main()
{
    int i = int(gl_GlobalInvocationID.x) + frame.image.z;
    if (i >= frame.image.w) {
        return;
    }
    receiver point;
    point.position = vec3(points[6 * i], points[6 * i + 1], points[6 * i + 2]);
    point.normal = vec3(points[6 * i + 3], points[6 * i + 4], points[6 * i + 5]);
    vec3 from_eye = (point.position - frame.eye_high.xyz) - frame.eye_low.xyz;
    point.view_depth = -dot(frame.backward.xyz, from_eye);
    point.noise = place_noise(point.position);
    stand_alone(point);
    verdict found = receiver_verdict(point);
    bool facing = !plane_known(point) || dot(point.normal, frame.to_light.xyz) > facing_limit;
    answers[i] = vec4(facing ? found.visibility : 0.0, float(found.cascade), found.next_weight, 0.0);
}
