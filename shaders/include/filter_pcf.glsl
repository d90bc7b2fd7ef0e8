// filter_pcf.glsl: percentage-closer filtering [Reeves, Salesin, Cook 1987].
//
// Size 2 is the hardware's bilinear compare of 2 x 2 texels. An odd size is the weighted mean of k x k nearest compares
// around the texel that holds the point, each against the receiver's plane at its own texel's centre. Depths come by
// gather, four at a time: at 5 x 5 that is 9 fetches for 25. Taps one by one add up in the same order.

#if CSM_KERNEL_SIZE == 2

float filter_visibility(map_receiver at)
{
    // texels beyond the rim are those at it: the layer may hold more than this map
    vec2 place = clamp(vec2(at.texel) + at.fraction, 0.5, float(at.size) - 0.5);
    return map_compare(at.cascade, place, min(at.z, 1.0));
}

#else

// Texels to either side of the receiver's own that may have a weight.
ivec2 pcf_reach(vec2 half_width)
{
#if CSM_KERNEL == CSM_KERNEL_TEXELS
    return ivec2(CSM_KERNEL_SIZE / 2);
#else
    return ivec2(ceil(half_width - 0.5));
#endif
}

float pcf_weight(int offset, float fraction, float half_width)
{
#if CSM_KERNEL == CSM_KERNEL_TEXELS && CSM_FILTER_WEIGHTS == CSM_FILTER_WEIGHTS_BOX
    return offset > CSM_KERNEL_SIZE / 2 ? 0.0 : 1.0;
#else
    return kernel_weight(offset, fraction, half_width);
#endif
}

// A quotient of equals need not be 1 on a GPU.
float pcf_share(float lit, float total)
{
    return lit < total ? lit / total : 1.0;
}

// Weight of a texel that is lit.
float pcf_tap(map_receiver at, ivec2 offset, float stored, float weight)
{
    return tap_lit(at, kept_in_map(at, offset), stored) ? weight : 0.0;
}

#if CSM_FILTER_FETCH == CSM_FILTER_FETCH_TAPS

float filter_visibility(map_receiver at)
{
    vec2 half_width = kernel_half_width(at);
    ivec2 reach = pcf_reach(half_width);
    precise float lit = 0.0, total = 0.0;
    for (int y = -reach.y; y <= reach.y; y++) {
        float down = pcf_weight(y, at.fraction.y, half_width.y);
        precise float row = 0.0, across = 0.0;
        for (int x = -reach.x; x <= reach.x; x++) {
            float weight = pcf_weight(x, at.fraction.x, half_width.x);
            float stored = map_depth_at(at.cascade, at.texel + kept_in_map(at, ivec2(x, y)));
            row += pcf_tap(at, ivec2(x, y), stored, weight);
            across += weight;
        }
        lit += down * row;
        total += down * across;
    }
    return pcf_share(lit, total);
}

#else

// Depths of the texels around the corner shared by texels (c - 1, c) along both axes, in the order of
// textureGather: left above, right above, right below, left below.
vec4 pcf_depths(map_receiver at, ivec2 corner)
{
#if CSM_SELECT == CSM_SELECT_MAP
    return map_depths_around(at.cascade, corner);
#else
    // as kept_in_map
    ivec2 inner = clamp(corner, ivec2(1), ivec2(at.size - 1));
    vec4 stored = map_depths_around(at.cascade, inner);
    stored = corner.x < inner.x ? stored.xxww : corner.x > inner.x ? stored.yyzz : stored;
    return corner.y < inner.y ? stored.wzzw : corner.y > inner.y ? stored.xyyx : stored;
#endif
}

// Two rows and two columns at a time; what a block has beyond the kernel weighs nothing.
float filter_visibility(map_receiver at)
{
    vec2 half_width = kernel_half_width(at);
    ivec2 reach = pcf_reach(half_width);
    precise float lit = 0.0, total = 0.0;
    for (int y = -reach.y; y <= reach.y; y += 2) {
        float below = pcf_weight(y, at.fraction.y, half_width.y);
        float above = pcf_weight(y + 1, at.fraction.y, half_width.y);
        precise float lower = 0.0, upper = 0.0, across = 0.0;
        for (int x = -reach.x; x <= reach.x; x += 2) {
            ivec2 offset = ivec2(x, y);
            float left = pcf_weight(x, at.fraction.x, half_width.x);
            float right = pcf_weight(x + 1, at.fraction.x, half_width.x);
            vec4 stored = pcf_depths(at, at.texel + offset + 1);
            lower += pcf_tap(at, offset, stored.w, left);
            lower += pcf_tap(at, offset + ivec2(1, 0), stored.z, right);
            upper += pcf_tap(at, offset + ivec2(0, 1), stored.x, left);
            upper += pcf_tap(at, offset + ivec2(1, 1), stored.y, right);
            across += left;
            across += right;
        }
        lit += below * lower;
        lit += above * upper;
        total += below * across;
        total += above * across;
    }
    return pcf_share(lit, total);
}

#endif

#endif
