// filter_evsm2.glsl: exponential variance shadow maps, positive warp [Lauritzen, McCool 2008].

float filter_visibility(map_receiver at)
{
    vec2 found = moments_at(at, 0, 1).xy;
    return largest_lit_share_scaled(exponential_warps(at.z).x, found.x, found.y, frame.moments.z);
}
