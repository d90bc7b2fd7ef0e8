// moments_esm.glsl: a power of depth [Annen et al. 2008], or of its logarithm what does not depend on the exponent.

vec4 moments_of(float depth, int slice)
{
#if CSM_LOG_FILTER
    return vec4(stored_pair(centred(depth)).x, 0.0, 0.0, 0.0);
#else
    return vec4(exp(frame.moments.x * depth), 0.0, 0.0, 0.0);
#endif
}
