// sums_lookup.glsl: mean moments of any rectangle by summed areas [Crow 1984; Lauritzen 2007].

layout(binding = 4) uniform usampler2DArray sums;

// Of the texels before a corner; sums may have wrapped around, which differences undo.
uvec2 sum_before(int cascade, ivec2 corner)
{
    uvec2 sum = texelFetch(sums, ivec3(max(corner - 1, 0), cascade), 0).xy;
    return min(corner.x, corner.y) > 0 ? sum : uvec2(0u);
}

// Along one axis: corners of the texels that a stretch covers, and the share of the first and the last that it does.
// The bilinear lookup between sums is a weighted mean of sums: taken apart into texels at the edges and those between,
// it stays in whole numbers until nothing can wrap any more.
struct stretch
{
    ivec4 corners;
    vec3 shares;
    float length;
};

stretch stretch_of(float middle, float half_width, int size)
{
    float first = clamp(middle - half_width, 0.0, float(size)), last = clamp(middle + half_width, 0.0, float(size));
    int begin = min(int(first), size - 1), end = max(int(ceil(last)), begin + 1);
    stretch along;
    along.corners = ivec4(begin, begin + 1, max(end - 1, begin + 1), end);
    float before = min(last, float(begin + 1)) - first;
    along.shares = vec3(before, 1.0, end > begin + 1 ? last - float(end - 1) : 0.0);
    along.length = last - first;
    return along;
}

// Mean depth from -1/2 to 1/2, and mean square of it, over the rectangle within half_width of a place
// [texels]; beyond the map it is cut.
vec2 mean_of_rectangle(int cascade, int size, vec2 place, vec2 half_width)
{
    place = clamp(place, 0.0, float(size));
    stretch x = stretch_of(place.x, half_width.x, size), y = stretch_of(place.y, half_width.y, size);
    vec2 total = vec2(0.0);
    uvec2 below[4];
    for (int i = 0; i < 4; i++) {
        below[i] = sum_before(cascade, ivec2(x.corners[i], y.corners[0]));
    }
    for (int j = 1; j < 4; j++) {
        uvec2 above[4];
        for (int i = 0; i < 4; i++) {
            above[i] = sum_before(cascade, ivec2(x.corners[i], y.corners[j]));
        }
        vec2 row = vec2(0.0);
        for (int i = 1; i < 4; i++) {
            uvec2 sum = above[i] - above[i - 1] - (below[i] - below[i - 1]);
            row += x.shares[i - 1] * vec2(float(int(sum.x)), float(sum.y));
        }
        total += y.shares[j - 1] * row;
        below = above;
    }
    return total * vec2(1.0, 0.25) / (x.length * y.length * frame.bleed.w);
}
