// receiver_range.comp: least and greatest view depth of the receivers that face the sun, for every run of pixels, and
// how many there are in each bin of depth.
#include "include/frame.glsl"
#include "include/geometry.glsl"
#include "include/receiver.glsl"
#include "include/view_receiver.glsl"
#include "include/view_column.glsl"

layout(local_size_x = 64) in;

const int depth_bins = 256; // CSM_DEPTH_BINS

layout(std430, binding = 7) buffer range_block
{
    uint histogram[depth_bins];
    vec2 ranges[]; // empty where least > greatest
};

// As depth_bin of receivers.c.
int depth_bin(float depth, vec2 ends)
{
    float share = ends.x > 0.0 ? log(depth / ends.x) / log(ends.y / ends.x) : (depth - ends.x) / (ends.y - ends.x);
    return clamp(int(share * float(depth_bins)), 0, depth_bins - 1);
}

void main()
{
    view_column run = column_of_invocation();
    if (run.first >= run.last) {
        return;
    }
    const float infinity = uintBitsToFloat(0x7f800000u);
    vec2 range = vec2(infinity, -infinity);
    for (int row = run.first; row < run.last; row++) {
        bool counts;
        float depth = depth_of_row(run, row, counts);
        range = vec2(min(range.x, counts ? depth : infinity), max(range.y, counts ? depth : -infinity));
        // quantiles need no more than every fourth pixel of every fourth row
        if (counts && run.column % 4 == 1 && row % 4 == 1) {
            atomicAdd(histogram[depth_bin(depth, run.ends)], 1u);
        }
    }
    ranges[int(gl_GlobalInvocationID.x)] = range;
}
