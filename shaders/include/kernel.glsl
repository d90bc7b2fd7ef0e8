// kernel.glsl: how far the kernel of a receiver reaches along u and v [texels]. A constant number of texels, or one
// of metres: given, or those of so many pixels at the receiver; never more texels than filter_size, never less than
// one compare takes [Zhang2009, listing 4.1.8, which lacks the limits].

vec2 kernel_half_width(map_receiver at)
{
#if CSM_KERNEL == CSM_KERNEL_TEXELS
    return vec2(CSM_KERNEL_SIZE > 0 ? 0.5 * float(CSM_KERNEL_SIZE) : frame.width.x);
#else
    // where nothing is seen the depth is infinite, and 0 times that no number
    float metres = frame.width.y + frame.width.z * min(at.view_depth, 1e30);
    return clamp(metres * at.density, vec2(frame.width.w), vec2(frame.width.x));
#endif
}
