/* snap.c: texel snapping, the one place where positions are rounded.
 *
 * In: a light window before padding, map size, padding. Out: the lower corner of the window, its
 * texel size, and the corner as integers in units of the texel. In light space, fixed to the world,
 * equal texel sizes and integer corners mean that a moving camera moves the texel grid onto itself.
 */
#include "placement.h"

#include <limits.h>
#include <math.h>

/* Sizes of a window in motion are 2^(k / 8) m: at most 9 % too large, and up to two steps more
 * while a held size is kept. */
#define STEPS_PER_OCTAVE 8
#define HELD_STEPS 2

/* The next size up, or the held one while it is at most HELD_STEPS too large. */
static double quantised(double half, int held, int *out_step) {
    int step = (int)ceil(STEPS_PER_OCTAVE * log2(half));
    while (exp2((double)step / STEPS_PER_OCTAVE) < half) {
        step++;
    }
    if (held >= step && held <= step + HELD_STEPS) {
        step = held;
    }
    *out_step = step;
    return exp2((double)step / STEPS_PER_OCTAVE);
}

double csm_settle_half(const csm_cascades_desc *desc, int i, int axis, double half,
                       csm_cascades *out) {
    if (desc->settings->effects[CSM_EFFECT_SNAP] != CSM_SNAP_EXACT) {
        return half;
    }
    const int held = desc->held ? desc->held->window_step[i][axis] : INT_MIN;
    return quantised(half, held, &out->hold.window_step[i][axis]);
}

csm_status csm_snap_window(const csm_window *window, int map_size, int padding_texels, int snap,
                           double out_corner[2], double out_texel_size[2], int64_t out_lattice[2],
                           csm_error *err) {
    /* Rounding displaces a window by up to half a texel: one texel of each side pays for it. */
    const int spent = (snap == CSM_SNAP_EXACT ? 1 : 0) + 2 * padding_texels;
    const int used = map_size - spent;
    if (padding_texels < 0 || used < 1) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "map_size must be > %d for a kernel radius of %d texels with snap %s "
                        "(got %d)",
                        spent, padding_texels, snap == CSM_SNAP_EXACT ? "exact" : "none", map_size);
    }
    for (int axis = 0; axis < 2; axis++) {
        const double centre = window->centre[axis];
        const double half_extent = window->half_extent[axis];
        if (!isfinite(centre) || !isfinite(half_extent) || !(half_extent > 0.0)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "a light window must be finite and have an extent > 0 (got centre %g, "
                            "half extent %g)",
                            centre, half_extent);
        }
        const double texel = 2.0 * half_extent / used;
        out_texel_size[axis] = texel;
        out_lattice[axis] = 0;
        if (snap != CSM_SNAP_EXACT) {
            out_corner[axis] = centre - 0.5 * map_size * texel;
            continue;
        }
        /* The corner is rounded, not the centre: then odd map sizes lie on the lattice too. */
        const double lattice = round(centre / texel - 0.5 * map_size);
        if (!(fabs(lattice) <= 0x1p53)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "a light window at %g m with texels of %g m is more than 2^53 texels "
                            "from the world origin",
                            centre, texel);
        }
        out_lattice[axis] = (int64_t)lattice;
        out_corner[axis] = lattice * texel;
    }
    return CSM_OK;
}
