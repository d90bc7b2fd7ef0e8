// filter_savsm.glsl: summed-area variance shadow maps [Lauritzen 2007]: Chebyshev's bound over a rectangle of any width.

float filter_visibility(map_receiver at)
{
    vec2 half_width = kernel_half_width(at);
    vec2 found = mean_of_rectangle(at.cascade, at.size, vec2(at.texel) + at.fraction, half_width);
    return largest_lit_share(at.z - 0.5, found.x, found.y, frame.moments.z);
}
