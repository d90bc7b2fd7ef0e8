// moments_lookup.glsl: filtered moments at a receiver, at full size or in smaller levels by the pixel's footprint.

layout(binding = 4) uniform sampler2DArray moments;

// Texels beyond the rim are those at it: the layer may hold more than this map.
vec3 moments_place(map_receiver at, vec2 texels, float layer)
{
    return vec3(clamp(texels, 0.5, float(at.size) - 0.5) / vec2(textureSize(moments, 0).xy), layer);
}

#if CSM_LOOKUP == CSM_LOOKUP_ANISOTROPIC

// Several lookups along the footprint's longer axis, each in a level as fine as the shorter axis allows
// (docs/numerics.md 29). By hand: with gradients given, software GL takes them for none.
vec4 moments_along(map_receiver at, vec2 place, float layer)
{
    // a disc as wide as the pixel becomes an ellipse, whose axes are the singular values of the two steps
    vec2 x = at.footprint.xy, y = at.footprint.zw;
    float half_sum = 0.5 * (dot(x, x) + dot(y, y));
    vec2 apart = vec2(0.5 * (x.x * x.x + y.x * y.x - x.y * x.y - y.y * y.y), x.x * x.y + y.x * y.y);
    float half_difference = length(apart);
    float longer = sqrt(half_sum + half_difference);
    float shorter = abs(x.x * y.y - x.y * y.x) / max(longer, 1e-20);
    // half the angle of (apart): of the two ways to write it, the one that does not cancel
    vec2 axis = apart.x > 0.0 ? vec2(half_difference + apart.x, apart.y) : vec2(apart.y, half_difference - apart.x);
    axis *= longer / max(length(axis), 1e-20);

    float lookups = clamp(ceil(longer / max(shorter, 1.0)), 1.0, frame.view_centre.w);
    float level = log2(max(longer / lookups, 1.0));
    vec4 sum = vec4(0.0);
    for (float i = 0.5; i < lookups; i += 1.0) {
        sum += textureLod(moments, moments_place(at, place + (i / lookups - 0.5) * axis, layer), level);
    }
    return sum / lookups;
}

#endif

vec4 moments_at(map_receiver at, int slice, int slices)
{
    vec2 place = vec2(at.texel) + at.fraction;
    float layer = float(at.cascade * slices + slice);
#if CSM_LOOKUP == CSM_LOOKUP_BILINEAR
    return textureLod(moments, moments_place(at, place, layer), 0.0);
#elif CSM_LOOKUP == CSM_LOOKUP_TRILINEAR
    float widest = max(length(at.footprint.xy), length(at.footprint.zw));
    return textureLod(moments, moments_place(at, place, layer), log2(max(widest, 1.0)));
#else
    return moments_along(at, place, layer);
#endif
}
