// receiver_bounds.comp: light-space boxes of the receivers that face the sun, a box per cascade for every run of
// pixels, along the axes of that cascade. The host takes their union: no atomics, and the same answer in any order.
#include "include/frame.glsl"
#include "include/geometry.glsl"
#include "include/receiver.glsl"
#include "include/view_receiver.glsl"
#include "include/view_column.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 7) writeonly buffer bounds_block
{
    vec4 bounds[]; // light x, y least and greatest relative to the origin; empty where least > greatest
};

// The mask pass may round a depth at a split to the other side.
const float split_tolerance = 1e-5;

void main()
{
    view_column run = column_of_invocation();
    if (run.first >= run.last) {
        return;
    }
    const float infinity = uintBitsToFloat(0x7f800000u);
    vec2 low[CSM_CASCADE_COUNT], high[CSM_CASCADE_COUNT];
    float nearest[CSM_CASCADE_COUNT], farthest[CSM_CASCADE_COUNT];
    for (int cascade = 0; cascade < CSM_CASCADE_COUNT; cascade++) {
        low[cascade] = vec2(infinity);
        high[cascade] = vec2(-infinity);
        float end = frame.slope[cascade].z;
        farthest[cascade] = end + abs(end) * split_tolerance;
        float start = cascade > 0 ? frame.slope[max(cascade - 1, 0)].z : -infinity;
        nearest[cascade] = start - abs(start) * split_tolerance;
    }
    vec2 start0 = light_position(run.start0).xy + light_position(run.eye_low).xy + light_position(run.eye_high).xy;
    vec2 start1 = light_position(run.start1).xy;
    vec2 direction0 = light_position(run.direction0).xy, direction1 = light_position(run.direction1).xy;
    for (int row = run.first; row < run.last; row++) {
        bool counts;
        float depth = depth_of_row(run, row, counts);
        float ndc_y = ndc_of_row(run, row);
        vec2 at = start0 + ndc_y * start1 + depth * (direction0 + ndc_y * direction1);
        for (int cascade = 0; cascade < CSM_CASCADE_COUNT; cascade++) {
            bool own = counts && depth > nearest[cascade] && depth <= farthest[cascade];
            vec2 along = turned(at, cascade);
            low[cascade] = min(low[cascade], own ? along : vec2(infinity));
            high[cascade] = max(high[cascade], own ? along : vec2(-infinity));
        }
    }
    for (int cascade = 0; cascade < CSM_CASCADE_COUNT; cascade++) {
        bounds[int(gl_GlobalInvocationID.x) * CSM_CASCADE_COUNT + cascade] = vec4(low[cascade], high[cascade]);
    }
}
