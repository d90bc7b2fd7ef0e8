// filter_vsm.glsl: variance shadow maps [Donnelly, Lauritzen 2006].

float filter_visibility(map_receiver at)
{
    vec2 found = pair_of_stored(moments_at(at, 0, 1).xy);
    return largest_lit_share(centred(at.z), found.x, found.y, frame.moments.z);
}
