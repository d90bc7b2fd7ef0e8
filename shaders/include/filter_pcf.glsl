// filter_pcf.glsl: percentage-closer filtering [Reeves, Salesin, Cook 1987].
//
// Size 2 is the hardware's bilinear compare of 2 x 2 texels. An odd size is the mean of k x k nearest compares
// centred on the texel that holds the point, each against the receiver's plane at its own texel's centre.
// Depths come by gather, four at a time: at 5 x 5 that is 9 fetches for 25.

#if CSM_FILTER_SIZE == 2

float filter_visibility(map_receiver at)
{
    vec2 uv = (vec2(at.texel) + at.fraction) / float(at.size);
    return texture(shadow_compare, vec4(uv, float(at.cascade), min(at.z, 1.0)));
}

#else

const int pcf_radius = CSM_FILTER_SIZE / 2;

// Compare of the texel at an offset from the receiver's own; outside the kernel it counts nothing.
float pcf_tap(map_receiver at, ivec2 offset, float stored)
{
    if (max(offset.x, offset.y) > pcf_radius) {
        return 0.0;
    }
    float plane = at.z + dot(at.slope, vec2(offset) + 0.5 - at.fraction);
    return min(plane, 1.0) <= stored ? 1.0 : 0.0; // an empty texel holds 1, however far the plane runs
}

float filter_visibility(map_receiver at)
{
    float size = float(at.size);
    float lit = 0.0;
    for (int y = -pcf_radius; y <= pcf_radius; y += 2) {
        for (int x = -pcf_radius; x <= pcf_radius; x += 2) {
            // gather around the corner shared by texels (x, y) .. (x + 1, y + 1)
            ivec2 offset = ivec2(x, y);
            vec2 uv = vec2(at.texel + offset + 1) / size;
            vec4 stored = textureGather(shadow_maps, vec3(uv, float(at.cascade)));
            lit += pcf_tap(at, offset + ivec2(0, 1), stored.x) +
                   pcf_tap(at, offset + ivec2(1, 1), stored.y) +
                   pcf_tap(at, offset + ivec2(1, 0), stored.z) + pcf_tap(at, offset, stored.w);
        }
    }
    return lit / float(CSM_FILTER_SIZE * CSM_FILTER_SIZE);
}

#endif
