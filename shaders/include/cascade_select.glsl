// cascade_select.glsl: which cascade answers for a receiver.

#if CSM_WARPED
#include "include/warp_select.glsl"
#else

// A receiver in the window of one cascade, not yet biased.
struct candidate
{
    int cascade;
    vec2 texels;   // light x, y on the cascade's lattice
    float z;
    vec4 centre;
    vec3 slope;    // depth per texel at a gradient of 1 in x, y; the least of them in a bias
    float constant_bias;
    float scale;   // depth per metre
};

// False if the kernel would leave the map or the depth range.
bool place_in_map(receiver point, int cascade, out candidate here)
{
    vec3 position_ls = offset_in_light(point, frame.depth[cascade].w);
    here.cascade = cascade;
    here.texels = lattice_texels(turned(position_ls.xy, cascade), cascade);
    here.z = map_depth(position_ls.z, cascade);
    here.centre = frame.centre[cascade];
    here.slope = frame.slope[cascade].xyw;
    here.constant_bias = frame.depth[cascade].z;
    here.scale = -frame.depth[cascade].x;
    bool inside = inside_window(here.texels, here.centre);
#if CSM_NORMAL_OFFSET
    // an offset may lift what lies at the range's near end out of it: the surface itself decides
    float z = map_depth(surface_in_light(point).z, cascade);
#else
    float z = here.z;
#endif
    return inside && abs(z - 0.5) <= 0.5;
}

// Change of depth from texel to texel: at one distance from the light, on a plane, and as a bias counts it.
vec2 level_slope(candidate chosen)
{
    return vec2(0.0);
}

vec2 plane_slope(candidate chosen, vec2 gradient)
{
    return gradient * chosen.slope.xy;
}

vec2 bias_slope(candidate chosen, vec2 gradient)
{
    return gradient * max(chosen.slope.xy, chosen.slope.z);
}

#endif

// Every cascade is tried with a constant index and the first that fits is kept.
candidate choose_cascade(receiver point)
{
    candidate chosen, here;
    bool fits = place_in_map(point, CSM_CASCADE_COUNT - 1, chosen);
#if CSM_SELECT != CSM_SELECT_INTERVAL
    chosen.cascade = fits ? chosen.cascade : no_cascade;
#endif
    for (int cascade = CSM_CASCADE_COUNT - 2; cascade >= 0; cascade--) {
        fits = place_in_map(point, cascade, here);
#if CSM_SELECT == CSM_SELECT_INTERVAL
        fits = point.view_depth <= frame.slope[cascade].z;
#endif
        if (fits) {
            chosen = here;
        }
    }
    // float32 view depths and double splits meet here: a receiver at the very end is inside
    if (point.view_depth > frame.slope[CSM_CASCADE_COUNT - 1].z * (1.0 + 1e-6)) {
        chosen.cascade = no_cascade;
    }
    return chosen;
}

map_receiver select_cascade(receiver point)
{
    candidate chosen = choose_cascade(point);
    vec2 gradient = turned(depth_gradient(point), min(chosen.cascade, CSM_CASCADE_COUNT - 1));
    vec2 whole = floor(chosen.texels);
    map_receiver at;
    at.cascade = chosen.cascade;
    at.size = int(chosen.centre.w);
    at.texel = ivec2(whole - (chosen.centre.xy - chosen.centre.z));
    at.fraction = chosen.texels - whole;
    at.z = chosen.z - depth_bias(point, bias_slope(chosen, gradient), chosen.constant_bias, chosen.scale);
#if CSM_RECEIVER_PLANE
    at.slope = plane_known(point) ? plane_slope(chosen, gradient) : level_slope(chosen);
#else
    at.slope = level_slope(chosen);
#endif
    return at;
}
