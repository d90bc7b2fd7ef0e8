// filter_pcf.glsl: percentage-closer filtering [Reeves, Salesin, Cook 1987].
//
// Size 2 is the hardware's bilinear compare of 2 x 2 texels. An odd size is the mean of k x k nearest compares
// centred on the texel that holds the point, each against the receiver's plane at its own texel's centre.
// Depths come by gather, four at a time: at 5 x 5 that is 9 fetches for 25.

#if CSM_KERNEL_SIZE == 2

float filter_visibility(map_receiver at)
{
    // texels beyond the rim are those at it: the layer may hold more than this map
    vec2 place = clamp(vec2(at.texel) + at.fraction, 0.5, float(at.size) - 0.5);
    return map_compare(at.cascade, place, min(at.z, 1.0));
}

#else

const int pcf_radius = CSM_KERNEL_SIZE / 2;

// Compare of the texel at an offset from the receiver's own; outside the kernel it counts nothing.
float pcf_tap(map_receiver at, ivec2 offset, float stored)
{
    if (max(offset.x, offset.y) > pcf_radius) {
        return 0.0;
    }
#if CSM_SELECT != CSM_SELECT_MAP
    offset = clamp(at.texel + offset, ivec2(0), ivec2(at.size - 1)) - at.texel;
#endif
    float plane = at.z + dot(at.slope, vec2(offset) + 0.5 - at.fraction);
    return min(plane, 1.0) <= stored ? 1.0 : 0.0; // an empty texel holds 1, however far the plane runs
}

// Depths of the texels around the corner shared by texels (c - 1, c) along both axes, in the order of
// textureGather: left above, right above, right below, left below.
vec4 pcf_depths(map_receiver at, ivec2 corner)
{
#if CSM_SELECT == CSM_SELECT_MAP
    return map_depths_around(at.cascade, corner);
#else
    // a kernel over the rim takes the texels at the rim again: the layer may hold more than this map
    ivec2 inner = clamp(corner, ivec2(1), ivec2(at.size - 1));
    vec4 stored = map_depths_around(at.cascade, inner);
    stored = corner.x < inner.x ? stored.xxww : corner.x > inner.x ? stored.yyzz : stored;
    return corner.y < inner.y ? stored.wzzw : corner.y > inner.y ? stored.xyyx : stored;
#endif
}

float filter_visibility(map_receiver at)
{
    float lit = 0.0;
    for (int y = -pcf_radius; y <= pcf_radius; y += 2) {
        for (int x = -pcf_radius; x <= pcf_radius; x += 2) {
            ivec2 offset = ivec2(x, y);
            vec4 stored = pcf_depths(at, at.texel + offset + 1);
            lit += pcf_tap(at, offset + ivec2(0, 1), stored.x) +
                   pcf_tap(at, offset + ivec2(1, 1), stored.y) +
                   pcf_tap(at, offset + ivec2(1, 0), stored.z) + pcf_tap(at, offset, stored.w);
        }
    }
    return lit / float(CSM_KERNEL_SIZE * CSM_KERNEL_SIZE);
}

#endif
