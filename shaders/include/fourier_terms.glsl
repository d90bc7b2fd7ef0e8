// fourier_terms.glsl: terms of the series for a step, c_k = pi (2 k - 1), as they are stored, and back.

const float pi = 3.14159265;

vec4 fourier_stored(vec4 terms)
{
    return CSM_MOMENT_FORMAT == CSM_MOMENT_FORMAT_UNORM16 ? 0.5 * terms + 0.5 : terms;
}

vec4 fourier_found(vec4 stored)
{
    return CSM_MOMENT_FORMAT == CSM_MOMENT_FORMAT_UNORM16 ? 2.0 * stored - 1.0 : stored;
}
