// filter_fourier.glsl: convolution shadow maps [Annen et al. 2007]: the step from light to shadow as a Fourier series,
// each term a product of one part of the receiver's depth and one of the map's, which can be filtered.
#include "include/fourier_terms.glsl"

const int fourier_slices = CSM_FOURIER_TERMS / 2;

vec2 turn_by(vec2 direction, vec2 angle)
{
    return vec2(direction.x * angle.x - direction.y * angle.y, direction.x * angle.y + direction.y * angle.x);
}

float filter_visibility(map_receiver at)
{
    if (at.z <= 0.0) {
        return 1.0; // nothing is nearer; the series has period 2 and would take an empty texel for an occluder
    }
    // Beyond the far end an empty texel, which holds 1, is no occluder: the series is one half at a depth's own place,
    // first 1 at this before it.
    float angle = pi * (at.z < 1.0 ? at.z : 1.0 - 0.3066 / float(CSM_FOURIER_TERMS));
    vec2 odd = vec2(cos(angle), sin(angle)), step = turn_by(odd, odd);
    float lit = 0.5;
    for (int slice = 0; slice < fourier_slices; slice++) {
        vec4 stored = fourier_found(moments_at(at, slice, fourier_slices));
        vec2 next = turn_by(odd, step);
        lit += 2.0 / (pi * float(4 * slice + 1)) * (odd.x * stored.x - odd.y * stored.y) +
               2.0 / (pi * float(4 * slice + 3)) * (next.x * stored.z - next.y * stored.w);
        odd = turn_by(next, step);
    }
    return clamp(lit, 0.0, 1.0);
}
