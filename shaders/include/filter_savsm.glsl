// filter_savsm.glsl: summed-area variance shadow maps [Lauritzen 2007]: Chebyshev's bound over a rectangle of any width.

float filter_visibility(map_receiver at)
{
    vec4 kernel = frame.kernel[at.cascade];
#if CSM_KERNEL == CSM_KERNEL_SCREEN
    float half_width = clamp(kernel.y * at.view_depth, 0.5, kernel.x);
#else
    float half_width = kernel.x;
#endif
    vec2 found = mean_of_rectangle(at.cascade, at.size, vec2(at.texel) + at.fraction, vec2(half_width));
    return largest_lit_share(at.z - 0.5, found.x, found.y, frame.moments.z);
}
