// seams.glsl: the cascade of a pixel and its footprint in that map, by what is done about the quads that two cascades
// share (docs/numerics.md 29). Needs cascade_select.glsl.

#if CSM_LOOKUP == CSM_LOOKUP_BILINEAR || CSM_GRADIENTS == CSM_GRADIENTS_ANALYTIC

choice choose_for_pixel(receiver point)
{
    return choose_cascade(point);
}

#else

// A pixel of the quad as a receiver of its own.
receiver as_receiver(receiver point, neighbour other)
{
    receiver there = point;
    there.position = other.position;
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
void place_in_cascade(receiver point, int cascade, inout candidate here)
{
    for (int i = 0; i < CSM_CASCADE_COUNT; i++) {
        if (i == cascade) {
            place_in_map(point, i, here);
        }
    }
}

// What a pixel of the quad says: its cascade, and the maps that hold it, a bit each. One without a cascade has no say.
struct say
{
    int finest, coarsest, held;
};

say say_of(receiver there, bool seen)
{
    candidate ignored;
    int held = 0;
    for (int cascade = 0; cascade < CSM_CASCADE_COUNT; cascade++) {
        held |= place_in_map(there, cascade, ignored) ? 1 << cascade : 0;
    }
    int own = choose_cascade(there).own.cascade;
    bool counts = seen && own != no_cascade;
    return say(counts ? own : no_cascade, counts ? own : -1, counts ? held : -1);
}

say both(say a, say b)
{
    return say(min(a.finest, b.finest), max(a.coarsest, b.coarsest), a.held & b.held);
}

// One cascade for the quad: the finest of its pixels' [Zhang2009] if that map holds all of them with their kernels,
// else the coarsest, else each pixel keeps its own.
choice choose_for_quad(receiver point)
{
    choice chosen = choose_cascade(point);
    say quad = both(both(say_of(as_receiver(point, point.own), point.own.seen),
                         say_of(as_receiver(point, point.beside), point.beside.seen)),
                    both(say_of(as_receiver(point, point.above), point.above.seen),
                         say_of(as_receiver(point, point.across), point.across.seen)));
    int own = chosen.own.cascade;
    if (own == no_cascade || quad.finest >= quad.coarsest) {
        return chosen;
    }
    int settled = (quad.held >> quad.finest & 1) != 0     ? quad.finest
                  : (quad.held >> quad.coarsest & 1) != 0 ? quad.coarsest
                                                          : own;
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
