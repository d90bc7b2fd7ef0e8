// cascade_select.glsl: which cascade answers for a receiver.

// The receiver in a cascade's window; false if the kernel would leave the map or the depth range.
bool place_in_map(receiver point, vec2 gradient, int cascade, out map_receiver at)
{
    vec3 position_ls = light_position(offset_position(point, cascade));
    vec2 texels = lattice_texels(position_ls.xy, cascade);
    vec2 whole = floor(texels);
    float depth = map_depth(position_ls.z, cascade);
    int border = frame.lattice[cascade].w;
    at.cascade = cascade;
    at.size = frame.lattice[cascade].z;
    at.texel = ivec2(whole) - frame.lattice[cascade].xy;
    at.fraction = texels - whole;
    at.z = depth - depth_bias(point, gradient, cascade);
    at.slope = depth_slope(point, gradient, cascade);
    bool inside = all(greaterThanEqual(at.texel, ivec2(border))) &&
                  all(lessThan(at.texel, ivec2(at.size - border)));
#if CSM_PANCAKE
    return inside && depth <= 1.0; // casters before the range are flattened onto its near plane
#else
    return inside && depth >= 0.0 && depth <= 1.0;
#endif
}

// The receiver in the map that answers; its cascade is no_cascade beyond the shadow range. Every cascade is
// tried with a constant index and the first that fits is kept.
map_receiver select_cascade(receiver point)
{
    map_receiver chosen, here;
    vec2 gradient = depth_gradient(point.normal);
    bool fits = place_in_map(point, gradient, CSM_CASCADE_COUNT - 1, chosen);
#if CSM_SELECT == CSM_SELECT_MAP
    chosen.cascade = fits ? chosen.cascade : no_cascade;
#endif
    for (int cascade = CSM_CASCADE_COUNT - 2; cascade >= 0; cascade--) {
        fits = place_in_map(point, gradient, cascade, here);
#if CSM_SELECT == CSM_SELECT_INTERVAL
        fits = point.view_depth <= frame.split[cascade].x;
#endif
        if (fits) {
            chosen = here;
        }
    }
    // float32 view depths and double splits meet here: a receiver at the very end is inside
    if (point.view_depth > frame.split[CSM_CASCADE_COUNT - 1].x * (1.0 + 1e-6)) {
        chosen.cascade = no_cascade;
    }
    return chosen;
}
