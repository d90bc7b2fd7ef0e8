/* splits_resolution.c: cuts of equal screen-space resolution, also for maps of unequal sizes.
 *
 * In: camera, fit, map sizes, a part of the view range. Out: splits for which a texel, measured in
 * pixels at the near end of its cascade, is the same everywhere: Andrew Stone's "constant
 * screen-space shadow resolution between cascades". docs/numerics.md 17.
 */
#include "placement.h"

#include <math.h>

/* No cascade is shorter than this part of an equal share. Between maps of very unequal sizes a
 * short range has no equal resolutions: the small map would be coarser than the large one even at
 * no length at all. */
#define LEAST_SHARE (1.0 / 64.0)

typedef struct march {
    const csm_camera *camera;
    int fit;
    double range_near;
    csm_share share;
    double texels[CSM_MAX_CASCADES]; /* of a window's side that hold the slice */
    double half_diagonal;            /* slope of a corner ray, or [m] if orthographic */
} march;

/* Half side of a light window for a slice. Windows that depend on the light or on what is seen are
 * taken at their largest: the slice's diameter. */
static double half_extent(const march *m, double near_depth, double far_depth) {
    if (m->fit == CSM_FIT_SPHERE || m->fit == CSM_FIT_SHIFTED) {
        csm_ball ball;
        csm_fit_sphere(m->camera, near_depth, far_depth, &ball);
        return ball.radius;
    }
    return 0.5 * csm_fit_diameter(m->camera, m->fit == CSM_FIT_SCENE ? m->range_near : near_depth,
                                  far_depth);
}

/* x in [low, high] where an increasing function that is < 0 at low and >= 0 at high comes within a
 * tolerance of 0: regula falsi, the value of an end that stays halved (Dowell and Jarratt 1971, "A
 * modified regula falsi method"). */
static double root(double (*function)(const void *context, double x), const void *context,
                   double low, double high, double tolerance) {
    double below = function(context, low), above = function(context, high), x = high;
    double miss = above;
    for (int i = 0, side = 0; i < 200 && fabs(miss) > tolerance; i++) {
        x = low + (high - low) * (below / (below - above));
        if (!(x > low && x < high)) {
            return high; /* neighbours */
        }
        miss = function(context, x);
        if (miss < 0.0) {
            low = x;
            below = miss;
            above *= side < 0 ? 0.5 : 1.0;
            side = -1;
        } else {
            high = x;
            above = miss;
            below *= side > 0 ? 0.5 : 1.0;
            side = 1;
        }
    }
    return x;
}

/* What a window lacks of its half side if the cascade ended at a depth. */
typedef struct wanted_window {
    const march *march;
    double near_depth, half;
} wanted_window;

static double beyond_half(const void *context, double far_depth) {
    const wanted_window *wanted = context;
    return half_extent(wanted->march, wanted->near_depth, far_depth) - wanted->half;
}

/* Where a cascade that starts at near_depth has a window of this half side. */
static double far_end(const march *m, double near_depth, double half) {
    const wanted_window wanted = {m, near_depth, half};
    if (beyond_half(&wanted, near_depth) >= 0.0) {
        return near_depth;
    }
    /* there the far end alone, or the length alone, is that large */
    const double high = m->camera->orthographic
                            ? (m->fit == CSM_FIT_SCENE ? m->range_near : near_depth) + 2.0 * half
                            : half / m->half_diagonal;
    return root(beyond_half, &wanted, near_depth, high, 0x1p-50 * half);
}

static double shortest_end(const march *m, double near_depth) {
    const csm_share *share = &m->share;
    const double part = LEAST_SHARE / share->count;
    return m->camera->orthographic
               ? near_depth + part * (share->far_depth - share->near_depth)
               : near_depth * exp(part * log(share->far_depth / share->near_depth));
}

/* The splits for a texel of exp(log_texel) pixels, up to a factor that all cascades share. */
static void march_to_far(const march *m, double log_texel, double *out_splits) {
    out_splits[0] = m->share.near_depth;
    for (int i = 0; i < m->share.count; i++) {
        const double start = out_splits[i];
        const double pixel = m->camera->orthographic ? 1.0 : start;
        const double end = far_end(m, start, exp(log_texel) * pixel * m->texels[i]);
        out_splits[i + 1] = fmax(end, shortest_end(m, start));
    }
}

/* How far the last cascade reaches beyond far: as a logarithm, or in lengths of the share. */
static double beyond_far(const void *context, double log_texel) {
    const march *m = context;
    const csm_share *share = &m->share;
    double splits[CSM_MAX_CASCADES + 1];
    march_to_far(m, log_texel, splits);
    const double last = splits[share->count], far_depth = share->far_depth;
    return m->camera->orthographic ? (last - far_depth) / (far_depth - share->near_depth)
                                   : log(last / far_depth);
}

void csm_splits_resolution(const csm_cascades_desc *desc, double range_near, const csm_share *share,
                           double *out_splits) {
    const csm_camera *camera = &desc->camera;
    const csm_settings *settings = desc->settings;
    march m = {.camera = camera,
               .fit = settings->effects[CSM_EFFECT_FIT],
               .range_near = range_near,
               .share = *share,
               .half_diagonal = hypot(camera->half_width, camera->half_height)};
    const int spent = (settings->effects[CSM_EFFECT_SNAP] == CSM_SNAP_NONE ? 0 : 1) +
                      2 * csm_window_padding(settings, 1.0);
    double most_texels = 1.0;
    for (int i = 0; i < share->count; i++) {
        m.texels[i] = fmax(settings->map_size[share->first + i] - spent, 1.0);
        most_texels = fmax(most_texels, m.texels[i]);
    }
    /* Texels as small as the corner rays allow reach nothing; with those of a first cascade that
     * holds the whole share, the last reaches beyond far. */
    const double widest = half_extent(&m, share->near_depth, share->far_depth);
    const double pixel = camera->orthographic ? 1.0 : share->near_depth;
    const double low = log(m.half_diagonal / most_texels);
    const double high = log(widest / (pixel * m.texels[0]));
    const double texel = root(beyond_far, &m, low, high, 1e-13);
    march_to_far(&m, texel, out_splits);
    out_splits[share->count] = share->far_depth;
}
