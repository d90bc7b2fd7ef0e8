// moments_vsm.glsl: depth and its square [Donnelly, Lauritzen 2006], from -1/2 to 1/2: that halves the rounding of the
// depth and quarters that of the square.

vec4 moments_of(float depth, int slice)
{
    float centred = depth - 0.5;
    return vec4(centred, centred * centred, 0.0, 0.0);
}
