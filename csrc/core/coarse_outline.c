/* coarse_outline.c: the outermost points of coarse pictures, in slices of depth.
 *
 * In: pictures, more points, two axes across the light. Out: at most 192 points. Their pixels are
 * gone through twice: for the range of depths, and for the points.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coarse.h"
#include "linalg.h"

#define DIRECTIONS CSM_OUTLINE_DIRECTIONS
#define SLICES CSM_OUTLINE_SLICES

typedef struct outer_point {
    size_t number; /* in the order in which points are met */
    double point[3];
} outer_point;

typedef struct outline {
    const double (*axes)[3];
    double along[2][DIRECTIONS];
    double borders[SLICES - 1]; /* between the slices [m] */
    size_t met;
    double reach[SLICES][DIRECTIONS]; /* -INFINITY where there is none yet */
    outer_point outermost[SLICES][DIRECTIONS];
} outline;

static double depth_of(const csm_camera *camera, const double point[3]) {
    double depth = 0.0;
    for (int i = 0; i < 3; i++) {
        depth -= (point[i] - camera->eye[i]) * camera->backward[i];
    }
    return depth;
}

/* Least and greatest depth; low > high of none. */
static void depth_range(const csm_coarse_picture *pictures, int picture_count,
                        const double (*points)[3], size_t point_count, double range[2]) {
    range[0] = INFINITY;
    range[1] = -INFINITY;
    for (int k = 0; k < picture_count; k++) {
        const csm_coarse_picture *picture = &pictures[k];
        const size_t pixels = (size_t)picture->camera->width * (size_t)picture->camera->height;
        for (size_t i = 0; i < pixels; i++) {
            if (picture->facing[i]) {
                const double depth = picture->view_depth[i];
                range[0] = depth < range[0] ? depth : range[0];
                range[1] = depth > range[1] ? depth : range[1];
            }
        }
    }
    for (size_t i = 0; i < point_count; i++) {
        const double depth = depth_of(pictures[0].camera, points[i]);
        range[0] = depth < range[0] ? depth : range[0];
        range[1] = depth > range[1] ? depth : range[1];
    }
}

static void outline_begin(outline *o, const double axes[2][3], const double range[2]) {
    o->axes = axes;
    o->met = 0;
    const double low = fmax(range[0], 1e-9), high = fmax(range[1], 2e-9);
    for (int k = 1; k < SLICES; k++) {
        o->borders[k - 1] = low * pow(high / low, (double)k / SLICES);
    }
    for (int k = 0; k < DIRECTIONS; k++) {
        const double angle = k * (2.0 * 3.14159265358979323846 / DIRECTIONS);
        o->along[0][k] = cos(angle);
        o->along[1][k] = sin(angle);
        for (int slice = 0; slice < SLICES; slice++) {
            o->reach[slice][k] = -INFINITY;
        }
    }
}

static void outline_add(outline *o, const double point[3], double depth) {
    const size_t number = o->met++;
    const double u = vec3_dot(point, o->axes[0]), v = vec3_dot(point, o->axes[1]);
    int slice = 0;
    for (int k = 0; k < SLICES - 1; k++) {
        slice += o->borders[k] < depth;
    }
    double *reach = o->reach[slice], here[DIRECTIONS];
    double most = -INFINITY;               /* a reach of -INFINITY is beaten by all */
    for (int k = 0; k < DIRECTIONS; k++) { /* hardly a point is, so all directions at once */
        here[k] = u * o->along[0][k] + v * o->along[1][k];
        const double beyond = here[k] - reach[k];
        most = beyond > most ? beyond : most;
    }
    for (int k = 0; most > 0.0 && k < DIRECTIONS; k++) {
        if (here[k] > reach[k]) {
            reach[k] = here[k];
            o->outermost[slice][k].number = number;
            memcpy(o->outermost[slice][k].point, point, 3 * sizeof *point);
        }
    }
}

static void outline_add_picture(outline *o, const csm_coarse_picture *picture) {
    const csm_camera *camera = picture->camera;
    for (int row = 0; row < camera->height; row++) {
        const double y = coarse_row_y(camera, row);
        const size_t first = (size_t)row * (size_t)camera->width;
        for (int column = 0; column < camera->width; column++) {
            if (picture->facing[first + (size_t)column]) {
                const double depth = picture->view_depth[first + (size_t)column];
                double point[3];
                coarse_point(camera, coarse_column_x(camera, column), y, depth, point);
                outline_add(o, point, depth);
            }
        }
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
                          const double (*points)[3], size_t point_count,
                          const double light_axes[2][3], double out[CSM_OUTLINE_MAX][3]) {
    double range[2];
    depth_range(pictures, picture_count, points, point_count, range);
    if (!(range[0] <= range[1])) {
        return 0;
    }
    outline o;
    outline_begin(&o, light_axes, range);
    for (int k = 0; k < picture_count; k++) {
        outline_add_picture(&o, &pictures[k]);
    }
    for (size_t i = 0; i < point_count; i++) {
        outline_add(&o, points[i], depth_of(pictures[0].camera, points[i]));
    }
    return outline_end(&o, out);
}
