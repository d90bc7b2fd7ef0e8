// warp.glsl: perspective warps of the light plane (docs/numerics.md 21); mirrored by csm_warp_uniforms in
// gl_internal.h, and bound only under a warp.
//
// A map's local coordinates are light x, y in units of what it holds, y from 0 to 1 along the warp. w depends on local
// y alone, so that light rays stay parallel to the depth axis. In this form nothing cancels, however weak the warp.

struct warp_values
{
    vec4 along_x[8];    // light x, y to local x: two factors, offset
    vec4 along_y[8];
    vec4 across[8];     // clip x times w of local x, y, 1; constant bias [texels]
    vec4 rows[8];       // clip y times w of local y and 1; w of local y and 1
    vec4 metres[8];     // light x, y [m] of a step in local x, then in local y
};

layout(std140, binding = 1) uniform warp_block
{
    warp_values warp_uniforms;
};

warp_values warp = warp_uniforms; // in registers, as frame

vec2 warp_local(vec2 light_xy, int cascade)
{
    return vec2(dot(warp.along_x[cascade].xy, light_xy) + warp.along_x[cascade].z,
                dot(warp.along_y[cascade].xy, light_xy) + warp.along_y[cascade].z);
}

vec4 warp_clip(vec2 local, float depth, int cascade)
{
    vec4 across = warp.across[cascade], rows = warp.rows[cascade];
    return vec4(across.x * local.x + across.y * local.y + across.z, rows.x * local.y + rows.y, depth,
                rows.z * local.y + rows.w);
}

// Sides [m] of a texel of the map where clip x, y, after the division, and w are these.
vec2 warp_texel(vec2 clip_xy, float w, int cascade)
{
    float across = warp.across[cascade].x, growth = warp.rows[cascade].z;
    float along = warp.rows[cascade].x - clip_xy.y * growth;
    float bend = (warp.across[cascade].y - clip_xy.x * growth) / across;
    vec4 metres = warp.metres[cascade];
    return vec2(length(metres.xy) * w / across, length(metres.zw - bend * metres.xy) * w / along) *
           (2.0 / frame.centre[cascade].w);
}

// Change of the map's depth from a row of texels to the next at one distance from the light.
float warp_tilt(float z, float clip_y, int cascade)
{
    float growth = warp.rows[cascade].z;
    return -z * growth / (warp.rows[cascade].x - clip_y * growth) / frame.centre[cascade].z;
}

// w where clip y, after the division, is this: 1 / w is linear over the map.
float warp_divisor(float clip_y, int cascade)
{
    vec4 rows = warp.rows[cascade];
    return (rows.x * rows.w - rows.y * rows.z) / (rows.x - clip_y * rows.z);
}
