// shadow_moments.frag: what is stored of the depths of a map.
#include "include/texels_moments.glsl"
#include "include/texel_target.glsl"

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    store_texel(texel, texel_moments(texel));
}
