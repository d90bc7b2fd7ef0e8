// noise.glsl: a number from 0 to 1 for each pixel, or each place, that decides what is drawn by lot.

// Interleaved gradient noise [Jimenez 2014]: its values are spread evenly over every 3 x 3 pixels.
float pixel_noise(ivec2 pixel)
{
    return fract(52.9829189 * fract(dot(vec2(pixel), vec2(0.06711056, 0.00583715))));
}

// Points have no pixel: their own place decides, so that a point keeps its lot from frame to frame.
float place_noise(vec3 position)
{
    uvec3 bits = floatBitsToUint(position) * uvec3(0x9e3779b1u, 0x85ebca77u, 0xc2b2ae3du);
    uint mixed = bits.x ^ (bits.y >> 7) ^ (bits.z << 9);
    mixed = (mixed ^ (mixed >> 15)) * 0x2c1b3c6du;
    mixed = (mixed ^ (mixed >> 12)) * 0x297a2d39u;
    return float((mixed ^ (mixed >> 15)) >> 8) / 16777216.0;
}
