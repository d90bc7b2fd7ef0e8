// moments_lvsm.glsl: depth in a layer and its square, two layers a slice [Lauritzen, McCool 2008].

vec4 moments_of(float depth, int slice)
{
    return vec4(stored_pair(centred(depth_in_layer(depth, 2 * slice))),
                stored_pair(centred(depth_in_layer(depth, 2 * slice + 1))));
}
