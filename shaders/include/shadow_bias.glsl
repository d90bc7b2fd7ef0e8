// shadow_bias.glsl: how far a receiver is lifted before it is compared. The smallest bias free
// of acne is the slope times the distance between the compared point and the texel's centre, plus half a depth quantum
// (docs/numerics.md 11).

// A plane steeper than this against the light (0.06 degrees from edge-on) moves by hundreds of texels of depth per
// texel: its rounding alone would reach past whole rooms.
const float max_slope_tangent = 1e3;

// A receiver is the eye plus a float32 view depth along a ray, and float32 coordinates relative to the origin.
const float rounding_of_depth = 1.0 / 4194304.0;    // 2^-22
const float rounding_of_position = 1.0 / 8388608.0; // 2^-23

// A normal along the axes of light space. The inverse transpose: what is orthogonal in the world need not be so
// under a skew.
vec3 light_normal(vec3 normal)
{
#if CSM_SKEWED
    return vec3(dot(frame.normal_from_origin[0].xyz, normal), dot(frame.normal_from_origin[1].xyz, normal),
                dot(frame.normal_from_origin[2].xyz, normal));
#else
    return light_position(normal);
#endif
}

#if CSM_PLANE == CSM_PLANE_DERIVATIVES

// Steps as parallel as this span no plane but by their rounding.
const float least_sine = 1e-6;

// The same from two steps of the picture in light space [MSDN]: it jumps where a step leaves the surface, and has the
// limit of planes from normals, as it grows without bounds towards edge-on while the steps stay apart.
vec2 gradient_of_steps(vec3 x, vec3 y)
{
    float determinant = x.x * y.y - x.y * y.x;
    bool parallel = abs(determinant) <= least_sine * length(x.xy) * length(y.xy);
    vec2 gradient = vec2(x.y * y.z - y.y * x.z, y.x * x.z - x.x * y.z) / (parallel ? 1.0 : determinant);
    return parallel ? vec2(0.0) : gradient * (max_slope_tangent / max(length(gradient), max_slope_tangent));
}

#endif

// Gradient of light-view depth over light x, y [m/m] on the receiver's plane.
vec2 depth_gradient(receiver point)
{
#if CSM_PLANE == CSM_PLANE_DERIVATIVES
    if (point.step_x != vec3(0.0) || point.step_y != vec3(0.0)) {
        return gradient_of_steps(point.step_x, point.step_y);
    }
#endif
    // an unknown plane is taken as tilted 45 degrees to the light, diagonal to the map
    vec3 normal_ls = plane_known(point) ? light_normal(point.normal) : vec3(sqrt(0.5), sqrt(0.5), 1.0);
    return normal_ls.xy / max(normal_ls.z, 1.0 / max_slope_tangent);
}

vec3 surface_in_light(receiver point)
{
#if CSM_TEXCOORD == CSM_TEXCOORD_INTERPOLATED
    return point.position_ls;
#else
    return light_position(point.position);
#endif
}

// The receiver moved along its normal, by the offset in texels of a side [m].
vec3 offset_in_light(receiver point, float texel)
{
#if CSM_NORMAL_OFFSET
    float sine = length(cross(point.normal, frame.to_light.xyz));
    vec3 offset = point.normal * (frame.bias.y * texel * sine);
#if CSM_TEXCOORD == CSM_TEXCOORD_INTERPOLATED
    return point.position_ls + light_position(offset);
#else
    return light_position(point.position + offset);
#endif
#else
    return surface_in_light(point);
#endif
}

// Depth to subtract: bias_slope is the plane's change of depth over one texel in x and y, as a bias counts texels;
// scale is the map's depth per metre.
float depth_bias(receiver point, vec2 bias_slope, float constant, float scale)
{
    float texels = frame.bias.x;
    vec3 reach = abs(point.position);
    float rounding = point.view_depth * rounding_of_depth +
                     max(reach.x, max(reach.y, reach.z)) * rounding_of_position;
#if CSM_RECEIVER_PLANE
    // without a plane to follow, every tap may lie the kernel's radius and half a texel away
    texels += plane_known(point) ? 0.0 : frame.bias.z + 0.5;
#endif
    return constant + texels * (abs(bias_slope.x) + abs(bias_slope.y)) +
           frame.bias.w * rounding * scale;
}
