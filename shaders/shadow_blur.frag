// shadow_blur.frag: moments blurred along one axis.
#include "include/texels_blur.glsl"
#include "include/texel_target.glsl"

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    store_texel(texel, blurred(texel));
}
