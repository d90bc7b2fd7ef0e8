// shadow_bias.glsl: how far a receiver is lifted before it is compared [SPEC 1.13: the smallest bias free of
// acne is the slope times the distance between the compared point and the texel's centre, plus half a
// depth quantum].

// A plane steeper than this against the light moves by whole scenes per texel; its points are edge-on.
const float max_slope_tangent = 1e5;

// Gradient of light-view depth over light x, y [m/m] on the receiver's plane.
vec2 depth_gradient(vec3 normal)
{
    if (normal == vec3(0.0)) {
        return vec2(sqrt(0.5)); // unknown plane: as if at 45 degrees to the light, diagonal to the map
    }
    vec3 normal_ls = light_position(normal);
    return normal_ls.xy / max(normal_ls.z, 1.0 / max_slope_tangent);
}

vec3 offset_position(receiver point, int cascade)
{
#if CSM_NORMAL_OFFSET
    float texel = max(frame.depth[cascade].z, frame.depth[cascade].w);
    float sine = length(cross(point.normal, frame.to_light.xyz));
    return point.position + point.normal * (frame.bias.z * texel * sine);
#else
    return point.position;
#endif
}

// Depth to subtract, in the map's [0, 1].
float depth_bias(receiver point, vec2 gradient, int cascade)
{
    vec2 texel = frame.depth[cascade].zw;
    float slope = dot(abs(gradient), texel);
    float metres = frame.bias.x * max(texel.x, texel.y) + frame.bias.y * slope;
#if CSM_RECEIVER_PLANE
    if (point.normal == vec3(0.0)) {
        // without a plane to follow, every tap may lie the kernel's radius and half a texel away
        metres += (float(frame.lattice[cascade].w) + 0.5) * slope;
    }
#endif
    return frame.bias.w - metres * frame.depth[cascade].x; // the scale of z is negative
}

// Change of map depth per texel along u and v on the receiver's plane.
vec2 depth_slope(receiver point, vec2 gradient, int cascade)
{
#if CSM_RECEIVER_PLANE
    vec2 slope = -gradient * frame.depth[cascade].zw * frame.depth[cascade].x;
    return point.normal == vec3(0.0) ? vec2(0.0) : slope;
#else
    return vec2(0.0);
#endif
}
