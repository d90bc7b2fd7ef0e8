// moments_pcss.glsl: depth and its square from -1/2 to 1/2, for levels of moments [Yang et al. 2010].

vec4 moments_of(float depth, int slice)
{
    float centred = depth - 0.5;
    return vec4(centred, centred * centred, 0.0, 0.0);
}
