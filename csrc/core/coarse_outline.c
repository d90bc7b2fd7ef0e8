/* coarse_outline.c: the outermost points of coarse pictures, in slices of depth.
 *
 * In: pictures, ends of planes, two axes across the light. Out: at most 192 points. Hardly a pixel
 * is outermost, so some of them first say how far out others must lie.
 */
#include <math.h>
#include <stdlib.h>

#include "coarse_outline.h"

#define EVERY 4      /* rows and columns to the next pixel that is looked at first */
#define CLEARLY 1e-9 /* of a point's distances, that those of points before it are not wrong by */

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

void csm_outline_add(outline *o, const double point[3], double depth, size_t number) {
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

/* All that pixels of the full picture see past one end. Their order: of each way all first pixels,
 * then all second ones. */
static void outline_add_reaching(outline *o, const coarse_way *way, const csm_plane_end *end,
                                 size_t first, size_t count) {
    const coarse_place place = coarse_place_of(way, end->place);
    for (int k = end->first; k <= end->reach; k++) {
        double point[3];
        coarse_end_point(way, &place, end, k, point);
        csm_outline_add(o, point, depth_of(way->full, point), first + (size_t)(k - 1) * count);
    }
}

static bool in_slice(const outline *o, int slice, double depth) {
    return (slice == 0 || o->borders[slice - 1] < depth) && !(o->borders[slice] < depth);
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
        csm_outline_add_picture(&o, &pictures[k], met);
        met += (size_t)pictures[k].camera->width * (size_t)pictures[k].camera->height;
    }
    if (ends) {
        outline_add_ends(&o, ends, met);
    }
    return outline_end(&o, out);
}
