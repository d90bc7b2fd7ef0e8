// filter_pcss_moments.glsl: soft shadows of the sun's disc [Fernando 2005] from moments [Yang et al. 2010] instead of
// taps: the occluders' distance and the visibility are read from the mean and variance of depths over an area.

// The sun's disc, seen through an occluder, has this half width of a square that blurs an edge as much: half the side
// whose variance is that of a disc of radius 1, sqrt(3) / 2.
const float square_of_disc = 0.8660254;

#if CSM_PCSS_MAP == CSM_PCSS_MAP_SUMMED

vec2 area_moments(map_receiver at, vec2 half_width)
{
    return mean_of_rectangle(at.cascade, at.size, vec2(at.texel) + at.fraction, half_width);
}

#else

// Four by four lookups in the level whose texels are as wide as they are apart, along the axis where that is less.
// Lookups between texels widen each by a sixth of the square of its width in the mean, so that the square is a little
// narrower for the same variance.
vec2 area_moments(map_receiver at, vec2 half_width)
{
    vec2 apart = half_width * (0.5 * 0.9428);
    float level = min(log2(max(min(apart.x, apart.y), 1.0)), float(textureQueryLevels(moments) - 1));
    vec2 texels = 1.0 / vec2(textureSize(moments, 0).xy);
    vec2 place = clamp(vec2(at.texel) + at.fraction, 0.5, float(at.size) - 0.5);
    vec2 total = vec2(0.0);
    for (int y = 0; y < 4; y++) {
        for (int x = 0; x < 4; x++) {
            vec2 tap = place + (vec2(x, y) - 1.5) * apart;
            tap = clamp(tap, 0.5, float(at.size) - 0.5);
            total += textureLod(moments, vec3(tap * texels, float(at.cascade)), level).xy;
        }
    }
    return pair_of_stored(total / 16.0);
}

#endif

// Mean distance of occluders, in the range of depths, or a negative number where there are none. Chebyshev's share of
// light p is exact for occluders at one depth above a level receiver, and the mean of depths is
// p * receiver + (1 - p) * occluders: their distance comes to E[(depth - z)^2] / E[depth - z].
float distance_of_occluders(float depth, vec2 found)
{
    float nearer = depth - found.x;
    float variance = max(found.y - found.x * found.x, 0.0);
    return nearer > 0.0 ? (variance + nearer * nearer) / nearer : -1.0;
}

float filter_visibility(map_receiver at)
{
    float widest = frame.width.x;
    float depth = at.z - 0.5;
    // [texels] of a square as wide as the disc of an occluder 1 away, in the range of depths
    vec2 growth = at.density * (square_of_disc * frame.blend.w / at.scale);
#if CSM_SKEWED
    // light x and y are no lengths across the rays: a disc reaches as far along them as their rows are long
    growth *= vec2(length(frame.light_from_origin[0].xyz), length(frame.light_from_origin[1].xyz));
#endif
    // what stands between here and the sun lies within the disc's cone up to the map's near end; filter_size limits
    // the area along each axis
    float slower = max(min(growth.x, growth.y), 1e-9);
    float farthest = min(at.z, widest / slower);
    float reach = min(farthest, 1.0 / slower);
    // The area grows until it holds the cone up to the occluders in it. Begun at the widest, surfaces farther away than
    // the receiver would raise the mean and hide occluders near it: light leaked under every eave.
    for (int i = 0; i < 7; i++) {
        float distance = distance_of_occluders(depth, area_moments(at, clamp(growth * reach, 0.5, widest)));
        if (distance > 0.0 && distance <= reach) {
            reach = distance;
            break;
        }
        if (reach >= farthest) {
            break;
        }
        reach = min(2.0 * reach, farthest);
    }
    vec2 found = area_moments(at, clamp(growth * reach, 0.5, widest));
    return largest_lit_share(depth, found.x, found.y, frame.moments.z);
}
