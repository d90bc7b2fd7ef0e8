// shadow_mask.frag: as shadow_mask.comp, a fragment a pixel.
#include "include/frame.glsl"
#include "include/geometry.glsl"
#include "include/visibility.glsl"
#include "include/view_receiver.glsl"
#include "include/answer.glsl"

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    bool seen;
    receiver point = receiver_at(pixel, seen);
    write_answer(pixel, point, seen);
}
