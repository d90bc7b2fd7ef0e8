/* coarse_outline_blocks.c: the pixels of a picture that may be outermost.
 *
 * In: a picture, the outermost points so far. Out: these, and those of the picture. Blocks whose
 * boxes lie nearer are left out, and of the others pixels, by single precision and what it may be
 * wrong by.
 */
#include <math.h>

#include "coarse_outline.h"

#define BLOCK 8 /* columns, and rows, of a block */
/* of distances, that those in single precision may be wrong by, and those in double precision */
#define SINGLE 2e-6
#define DOUBLE 1e-14

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
            csm_outline_add(o, point, depth, view->first + i);
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

void csm_outline_add_picture(outline *o, const csm_coarse_picture *picture, size_t first) {
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
