// filter_pcss.glsl: percentage-closer soft shadows [Fernando 2005] of a sun, whose rays fill a cone: what lies d
// metres up the ray darkens a disc of radius d * tan(angular radius) across it.
//
// Blockers are looked for as far as the farthest possible one would throw a penumbra, more taps the nearer the middle,
// and only those count that stand in the cone: the others hide nothing of the sun. Their mean distance gives the
// radius of the disc that is filtered. filter_size limits both.

// An offset across the sun's rays [m], as one in light x, y.
vec2 across_rays(vec2 offset)
{
#if CSM_SKEWED
    // light x and y run askew: the part of a root of their Gram matrix
    vec3 x = frame.light_from_origin[0].xyz, y = frame.light_from_origin[1].xyz;
    float side = length(x), shared = dot(x, y) / side;
    float rest = sqrt(max(dot(y, y) - shared * shared, 0.0));
    return vec2(side * offset.x, shared * offset.x + rest * offset.y);
#else
    return offset;
#endif
}

// How far a disc of 1 m across the rays reaches along u and v [texels].
vec2 texels_across(map_receiver at)
{
#if CSM_SKEWED
    return at.density * vec2(length(frame.light_from_origin[0].xyz), length(frame.light_from_origin[1].xyz));
#else
    return at.density;
#endif
}

// Mean distance of the blockers in the sun's cone [m]; negative if there are none.
float blocker_distance(map_receiver at, vec2 turn, float radius, float texel)
{
    float sum = 0.0, count = 0.0;
    for (int i = -1; i < CSM_TAP_COUNT; i++) {
        vec2 place = i < 0 ? vec2(0.0) : disc_place(i, turn);
        place *= radius * length(place);
        ivec2 offset = disc_texel(at, across_rays(place) * at.density);
        float stored = map_depth_at(at.cascade, at.texel + offset);
        vec2 away = vec2(offset) + 0.5 - at.fraction;
        float distance = (at.z + dot(at.level, away) - stored) / at.scale;
        // a texel's neighbour may be the one whose edge is in the cone
        bool in_cone = length(place) <= max(distance, 0.0) * frame.blend.w + texel;
        if (in_cone && !tap_lit(at, offset, stored)) {
            sum += max(distance, 0.0);
            count += 1.0;
        }
    }
    return count > 0.0 ? sum / count : -1.0;
}

float filter_visibility(map_receiver at)
{
    vec2 texels = texels_across(at);
    float widest = frame.width.x / max(texels.x, texels.y);
    float texel = 1.0 / min(texels.x, texels.y);
    vec2 turn = disc_turn(at);
    float farthest = max(at.z, 0.0) / at.scale;
    float found = blocker_distance(at, turn, min(farthest * frame.blend.w, widest), texel);
    if (found < 0.0) {
        return 1.0;
    }
    float radius = min(found * frame.blend.w, widest);
    float lit = 0.0;
    for (int i = 0; i < CSM_TAP_COUNT; i++) {
        vec2 away = across_rays(radius * disc_place(i, turn)) * at.density;
        lit += disc_tap_lit(at, disc_texel(at, away)) ? 1.0 : 0.0;
    }
    return lit / float(CSM_TAP_COUNT);
}
