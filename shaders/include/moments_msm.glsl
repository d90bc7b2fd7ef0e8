// moments_msm.glsl: the first four powers of depth, from -1 to 1 [Peters, Klein 2015].
#include "include/msm_transform.glsl"

vec4 moments_of(float depth, int slice)
{
    float centred = 2.0 * depth - 1.0;
    float square = centred * centred;
    return msm_stored(vec4(centred, square, square * centred, square * square));
}
