// depth_warps.glsl: what prefiltered filters make of a depth, the same for casters and receivers. Needs frame.glsl.

// Depth as moments of it take it: from -1/2 to 1/2, which halves the rounding of the depth and quarters that of its
// square.
float centred(float depth)
{
    return depth - 0.5;
}

// A centred depth and its square. unorm16 holds 0 to 1 alone, and spends its steps on all of that.
vec2 stored_pair(float depth)
{
#if CSM_MOMENT_FORMAT == CSM_MOMENT_FORMAT_UNORM16
    return vec2(depth + 0.5, 4.0 * depth * depth);
#else
    return vec2(depth, depth * depth);
#endif
}

vec2 pair_of_stored(vec2 stored)
{
#if CSM_MOMENT_FORMAT == CSM_MOMENT_FORMAT_UNORM16
    return vec2(stored.x - 0.5, 0.25 * stored.y);
#else
    return stored;
#endif
}

// exp(c d) and -exp(-c d) of depth d from -1 to 1 [Lauritzen, McCool 2008]: both rise with depth.
vec2 exponential_warps(float depth)
{
    float d = 2.0 * depth - 1.0;
    return vec2(exp(frame.moments.x * d), -exp(-frame.moments.y * d));
}

// Layers of depth [Lauritzen, McCool 2008]. A receiver has one of `count` equal parts of the range to itself, and its
// layer reaches half a part further either way. What is cut off behind it would count as shadow: its own plane around
// it must not be. What is cut off before it must lie a good deal before it, or rounding takes it for the receiver.

int layer_of(float depth)
{
    return clamp(int(depth * float(CSM_LAYER_COUNT)), 0, CSM_LAYER_COUNT - 1);
}

// Depth in a layer: 0 where it begins, 1 where it ends.
float depth_in_layer(float depth, int layer)
{
    float parts = float(CSM_LAYER_COUNT);
    float begin = max(float(layer) - 0.5, 0.0);
    float end = min(float(layer) + 1.5, parts);
    return clamp((depth * parts - begin) / (end - begin), 0.0, 1.0);
}
