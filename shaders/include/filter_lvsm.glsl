// filter_lvsm.glsl: layered variance shadow maps [Lauritzen, McCool 2008]: in the receiver's layer, where every
// occluder before it counts as at its beginning.

float filter_visibility(map_receiver at)
{
    int layer = layer_of(at.z);
    vec4 found = moments_at(at, layer / 2, CSM_LAYER_COUNT / 2);
    vec2 pair = pair_of_stored(layer % 2 == 0 ? found.xy : found.zw);
    return largest_lit_share(centred(depth_in_layer(at.z, layer)), pair.x, pair.y, frame.moments.z);
}
