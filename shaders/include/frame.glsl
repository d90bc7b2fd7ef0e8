// frame.glsl: what the CPU tells every pass of a frame; mirrored by csm_frame_uniforms in gl_internal.h.
//
// Functions read the copy, which lives in registers: on software GL every read of a uniform block costs about as much
// as ten multiplications, and passes that answer for several pixels read it once for all.
//
// Spaces: "origin" is the world relative to the fixed origin of the scene; light space is a rotation of it, or a skew.
// A cascade's texel coordinates are light x, y in texels from the window's lower left corner.

struct frame_values
{
    vec4 light_from_origin[3];      // rows; w unused
    vec4 eye_high, eye_low;         // the eye relative to the origin, in two floats a coordinate
    vec4 right, up, backward;       // of the camera; right w: 1 if it is orthographic
    vec4 to_light;
    mat4 clip_from_eye;             // reversed depth, for the view pass alone
    vec4 view;                      // half width, half height, near, far
    ivec4 image;                    // width, height, first row of the band (or first point), points
    vec4 bias;                      // slope, normal offset [texels]; border of the kernel [texels]; roundings
    vec4 window[8];                 // texels per metre in x, y; phase in x, y [texels]
    vec4 centre[8];                 // of the window in lattice texels x, y; texels of its half side, of its side
    vec4 depth[8];                  // scale, offset of z; constant bias [depth]; larger texel side [m]
    vec4 slope[8];                  // depth per texel at a gradient of 1 in x, y; far view depth [m]; least of x, y in a bias
    vec4 clip[8];                   // light x, y to clip x, y: scale, offset
    vec4 turn[8];                   // cosine, sine of its axes against those of light space
    vec4 normal_from_origin[3];     // rows: normals to light space, where it is skewed
    vec4 view_centre;               // x, y of the picture's centre, in the units of view.xy; view depth of the first split; most lookups along a footprint
    ivec4 place[8];                 // x, y of the map in what holds it [texels]; layer
    vec4 kernel[8];                 // half width in x, y [texels]
    vec4 width;                     // half of filter_size [texels]; half width [m], and a part per metre of view depth; least [texels]
    vec4 blend;                     // share of half a map; depth where they end; 1 / width of their fade before it; tangent of the sun's angular radius
    vec4 moments;                   // exponents of the positive and negative warp; least variance; bias
    vec4 bleed;                     // step; 1 / (1 - step); power; steps of summed areas to the range of depths
};

layout(std140, binding = 0) uniform frame_block
{
    frame_values frame_uniforms;
};

frame_values frame = frame_uniforms;

vec3 light_position(vec3 position_origin)
{
    return vec3(dot(frame.light_from_origin[0].xyz, position_origin),
                dot(frame.light_from_origin[1].xyz, position_origin),
                dot(frame.light_from_origin[2].xyz, position_origin));
}

// Light x, y along the axes of a cascade.
vec2 turned(vec2 along_light, int cascade)
{
#if CSM_TURNED
    vec2 turn = frame.turn[cascade].xy;
    return vec2(turn.x * along_light.x + turn.y * along_light.y,
                turn.x * along_light.y - turn.y * along_light.x);
#else
    return along_light;
#endif
}

// Light x, y in texels of a cascade, counted from a lattice point near the scene's origin: the same number in
// every frame while the texel size stays, however the window moves.
vec2 lattice_texels(vec2 position_ls, int cascade)
{
    return position_ls * frame.window[cascade].xy + frame.window[cascade].zw;
}

// Whether a map answers for a point: centre is that of the window and half its side, in the texels of the point.
bool inside_window(vec2 texels, vec4 centre)
{
    vec2 away = abs(texels - centre.xy);
#if CSM_SELECT == CSM_SELECT_FRUSTUM
    return max(away.x, away.y) < centre.z; // the kernel may reach over the rim
#else
    return max(away.x, away.y) < centre.z - frame.bias.z;
#endif
}

float map_depth(float z_ls, int cascade)
{
    return z_ls * frame.depth[cascade].x + frame.depth[cascade].y;
}
