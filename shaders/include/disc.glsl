// disc.glsl: places of taps in a disc of radius 1. Needs noise in map_receiver.
//
// Poisson: points kept apart by best candidate [Mitchell 1991], with the disc's own centroid and variances; made and
// printed by scripts/poisson_discs.py. Vogel's spiral [Vogel 1979]: any number, each on its own ring of equal area.

#if CSM_DISC == CSM_DISC_POISSON
#if CSM_TAP_COUNT == 8
const vec2 poisson_disc[8] = vec2[](
    vec2(-0.18124, 0.02221),
    vec2(0.37539, -0.26462),
    vec2(0.33716, 0.61187),
    vec2(-0.28192, 0.65742),
    vec2(-0.51455, -0.57749),
    vec2(-0.77202, 0.24726),
    vec2(0.17621, -0.84107),
    vec2(0.86096, 0.14443));
#else
const vec2 poisson_disc[16] = vec2[](
    vec2(-0.06676, -0.15074),
    vec2(-0.26125, 0.30381),
    vec2(0.22648, 0.33948),
    vec2(0.44404, -0.07789),
    vec2(-0.53541, -0.06200),
    vec2(-0.33400, -0.48538),
    vec2(0.15878, -0.60430),
    vec2(-0.03404, 0.74738),
    vec2(0.69942, 0.34846),
    vec2(-0.74965, 0.33344),
    vec2(0.43042, 0.70144),
    vec2(-0.47288, 0.70732),
    vec2(0.63001, -0.60439),
    vec2(-0.77213, -0.42099),
    vec2(0.86540, -0.18110),
    vec2(-0.22843, -0.89454));
#endif
#else
const vec2 golden_turn = vec2(-0.73736888, 0.67549029); // cosine, sine of the golden angle, pi (3 - sqrt(5))
#endif

vec2 turned_by(vec2 place, vec2 turn)
{
    return vec2(turn.x * place.x - turn.y * place.y, turn.y * place.x + turn.x * place.y);
}

// Cosine and sine by which the whole disc is turned for a receiver.
vec2 disc_turn(map_receiver at)
{
#if CSM_ROTATED
    float angle = 6.28318531 * at.noise;
    return vec2(cos(angle), sin(angle));
#else
    return vec2(1.0, 0.0);
#endif
}

// The place of tap i; taps are asked for in order, and turn is carried from each to the next.
vec2 disc_place(int i, inout vec2 turn)
{
#if CSM_DISC == CSM_DISC_POISSON
#if CSM_ROTATED
    return turned_by(poisson_disc[i], turn);
#else
    return poisson_disc[i];
#endif
#else
    vec2 place = turn * sqrt((float(i) + 0.5) / float(CSM_TAP_COUNT));
    turn = turned_by(turn, golden_turn);
    return place;
#endif
}

// A tap in the map: how many texels from the receiver's own the one lies that holds it.
ivec2 disc_texel(map_receiver at, vec2 away)
{
    return kept_in_map(at, ivec2(floor(at.fraction + away)));
}

bool disc_tap_lit(map_receiver at, ivec2 offset)
{
    return tap_lit(at, offset, map_depth_at(at.cascade, at.texel + offset));
}
