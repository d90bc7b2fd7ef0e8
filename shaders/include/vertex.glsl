// vertex.glsl: what every pass that draws triangles gets per vertex.
#include "include/geometry.glsl"

layout(location = 0) in vec3 position;

#if CSM_INSTANCES
layout(location = 1) in uint instance; // steps once per drawn instance
#else
const uint instance = 0u;
#endif
