// shadow_moments.comp: what is stored of the depths of a map.
#include "include/texels_moments.glsl"
#include "include/texel_target.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(location = 2) uniform int written; // texels along a side

void main()
{
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (max(texel.x, texel.y) < written) {
        store_texel(texel, texel_moments(texel));
    }
}
