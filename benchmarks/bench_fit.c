/* bench_fit.c: cascade fits per second on one core, for every fit and snap, then for every split.
 *
 * Links csrc/core alone: no Python, no OpenGL. A camera walks and turns over a scene of boxes;
 * every frame is a whole fit of four cascades, matrices included, that holds what the one before
 * handed on. Each line of the output: setting, value, value, cascades fitted per second of CPU
 * time. Usage: bench_fit [seconds per line]
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "csm.h"

#define FRAMES 64
#define BOXES 64   /* of the scene's parts, and of what is seen: in every frame the same */
#define CASCADES 4 /* as by default */

static const double scene_bounds[6] = {-500, 0, -500, 500, 60, 500};

typedef struct walk {
    csm_camera cameras[FRAMES];
    double boxes[6 * BOXES];
    float seen_boxes[4 * BOXES * CASCADES];
    uint32_t histogram[CSM_DEPTH_BINS];
    csm_receivers receivers;
} walk;

static csm_camera camera_at(double t) {
    const double heading = 0.7 * t, pitch = 0.2 * sin(1.3 * t);
    const double backward[3] = {cos(pitch) * cos(heading), sin(pitch), cos(pitch) * sin(heading)};
    csm_camera camera = {.eye = {40 * cos(t), 2 + sin(3 * t), 30 * sin(2 * t)},
                         .right = {-sin(heading), 0, cos(heading)},
                         .half_width = 1.0264,
                         .half_height = 0.57735,
                         .near_depth = 0.1,
                         .far_depth = 1000.0,
                         .width = 1920,
                         .height = 1080};
    /* up = backward x right; backward was chosen so that right, up, backward are right-handed */
    const double *b = backward, *r = camera.right;
    camera.up[0] = b[1] * r[2] - b[2] * r[1];
    camera.up[1] = b[2] * r[0] - b[0] * r[2];
    camera.up[2] = b[0] * r[1] - b[1] * r[0];
    memcpy(camera.backward, backward, sizeof backward);
    return camera;
}

static void fill(walk *w) {
    for (int i = 0; i < FRAMES; i++) {
        w->cameras[i] = camera_at(0.05 * i);
    }
    for (int i = 0; i < BOXES; i++) {
        const double x = 110.0 * (i % 8) - 440, z = 110.0 * (double)(i / 8) - 440;
        const double box[6] = {x, 0, z, x + 60, 5 + i % 11, z + 70};
        memcpy(w->boxes + (ptrdiff_t)6 * i, box, sizeof box);
        for (int cascade = 0; cascade < CASCADES; cascade++) {
            const float size = (float)(1 << (2 * cascade)), at = size * (float)(i % 8);
            const float seen[4] = {at, at * 0.5f, at + size, at + 2 * size};
            memcpy(w->seen_boxes + (ptrdiff_t)4 * (i * CASCADES + cascade), seen, sizeof seen);
        }
    }
    for (int i = 0; i < CSM_DEPTH_BINS; i++) {
        w->histogram[i] = (uint32_t)(i > 90 && i < 220 ? 100 + 7 * (i % 13) : 0);
    }
    w->receivers = (csm_receivers){.seen = true,
                                   .depth_range = {2.7, 260.0},
                                   .depth_histogram = w->histogram,
                                   .boxes = w->seen_boxes,
                                   .box_count = BOXES};
}

/* Cascades per second of CPU time; negative after a message if a fit fails. */
static double measure(const walk *w, const csm_settings *settings, double seconds) {
    csm_error err = {0};
    csm_hold held = csm_hold_none();
    csm_cascades cascades;
    long fits = 0;
    const clock_t start = clock();
    double spent = 0.0;
    while (spent < seconds) {
        for (int i = 0; i < FRAMES; i++) {
            const csm_cascades_desc desc = {.camera = w->cameras[i],
                                            .to_light = {0.4, 0.8, 0.3},
                                            .settings = settings,
                                            .scene_bounds = scene_bounds,
                                            .boxes = w->boxes,
                                            .box_count = BOXES,
                                            .receivers = &w->receivers,
                                            .held = &held};
            if (csm_cascades_fit(&desc, &cascades, &err) != CSM_OK) {
                fprintf(stderr, "%s\n", err.text);
                return -1.0;
            }
            held = cascades.hold;
            fits += cascades.count;
        }
        spent = (double)(clock() - start) / CLOCKS_PER_SEC;
    }
    return (double)fits / spent;
}

/* Name number `value` among the choices of an effect. */
static void print_choice(int effect, int value) {
    const char *name = csm_effect_describe(effect)->choices;
    for (int i = 0; i < value; i++) {
        name = strchr(name, ' ') + 1;
    }
    printf(" %.*s", (int)strcspn(name, " "), name);
}

static int line(const walk *w, int first, int first_value, int second, int second_value,
                double seconds) {
    csm_settings settings = csm_settings_default();
    settings.effects[CSM_EFFECT_CASCADE_COUNT] = CASCADES;
    settings.effects[first] = first_value;
    settings.effects[second] = second_value;
    const double by_hand[CASCADES - 1] = {4.0, 16.0, 64.0};
    memcpy(settings.manual_splits, by_hand, sizeof by_hand);
    const double rate = measure(w, &settings, seconds);
    printf("%s", csm_effect_describe(first)->name);
    print_choice(first, first_value);
    print_choice(second, second_value);
    printf(" %.0f\n", rate);
    return rate > 0.0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

int main(int argc, char **argv) {
    const double seconds = argc > 1 ? strtod(argv[1], NULL) : 0.2;
    static walk w;
    int failed = EXIT_SUCCESS;
    fill(&w);
    for (int fit = 0; fit <= csm_effect_describe(CSM_EFFECT_FIT)->max; fit++) {
        for (int snap = 0; snap <= csm_effect_describe(CSM_EFFECT_SNAP)->max; snap++) {
            failed |= line(&w, CSM_EFFECT_FIT, fit, CSM_EFFECT_SNAP, snap, seconds);
        }
    }
    for (int split = 0; split <= csm_effect_describe(CSM_EFFECT_SPLIT)->max; split++) {
        failed |= line(&w, CSM_EFFECT_SPLIT, split, CSM_EFFECT_SNAP, CSM_SNAP_EXACT, seconds);
    }
    return failed;
}
