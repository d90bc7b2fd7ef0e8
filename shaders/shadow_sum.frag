// shadow_sum.frag: a step towards summed areas.
#include "include/texels_sum.glsl"
#include "include/texel_target.glsl"

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    store_texel(texel, summed(texel));
}
