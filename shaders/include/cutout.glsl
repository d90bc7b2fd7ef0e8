// cutout.glsl: which texels of a mesh are there, by the image laid over it (docs/numerics.md 26). Included by the
// fragment stage of passes that draw triangles, for the meshes that have a cut-out.
//
// Images lie behind each other in one buffer, a bit a texel: nearest texel, wrapping round, no filter and no mip level.
// The truth looks up the same bit.

layout(binding = 7) uniform usamplerBuffer cutouts;

// Per sample, where maps have several: each then has a place of its own, and none lies outside the triangle.
layout(location = 8) sample in vec2 cutout_texels; // from the image's upper left corner, never negative
layout(location = 9) flat in uvec2 cutout_image;   // word that it begins at; width - 1, height - 1 in 16 bits each

bool cut_out()
{
    vec2 last = vec2(cutout_image.y & 0xffffu, cutout_image.y >> 16);
    vec2 texel = floor(max(cutout_texels, vec2(0.0)));
    // exact to 2^20 texels: half a texel keeps the quotient off the whole numbers
    texel -= floor((texel + 0.5) / (last + 1.0)) * (last + 1.0);
    uvec2 place = uvec2(clamp(texel, vec2(0.0), last));
    uint row_words = (uint(last.x) >> 5) + 1u;
    uint word = texelFetch(cutouts, int(cutout_image.x + place.y * row_words + (place.x >> 5))).x;
    return (word >> (place.x & 31u) & 1u) == 0u;
}
