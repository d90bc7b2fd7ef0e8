// tap.glsl: one compare of a receiver with one texel. Needs receiver.glsl.

// A kernel over the rim takes the texels at the rim again: the layer may hold more than this map. Selection by map
// keeps kernels inside.
ivec2 kept_in_map(map_receiver at, ivec2 offset)
{
#if CSM_SELECT == CSM_SELECT_MAP
    return offset;
#else
    return clamp(at.texel + offset, ivec2(0), ivec2(at.size - 1)) - at.texel;
#endif
}

// Depth of the receiver's plane at the centre of the texel that lies offset texels from the receiver's own.
float plane_depth(map_receiver at, ivec2 offset)
{
    return at.z + dot(at.slope, vec2(offset) + 0.5 - at.fraction);
}

bool tap_lit(map_receiver at, ivec2 offset, float stored)
{
    return min(plane_depth(at, offset), 1.0) <= stored; // an empty texel holds 1, however far the plane runs
}
