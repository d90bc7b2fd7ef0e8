/* arranged.c: what windows of cascades make of a coarse view, whatever the size of their maps.
 *
 * In: points of a view, windows as matrices. Out: which window answers for each shadow edge and
 * each receiver, and how far a map of one texel displaces edges: of each, or summed up.
 * docs/numerics.md 13 has the formulas.
 */
#include <stdlib.h>

#include "csm.h"
#include "linalg.h"
#include "runs.h"

#define BLOCK 64 /* edges whose displacements are summed up at once */

/* Place on a map without a warp. */
static void affine_place(const double uvz[16], const double p[3], double out_uv[2]) {
    for (int row = 0; row < 2; row++) {
        out_uv[row] = uvz[row] * p[0] + uvz[row + 4] * p[1] + uvz[row + 8] * p[2] + uvz[row + 12];
    }
}

/* Place on any map, and the divisor w there. */
static void place_of(const double uvz[16], const double p[3], double out_uv[2], double *out_w) {
    *out_w = uvz[3] * p[0] + uvz[7] * p[1] + uvz[11] * p[2] + uvz[15];
    affine_place(uvz, p, out_uv);
    out_uv[0] /= *out_w;
    out_uv[1] /= *out_w;
}

/* Whether w is 1 everywhere. */
static bool is_affine(const double uvz[16]) {
    return uvz[3] == 0.0 && uvz[7] == 0.0 && uvz[11] == 0.0 && uvz[15] == 1.0;
}

/* The slice of a view depth: what lies on a split belongs before it. */
static int slice_of(const csm_arrangement *windows, double depth) {
    int slice = 0;
    while (slice < windows->count - 1 && windows->splits[slice + 1] < depth) {
        slice++;
    }
    return slice;
}

/* The end of those of ascending depths from begin on that lie in one slice, *out. */
static size_t end_of_slice(const csm_arrangement *windows, const double *depths, size_t begin,
                           size_t end, int *out) {
    *out = slice_of(windows, depths[begin]);
    if (*out == windows->count - 1) {
        return end;
    }
    return first_beyond(depths, begin, end, windows->splits[*out + 1], false);
}

/* The first map that holds a point; what none holds is left to the last. */
static int map_of(const csm_arrangement *windows, const bool *affine, const double p[3]) {
    for (int i = 0; i < windows->count - 1; i++) {
        const double *uvz = windows->uvz_from_world[i];
        double uv[2], w;
        if (affine[i]) {
            affine_place(uvz, p, uv);
        } else {
            place_of(uvz, p, uv, &w);
        }
        if (fabs(uv[0] - 0.5) <= 0.5 && fabs(uv[1] - 0.5) <= 0.5) {
            return i;
        }
    }
    return windows->count - 1;
}

/* Metres along both axes that lead over the whole map along u and along v: [axis][u or v]. Places
 * on the map do not change along the light, so that the axes across it tell all. False where u and
 * v do not spread. */
static bool metres_of(const csm_coarse_view *view, const double uvz[16], const double p[3],
                      double out[2][2]) {
    double uv[2], w, along[2][2]; /* change of u or v along an axis */
    place_of(uvz, p, uv, &w);
    for (int row = 0; row < 2; row++) {
        double gradient[3];
        for (int k = 0; k < 3; k++) {
            gradient[k] = (uvz[4 * k + row] - uv[row] * uvz[4 * k + 3]) / w;
        }
        for (int axis = 0; axis < 2; axis++) {
            along[row][axis] = vec3_dot(gradient, view->axes[axis]);
        }
    }
    const double volume = along[0][0] * along[1][1] - along[0][1] * along[1][0];
    out[0][0] = along[1][1] / volume;
    out[0][1] = -along[0][1] / volume;
    out[1][0] = -along[1][0] / volume;
    out[1][1] = along[0][0] / volume;
    return volume != 0.0;
}

/* Which window answers for points begin to end: those of one kind. */
static void choose_windows(const csm_coarse_view *view, const csm_arrangement *windows,
                           const bool *affine, size_t begin, size_t end, int *out) {
    if (!windows->by_interval) {
        for (size_t k = begin; k < end; k++) {
            *out++ = map_of(windows, affine, view->points + 3 * k);
        }
        return;
    }
    for (size_t k = begin, next; k < end; k = next) {
        int slice;
        next = end_of_slice(windows, view->depths, k, end, &slice);
        for (size_t i = k; i < next; i++) {
            *out++ = slice;
        }
    }
}

/* A way across an edge taken back to a map: its longer and its shorter side there. */
typedef struct sides {
    double most, least;
} sides;

static inline sides sides_of(const double steps[2], double metres[2][2]) {
    const double u = fabs(steps[0] * metres[0][0] + steps[1] * metres[1][0]);
    const double v = fabs(steps[0] * metres[0][1] + steps[1] * metres[1][1]);
    return (sides){.most = u < v ? v : u, .least = u < v ? u : v};
}

/* An edge displaced by a map of one texel: the mean of |a . d| over the square of half a texel
 * either way. */
static inline double displacement(sides of) {
    const double most = of.most > 1e-12 ? of.most : 1e-12;
    return of.most / 4.0 + of.least * of.least / (12.0 * most);
}

/* Edges in a row that one window answers for: [begin, end), counted from the first edge, and the
 * metres along the axes over its map. Of a warped map these are an edge's own. */
typedef struct edge_run {
    size_t begin, end;
    int window;
    double metres[2][2];
} edge_run;

typedef struct edge_reader {
    const csm_coarse_view *view;
    const csm_arrangement *windows;
    const int *taken; /* of each edge */
    bool affine[CSM_MAX_CASCADES], spread[CSM_MAX_CASCADES];
    double metres[CSM_MAX_CASCADES][2][2]; /* of affine maps */
} edge_reader;

static void read_windows(const csm_coarse_view *view, const csm_arrangement *windows,
                         edge_reader *out) {
    out->view = view;
    out->windows = windows;
    for (int i = 0; i < windows->count; i++) {
        const double *uvz = windows->uvz_from_world[i];
        out->affine[i] = is_affine(uvz);
        out->spread[i] = out->affine[i] && metres_of(view, uvz, (double[3]){0.0}, out->metres[i]);
    }
}

static size_t edge_count(const csm_coarse_view *view) {
    return view->ends[CSM_SEEN_EDGES] - view->ends[CSM_SEEN_RECEIVERS];
}

/* The run that begins at an edge. */
static csm_status next_run(const edge_reader *edges, size_t begin, edge_run *out, csm_error *err) {
    const int window = edges->taken[begin];
    bool spread = edges->spread[window];
    *out = (edge_run){.begin = begin, .end = begin + 1, .window = window};
    if (edges->affine[window]) {
        memcpy(out->metres, edges->metres[window], sizeof out->metres);
        const size_t count = edge_count(edges->view);
        while (out->end < count && edges->taken[out->end] == window) {
            out->end++;
        }
    } else {
        const double *point =
            edges->view->points + 3 * (edges->view->ends[CSM_SEEN_RECEIVERS] + begin);
        spread = metres_of(edges->view, edges->windows->uvz_from_world[window], point, out->metres);
    }
    return spread ? CSM_OK
                  : csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                             "uvz_from_world must map the plane across the light to an area (that "
                             "of cascade %d does not)",
                             window);
}

csm_status csm_arrange(const csm_coarse_view *view, const csm_arrangement *windows,
                       csm_arranged *out, csm_error *err) {
    edge_reader edges;
    edge_run run;
    read_windows(view, windows, &edges);
    const size_t receivers = view->ends[CSM_SEEN_RECEIVERS];
    choose_windows(view, windows, edges.affine, 0, receivers, out->receiver_cascade);
    choose_windows(view, windows, edges.affine, receivers, view->ends[CSM_SEEN_EDGES],
                   out->edge_cascade);
    edges.taken = out->edge_cascade;
    for (size_t k = 0; k < receivers; k++) {
        const double gradient = view->gradients[k];
        out->receiver_bias[k] = windows->bias_texels * windows->sides[out->receiver_cascade[k]] *
                                (gradient < windows->steepest ? gradient : windows->steepest);
    }
    csm_status status = CSM_OK;
    for (size_t k = 0; k < edge_count(view) && status == CSM_OK; k = run.end) {
        status = next_run(&edges, k, &run, err);
        for (size_t i = k; i < run.end; i++) {
            const sides of = sides_of(view->steps_across + 2 * i, run.metres);
            out->moved[i] = displacement(of);
            out->reach[i] = sqrt(of.most * of.most + of.least * of.least);
        }
    }
    return status;
}

/* In blocks: the displacements in vectors, which a sum in order would not let be. */
static double sum_of_run(const csm_coarse_view *view, edge_run *run, double most_moved) {
    double sum = 0.0;
    for (size_t i = run->begin; i < run->end; i += BLOCK) {
        double moved[BLOCK];
        const size_t count = run->end - i < BLOCK ? run->end - i : BLOCK;
        for (size_t k = 0; k < count; k++) {
            const double one =
                displacement(sides_of(view->steps_across + 2 * (i + k), run->metres));
            moved[k] = view->lengths[i + k] * (one < most_moved ? one : most_moved);
        }
        for (size_t k = 0; k < count; k++) {
            sum += moved[k];
        }
    }
    return sum;
}

csm_status csm_sum_displaced(const csm_coarse_view *view, const csm_arrangement *windows,
                             double out_displaced[CSM_MAX_CASCADES],
                             bool out_held[CSM_MAX_CASCADES], csm_error *err) {
    edge_reader edges;
    edge_run run;
    csm_status status = CSM_OK;
    memset(out_displaced, 0, CSM_MAX_CASCADES * sizeof *out_displaced);
    memset(out_held, 0, CSM_MAX_CASCADES * sizeof *out_held);
    size_t begin = 0;
    for (int kind = 0; kind < CSM_SEEN_KINDS; kind++) {
        while (begin < view->ends[kind]) {
            int slice;
            begin = end_of_slice(windows, view->depths, begin, view->ends[kind], &slice);
            out_held[slice] = true;
        }
    }
    int *taken = malloc((edge_count(view) + 1) * sizeof *taken);
    if (!taken) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to read edges");
    }
    read_windows(view, windows, &edges);
    choose_windows(view, windows, edges.affine, view->ends[CSM_SEEN_RECEIVERS],
                   view->ends[CSM_SEEN_EDGES], taken);
    edges.taken = taken;
    for (size_t k = 0; k < edge_count(view) && status == CSM_OK; k = run.end) {
        status = next_run(&edges, k, &run, err);
        if (status == CSM_OK) {
            out_displaced[run.window] += sum_of_run(view, &run, windows->most_moved);
        }
    }
    free(taken);
    return status;
}
