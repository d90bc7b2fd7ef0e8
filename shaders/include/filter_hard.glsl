// filter_hard.glsl: one nearest compare against the receiver's plane at the texel's centre.

float filter_visibility(map_receiver at)
{
    ivec2 texel = clamp(at.texel, ivec2(0), ivec2(at.size - 1));
    float stored = map_depth_at(at.cascade, texel);
    float plane = at.z + dot(at.slope, 0.5 - at.fraction);
    return min(plane, 1.0) <= stored ? 1.0 : 0.0; // an empty texel holds 1, however far the plane runs
}
