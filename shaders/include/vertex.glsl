// vertex.glsl: what every pass that draws triangles gets per vertex.
#include "include/geometry.glsl"

layout(location = 0) in vec3 position;

#if CSM_INSTANCES
layout(location = 1) in uint instance; // steps once per drawn instance
#else
const uint instance = 0u;
#endif

#if CSM_ALPHA_TEST
layout(location = 2) in vec2 texels;
layout(location = 3) in uvec2 image;

layout(location = 8) sample out vec2 cutout_texels; // of include/cutout.glsl
layout(location = 9) flat out uvec2 cutout_image;

void pass_cutout()
{
    cutout_texels = texels;
    cutout_image = image;
}
#endif
