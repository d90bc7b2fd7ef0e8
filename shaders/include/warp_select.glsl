// warp_select.glsl: a receiver in a warped map; included by cascade_select.glsl.
//
// Planes stay planes under a warp, so that on a receiver's plane the map's depth changes by the same amount from each
// texel to the next, all over the map: its slope, which has a part that is there even on a surface facing the light.
#include "include/warp.glsl"

// A receiver in the window of one cascade, not yet biased.
struct candidate
{
    int cascade;
    vec2 texels;   // from the lower left corner
    float z;
    vec4 centre;
    vec4 slope;    // depth per texel in u, then in v, at a gradient of 1 in light x, y
    float tilt;    // depth per texel in v at one distance from the light
    float constant_bias;
    float scale;   // depth per metre
    vec2 density;  // texels per metre
    float largest; // by hand, biases take the larger side of the texel: its depth, else 0
    bool in_range; // of the map's depths
#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR
    vec4 growth;    // texels in u, v per metre along light x, then along light y
    vec4 footprint; // where it is taken from maps; else it comes of light space
#endif
};

// Derivatives of a map at a place: with clip (u, v), local (a, b) and w they are da/du = w / across.x,
// db/dv = w / along and da/dv = -bend * db/dv, db/du = 0.
struct warp_place
{
    vec2 local, uv;
    float w, along, bend;
    vec2 texel; // sides [m]
};

warp_place warp_at(vec2 light_xy, int cascade)
{
    warp_place at;
    at.local = warp_local(light_xy, cascade);
    vec4 clip = warp_clip(at.local, 0.0, cascade);
    float across = warp.across[cascade].x, growth = warp.rows[cascade].z;
    at.w = clip.w > 0.0 ? clip.w : 1.0; // behind the horizon: any number, it is refused
    at.uv = clip.w > 0.0 ? clip.xy / clip.w : vec2(2.0);
    at.along = warp.rows[cascade].x - at.uv.y * growth;
    at.bend = (warp.across[cascade].y - at.uv.x * growth) / across;
    at.texel = warp_texel(at.uv, at.w, cascade);
    return at;
}

// False if the kernel would leave the map or the depth range.
bool place_in_map(receiver point, int cascade, out candidate here)
{
    vec3 surface_ls = surface_in_light(point);
    warp_place at = warp_at(surface_ls.xy, cascade);
    float depth = map_depth(surface_ls.z, cascade);
    bool in_range = abs(depth - 0.5) <= 0.5;
    float largest = max(at.texel.x, at.texel.y);
#if CSM_NORMAL_OFFSET
    vec3 position_ls = offset_in_light(point, largest);
    at = warp_at(position_ls.xy, cascade);
    depth = map_depth(position_ls.z, cascade);
#endif
    float scale = -frame.depth[cascade].x;
    float across = warp.across[cascade].x, growth = warp.rows[cascade].z;
    vec4 metres = warp.metres[cascade] * scale;
    here.cascade = cascade;
    here.centre = frame.centre[cascade];
    here.texels = here.centre.xy + at.uv * here.centre.z;
    here.z = depth / at.w;
    float step = 1.0 / here.centre.z; // clip units of a texel
    here.slope = vec4(metres.xy / across, (metres.zw - at.bend * metres.xy) / at.along) * step;
    here.tilt = warp_tilt(here.z, at.uv.y, cascade);
    here.scale = scale / at.w;
    here.density = 1.0 / at.texel;
    here.constant_bias = frame.depth[cascade].z + warp.across[cascade].w * largest * here.scale;
    // a tilted depth feels that corners of casters are snapped, to 1/256 texel or better; where four texels are
    // compared with one depth it differs from texel to texel
    float tilted = CSM_RECEIVER_PLANE == 1 ? 1.0 / 128.0 : 1.0 + 1.0 / 128.0;
    here.constant_bias += frame.bias.w * abs(here.tilt) * tilted;
    here.largest = frame.slope[cascade].w > 0.0 ? largest * here.scale : 0.0;
    here.in_range = in_range;
#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR
    // local a, b to clip u, v: du = across / w * (da + bend * db), dv = along / w * db
    vec2 along_x = vec2(warp.along_x[cascade].x, warp.along_y[cascade].x);
    vec2 along_y = vec2(warp.along_x[cascade].y, warp.along_y[cascade].y);
    vec2 texels = vec2(across, at.along) * here.centre.z / at.w;
    here.growth = vec4(along_x.x + at.bend * along_x.y, along_x.y, along_y.x + at.bend * along_y.y, along_y.y) *
                  texels.xyxy;
#endif
    return inside_window(here.texels, here.centre) && in_range;
}

vec2 level_slope(candidate chosen)
{
    return vec2(0.0, chosen.tilt);
}

vec2 own_slope(candidate chosen, vec2 gradient)
{
    return vec2(dot(chosen.slope.xy, gradient), dot(chosen.slope.zw, gradient));
}

vec2 plane_slope(candidate chosen, vec2 gradient)
{
    return own_slope(chosen, gradient) + level_slope(chosen);
}

// The tilt is the map's own and known everywhere: no bias counts it.
vec2 bias_slope(candidate chosen, vec2 gradient)
{
    return chosen.largest > 0.0 ? gradient * chosen.largest : own_slope(chosen, gradient);
}
