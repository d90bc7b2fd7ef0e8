// filter_vsm.glsl: variance shadow maps [Donnelly, Lauritzen 2006].

float filter_visibility(map_receiver at)
{
    vec2 found = moments_at(at, 0, 1).xy;
    return largest_lit_share(at.z - 0.5, found.x, found.y, frame.moments.z);
}
