// filter_pcss.glsl: percentage-closer soft shadows [Fernando 2005] of a sun, whose rays fill a cone: what lies d
// metres up the ray darkens a disc of radius d * tan(angular radius) across it.
//
// Blockers are looked for as far as the farthest possible one would throw a penumbra, more taps the nearer the middle,
// and only those count that stand in the cone: the others hide nothing of the sun. Their mean distance gives the
// radius of the disc that is filtered. filter_size limits both, along u and along v.

// An offset across the sun's rays [m], as one in light x, y.
vec2 across_rays(vec2 offset)
{
#if CSM_SKEWED
    // light x and y run askew: the part of a root of their Gram matrix
    vec3 x = frame.light_from_origin[0].xyz, y = frame.light_from_origin[1].xyz;
    float side = length(x), along = dot(x, y) / side;
    float rest = sqrt(max(dot(y, y) - along * along, 0.0));
    return vec2(side * offset.x, along * offset.x + rest * offset.y);
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

// Texels to a place across the rays [m].
vec2 texels_away(map_receiver at, vec2 place)
{
    vec2 away = across_rays(place) * at.density;
#if CSM_SKEWED
    away = clamp(away, -frame.width.x, frame.width.x); // limits hold along the rays' axes, not u and v
#endif
    return away;
}

// A blocker hides of the sun what is in its own disc. The map knows one distance a texel: what is seen of a slanted
// wall farther down stands for its top, too, so filtering takes blockers within four discs, which holds for all
// slopes up to 3/4 of the inverse tangent.
const float discs_searched = 1.0, discs_filtered = 4.0;

// Whether the texel at a place across the rays [m] holds a blocker whose disc, so many times as large, reaches the
// receiver, and how far up the ray it lies [m].
bool blocked(map_receiver at, vec2 place, float discs, out float metres)
{
    ivec2 offset = disc_texel(at, texels_away(at, place));
    float stored = map_depth_at(at.cascade, at.texel + offset);
    float level = at.z + dot(at.level, vec2(offset) + 0.5 - at.fraction);
    metres = max(level - stored, 0.0) / at.scale;
    // the texel that holds a place may show an edge a texel away
    vec2 texels = texels_across(at);
    float texel = 1.0 / min(texels.x, texels.y);
    return length(place) <= discs * metres * frame.blend.w + texel && !tap_lit(at, offset, stored);
}

// Mean distance of the blockers in the sun's cone [m]; negative if there are none.
float blocker_distance(map_receiver at, inout vec2 turn, vec2 radius)
{
    float sum = 0.0, count = 0.0, metres;
    for (int i = -1; i < CSM_TAP_COUNT; i++) {
        vec2 place = i < 0 ? vec2(0.0) : disc_place(i, turn);
        if (blocked(at, radius * length(place) * place, discs_searched, metres)) {
            sum += metres;
            count += 1.0;
        }
    }
    return count > 0.0 ? sum / count : -1.0;
}

float filter_visibility(map_receiver at)
{
    vec2 widest = frame.width.x / texels_across(at);
    vec2 turn = disc_turn(at);
    float farthest = max(at.z, 0.0) / at.scale;
    float mean = blocker_distance(at, turn, min(vec2(farthest * frame.blend.w), widest));
    if (mean < 0.0) {
        return 1.0;
    }
    vec2 radius = min(vec2(mean * frame.blend.w), widest);
    float lit = 0.0, metres;
    for (int i = 0; i < CSM_TAP_COUNT; i++) {
        lit += blocked(at, radius * disc_place(i, turn), discs_filtered, metres) ? 0.0 : 1.0;
    }
    return lit / float(CSM_TAP_COUNT);
}
