// filter_evsm4.glsl: exponential variance shadow maps, the smaller bound of both warps [Lauritzen, McCool 2008].

#if CSM_RECEIVER_PLANE

// Logarithm of the mean of exp(a x) over x from -1 to 1.
float log_mean_of_power(float a)
{
    return a < 0.1 ? a * a / 6.0 : a + log((1.0 - exp(-2.0 * a)) / (2.0 * a));
}

#endif

float filter_visibility(map_receiver at)
{
    vec4 found = moments_at(at, 0, 1);
    vec2 warped = exponential_warps(at.z);
#if CSM_RECEIVER_PLANE
    // The negative warp bends down, so its mean over the receiver's own plane lies before the receiver, which would
    // shadow itself: it is compared as that mean, of a box as wide as the kernel and the lookup. The other bends up.
    vec2 change = 2.0 * frame.moments.y * frame.bias.z * abs(at.slope);
    float lift = log_mean_of_power(change.x) + log_mean_of_power(change.y);
    warped.y = -exp(min(lift - frame.moments.y * (2.0 * at.z - 1.0), frame.moments.y));
#endif
    return min(largest_lit_share_scaled(warped.x, found.x, found.y, frame.moments.z),
               largest_lit_share_scaled(warped.y, found.z, found.w, frame.moments.z));
}
