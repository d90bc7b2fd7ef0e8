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
    bool in_range; // of the map's depths
    vec2 density;  // texels per metre
#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR
    vec4 growth;    // texels in u, v per metre along light x, then along light y
    vec4 footprint; // where it is taken from maps; else it comes of light space
#endif
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
    here.density = frame.window[cascade].xy;
#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR
    vec2 along_x = turned(vec2(1.0, 0.0), cascade), along_y = turned(vec2(0.0, 1.0), cascade);
    here.growth = vec4(along_x * frame.window[cascade].xy, along_y * frame.window[cascade].xy);
#endif
    bool inside = inside_window(here.texels, here.centre);
#if CSM_NORMAL_OFFSET
    // an offset may lift what lies at the range's near end out of it: the surface itself decides
    float z = map_depth(surface_in_light(point).z, cascade);
#else
    float z = here.z;
#endif
    here.in_range = abs(z - 0.5) <= 0.5;
    return inside && here.in_range;
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

// The candidate that answers, and the one that blends in.
struct choice
{
    candidate own;
#if CSM_BLEND != CSM_BLEND_NONE
    candidate next;
    float next_weight; // 0 where the next one does not hold the receiver
#endif
};

#if CSM_BLEND != CSM_BLEND_NONE

// How far inside its window a receiver lies, in widths of the transition: 1 and more where the map is its alone, 0 at
// the rim, negative outside.
float rim_share(candidate here)
{
    vec2 away = abs(here.texels - here.centre.xy);
    float rim = here.centre.z - (CSM_SELECT == CSM_SELECT_FRUSTUM ? 0.0 : frame.bias.z);
    return (rim - max(away.x, away.y)) / (frame.blend.x * here.centre.z);
}

// The same in a slice, to its far end.
float slice_share(receiver point, int cascade)
{
    float start = cascade > 0 ? frame.slope[max(cascade - 1, 0)].z : frame.view_centre.z;
    float end = frame.slope[cascade].z;
    return (end - point.view_depth) / (frame.blend.x * (end - start));
}

// Weight of the next map (docs/numerics.md 30): 1 - own share where the next one holds the receiver far inside. It
// falls to 0 towards the next one's rim, and towards that of a finer map from outside, where all is the own one's.
float weight_of_next(float own_share, float next_share, float outside)
{
    float own = clamp(own_share, 0.0, 1.0);
    float next = (1.0 - own) * clamp(next_share, 0.0, 1.0) * clamp(outside, 0.0, 1.0);
    return next > 0.0 ? next / (own + next) : 0.0;
}

#endif

// Every cascade is tried with a constant index and the first that fits is kept.
choice choose_cascade(receiver point)
{
    choice chosen;
    candidate here;
    bool held = place_in_map(point, CSM_CASCADE_COUNT - 1, chosen.own);
#if CSM_BLEND != CSM_BLEND_NONE
    chosen.next = chosen.own;
    float own_share = 1.0, next_share = 0.0, outside = 1.0;
    candidate coarser = chosen.own; // the last one tried that may be next
    float coarser_share = held ? rim_share(chosen.own) : 0.0;
#endif
#if CSM_SELECT != CSM_SELECT_INTERVAL
    chosen.own.cascade = held ? chosen.own.cascade : no_cascade;
#endif
    for (int cascade = CSM_CASCADE_COUNT - 2; cascade >= 0; cascade--) {
        held = place_in_map(point, cascade, here);
#if CSM_SELECT == CSM_SELECT_INTERVAL
        bool fits = point.view_depth <= frame.slope[cascade].z;
#else
        bool fits = held;
#endif
#if CSM_BLEND != CSM_BLEND_NONE
        float share = rim_share(here);
        if (fits) {
            chosen.next = coarser;
            next_share = coarser_share;
            own_share = CSM_SELECT == CSM_SELECT_INTERVAL ? slice_share(point, cascade) : share;
            outside = 1.0;
        } else if (CSM_SELECT != CSM_SELECT_INTERVAL && here.in_range) {
            outside = min(outside, -share);
        }
        if (held || CSM_SELECT == CSM_SELECT_INTERVAL) {
            coarser = here;
            coarser_share = held ? share : 0.0;
        }
#endif
        if (fits) {
            chosen.own = here;
        }
    }
#if CSM_BLEND != CSM_BLEND_NONE
    chosen.next_weight = weight_of_next(own_share, next_share, outside);
#endif
    // float32 view depths and double splits meet here: a receiver at the very end is inside
    if (point.view_depth > frame.slope[CSM_CASCADE_COUNT - 1].z * (1.0 + 1e-6)) {
        chosen.own.cascade = no_cascade;
    }
    return chosen;
}

#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR

// Steps as long as the whole map ask for no more than its coarsest level, and are finite in every format.
vec2 limited(vec2 texels, float longest)
{
    float ratio = longest / max(length(texels), longest);
    return texels * ratio;
}

// Steps in light space are the same for all cascades; a map scales them.
vec4 footprint_of(receiver point, candidate chosen)
{
#if CSM_GRADIENTS == CSM_GRADIENTS_HARDWARE || (CSM_GRADIENTS == CSM_GRADIENTS_QUAD && CSM_WARPED)
    vec4 texels = chosen.footprint;
#else
#if CSM_STEPS == CSM_STEPS_BOTH
    vec2 step_x = point.plane_step_x.xy, step_y = point.plane_step_y.xy;
#else
    vec2 step_x = point.step_x.xy, step_y = point.step_y.xy;
#endif
    vec4 growth = chosen.growth;
    vec4 texels = vec4(growth.xy * step_x.x + growth.zw * step_x.y, growth.xy * step_y.x + growth.zw * step_y.y);
#endif
    return vec4(limited(texels.xy, chosen.centre.w), limited(texels.zw, chosen.centre.w));
}

#endif

map_receiver in_map(receiver point, candidate chosen)
{
    int cascade = min(chosen.cascade, CSM_CASCADE_COUNT - 1);
    vec2 gradient = turned(depth_gradient(point), cascade);
    vec2 whole = floor(chosen.texels);
    map_receiver at;
    at.cascade = cascade;
    at.size = int(chosen.centre.w);
    at.texel = ivec2(whole - (chosen.centre.xy - chosen.centre.z));
    at.fraction = chosen.texels - whole;
    at.z = chosen.z - depth_bias(point, bias_slope(chosen, gradient), chosen.constant_bias, chosen.scale);
#if CSM_RECEIVER_PLANE
    at.slope = plane_known(point) ? plane_slope(chosen, gradient) : level_slope(chosen);
#else
    at.slope = level_slope(chosen);
#endif
#if CSM_PREFILTERED
    // Under selection by slice a receiver may lie outside of the map's depths: behind all that the map holds, or before
    // it. Means have no more to tell there than at the ends, and powers beyond them overflow.
    at.z = clamp(at.z, 0.0, 1.0);
#endif
    at.level = level_slope(chosen);
    at.density = chosen.density;
    at.scale = chosen.scale;
#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR
    at.footprint = footprint_of(point, chosen);
#endif
    at.noise = point.noise;
    at.view_depth = point.view_depth;
    return at;
}
