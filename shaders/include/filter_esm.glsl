// filter_esm.glsl: exponential shadow maps [Annen et al. 2008]: the share that Markov's inequality allows for
// exp(c z), whose mean is stored.

#if CSM_LOG_FILTER

float depth_stored(map_receiver at, ivec2 texel)
{
    // texels beyond the rim are those at it: the layer may hold more than this map
    ivec2 inside = clamp(texel, ivec2(0), ivec2(at.size - 1));
    return pair_of_stored(texelFetch(moments, ivec3(inside, at.cascade), 0).xy).x + 0.5;
}

// Bilinear in the powers, which logarithms do not mix to.
float filter_visibility(map_receiver at)
{
    vec2 place = vec2(at.texel) + at.fraction - 0.5;
    ivec2 corner = ivec2(floor(place));
    vec2 share = place - vec2(corner);
    vec4 depths = vec4(depth_stored(at, corner), depth_stored(at, corner + ivec2(1, 0)),
                       depth_stored(at, corner + ivec2(0, 1)), depth_stored(at, corner + ivec2(1, 1)));
    // light is never more than 1, and no power too large
    vec4 lit = exp(min(frame.moments.x * (depths - at.z), 80.0));
    return min(mix(mix(lit.x, lit.y, share.x), mix(lit.z, lit.w, share.x), share.y), 1.0);
}

#else

float filter_visibility(map_receiver at)
{
    return min(moments_at(at, 0, 1).x / exp(frame.moments.x * at.z), 1.0);
}

#endif
