// chebyshev.glsl: the largest share of depths at or behind a receiver that a mean and a variance allow.

// Light at or below a step is taken for bleeding, and a power darkens the rest.
float without_bleeding(float lit)
{
#if CSM_BLEEDING
    return pow(clamp((lit - frame.bleed.x) * frame.bleed.y, 0.0, 1.0), frame.bleed.z);
#else
    return lit;
#endif
}

float largest_lit_share(float depth, float mean, float square, float least_variance)
{
    float variance = max(square - mean * mean, least_variance);
    float behind = depth - mean;
    // the quotient of nearly equal numbers may exceed 1 on a GPU
    return behind <= 0.0 ? 1.0 : without_bleeding(min(variance / (variance + behind * behind), 1.0));
}

// The same of values from tiny to huge that are rounded as shares of themselves, and so is the least variance:
// in units of the larger of receiver and mean nothing is lost, and no square overflows.
float largest_lit_share_scaled(float depth, float mean, float square, float least_variance)
{
    float unit = 1.0 / max(abs(depth), abs(mean));
    return largest_lit_share(depth * unit, mean * unit, square * unit * unit, least_variance);
}
