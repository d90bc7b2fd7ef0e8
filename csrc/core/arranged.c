/* arranged.c: what windows of cascades make of a coarse view, whatever the size of their maps.
 *
 * In: points of a view, windows as matrices. Out: for each shadow edge how far a map of one texel
 * displaces it, for each receiver its bias, and which window answers for either. docs/numerics.md
 * 13 has the formulas.
 */
#include "linalg.h"

#include "csm.h"

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

/* An edge displaced by a map of one texel: the mean of |a . d| over the square of half a texel
 * either way, and the reach of a disc as wide as the map, an ellipse in the picture. */
static void displace(const double steps[2], double metres[2][2], double *out_moved,
                     double *out_reach) {
    const double u = fabs(steps[0] * metres[0][0] + steps[1] * metres[1][0]);
    const double v = fabs(steps[0] * metres[0][1] + steps[1] * metres[1][1]);
    const double least = u < v ? u : v, most = u < v ? v : u;
    *out_moved = most / 4.0 + least * least / (12.0 * (most > 1e-12 ? most : 1e-12));
    *out_reach = sqrt(u * u + v * v);
}

static csm_status arrange_edges(const csm_coarse_view *view, const csm_arrangement *windows,
                                const bool *affine, csm_arranged *out, csm_error *err) {
    double metres[CSM_MAX_CASCADES][2][2];
    bool spread[CSM_MAX_CASCADES];
    const double *edges = view->points + 3 * view->receiver_count;
    for (int i = 0; i < windows->count; i++) {
        spread[i] =
            !affine[i] || metres_of(view, windows->uvz_from_world[i], (double[3]){0.0}, metres[i]);
    }
    for (size_t k = 0; k < view->edge_count; k++) {
        const int i = out->edge_cascade[k];
        if (!affine[i]) {
            spread[i] = metres_of(view, windows->uvz_from_world[i], edges + 3 * k, metres[i]);
        }
        if (!spread[i]) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "uvz_from_world must map the plane across the light to an area (that "
                            "of cascade %d does not)",
                            i);
        }
        displace(view->steps_across + 2 * k, metres[i], &out->moved[k], &out->reach[k]);
        const double moved = out->moved[k];
        out->displaced[i] +=
            view->lengths[k] * (moved < windows->most_moved ? moved : windows->most_moved);
    }
    return CSM_OK;
}

csm_status csm_arrange(const csm_coarse_view *view, const csm_arrangement *windows,
                       csm_arranged *out, csm_error *err) {
    const csm_camera *camera = &view->camera;
    memset(out->displaced, 0, sizeof out->displaced);
    memset(out->held, 0, sizeof out->held);
    bool affine[CSM_MAX_CASCADES];
    for (int i = 0; i < windows->count; i++) {
        affine[i] = is_affine(windows->uvz_from_world[i]);
    }
    for (size_t k = 0; k < view->point_count; k++) {
        const double *p = view->points + 3 * k;
        const double from_eye[3] = {p[0] - camera->eye[0], p[1] - camera->eye[1],
                                    p[2] - camera->eye[2]};
        const int slice = slice_of(windows, -vec3_dot(camera->backward, from_eye));
        out->held[slice] = true;
        if (k >= view->receiver_count + view->edge_count) {
            continue;
        }
        const int taken = windows->by_interval ? slice : map_of(windows, affine, p);
        if (k >= view->receiver_count) {
            out->edge_cascade[k - view->receiver_count] = taken;
            continue;
        }
        const double gradient = view->gradients[k];
        out->receiver_cascade[k] = taken;
        out->receiver_bias[k] = windows->bias_texels * windows->sides[taken] *
                                (gradient < windows->steepest ? gradient : windows->steepest);
    }
    return arrange_edges(view, windows, affine, out, err);
}
