// moments_sums.glsl: depth from -1/2 to 1/2, and four times its square: in whole steps of 1 they are what summed areas
// [Lauritzen 2007] add. About the middle, both are rounded finer.

vec4 moments_of(float depth, int slice)
{
    float centred = depth - 0.5;
    return vec4(centred, 4.0 * centred * centred, 0.0, 0.0);
}
