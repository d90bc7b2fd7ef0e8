/* coarse_outline.c: the outermost points of coarse pictures, in slices of depth.
 *
 * In: pictures, ends of planes, two axes across the light. Out: at most 192 points. Their pixels
 * are gone through twice: for the range of depths, and for the points. Hardly a pixel is outermost:
 * some of them say how far out others must lie; blocks whose boxes lie nearer are left out, and of
 * the others pixels, by single precision and what it may be wrong by.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coarse.h"
#include "linalg.h"

#define DIRECTIONS CSM_OUTLINE_DIRECTIONS
#define SLICES CSM_OUTLINE_SLICES
#define TOGETHER 64 /* columns that are gone through at once */
#define BLOCK 8     /* columns, and rows, of a block */
#define EVERY 4     /* rows and columns to the next pixel that is looked at first */
/* of distances, that those in single precision may be wrong by, and those in double precision */
#define SINGLE 2e-6
#define DOUBLE 1e-14
#define CLEARLY 1e-9 /* of a point's distances, that those of points before it are not wrong by */

typedef struct outer_point {
    size_t number; /* in the order in which points are met */
    double point[3];
} outer_point;

typedef struct outline {
    const double (*axes)[3];
    double along[2][DIRECTIONS];
    double borders[SLICES];           /* between the slices [m], and INFINITY */
    double least[SLICES][DIRECTIONS]; /* the outermost reach no less; -INFINITY: unknown */
    double reach[SLICES][DIRECTIONS]; /* -INFINITY where there is none yet */
    outer_point outermost[SLICES][DIRECTIONS];
} outline;

/* Depths of count pixels of a row, NAN where they do not face the sun: no comparison holds. */
static void facing_depths(const csm_coarse_picture *picture, size_t first, int count,
                          float out[TOGETHER]) {
    for (int i = 0; i < count; i++) {
        const float depth = picture->view_depth[first + (size_t)i];
        out[i] = picture->facing[first + (size_t)i] ? depth : NAN;
    }
}

/* Lanes hold what was least and greatest. */
static void widen(const float *values, int count, float *restrict low, float *restrict high) {
    for (int i = 0; i < count; i++) {
        low[i] = values[i] < low[i] ? values[i] : low[i];
        high[i] = values[i] > high[i] ? values[i] : high[i];
    }
}

/* The range of all lanes; low > high of none. */
static void range_of(const float *low, const float *high, int count, double out[2]) {
    float least = INFINITY, most = -INFINITY;
    for (int i = 0; i < count; i++) {
        least = low[i] < least ? low[i] : least;
        most = high[i] > most ? high[i] : most;
    }
    out[0] = least;
    out[1] = most;
}

static void empty_lanes(float *low, float *high, int count) {
    for (int i = 0; i < count; i++) {
        low[i] = INFINITY;
        high[i] = -INFINITY;
    }
}

/* Least and greatest depth; low > high of none. */
static void depth_range(const csm_coarse_picture *pictures, int picture_count,
                        const csm_plane_ends *ends, double range[2]) {
    float depths[TOGETHER], low[TOGETHER], high[TOGETHER];
    empty_lanes(low, high, TOGETHER);
    for (int k = 0; k < picture_count; k++) {
        const size_t pixels =
            (size_t)pictures[k].camera->width * (size_t)pictures[k].camera->height;
        for (size_t i = 0; i < pixels; i += TOGETHER) {
            const int count = pixels - i < TOGETHER ? (int)(pixels - i) : TOGETHER;
            facing_depths(&pictures[k], i, count, depths);
            widen(depths, count, low, high);
        }
    }
    range_of(low, high, TOGETHER, range);
    for (size_t i = 0; ends && i < ends->starts[CSM_PLANE_WAYS]; i++) {
        const double depth = ends->ends[i].depth; /* all before it lie between it and a pixel */
        range[0] = depth < range[0] ? depth : range[0];
        range[1] = depth > range[1] ? depth : range[1];
    }
}

static void outline_begin(outline *o, const double axes[2][3], const double range[2]) {
    o->axes = axes;
    const double low = fmax(range[0], 1e-9), high = fmax(range[1], 2e-9);
    for (int k = 1; k < SLICES; k++) {
        o->borders[k - 1] = low * pow(high / low, (double)k / SLICES);
    }
    o->borders[SLICES - 1] = INFINITY;
    for (int k = 0; k < DIRECTIONS; k++) {
        const double angle = k * (2.0 * 3.14159265358979323846 / DIRECTIONS);
        o->along[0][k] = cos(angle);
        o->along[1][k] = sin(angle);
        for (int slice = 0; slice < SLICES; slice++) {
            o->least[slice][k] = o->reach[slice][k] = -INFINITY;
        }
    }
}

static int slice_of(const outline *o, double depth) {
    int slice = 0;
    for (int k = 0; k < SLICES - 1; k++) {
        slice += o->borders[k] < depth;
    }
    return slice;
}

/* The greatest. By halves, which compilers pack. */
static inline double most_of(double values[DIRECTIONS]) {
    for (int k = 0; k < DIRECTIONS / 2; k++) {
        const double other = values[k + DIRECTIONS / 2];
        values[k] = values[k] > other ? values[k] : other;
    }
    for (int k = 0; k < DIRECTIONS / 4; k++) {
        const double other = values[k + DIRECTIONS / 4];
        values[k] = values[k] > other ? values[k] : other;
    }
    double most = values[0];
    for (int k = 1; k < DIRECTIONS / 4; k++) {
        most = values[k] > most ? values[k] : most;
    }
    return most;
}

static bool in_slice(const outline *o, int slice, double depth) {
    return (slice == 0 || o->borders[slice - 1] < depth) && !(o->borders[slice] < depth);
}

/* How far out a point lies, and whether, a margin farther out, it may be outermost anywhere in its
 * slice. Hardly a point is, so all directions are asked at once. */
static inline bool reaches_out(const outline *o, const double point[3], int slice, double margin,
                               double here[DIRECTIONS]) {
    const double u = vec3_dot(point, o->axes[0]), v = vec3_dot(point, o->axes[1]);
    const double *least = o->least[slice];
    double beyond[DIRECTIONS];
    for (int k = 0; k < DIRECTIONS; k++) {
        here[k] = u * o->along[0][k] + v * o->along[1][k];
        beyond[k] = here[k] - least[k];
    }
    return most_of(beyond) + margin >= 0.0; /* a reach of -INFINITY is beaten by all */
}

/* Of points that lie equally far out the first counts, in whichever order they come. */
static void outline_add(outline *o, const double point[3], double depth, size_t number) {
    const int slice = slice_of(o, depth);
    double here[DIRECTIONS], *reach = o->reach[slice], *least = o->least[slice];
    if (!reaches_out(o, point, slice, 0.0, here)) {
        return;
    }
    for (int k = 0; k < DIRECTIONS; k++) {
        outer_point *outer = &o->outermost[slice][k];
        if (here[k] > reach[k] || (here[k] == reach[k] && number < outer->number)) {
            reach[k] = here[k];
            least[k] = here[k] > least[k] ? here[k] : least[k];
            outer->number = number;
            memcpy(outer->point, point, 3 * sizeof *point);
        }
    }
}

static void pixel_point(const csm_coarse_picture *picture, int row, int column, double depth,
                        double out[3]) {
    const csm_camera *camera = picture->camera;
    coarse_point(camera, coarse_column_x(camera, column), coarse_row_y(camera, row), depth, out);
}

/* Some pixels say how far out the outermost lie at least. */
static void look_first(outline *o, const csm_coarse_picture *picture) {
    const int width = picture->camera->width;
    for (int row = 0; row < picture->camera->height; row += EVERY) {
        for (int column = row / EVERY % EVERY; column < width; column += EVERY) {
            const size_t i = (size_t)row * (size_t)width + (size_t)column;
            if (picture->facing[i]) {
                const double depth = picture->view_depth[i];
                const int slice = slice_of(o, depth);
                double point[3], here[DIRECTIONS], *least = o->least[slice];
                pixel_point(picture, row, column, depth, point);
                reaches_out(o, point, slice, 0.0, here);
                for (int k = 0; k < DIRECTIONS; k++) {
                    least[k] = here[k] > least[k] ? here[k] : least[k];
                }
            }
        }
    }
}

/* How u and v of a picture's pixels follow, from the eye on: away * (row + column * step) - depth *
 * back; away is the depth, 1 if orthographic. */
typedef struct block_view {
    const csm_coarse_picture *picture;
    size_t first;                   /* number of its first pixel */
    double eye[2], right[2], up[2]; /* u and v of the eye, and of the camera's axes */
    float step[2], back[2];         /* per column, and per metre of depth */
    double extent, slack;           /* of the picture plane; of distances in double precision */
} block_view;

static block_view view_blocks(const outline *o, const csm_coarse_picture *picture, size_t first) {
    const csm_camera *camera = picture->camera;
    block_view out = {.picture = picture, .first = first, .extent = 1.0};
    const double pixel = 2.0 * camera->half_width / camera->width;
    for (int i = 0; i < 2; i++) {
        out.eye[i] = vec3_dot(camera->eye, o->axes[i]);
        out.right[i] = vec3_dot(camera->right, o->axes[i]);
        out.up[i] = vec3_dot(camera->up, o->axes[i]);
        out.step[i] = (float)(pixel * out.right[i]);
        out.back[i] = (float)vec3_dot(camera->backward, o->axes[i]);
    }
    out.extent += fabs(camera->centre[0]) + camera->half_width;
    out.extent += fabs(camera->centre[1]) + camera->half_height;
    for (int i = 0; i < 3; i++) {
        out.slack += DOUBLE * fabs(camera->eye[i]);
    }
    return out;
}

/* Columns next to each other in the rows of a block. */
typedef struct lanes {
    float at[3][BLOCK][TOGETHER];              /* u, v, depth of every pixel, NAN of none */
    float low[3][TOGETHER], high[3][TOGETHER]; /* of each column */
} lanes;

static void add_row(const block_view *view, int row, int column, int count, int number,
                    lanes *out) {
    const csm_camera *camera = view->picture->camera;
    const size_t first = (size_t)row * (size_t)camera->width + (size_t)column;
    const double x = coarse_column_x(camera, column), y = coarse_row_y(camera, row);
    float *restrict depths = out->at[2][number];
    facing_depths(view->picture, first, count, depths);
    widen(depths, count, out->low[2], out->high[2]);
    for (int axis = 0; axis < 2; axis++) {
        const float start = (float)(x * view->right[axis] + y * view->up[axis]);
        const float step = view->step[axis], back = view->back[axis];
        float *restrict across = out->at[axis][number];
        if (camera->orthographic) {
            for (int i = 0; i < count; i++) {
                across[i] = start + (float)i * step - depths[i] * back;
            }
        } else {
            for (int i = 0; i < count; i++) {
                across[i] = depths[i] * (start + (float)i * step - back);
            }
        }
        widen(across, count, out->low[axis], out->high[axis]);
    }
}

/* Whether anything in a box of u, v and depth, by so much wider, may be outermost. */
static bool box_reaches_out(const outline *o, const double box[3][2], double wrong) {
    const double u = 0.5 * (box[0][0] + box[0][1]), v = 0.5 * (box[1][0] + box[1][1]);
    double wide = 0.5 * (box[0][1] - box[0][0]), high = 0.5 * (box[1][1] - box[1][0]);
    const double more = wrong + DOUBLE * (fabs(u) + fabs(v) + wide + high);
    wide += more;
    high += more;
    const int last = slice_of(o, box[2][1]);
    double here[DIRECTIONS];
    for (int k = 0; k < DIRECTIONS; k++) {
        const double c = o->along[0][k], s = o->along[1][k];
        here[k] = u * c + v * s + wide * fabs(c) + high * fabs(s);
    }
    bool out = false;
    for (int slice = slice_of(o, box[2][0]); slice <= last && !out; slice++) {
        double beyond[DIRECTIONS];
        for (int k = 0; k < DIRECTIONS; k++) {
            beyond[k] = here[k] - o->least[slice][k];
        }
        out = !(most_of(beyond) < 0.0); /* what has no size is looked at */
    }
    return out;
}

/* What u and v in single precision may be wrong by at such depths. */
static double wrong_by(const block_view *view, const double depths[2]) {
    const double depth = fmax(fabs(depths[0]), fabs(depths[1]));
    const bool straight = view->picture->camera->orthographic;
    return SINGLE * (straight ? depth + view->extent : depth * view->extent) + view->slack;
}

/* How far out any pixel of a block may lie, from what the outermost of its slices reach at least;
 * -INFINITY where there is none. */
static void block_beyond(const outline *o, const block_view *view, const lanes *all, int at,
                         int width, const double depths[2], float beyond[BLOCK * BLOCK]) {
    const double wrong = 2.0 * wrong_by(view, depths); /* along u and along v */
    const int first = slice_of(o, depths[0]), last = slice_of(o, depths[1]);
    float u[BLOCK * BLOCK], v[BLOCK * BLOCK];
    for (int i = 0; i < BLOCK * BLOCK; i++) {
        const int column = i % BLOCK < width ? at + i % BLOCK : at;
        u[i] = all->at[0][i / BLOCK][column];
        v[i] = all->at[1][i / BLOCK][column];
        beyond[i] = -INFINITY;
    }
    for (int k = 0; k < DIRECTIONS; k++) {
        double least = o->least[first][k];
        for (int slice = first + 1; slice <= last; slice++) {
            least = o->least[slice][k] < least ? o->least[slice][k] : least;
        }
        const double eye = view->eye[0] * o->along[0][k] + view->eye[1] * o->along[1][k];
        const float c = (float)o->along[0][k], s = (float)o->along[1][k];
        const float from = (float)(least - eye - wrong);
        for (int i = 0; i < BLOCK * BLOCK; i++) {
            const float here = u[i] * c + v[i] * s - from;
            beyond[i] = here > beyond[i] ? here : beyond[i];
        }
    }
}

/* Pixels of a block that may be outermost. */
static void add_block(outline *o, const block_view *view, int row, int rows, int column, int width,
                      const float beyond[BLOCK * BLOCK]) {
    const csm_coarse_picture *picture = view->picture;
    for (int k = 0; k < rows * BLOCK; k++) {
        if (beyond[k] < 0.0F || k % BLOCK >= width) {
            continue;
        }
        const int at = row + k / BLOCK, across = column + k % BLOCK;
        const size_t i = (size_t)at * (size_t)picture->camera->width + (size_t)across;
        if (picture->facing[i]) {
            const double depth = picture->view_depth[i];
            double point[3];
            pixel_point(picture, at, across, depth, point);
            outline_add(o, point, depth, view->first + i);
        }
    }
}

/* Blocks of some columns in the rows from one on. Of a block that may hold what is outermost each
 * pixel is asked, in single precision first. */
static void add_blocks(outline *o, const block_view *view, int row, int rows, int column,
                       int count) {
    lanes all;
    for (int i = 0; i < 3; i++) {
        empty_lanes(all.low[i], all.high[i], count);
    }
    for (int k = 0; k < BLOCK; k++) { /* past the picture its last row once more */
        add_row(view, row + (k < rows ? k : rows - 1), column, count, k, &all);
    }
    for (int at = 0; at < count; at += BLOCK) {
        const int width = count - at < BLOCK ? count - at : BLOCK;
        double box[3][2];
        for (int i = 0; i < 3; i++) {
            range_of(all.low[i] + at, all.high[i] + at, width, box[i]);
            for (int side = 0; i < 2 && side < 2; side++) {
                box[i][side] += view->eye[i];
            }
        }
        if (box[2][0] <= box[2][1] && box_reaches_out(o, box, wrong_by(view, box[2]))) {
            float beyond[BLOCK * BLOCK];
            block_beyond(o, view, &all, at, width, box[2], beyond);
            add_block(o, view, row, rows, column + at, width, beyond);
        }
    }
}

static void outline_add_picture(outline *o, const csm_coarse_picture *picture, size_t first) {
    const int width = picture->camera->width, height = picture->camera->height;
    const block_view view = view_blocks(o, picture, first);
    for (int row = 0; row < height; row += BLOCK) {
        const int rows = row + BLOCK < height ? BLOCK : height - row;
        for (int column = 0; column < width; column += TOGETHER) {
            const int count = width - column < TOGETHER ? width - column : TOGETHER;
            add_blocks(o, &view, row, rows, column, count);
        }
    }
}

/* All that pixels of the full picture see past one end. Their order: of each way all first pixels,
 * then all second ones. */
static void outline_add_reaching(outline *o, const coarse_way *way, const csm_plane_end *end,
                                 size_t first, size_t count) {
    const coarse_place place = coarse_place_of(way, end->place);
    for (int k = end->first; k <= end->reach; k++) {
        const double ahead = coarse_ahead(way, &place, k);
        double point[3];
        coarse_point_past(way, &place, k, end->crossing,
                          coarse_depth_past(way, end->last, end->step, ahead), point);
        outline_add(o, point, depth_of(way->full, point), first + (size_t)(k - 1) * count);
    }
}

/* Past an end points lie in a line, from the coarse pixel, which was met, to the last of them. So
 * where both are of one slice of depth, and the last one lies farther in than rounding may tell,
 * none of them is outermost. */
static bool may_reach_out(const outline *o, const csm_plane_end *end, double from) {
    const int slice = slice_of(o, end->depth);
    double here[DIRECTIONS];
    if (!in_slice(o, slice, from)) {
        return true;
    }
    const double margin =
        CLEARLY * (fabs(end->point[0]) + fabs(end->point[1]) + fabs(end->point[2]));
    return reaches_out(o, end->point, slice, margin, here);
}

static void outline_add_ends(outline *o, const csm_plane_ends *ends, size_t first) {
    for (int number = 0; number < CSM_PLANE_WAYS; number++) {
        const coarse_way way = coarse_way_of(&ends->full, &ends->small, number);
        const size_t start = ends->starts[number], count = ends->starts[number + 1] - start;
        for (size_t i = 0; i < count; i++) {
            const csm_plane_end *end = &ends->ends[start + i];
            const double from = coarse_depth_past(&way, end->last, end->step, 0.0);
            if (may_reach_out(o, end, from)) {
                outline_add_reaching(o, &way, end, first + i, count);
            }
        }
        first += (size_t)way.most * count;
    }
}

static int compare_numbers(const void *left, const void *right) {
    const outer_point *a = left, *b = right;
    return (a->number > b->number) - (a->number < b->number);
}

/* Each point once, in order. */
static size_t outline_end(outline *o, double out[CSM_OUTLINE_MAX][3]) {
    outer_point *all = o->outermost[0];
    size_t held = 0, count = 0;
    for (int slice = 0; slice < SLICES; slice++) {
        for (int k = 0; k < DIRECTIONS; k++) {
            if (o->reach[slice][k] > -INFINITY) {
                all[held++] = o->outermost[slice][k];
            }
        }
    }
    qsort(all, held, sizeof *all, compare_numbers);
    for (size_t i = 0; i < held; i++) {
        if (i == 0 || all[i].number != all[i - 1].number) {
            memcpy(out[count++], all[i].point, sizeof all[i].point);
        }
    }
    return count;
}

size_t csm_coarse_outline(const csm_coarse_picture *pictures, int picture_count,
                          const csm_plane_ends *ends, const double light_axes[2][3],
                          double out[CSM_OUTLINE_MAX][3]) {
    double range[2];
    depth_range(pictures, picture_count, ends, range);
    if (!(range[0] <= range[1])) {
        return 0;
    }
    outline o;
    outline_begin(&o, light_axes, range);
    for (int k = 0; k < picture_count; k++) {
        look_first(&o, &pictures[k]);
    }
    size_t met = 0;
    for (int k = 0; k < picture_count; k++) {
        outline_add_picture(&o, &pictures[k], met);
        met += (size_t)pictures[k].camera->width * (size_t)pictures[k].camera->height;
    }
    if (ends) {
        outline_add_ends(&o, ends, met);
    }
    return outline_end(&o, out);
}
