// pcss_pair.glsl: a centred depth and its square as they are stored, and back: unorm16 holds 0 to 1 alone.

vec2 pcss_stored(float centred)
{
    vec2 pair = vec2(centred, centred * centred);
    return CSM_MOMENT_FORMAT == CSM_MOMENT_FORMAT_UNORM16 ? vec2(pair.x + 0.5, 4.0 * pair.y) : pair;
}

vec2 pcss_found(vec2 stored)
{
    return CSM_MOMENT_FORMAT == CSM_MOMENT_FORMAT_UNORM16 ? vec2(stored.x - 0.5, 0.25 * stored.y) : stored;
}
