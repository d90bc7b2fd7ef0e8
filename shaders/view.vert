// view.vert: casters and receivers as the camera sees them.
#include "include/frame.glsl"
#include "include/vertex.glsl"

layout(location = 0) flat out uvec2 ids; // of the provoking vertex, which ends one triangle alone

invariant gl_Position; // shadow_forward.vert draws the same pixels again

void main()
{
    // The eye is subtracted first, in two parts: near the eye this difference is exact, and the
    // translation never cancels inside a matrix product.
    precise vec3 from_eye =
        (origin_from_local(instance, position) - frame.eye_high.xyz) - frame.eye_low.xyz;
    gl_Position = frame.clip_from_eye * vec4(from_eye, 1.0);
    ids = uvec2(uint(gl_VertexID), instance);
#if CSM_ALPHA_TEST
    pass_cutout();
#endif
}
