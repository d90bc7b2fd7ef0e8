/* light_basis.c: the axes of light space for a direction to the light.
 *
 * In: to_light, world, any length. Out: light_from_world, a rotation about the world origin whose
 * third row is to_light. Branch-free form: Duff, Burgess, Christensen, Hery, Kensler, Liani,
 * Villemin 2017, "Building an orthonormal basis, revisited". A look-at with an up vector would lose
 * all digits for a sun near the zenith.
 */
#include "placement.h"

#include "linalg.h"

csm_status csm_light_basis_orthonormal(const double to_light[3], double out[16], csm_error *err) {
    /* Divided by the largest component first: lengths from denormal to huge keep their digits. */
    const double largest = fmax(fabs(to_light[0]), fmax(fabs(to_light[1]), fabs(to_light[2])));
    if (!vec3_finite(to_light) || !(largest > 0.0)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "to_light must be finite and not zero (got %g, %g, %g)", to_light[0],
                        to_light[1], to_light[2]);
    }
    double z[3] = {to_light[0] / largest, to_light[1] / largest, to_light[2] / largest};
    const double length = sqrt(vec3_dot(z, z));
    for (int axis = 0; axis < 3; axis++) {
        z[axis] /= length;
    }

    const double s = copysign(1.0, z[2]);
    const double a = -1.0 / (s + z[2]);
    const double b = z[0] * z[1] * a;
    const double x[3] = {1.0 + s * z[0] * z[0] * a, s * b, -s * z[0]};
    const double y[3] = {b, s + z[1] * z[1] * a, -z[1]};
    mat4_from_rows(x, y, z, out);
    return CSM_OK;
}

csm_status csm_place_light(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err) {
    double light_from_world[16];
    const csm_status status = csm_light_basis_orthonormal(desc->to_light, light_from_world, err);
    for (int i = 0; status == CSM_OK && i < out->count; i++) {
        memcpy(out->light_from_world[i], light_from_world, sizeof light_from_world);
    }
    return status;
}
