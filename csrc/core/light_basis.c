/* light_basis.c: the axes of light space for a direction to the light.
 *
 * In: to_light, world, any length; what the frame before held. Out: light_from_world about the
 * world origin, its +z along the ray to the light, and how much longer than in the world a length
 * may be in it. docs/numerics.md 6 and 18.
 *
 * Orthonormal, branch-free: Duff, Burgess, Christensen, Hery, Kensler, Liani, Villemin 2017,
 * "Building an orthonormal basis, revisited". A look-at with an up vector would lose all digits for
 * a sun near the zenith.
 */
#include "placement.h"

#include <limits.h>

#include "linalg.h"

#define PI 3.14159265358979323846

/* Stretches of a skew are 2^(k / 8), so that texel sizes stay while the sun moves. It is left above
 * k = 12, a sun at 20.7 degrees, and taken up again at k = 10, 24.9 degrees. */
#define STEPS_PER_OCTAVE 8
#define LEAVE_STEP 12
#define RETURN_STEP 10

/* Cosine of a turn beyond which there is no path to carry axes along: 179.97 degrees. */
#define OPPOSITE (-1.0 + 1e-7)

static csm_status unit_direction(const double to_light[3], double out[3], csm_error *err) {
    /* Divided by the largest component first: lengths from denormal to huge keep their digits. */
    const double largest = fmax(fabs(to_light[0]), fmax(fabs(to_light[1]), fabs(to_light[2])));
    if (!vec3_finite(to_light) || !(largest > 0.0)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "to_light must be finite and not zero (got %g, %g, %g)", to_light[0],
                        to_light[1], to_light[2]);
    }
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = to_light[axis] / largest;
    }
    const double length = sqrt(vec3_dot(out, out));
    for (int axis = 0; axis < 3; axis++) {
        out[axis] /= length;
    }
    return CSM_OK;
}

static void orthonormal(const double z[3], double out[16]) {
    const double s = copysign(1.0, z[2]);
    const double a = -1.0 / (s + z[2]);
    const double b = z[0] * z[1] * a;
    const double x[3] = {1.0 + s * z[0] * z[0] * a, s * b, -s * z[0]};
    const double y[3] = {b, s + z[1] * z[1] * a, -z[1]};
    mat4_from_rows(x, y, z, out);
}

csm_status csm_light_basis_orthonormal(const double to_light[3], double out[16], csm_error *err) {
    double z[3];
    const csm_status status = unit_direction(to_light, z, err);
    if (status == CSM_OK) {
        orthonormal(z, out);
    }
    return status;
}

void csm_sun_step(double step_deg, double to_light[3]) {
    if (!(step_deg > 0.0)) {
        return;
    }
    const double spacing = 0.5 * PI / ceil(90.0 / step_deg);
    const double elevation = atan2(to_light[1], hypot(to_light[0], to_light[2]));
    const double ring = spacing * round(elevation / spacing);
    const double around = 2.0 * PI / fmax(1.0, ceil(2.0 * PI * cos(ring) / spacing - 1e-9));
    const double azimuth = around * round(atan2(to_light[0], to_light[2]) / around);
    to_light[0] = cos(ring) * sin(azimuth);
    to_light[1] = sin(ring);
    to_light[2] = cos(ring) * cos(azimuth);
}

/* Coordinates of a point p: it is x (1, 0, 0) + y (0, 0, -side) + z to_light. The y axis turns over
 * with the light's side, so that the basis stays right-handed for light from below. */
static void skewed(const double to_light[3], double out[16]) {
    const double side = copysign(1.0, to_light[1]);
    const double x[3] = {1.0, -to_light[0] / to_light[1], 0.0};
    const double y[3] = {0.0, side * to_light[2] / to_light[1], -side};
    const double z[3] = {0.0, 1.0 / to_light[1], 0.0};
    mat4_from_rows(x, y, z, out);
}

/* Least k whose stretch no row of the skew exceeds, or the held one where that is one more;
 * INT_MIN where the sun is too low. */
static int stretch_step(const double to_light[3], const csm_hold *held) {
    const double y = fabs(to_light[1]);
    const double longest = fmax(1.0, fmax(hypot(to_light[0], y), hypot(to_light[2], y))) / y;
    if (!(longest <= exp2((LEAVE_STEP + 1.0) / STEPS_PER_OCTAVE))) {
        return INT_MIN;
    }
    int step = (int)ceil(STEPS_PER_OCTAVE * log2(longest));
    while (exp2((double)step / STEPS_PER_OCTAVE) < longest) {
        step++;
    }
    const bool left = held && held->light_basis == CSM_LIGHT_BASIS_ORTHONORMAL;
    if (step > (left ? RETURN_STEP : LEAVE_STEP)) {
        return INT_MIN;
    }
    const bool same = held && held->light_basis == CSM_LIGHT_BASIS_WORLD;
    return same && held->stretch_step == step + 1 ? held->stretch_step : step;
}

/* The shortest turn that takes the held axis to the light, applied to the held x. */
static void transport(const double held[16], const double z[3], double out[16]) {
    const double held_x[3] = {held[0], held[4], held[8]};
    const double held_z[3] = {held[2], held[6], held[10]};
    if (memcmp(held_z, z, sizeof held_z) == 0) {
        memcpy(out, held, 16 * sizeof *out); /* to the bit: the texel grid must not creep */
        return;
    }
    if (!(vec3_dot(held_z, z) > OPPOSITE)) {
        orthonormal(z, out);
        return;
    }
    const double share = vec3_dot(held_x, z) / (1.0 + vec3_dot(held_z, z));
    double x[3], y[3];
    for (int axis = 0; axis < 3; axis++) {
        x[axis] = held_x[axis] - share * (held_z[axis] + z[axis]);
    }
    /* Gram and Schmidt, twice: after a half turn the first pass leaves what it takes away. */
    for (int pass = 0; pass < 2; pass++) {
        const double along = vec3_dot(x, z);
        for (int axis = 0; axis < 3; axis++) {
            x[axis] -= along * z[axis];
        }
        const double length = sqrt(vec3_dot(x, x));
        for (int axis = 0; axis < 3; axis++) {
            x[axis] /= length;
        }
    }
    vec3_cross(z, x, y);
    mat4_from_rows(x, y, z, out);
}

csm_status csm_place_light(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err) {
    const int basis = desc->settings->effects[CSM_EFFECT_LIGHT_BASIS];
    const csm_hold *held = desc->held;
    csm_hold *hold = &out->hold;
    double z[3];
    const csm_status status = unit_direction(desc->to_light, z, err);
    if (status != CSM_OK) {
        return status;
    }
    csm_sun_step(desc->settings->sun_step_deg, z);
    out->stretch = 1.0;
    hold->light_basis = CSM_LIGHT_BASIS_ORTHONORMAL;
    if (basis == CSM_LIGHT_BASIS_WORLD) {
        hold->stretch_step = stretch_step(z, held);
    }
    if (hold->stretch_step != INT_MIN) {
        hold->light_basis = CSM_LIGHT_BASIS_WORLD;
        out->stretch = exp2((double)hold->stretch_step / STEPS_PER_OCTAVE);
        skewed(z, hold->light_from_world);
    } else if (basis == CSM_LIGHT_BASIS_TRANSPORTED && held &&
               held->light_basis == CSM_LIGHT_BASIS_ORTHONORMAL) {
        transport(held->light_from_world, z, hold->light_from_world);
    } else {
        orthonormal(z, hold->light_from_world);
    }
    for (int i = 0; i < out->count; i++) {
        memcpy(out->light_from_world[i], hold->light_from_world, sizeof out->light_from_world[i]);
    }
    return CSM_OK;
}

void csm_light_normals(const csm_cascades *cascades, int cascade, double out[3][3]) {
    const double *m = cascades->light_from_world[cascade];
    double rows[3][3];
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            rows[row][column] = m[4 * column + row];
        }
    }
    memcpy(out, rows, sizeof rows);
    if (cascades->stretch == 1.0) {
        return;
    }
    for (int row = 0; row < 3; row++) {
        vec3_cross(rows[(row + 1) % 3], rows[(row + 2) % 3], out[row]);
        const double volume = vec3_dot(out[row], rows[row]);
        for (int axis = 0; axis < 3; axis++) {
            out[row][axis] /= volume;
        }
    }
}
