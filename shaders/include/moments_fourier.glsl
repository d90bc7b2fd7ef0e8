// moments_fourier.glsl: sines and cosines of depth [Annen et al. 2007], two terms in each layer.
#include "include/fourier_terms.glsl"

vec4 moments_of(float depth, int slice)
{
    float first = pi * depth * float(4 * slice + 1), second = pi * depth * float(4 * slice + 3);
    return fourier_stored(vec4(sin(first), cos(first), sin(second), cos(second)));
}
