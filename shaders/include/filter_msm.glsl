// filter_msm.glsl: moment shadow maps [Peters, Klein 2015]: the largest share of light that four moments allow.
//
// Among all distributions of depths with these moments one has the receiver among its depths and the least mass before
// it; with four moments it has three depths. The masses come from the kernel of orthogonal polynomials (Christoffel's
// function) instead of from an interpolation: no differences of roots, so that float32 is enough.
#include "include/msm_transform.glsl"

// Depths y from their mean: the polynomials are 1, y and y * y - skew * y - variance, with squared norms 1, variance
// and rest.
struct msm_shape
{
    float mean, variance, skew, rest;
};

// Both norms are concave in the moments: after the bias they cannot be less but for rounding.
msm_shape msm_shape_of(vec4 moments, float bias)
{
    precise msm_shape shape;
    shape.mean = moments.x;
    shape.variance = max(moments.y - moments.x * moments.x, 0.5 * bias);
    precise float mixed = (moments.z - moments.x * moments.y) / shape.variance;
    shape.rest = max(moments.w - moments.y * moments.y - mixed * mixed * shape.variance, 0.125 * bias);
    shape.skew = mixed - 2.0 * moments.x;
    return shape;
}

float msm_quadratic(msm_shape shape, float y)
{
    precise float quadratic = (y - shape.skew) * y - shape.variance;
    return quadratic;
}

// Mass of a depth in the distribution of three depths that holds it.
float msm_mass(msm_shape shape, float y)
{
    precise float mass;
    float quadratic = msm_quadratic(shape, y);
    mass = 1.0 / (1.0 + y * y / shape.variance + quadratic * quadratic / shape.rest);
    return mass;
}

// Depths may lie anywhere. The other two are the roots of weight x^2 + linear x + constant: both on one side of the
// receiver, or where weight is negative on either side.
float msm_lit_anywhere(msm_shape shape, float y, float weight, float linear, float constant)
{
    if (weight >= 0.0) {
        return y > 0.0 ? msm_mass(shape, y) : 1.0;
    }
    precise float root = sqrt(linear * linear - 4.0 * weight * constant);
    precise float first = linear > 0.0 ? -2.0 * constant / (linear + root) : (linear - root) / (-2.0 * weight);
    return 1.0 - msm_mass(shape, max(first, -1e9)); // far away its mass is 0, and its square still a float
}

#if CSM_MSM_BOUND == CSM_MSM_BOUND_HAUSDORFF

// Depths lie from -1 to 1: where the free distribution reaches beyond, the sharpest one holds both ends, the receiver
// and one more depth. Weighted by 1 - z^2 the ends drop out, and two depths are those of Chebyshev's bound.
float msm_lit_between_ends(vec4 moments, float z, float bias)
{
    vec3 inner = vec3(1.0, moments.xy) - moments.yzw;
    inner.x = max(inner.x, 0.5 * bias);
    float mean = inner.y / inner.x;
    float variance = max(inner.z / inner.x - mean * mean, 0.0);
    float away = z - mean;
    float square = max(variance + away * away, 1e-12);
    float other = clamp(mean - variance / (abs(away) > 1e-9 ? away : 1e-9), -1.0, 1.0);
    float own_mass = inner.x * variance / (square * (1.0 - z * z));
    float other_mass = inner.x * away * away / (square * max(1.0 - other * other, 1e-6));
    float ends = 1.0 - own_mass - other_mass;
    float difference = moments.x - z * own_mass - other * other_mass;
    return own_mass + (other > z ? other_mass : 0.0) + 0.5 * (ends + difference);
}

bool msm_reaches_beyond(vec2 at_ends, float y, float weight)
{
    if (weight < 0.0) {
        return max(at_ends.x, at_ends.y) > 0.0;
    }
    return (y > 0.0 ? at_ends.x : at_ends.y) < 0.0;
}

#endif

float msm_lit_share(vec4 moments, float z, float bias)
{
    // towards those of the arcsine distribution
    precise vec4 inner = moments + (vec4(0.0, 0.5, 0.0, 0.375) - moments) * bias;
    msm_shape shape = msm_shape_of(inner, bias);
    precise float y = z - shape.mean;
    precise float weight = msm_quadratic(shape, y) / shape.rest;
    precise float linear = y / shape.variance - shape.skew * weight;
    precise float constant = 1.0 - weight * shape.variance;
    float lit = msm_lit_anywhere(shape, y, weight, linear, constant);
#if CSM_MSM_BOUND == CSM_MSM_BOUND_HAUSDORFF
    vec2 ends = vec2(-1.0, 1.0) - shape.mean;
    if (msm_reaches_beyond((weight * ends + linear) * ends + constant, y, weight)) {
        lit = min(lit, msm_lit_between_ends(inner, z, bias));
    }
#endif
    return clamp(lit, 0.0, 1.0);
}

float filter_visibility(map_receiver at)
{
    vec4 found = msm_moments(moments_at(at, 0, 1));
    float z = clamp(2.0 * at.z - 1.0, -1.0 + 1e-6, 1.0 - 1e-6);
    return without_bleeding(msm_lit_share(found, z, frame.moments.w));
}
