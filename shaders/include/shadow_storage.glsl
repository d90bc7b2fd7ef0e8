// shadow_storage.glsl: depths of the shadow maps, wherever they lie, 0 at the caster side: layers of an array, tiles
// of an atlas, textures of their own, faces of a cube. Needs frame.glsl. Texels count from the map's lower left corner.
// choose_map comes before lookups in a map.

// Hardware compares and plain depths are two ways to read one texture. Both come four at a time, never as the hardware's
// own mean: its weights have few bits and those depend on where in which texture a map lies, so that a tile's neighbour
// would show at the rim, and one map would give other masks from other places.
#if CSM_STORAGE == CSM_STORAGE_ARRAY

layout(binding = 1) uniform sampler2DArray shadow_maps;
layout(binding = 2) uniform sampler2DArrayShadow shadow_compare;

vec2 texture_step = 1.0 / vec2(textureSize(shadow_maps, 0).xy);

float raw_depth(int cascade, ivec2 texel)
{
    return texelFetch(shadow_maps, ivec3(texel, cascade), 0).r;
}

vec4 raw_depths(int cascade, ivec2 corner)
{
    return textureGather(shadow_maps, vec3(vec2(corner) * texture_step, float(cascade)));
}

vec4 raw_compares(int cascade, ivec2 corner, float z)
{
    return textureGather(shadow_compare, vec3(vec2(corner) * texture_step, float(cascade)), z);
}

#elif CSM_STORAGE == CSM_STORAGE_ATLAS

// Lower left corner of the tile that is looked up: read once, not at every tap.
ivec2 tile_corner;

void choose_map(int cascade)
{
    tile_corner = frame.place[cascade].xy;
}

layout(binding = 1) uniform sampler2D shadow_maps;
layout(binding = 2) uniform sampler2DShadow shadow_compare;

vec2 texture_step = 1.0 / vec2(textureSize(shadow_maps, 0));

float raw_depth(int cascade, ivec2 texel)
{
    return texelFetch(shadow_maps, tile_corner + texel, 0).r;
}

vec4 raw_depths(int cascade, ivec2 corner)
{
    return textureGather(shadow_maps, vec2(tile_corner + corner) * texture_step);
}

vec4 raw_compares(int cascade, ivec2 corner, float z)
{
    return textureGather(shadow_compare, vec2(tile_corner + corner) * texture_step, z);
}

#elif CSM_STORAGE == CSM_STORAGE_SEPARATE

// Samplers may be picked by a constant index alone: every map is asked for in turn, and one answer kept. Without
// branches: on software GL they cost four times the fetches. A pass over one map, which does not see how many there
// are, has that one alone.
const int map_count = CSM_CASCADE_COUNT > 1 ? CSM_CASCADE_COUNT : 1;

#if CSM_KERNEL_SIZE == 2

layout(binding = 8) uniform sampler2DShadow shadow_compare[map_count];

vec4 raw_compares(int cascade, ivec2 corner, float z)
{
    vec4 lit = vec4(1.0);
    for (int i = 0; i < map_count; i++) {
        vec4 here = textureGather(shadow_compare[i], vec2(corner) / vec2(textureSize(shadow_compare[i], 0)), z);
        lit = mix(lit, here, bvec4(i == cascade));
    }
    return lit;
}

#else

layout(binding = 8) uniform sampler2D shadow_maps[map_count];

// Beyond a smaller map fetches of no consequence would lie outside of it.
float raw_depth(int cascade, ivec2 texel)
{
    float depth = 1.0;
    for (int i = 0; i < map_count; i++) {
        ivec2 last = textureSize(shadow_maps[i], 0) - 1;
        float here = texelFetch(shadow_maps[i], clamp(texel, ivec2(0), last), 0).r;
        depth = i == cascade ? here : depth;
    }
    return depth;
}

vec4 raw_depths(int cascade, ivec2 corner)
{
    vec4 depths = vec4(1.0);
    for (int i = 0; i < map_count; i++) {
        vec4 here = textureGather(shadow_maps[i], vec2(corner) / vec2(textureSize(shadow_maps[i], 0)));
        depths = mix(depths, here, bvec4(i == cascade));
    }
    return depths;
}

#endif

#else

layout(binding = 1) uniform samplerCube shadow_maps;
layout(binding = 2) uniform samplerCubeShadow shadow_compare;

float cube_step = 2.0 / float(textureSize(shadow_maps, 0).x);

// Towards a place on the face of a cascade; the inverse of table 8.19 of the OpenGL specification.
vec3 cube_direction(int cascade, vec2 texels)
{
    vec2 at = texels * cube_step - 1.0;
    vec3 towards = vec3(1.0, -at.y, -at.x);
    towards = cascade == 1 ? vec3(-1.0, -at.y, at.x) : towards;
    towards = cascade == 2 ? vec3(at.x, 1.0, at.y) : towards;
    towards = cascade == 3 ? vec3(at.x, -1.0, -at.y) : towards;
    towards = cascade == 4 ? vec3(at.x, -at.y, 1.0) : towards;
    return cascade == 5 ? vec3(-at.x, -at.y, -1.0) : towards;
}

float raw_depth(int cascade, ivec2 texel)
{
    return textureLod(shadow_maps, cube_direction(cascade, vec2(texel) + 0.5), 0.0).r;
}

// Corners at the rim lie on two faces: a quarter of a texel inwards the texels are the same, on this face and the next.
vec3 corner_direction(int cascade, ivec2 corner)
{
    return cube_direction(cascade, clamp(vec2(corner), 0.25, 2.0 / cube_step - 0.25));
}

vec4 raw_depths(int cascade, ivec2 corner)
{
    return textureGather(shadow_maps, corner_direction(cascade, corner));
}

vec4 raw_compares(int cascade, ivec2 corner, float z)
{
    return textureGather(shadow_compare, corner_direction(cascade, corner), z);
}

#endif

#if CSM_STORAGE != CSM_STORAGE_ATLAS

void choose_map(int cascade)
{
}

#endif

#if CSM_STORAGE != CSM_STORAGE_SEPARATE || CSM_KERNEL_SIZE != 2

float map_depth_at(int cascade, ivec2 texel)
{
    float depth = raw_depth(cascade, texel);
    return CSM_REVERSED_DEPTH == 1 ? 1.0 - depth : depth;
}

// Depths of the texels around the corner shared by texels (c - 1, c) along both axes, in the order of textureGather:
// left above, right above, right below, left below.
vec4 map_depths_around(int cascade, ivec2 corner)
{
    vec4 depths = raw_depths(cascade, corner);
    return CSM_REVERSED_DEPTH == 1 ? 1.0 - depths : depths;
}

#endif

#if CSM_STORAGE != CSM_STORAGE_SEPARATE || CSM_KERNEL_SIZE == 2

// Bilinear mean of the hardware's compares of the four texels around a place; at the outermost centres of a map the
// texels beyond them weigh nothing.
float map_compare(int cascade, vec2 texels, float z)
{
    vec2 first = floor(texels - 0.5), share = texels - 0.5 - first;
    vec4 lit = raw_compares(cascade, ivec2(first) + 1, CSM_REVERSED_DEPTH == 1 ? 1.0 - z : z);
    return mix(mix(lit.w, lit.z, share.x), mix(lit.x, lit.y, share.x), share.y);
}

#endif
