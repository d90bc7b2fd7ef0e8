/* coarse_picture.c: which pixels of a coarse frame face the sun, are judged, are lit; and some of
 * those that face it as points of the world.
 *
 * In: arrays of a frame. Out: bytes of every pixel, counts, arrays of receivers.
 */
#include <math.h>
#include <string.h>

#include "coarse.h"
#include "linalg.h"

#define TOGETHER 128 /* pixels that are gone through at once; a byte holds their number */
#define NO_CASCADE 255

/* Pixels whose surface the sun sees. */
static void face(const csm_coarse_shown *shown, size_t first, int count, uint8_t *restrict out) {
    const float(*normal)[3] = shown->normal + first;
    const uint8_t *valid = shown->valid + first;
    const float x = (float)shown->to_light[0], y = (float)shown->to_light[1],
                z = (float)shown->to_light[2], least = (float)shown->least_cosine;
    float cosine[TOGETHER];
    for (int i = 0; i < count; i++) {
        cosine[i] = normal[i][0] * x + normal[i][1] * y + normal[i][2] * z;
    }
    for (int i = 0; i < count; i++) {
        out[i] = valid[i] & (cosine[i] > least);
    }
}

static size_t sum_of(const uint8_t *bytes, int count) {
    uint8_t sum = 0;
    for (int i = 0; i < count; i++) {
        sum = (uint8_t)(sum + bytes[i]);
    }
    return sum;
}

static void judge(const csm_coarse_shown *shown, size_t first, int count, csm_coarse_read *out) {
    const uint8_t *cascade = shown->cascade + first, *facing = out->facing + first;
    const float *mask = shown->mask + first, least = (float)shown->least_lit;
    uint8_t *restrict judged = out->judged + first, *restrict lit = out->lit + first;
    uint8_t here[TOGETHER];
    for (int i = 0; i < count; i++) {
        lit[i] = mask[i] >= least;
    }
    for (int i = 0; i < count; i++) {
        judged[i] = facing[i] & (cascade[i] != NO_CASCADE);
    }
    for (int i = 0; i < count; i++) {
        here[i] = judged[i] & (lit[i] ^ 1);
    }
    out->shadowed_count += sum_of(here, count);
    for (int k = 0; k < shown->cascade_count; k++) {
        for (int i = 0; i < count; i++) {
            here[i] = facing[i] & (cascade[i] == k);
        }
        out->of_cascade[k] += sum_of(here, count);
    }
}

void csm_coarse_look(const csm_coarse_shown *shown, csm_coarse_read *out) {
    out->seen_count = out->facing_count = out->shadowed_count = 0;
    memset(out->of_cascade, 0, sizeof out->of_cascade);
    for (size_t i = 0; i < shown->pixels; i += TOGETHER) {
        const size_t left = shown->pixels - i;
        const int count = left < TOGETHER ? (int)left : TOGETHER;
        face(shown, i, count, out->facing + i);
        out->seen_count += sum_of(shown->valid + i, count);
        out->facing_count += sum_of(out->facing + i, count);
        if (out->judged) {
            judge(shown, i, count, out);
        }
    }
}

size_t csm_coarse_changed(size_t pixels, const uint8_t *judged, const uint8_t *one,
                          const uint8_t *other) {
    size_t sum = 0;
    uint8_t here[TOGETHER];
    for (size_t i = 0; i < pixels; i += TOGETHER) {
        const int count = pixels - i < TOGETHER ? (int)(pixels - i) : TOGETHER;
        for (int k = 0; k < count; k++) {
            here[k] = judged[i + (size_t)k] & (one[i + (size_t)k] ^ other[i + (size_t)k]);
        }
        sum += sum_of(here, count);
    }
    return sum;
}

/* How many of eight bytes are 1. */
static size_t sum_of_eight(const uint8_t *bytes) {
    uint64_t eight;
    memcpy(&eight, bytes, sizeof eight);
    return (size_t)(eight * 0x0101010101010101U >> 56);
}

/* A pixel, and how many before it face the sun. */
typedef struct facing_walk {
    size_t pixel, met;
} facing_walk;

/* Walks on to the one that faces the sun and has a number; there is one. */
static size_t walk_to(facing_walk *walk, const uint8_t *facing, size_t pixels, size_t number) {
    while (walk->pixel + 8 <= pixels) {
        const size_t here = sum_of_eight(facing + walk->pixel);
        if (walk->met + here > number) {
            break;
        }
        walk->met += here;
        walk->pixel += 8;
    }
    size_t pixel = walk->pixel;
    for (size_t met = walk->met; met + facing[pixel] <= number; pixel++) {
        met += facing[pixel];
    }
    return pixel;
}

static double clamped(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

size_t csm_coarse_receiver_count(size_t facing) {
    return coarse_looked_at(facing, CSM_COARSE_RECEIVERS);
}

size_t csm_coarse_facing_count(const csm_coarse_picture *picture) {
    const size_t pixels = (size_t)picture->camera->width * (size_t)picture->camera->height;
    size_t sum = 0;
    for (size_t i = 0; i < pixels; i += TOGETHER) {
        sum += sum_of(picture->facing + i, pixels - i < TOGETHER ? (int)(pixels - i) : TOGETHER);
    }
    return sum;
}

void csm_coarse_receivers(const csm_coarse_picture *picture, size_t facing,
                          const csm_coarse_light *light, const csm_coarse_receiver_arrays *out) {
    const csm_camera *camera = picture->camera;
    const size_t width = (size_t)camera->width, pixels = width * (size_t)camera->height;
    const size_t count = csm_coarse_receiver_count(facing),
                 stride = coarse_stride(facing, CSM_COARSE_RECEIVERS);
    facing_walk walk = {0, 0};
    for (size_t k = 0; k < count; k++) {
        const size_t i = walk_to(&walk, picture->facing, pixels, k * stride);
        const double depth = picture->view_depth[i];
        coarse_point(camera, coarse_column_x(camera, (int)(i % width)),
                     coarse_row_y(camera, (int)(i / width)), depth, out->point[k]);
        double normal[3];
        for (int axis = 0; axis < 3; axis++) {
            normal[axis] = picture->normal[i][axis];
        }
        const double cosine = clamped(vec3_dot(normal, light->to_light), light->least_cosine, 1.0);
        const double along = fabs(vec3_dot(normal, light->axes[0]));
        out->depth[k] = depth;
        out->slope[k] = sqrt(1.0 / (cosine * cosine) - 1.0);
        out->gradient[k] = (along + fabs(vec3_dot(normal, light->axes[1]))) / cosine;
        out->cascade[k] = picture->cascade[i];
        out->dark[k] = picture->lit[i] ^ 1;
    }
}
