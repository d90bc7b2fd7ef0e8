// cascade_select.glsl: which cascade answers for a receiver.

const int no_cascade = 255;

// The receiver in a cascade's window; false if the kernel would leave the map or the depth range.
bool place_in_map(receiver point, int cascade, out ivec2 texel, out vec2 fraction, out float z)
{
    vec3 position_ls = light_position(offset_position(point, cascade));
    vec2 texels = lattice_texels(position_ls.xy, cascade);
    vec2 whole = floor(texels);
    texel = ivec2(whole) - frame.lattice[cascade].xy;
    fraction = texels - whole;
    z = map_depth(position_ls.z, cascade);
    int border = frame.lattice[cascade].w;
    int size = frame.lattice[cascade].z;
    bool inside = all(greaterThanEqual(texel, ivec2(border))) &&
                  all(lessThan(texel, ivec2(size - border)));
#if CSM_PANCAKE
    return inside && z <= 1.0; // casters before the range are flattened onto its near plane
#else
    return inside && z >= 0.0 && z <= 1.0;
#endif
}

int select_cascade(receiver point, out ivec2 texel, out vec2 fraction, out float z)
{
    // float32 view depths and double splits meet here: a receiver at the very end is inside
    if (point.view_depth > frame.split[CSM_CASCADE_COUNT - 1].x * (1.0 + 1e-6)) {
        return no_cascade;
    }
#if CSM_SELECT == CSM_SELECT_MAP
    for (int cascade = 0; cascade < CSM_CASCADE_COUNT; cascade++) {
        if (place_in_map(point, cascade, texel, fraction, z)) {
            return cascade;
        }
    }
    return no_cascade;
#else
    int cascade = 0;
    for (int i = 0; i < CSM_CASCADE_COUNT - 1; i++) {
        cascade += int(point.view_depth > frame.split[i].x);
    }
    place_in_map(point, cascade, texel, fraction, z);
    return cascade;
#endif
}
