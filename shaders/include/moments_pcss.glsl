// moments_pcss.glsl: depth and its square from -1/2 to 1/2, for levels of moments [Yang et al. 2010].
#include "include/pcss_pair.glsl"

vec4 moments_of(float depth, int slice)
{
    return vec4(pcss_stored(depth - 0.5), 0.0, 0.0);
}
