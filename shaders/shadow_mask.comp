// shadow_mask.comp: visibility and what else is asked for, at every pixel.
#include "include/frame.glsl"
#include "include/geometry.glsl"
#include "include/visibility.glsl"
#include "include/view_receiver.glsl"

layout(local_size_x = 16, local_size_y = 8) in;

#include "include/answer.glsl"

// Neighbours in a row that one invocation answers for, so that uniforms are read once for all of them.
const int run_length = 8;

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
