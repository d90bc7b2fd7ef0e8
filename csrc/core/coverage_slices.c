/* coverage_slices.c: slices of the view as bodies, under the windows of any cascades.
 *
 * In: a view and windows. Out: of one slice what its corners say, how much of it each window holds,
 * what none holds, the casters over it, and the texels it uses. Slices and windows are convex, so
 * corners decide and what cuts leave over is exact (docs/numerics.md 23).
 */
#include <stdlib.h>

#include "coverage.h"
#include "linalg.h"
#include "tetrahedra.h"

/* Cuts of one slice by the windows, after which what is left is judged by the centres of pieces. */
#define CUTS_MAX 400000

#define PLANES_MAX (6 + WINDOW_PLANES)

typedef struct body {
    view *v;
    int slice;
    tetrahedron pieces[6]; /* of the frustum, before the bounds */
    int bound_count;
    double bounds[6][4]; /* planes of the scene's bounds */
    double volume, gap_volume;
    int cuts;
} body;

static void judge_piece(void *user, const tetrahedron *piece) {
    body *b = user;
    b->volume += tetrahedron_volume(piece);
    for (int i = 0; i < 4; i++) {
        coverage_judge_point(b->v, b->slice, piece->corners[i]);
    }
}

static void add_volume(void *user, const tetrahedron *piece) {
    *(double *)user += tetrahedron_volume(piece);
}

/* Visits what the bounds and some planes leave of six pieces. */
static void visit_body(const body *b, const tetrahedron pieces[6], const double (*planes)[4],
                       int plane_count, tetrahedron_visit visit, void *user) {
    double all[PLANES_MAX][4];
    memcpy(all, b->bounds, (size_t)b->bound_count * sizeof all[0]);
    if (plane_count > 0) {
        memcpy(all + b->bound_count, planes, (size_t)plane_count * sizeof all[0]);
    }
    for (int i = 0; i < 6; i++) {
        tetrahedron_clip(&pieces[i], (const double(*)[4])all, b->bound_count + plane_count, visit,
                         user);
    }
}

/* ------------------------------------------------------------------------------------------------
 * Casters
 */

typedef struct caster_search {
    const light_window *window;
    csm_coverage_worst *worst;
    double leave[4]; /* distance from a point to the side where its column leaves the bounds */
} caster_search;

static void judge_casters(void *user, const tetrahedron *piece) {
    const caster_search *search = user;
    const light_window *window = search->window;
    for (int i = 0; i < 4; i++) {
        const double *p = piece->corners[i];
        const double up = vec3_dot(search->leave, p) + search->leave[3];
        double highest[3], clip[4];
        for (int axis = 0; axis < 3; axis++) {
            highest[axis] = p[axis] + up * window->to_light[axis];
        }
        light_window_clip(window, highest, clip);
        const double amount = -clip[WINDOW_Z] / window->depth_slope;
        if (amount > search->worst->amount) {
            search->worst->amount = amount;
            memcpy(search->worst->point, highest, sizeof highest);
        }
    }
}

/* The highest caster that the bounds allow over a slice: a column leaves them through the nearest
 * of up to three sides. Where one side is the nearest, the distance to it is linear, so the pieces
 * of the slice under each side have their extremes at corners. */
static void find_casters(body *b) {
    const light_window *window = &b->v->windows[b->slice];
    double exits[6][4];
    int exit_count = 0;
    for (int side = 0; side < b->bound_count; side++) {
        const double closing = -vec3_dot(b->bounds[side], window->to_light);
        if (closing > 1e-12) {
            for (int i = 0; i < 4; i++) {
                exits[exit_count][i] = b->bounds[side][i] / closing;
            }
            exit_count++;
        }
    }
    for (int nearest = 0; nearest < exit_count; nearest++) {
        caster_search search = {.window = window, .worst = &b->v->out[b->slice].caster};
        double planes[6][4];
        int count = 0;
        memcpy(search.leave, exits[nearest], sizeof search.leave);
        for (int other = 0; other < exit_count; other++) {
            if (other != nearest) {
                for (int i = 0; i < 4; i++) {
                    planes[count][i] = exits[other][i] - exits[nearest][i];
                }
                count++;
            }
        }
        visit_body(b, b->pieces, (const double(*)[4])planes, count, judge_casters, &search);
    }
}

/* ------------------------------------------------------------------------------------------------
 * Gaps: what is left of a slice after all windows
 */

static void keep_gap(body *b, const tetrahedron *piece) {
    const double volume = tetrahedron_volume(piece);
    b->gap_volume += volume;
    for (int i = 0; i < 4; i++) {
        coverage_widen_gap(b->v, b->slice, piece->corners[i]);
    }
    double centre[3];
    tetrahedron_centre(piece, centre);
    coverage_add_gap(b->v, b->slice, centre, volume);
}

/* What no map holds lies outside its own map's sides, or inside them and outside its depth range.
 */
static void judge_lost(body *b, const tetrahedron *piece, int side) {
    if (side == WINDOW_SIDES) {
        for (int i = 0; i < 4; i++) {
            coverage_judge_depth(b->v, b->slice, piece->corners[i]);
        }
        return;
    }
    tetrahedron_cut cut;
    tetrahedron_split(piece, b->v->planes[b->slice][side], &cut);
    for (int i = 0; i < cut.inside_count; i++) {
        judge_lost(b, &cut.inside[i], side + 1);
    }
    for (int i = 0; i < cut.outside_count; i++) {
        keep_gap(b, &cut.outside[i]);
    }
}

/* Takes away from a piece what the windows from the step-th on hold, the slice's own first, each
 * from its plane-th plane on. */
static void subtract_windows(body *b, const tetrahedron *piece, int step, int plane) {
    const int count = b->v->desc->count;
    if (!(tetrahedron_volume(piece) > 1e-20 * b->volume)) {
        return; /* flat; a corner cut off by a hundredth of a texel is still above this */
    }
    if (step == count) {
        judge_lost(b, piece, 0);
        return;
    }
    if (plane == WINDOW_PLANES) {
        return;
    }
    const double *cutting = b->v->planes[(b->slice + step) % count][plane];
    tetrahedron_cut cut = {0};
    if (++b->cuts > CUTS_MAX) {
        double centre[3];
        tetrahedron_centre(piece, centre);
        const bool inside = vec3_dot(cutting, centre) + cutting[3] >= 0.0;
        *(inside ? &cut.inside_count : &cut.outside_count) = 1;
        *(inside ? cut.inside : cut.outside) = *piece;
    } else {
        tetrahedron_split(piece, cutting, &cut);
    }
    for (int i = 0; i < cut.inside_count; i++) {
        subtract_windows(b, &cut.inside[i], step, plane + 1);
    }
    for (int i = 0; i < cut.outside_count; i++) {
        subtract_windows(b, &cut.outside[i], step + 1, 0);
    }
}

static void find_gaps(void *user, const tetrahedron *piece) {
    subtract_windows(user, piece, 0, 0);
}

/* ------------------------------------------------------------------------------------------------
 * Texels that are used
 */

typedef struct texel_rows {
    const light_window *window;
    double *low, *high; /* per row of texels: what the body spans, empty where low > high */
} texel_rows;

/* The rows that a line between two places on the map crosses, and where. The part of a convex body
 * in a row of texels is convex: it meets every texel between its ends. */
static void span_line(texel_rows *rows, const double a[2], const double b[2]) {
    const double bottom = fmin(a[1], b[1]), top = fmax(a[1], b[1]);
    const double size = rows->window->size;
    const int first = (int)fmax(floor(bottom), 0.0), last = (int)fmin(floor(top), size - 1.0);
    const double slope = top > bottom ? (b[0] - a[0]) / (b[1] - a[1]) : 0.0;
    for (int row = first; row <= last; row++) {
        double ends[2] = {a[0], b[0]};
        if (top > bottom) {
            ends[0] = a[0] + slope * (fmax(row, bottom) - a[1]);
            ends[1] = a[0] + slope * (fmin(row + 1.0, top) - a[1]);
        }
        rows->low[row] = fmin(rows->low[row], fmin(ends[0], ends[1]));
        rows->high[row] = fmax(rows->high[row], fmax(ends[0], ends[1]));
    }
}

static void span_piece(void *user, const tetrahedron *piece) {
    texel_rows *rows = user;
    double texels[4][2];
    for (int i = 0; i < 4; i++) {
        if (!light_window_texel(rows->window, piece->corners[i], texels[i])) {
            return; /* on the window's edge, where its sides meet at w = 0 */
        }
    }
    for (int i = 0; i < 4; i++) {
        for (int j = i + 1; j < 4; j++) {
            span_line(rows, texels[i], texels[j]);
        }
    }
}

static double count_texels(const texel_rows *rows) {
    const int size = (int)rows->window->size;
    double texels = 0.0;
    for (int row = 0; row < size; row++) {
        const double low = fmax(floor(rows->low[row]), 0.0);
        const double high = fmin(ceil(rows->high[row]), size);
        texels += fmax(high - low, 0.0);
    }
    return texels / ((double)size * size);
}

static csm_status measure_utilisation(const body *b, const tetrahedron served[6], csm_error *err) {
    const light_window *window = &b->v->windows[b->slice];
    const size_t size = (size_t)window->size;
    double *ends = malloc(2 * size * sizeof *ends);
    if (!ends) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu rows of texels", size);
    }
    texel_rows rows = {window, ends, ends + size};
    for (size_t row = 0; row < size; row++) {
        rows.low[row] = INFINITY;
        rows.high[row] = -INFINITY;
    }
    double planes[WINDOW_PLANES][4];
    light_window_planes(window, 0.0, 0.0, planes);
    visit_body(b, served, (const double(*)[4])planes, WINDOW_SIDES, span_piece, &rows);
    b->v->out[b->slice].utilisation = count_texels(&rows);
    free(ends);
    return CSM_OK;
}

/* ------------------------------------------------------------------------------------------------
 * Slices
 */

/* The part of the view between two depths that the camera sees, relative to the eye. */
static bool cut_slice(const view *v, double near_depth, double far_depth, tetrahedron out[6]) {
    csm_camera camera = v->desc->camera;
    near_depth = fmax(near_depth, camera.near_depth);
    far_depth = fmin(far_depth, camera.far_depth);
    if (!(far_depth > near_depth)) {
        return false;
    }
    double corners[CSM_CORNER_COUNT][3];
    memset(camera.eye, 0, sizeof camera.eye);
    csm_frustum_corners(&camera, near_depth, far_depth, corners);
    tetrahedra_of_slice((const double(*)[3])corners, out);
    return true;
}

/* Planes of the scene's bounds; a flat scene gets a thickness far below any texel, so that its
 * shares of volume are shares of area. */
static void cut_bounds(body *b) {
    const double *bounds = b->v->desc->scene_bounds, *eye = b->v->desc->camera.eye;
    if (!bounds) {
        return;
    }
    double largest = 0.0;
    for (int i = 0; i < 6; i++) {
        largest = fmax(largest, fabs(bounds[i]));
    }
    const double margin = 1e-9 * box_largest_extent(bounds) + 0x1p-44 * largest;
    for (int side = 0; side < 6; side++) {
        const int axis = side / 2;
        const double sign = side % 2 == 0 ? 1.0 : -1.0;
        b->bounds[side][axis] = sign;
        b->bounds[side][3] = sign * (eye[axis] - bounds[side % 2 == 0 ? axis : axis + 3]) + margin;
    }
    b->bound_count = 6;
}

csm_status coverage_measure_slice(view *v, int slice, csm_error *err) {
    const csm_coverage_desc *desc = v->desc;
    csm_coverage *out = &v->out[slice];
    body b = {.v = v, .slice = slice};
    cut_bounds(&b);
    if (!cut_slice(v, desc->splits[slice], desc->splits[slice + 1], b.pieces)) {
        return CSM_OK;
    }
    visit_body(&b, b.pieces, NULL, 0, judge_piece, &b);
    if (!(b.volume > 0.0)) {
        return CSM_OK;
    }
    for (int other = 0; other < desc->count; other++) {
        double volume = 0.0;
        visit_body(&b, b.pieces, (const double(*)[4])v->planes[other], WINDOW_PLANES, add_volume,
                   &volume);
        out->overlap[other] = fmin(volume / b.volume, 1.0);
    }
    if (desc->scene_bounds) {
        find_casters(&b);
    }
    /* Sound cascades end here: a slice inside its own window leaves nothing to search. */
    const bool held =
        out->overflow.amount <= out->tolerance_texels && out->overlap[slice] >= 1.0 - 1e-9;
    if (desc->first_map && !held) {
        visit_body(&b, b.pieces, NULL, 0, find_gaps, &b);
        out->gap_share = b.gap_volume / b.volume;
    }
    tetrahedron served[6];
    const double last = desc->splits[desc->first_map ? desc->count : slice + 1];
    cut_slice(v, desc->splits[slice], last, served);
    return measure_utilisation(&b, served, err);
}
