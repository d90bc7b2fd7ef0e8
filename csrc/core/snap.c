/* snap.c: texel snapping, the one place where positions are rounded.
 *
 * In: a light window before padding, map size, padding. Out: the lower corner of the window, its
 * texel size, and the corner as integers in units of the texel. In light space, fixed to the world,
 * equal texel sizes and integer corners mean that a moving camera moves the texel grid onto itself.
 * Windows whose size depends on the camera get one of few sizes first (docs/numerics.md 7 and 19;
 * Zhang, Zaprjagaev, Bentham 2009, "Practical cascaded shadow maps", listing 4.1.2).
 */
#include "placement.h"

#include <limits.h>

#include "linalg.h"

/* Geometric levels are spread over this many octaves below the base; smaller windows go on in the
 * same steps. */
#define LEVEL_OCTAVES 8.0

/* Texels of a side that hold no content: rounding displaces a window by up to half a texel, one
 * texel of each side pays for it. */
static int spent_texels(int padding_texels, int snap) {
    return (snap == CSM_SNAP_NONE ? 0 : 1) + 2 * padding_texels;
}

double csm_snap_level(double ratio, int spacing, int count, int hysteresis, int held,
                      int *out_level) {
    const bool linear = spacing == CSM_LEVELS_LINEAR;
    const double per_octave = count / LEVEL_OCTAVES;
    double level = linear ? ceil(count * ratio) : ceil(per_octave * log2(ratio));
    if (!(ratio > 0.0) || !(fabs(level) < INT_MAX - 1.0)) {
        return NAN;
    }
    /* one more where the logarithm or the product was rounded down */
    while ((linear ? level / count : exp2(level / per_octave)) < ratio) {
        level += 1.0;
    }
    if (held > level && held <= level + hysteresis) {
        level = held;
    }
    *out_level = (int)level;
    return linear ? level / count : exp2(level / per_octave);
}

/* Side [m] of the window that sizes are parts of. It must not depend on where the camera looks, or
 * the levels would move with it: the scene as the light sees it, or without one what holds every
 * view of the camera. */
static double base_side(const csm_cascades_desc *desc, const double light_from_world[16],
                        double stretch) {
    const double *bounds = desc->scene_bounds;
    if (!bounds) {
        return stretch *
               csm_fit_diameter(&desc->camera, desc->camera.near_depth, desc->camera.far_depth);
    }
    double sides[2] = {0.0, 0.0};
    for (int axis = 0; axis < 3; axis++) {
        for (int row = 0; row < 2; row++) {
            sides[row] +=
                fabs(light_from_world[4 * axis + row]) * (bounds[axis + 3] - bounds[axis]);
        }
    }
    return fmax(sides[0], sides[1]);
}

csm_status csm_snap_sizes(const csm_cascades_desc *desc, csm_cascades *out, int i, int padding,
                          csm_window *window, csm_error *err) {
    const csm_settings *settings = desc->settings;
    const int *effects = settings->effects;
    if (effects[CSM_EFFECT_SNAP] != CSM_SNAP_APPROXIMATE) {
        return CSM_OK;
    }
    const int map_size = settings->map_size[i];
    const double used = map_size - spent_texels(padding, CSM_SNAP_APPROXIMATE);
    const double base = base_side(desc, out->light_from_world[i], out->stretch);
    for (int axis = 0; axis < 2; axis++) {
        /* content of a window as large as the base */
        const double largest = 0.5 * base * used / map_size;
        const int held = desc->held ? desc->held->level[i][axis] : INT_MIN;
        const double ratio =
            csm_snap_level(window->half_extent[axis] / largest, effects[CSM_EFFECT_LEVEL_SPACING],
                           effects[CSM_EFFECT_LEVEL_COUNT], effects[CSM_EFFECT_LEVEL_HYSTERESIS],
                           held, &out->hold.level[i][axis]);
        if (used >= 1.0 && !isfinite(ratio)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "snap approximate has no level for a window of %g m in a scene of "
                            "%g m, seen from the light",
                            2.0 * window->half_extent[axis], base);
        }
        window->half_extent[axis] = largest * ratio;
    }
    return CSM_OK;
}

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
    const int spent = spent_texels(padding_texels, snap);
    const int used = map_size - spent;
    if (padding_texels < 0 || used < 1) {
        static const char *const names[] = {"exact", "none", "approximate"};
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "map_size must be > %d for a kernel radius of %d texels with snap %s "
                        "(got %d)",
                        spent, padding_texels, names[snap], map_size);
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
        if (snap == CSM_SNAP_NONE) {
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
