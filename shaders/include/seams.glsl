// seams.glsl: the cascade of a pixel and its footprint in that map, by what is done about the quads that two cascades
// share (docs/numerics.md 29). Needs cascade_select.glsl.

#if CSM_LOOKUP == CSM_LOOKUP_BILINEAR || CSM_STEPS != CSM_STEPS_DIFFERENCES

choice choose_for_pixel(receiver point)
{
    return choose_cascade(point);
}

#else

// A pixel of the quad as a receiver of its own.
receiver as_receiver(receiver point, neighbour other)
{
    receiver there = point;
    there.position = frame.eye_high.xyz + other.away;
    there.normal = other.normal;
    there.view_depth = other.view_depth;
#if CSM_TEXCOORD == CSM_TEXCOORD_INTERPOLATED
    there.position_ls = point.position_ls + light_position(other.away - point.own.away);
#endif
    return there;
}

#if CSM_GRADIENTS == CSM_GRADIENTS_HARDWARE || CSM_WARPED

// Share of the map's side from its lower left corner: what a shader would look up with.
vec2 map_share(candidate at)
{
    return (at.texels - at.centre.xy + at.centre.z) / at.centre.w;
}

vec4 difference(candidate own, candidate beside, candidate above)
{
    vec2 here = map_share(own);
    return vec4(map_share(beside) - here, map_share(above) - here) * own.centre.w;
}

#endif

#if CSM_GRADIENTS == CSM_GRADIENTS_HARDWARE

// Each pixel in its own cascade: where those differ, so do the maps that are subtracted.
choice choose_for_pixel(receiver point)
{
    choice chosen = choose_cascade(point);
    choice beside = choose_cascade(as_receiver(point, point.beside));
    choice above = choose_cascade(as_receiver(point, point.above));
    chosen.own.footprint = difference(chosen.own, beside.own, above.own);
#if CSM_BLEND != CSM_BLEND_NONE
    chosen.next.footprint = difference(chosen.next, beside.next, above.next);
#endif
    return chosen;
}

#else

// place_in_map for a cascade that is not known beforehand; of none, here stays.
bool place_in_cascade(receiver point, int cascade, inout candidate here)
{
    bool held = false;
    for (int i = 0; i < CSM_CASCADE_COUNT; i++) {
        if (i == cascade) {
            held = place_in_map(point, i, here);
        }
    }
    return held;
}

int cascade_of(receiver point, neighbour other)
{
    return other.seen ? choose_cascade(as_receiver(point, other)).own.cascade : no_cascade;
}

// Pixels without a cascade have no say.
bool held_by(receiver point, neighbour other, int own, int cascade)
{
    candidate there;
    there.cascade = cascade;
    return own == no_cascade || place_in_cascade(as_receiver(point, other), cascade, there);
}

// One cascade for the quad: the finest of its pixels' [Zhang2009] if that map holds all of them with their kernels,
// else the coarsest, else each pixel keeps its own.
choice choose_for_quad(receiver point)
{
    choice chosen = choose_cascade(point);
    int own = chosen.own.cascade;
    int beside = cascade_of(point, point.beside);
    int above = cascade_of(point, point.above);
    int across = cascade_of(point, point.across);
    ivec4 all = ivec4(own, beside, above, across);
    ivec4 taken = ivec4(own == no_cascade ? -1 : own, beside == no_cascade ? -1 : beside,
                        above == no_cascade ? -1 : above, across == no_cascade ? -1 : across);
    int finest = min(min(all.x, all.y), min(all.z, all.w));
    int coarsest = max(max(taken.x, taken.y), max(taken.z, taken.w));
    if (own == no_cascade || finest >= coarsest) {
        return chosen;
    }
    bvec2 held = bvec2(true);
    for (int i = 0; i < 2; i++) {
        int cascade = i == 0 ? finest : coarsest;
        held[i] = held_by(point, point.own, own, cascade) && held_by(point, point.beside, beside, cascade) &&
                  held_by(point, point.above, above, cascade) && held_by(point, point.across, across, cascade);
    }
    int settled = held.x ? finest : held.y ? coarsest : own;
    if (settled != own) {
#if CSM_BLEND != CSM_BLEND_NONE
        // a pixel moved to the finer map has left the part that is that map's alone
        chosen.next = chosen.own;
        chosen.next_weight = settled < own ? 1.0 : 0.0;
#endif
        place_in_cascade(point, settled, chosen.own);
    }
    return chosen;
}

#if CSM_WARPED

// From pixel to pixel a warped map's coordinates change more evenly than those of light space, so they are subtracted.
vec4 difference_in(receiver point, candidate own)
{
    candidate beside = own, above = own;
    place_in_cascade(as_receiver(point, point.beside), own.cascade, beside);
    place_in_cascade(as_receiver(point, point.above), own.cascade, above);
    return difference(own, beside, above);
}

#endif

choice choose_for_pixel(receiver point)
{
    choice chosen = choose_for_quad(point);
#if CSM_WARPED
    chosen.own.footprint = difference_in(point, chosen.own);
#if CSM_BLEND != CSM_BLEND_NONE
    chosen.next.footprint = difference_in(point, chosen.next);
#endif
#endif
    return chosen;
}

#endif

#endif
