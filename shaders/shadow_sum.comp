// shadow_sum.comp: a step towards summed areas.
#include "include/texels_sum.glsl"
#include "include/texel_target.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(location = 2) uniform int written; // texels along a side

void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (max(texel.x, texel.y) < written) {
        store_texel(texel, summed(texel));
    }
}
