// moments_evsm.glsl: moments of exponential warps [Lauritzen, McCool 2008]; of two channels the positive one's alone.

vec4 moments_of(float depth, int slice)
{
    vec2 warped = exponential_warps(depth);
    return vec4(warped.x, warped.x * warped.x, warped.y, warped.y * warped.y);
}
