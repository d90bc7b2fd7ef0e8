// weights.glsl: how much a texel counts in a kernel of a given half width [texels], by its distance from the middle.
//
// box counts the texels around the one in the middle; the others are centred on the point itself, fraction of a texel
// from that one's lower corner. Box and bilinear weigh by the share of the texel that the kernel covers, so that the
// width need not be whole.

// Unscaled weight along one axis of the texel that lies offset texels from the one that holds the point.
float kernel_weight(int offset, float fraction, float half_width)
{
#if CSM_FILTER_WEIGHTS == CSM_FILTER_WEIGHTS_BOX
    return clamp(half_width + 0.5 - abs(float(offset)), 0.0, 1.0);
#elif CSM_FILTER_WEIGHTS == CSM_FILTER_WEIGHTS_BILINEAR
    // what a mean of bilinear lookups comes to: a window narrower by a texel, moved with the point
    float away = abs(float(offset) + 0.5 - fraction);
    return clamp(half_width - away, 0.0, 1.0);
#elif CSM_FILTER_WEIGHTS == CSM_FILTER_WEIGHTS_TENT
    return max(half_width - abs(float(offset) + 0.5 - fraction), 0.0);
#else
    // ends at two standard deviations, less its value there, so that texels come and go at nothing
    float away = (float(offset) + 0.5 - fraction) / half_width;
    return max(exp(-2.0 * away * away) - 0.1353352832, 0.0);
#endif
}
