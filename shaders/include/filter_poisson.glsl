// filter_poisson.glsl: the mean of compares in a disc, each against the receiver's plane at the centre of the texel
// that it fetches.

float filter_visibility(map_receiver at)
{
    vec2 radius = kernel_half_width(at);
    vec2 turn = disc_turn(at);
    float lit = 0.0;
    for (int i = 0; i < CSM_TAP_COUNT; i++) {
        lit += disc_tap_lit(at, disc_texel(at, radius * disc_place(i, turn))) ? 1.0 : 0.0;
    }
    return lit / float(CSM_TAP_COUNT);
}
