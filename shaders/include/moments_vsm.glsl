// moments_vsm.glsl: depth and its square [Donnelly, Lauritzen 2006].

vec4 moments_of(float depth, int slice)
{
    return vec4(stored_pair(centred(depth)), 0.0, 0.0);
}
