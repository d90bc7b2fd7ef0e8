// msm_transform.glsl: four moments of depths from -1 to 1 as they are stored, and back.
//
// Centred depths make float32 moments some ten times finer than those of depths from 0 to 1. In 16 bits rounding
// would still drown what tells distributions apart: the linear map of [Peters 2017] spreads all curves of moments as
// wide as a cube allows. It is linear, so that means of what it gives are what it gives of means.

#if CSM_MOMENT_FORMAT == CSM_MOMENT_FORMAT_UNORM16

const float root_of_3 = 1.7320508;

vec4 msm_stored(vec4 moments)
{
    return vec4(1.5 * moments.x - 2.0 * moments.z + 0.5, 4.0 * (moments.y - moments.w),
                root_of_3 * (0.5 * moments.x - moments.z * (2.0 / 9.0)) + 0.5, 0.5 * (moments.y + moments.w));
}

vec4 msm_moments(vec4 stored)
{
    vec2 odd = stored.xz - 0.5;
    float eighth = 0.125 * stored.y;
    return vec4(root_of_3 * odd.y - odd.x * (1.0 / 3.0), stored.w + eighth,
                0.75 * (root_of_3 * odd.y - odd.x), stored.w - eighth);
}

#else

vec4 msm_stored(vec4 moments)
{
    return moments;
}

vec4 msm_moments(vec4 stored)
{
    return stored;
}

#endif
