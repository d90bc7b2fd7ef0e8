/* coarse_maps.c: what the maps of a coarse frame hold before points, and how thin that is.
 *
 * In: maps and points of the world. Out: distances along the light, and shares.
 */
#include <math.h>

#include "csm.h"
#include "linalg.h"

#define CURVED 0.25      /* of a surface's slope that it may change by from texel to texel */
#define LAYERS_BLEED 0.1 /* share of the light that layers of occluders let into a variance map */
#define AROUND 25        /* texels of the widest look */

/* u, v [texels] and z of a point. */
static void texel_place(const csm_coarse_maps *maps, int cascade, const double point[3],
                        double out[3]) {
    const double *m = maps->uvz_from_world[cascade];
    double uvzw[4];
    for (int i = 0; i < 4; i++) {
        uvzw[i] = m[i] * point[0] + m[4 + i] * point[1] + m[8 + i] * point[2] + m[12 + i];
    }
    for (int i = 0; i < 3; i++) {
        out[i] = uvzw[i] / uvzw[3] * (i < 2 ? maps->size[cascade] : 1.0);
    }
}

/* The texel of a place, with as many around it as the reach. */
static int texel_within(double place, int size, int reach) {
    const int last = size - 1 - reach;
    return !(place >= reach) ? reach : place >= last ? last : (int)place;
}

/* Distances [m] from a point to what its map holds in the texels around it; how many those are. */
static int gaps_around(const csm_coarse_maps *maps, int cascade, const double place[3], int reach,
                       double out[AROUND]) {
    const int size = maps->size[cascade];
    const int u = texel_within(place[0], size, reach), v = texel_within(place[1], size, reach);
    int count = 0;
    for (int row = v - reach; row <= v + reach; row++) {
        const float *depths = maps->depths[cascade] + (size_t)row * (size_t)size;
        for (int column = u - reach; column <= u + reach; column++) {
            out[count++] = (place[2] - (double)depths[column]) * maps->span[cascade];
        }
    }
    return count;
}

void csm_coarse_gaps(const csm_coarse_maps *maps, const csm_coarse_points *points, double *out) {
    for (size_t i = 0; i < points->count; i++) {
        const int cascade = points->cascade[i];
        out[i] = INFINITY;
        if (!points->dark[i] || cascade >= maps->count) {
            continue;
        }
        double place[3], gap[AROUND];
        texel_place(maps, cascade, points->point[i], place);
        gaps_around(maps, cascade, place, 0, gap);
        /* dark by the plane at the texel's centre alone: how near the occluder is, is not known */
        out[i] = gap[0] > 0.0 ? gap[0] : INFINITY;
    }
}

/* Vectors of a surface that leave v, and u, as they are; and how much u grows along the first. */
static double surface_steps(const csm_coarse_maps *maps, int cascade, const double normal[3],
                            double along[2][3], double row[3][3]) {
    const double *m = maps->uvz_from_world[cascade];
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            row[i][k] = m[4 * k + i];
        }
    }
    vec3_cross(row[1], normal, along[0]);
    vec3_cross(normal, row[0], along[1]);
    return vec3_dot(along[0], row[0]);
}

/* How much deeper the point's own surface lies per map along u and v [m]; level where it stands
 * along the light, against the steepest that is not: least is its volume. */
static void surface_slopes(const csm_coarse_maps *maps, int cascade, const double normal[3],
                           double least, double out[2]) {
    double along[2][3], row[3][3];
    const double volume = surface_steps(maps, cascade, normal, along, row);
    for (int i = 0; i < 2; i++) {
        out[i] =
            fabs(volume) > least ? vec3_dot(along[i], row[2]) / volume * maps->span[cascade] : 0.0;
    }
}

static double blocker_distance(const csm_coarse_maps *maps, int cascade, const double point[3],
                               const double slopes[2]) {
    const int size = maps->size[cascade];
    const double texel = maps->texel[cascade];
    double place[3], gap[AROUND];
    texel_place(maps, cascade, point, place);
    gaps_around(maps, cascade, place, 1, gap);
    const double steepness = (fabs(slopes[0]) + fabs(slopes[1])) / (size * texel);
    const double u = texel_within(place[0], size, 1) - 0.5 - place[0];
    const double v = texel_within(place[1], size, 1) - 0.5 - place[1];
    double nearest = INFINITY, farthest = 0.0;
    for (int k = 0; k < 9; k++) {
        const double own = ((u + k % 3) * slopes[0] + (v + k / 3) * slopes[1]) / size;
        const double distance = gap[k] + own;
        /* nearer ones are the surface itself, which curves by a part of its slope */
        if (distance > texel * (0.5 + CURVED * steepness)) {
            nearest = fmin(nearest, distance);
            farthest = fmax(farthest, distance);
        }
    }
    return farthest > 0.0 ? 0.5 * (nearest + farthest) : 0.5 * texel;
}

void csm_coarse_blockers(const csm_coarse_maps *maps, const csm_coarse_points *points,
                         double *out) {
    double least[CSM_MAX_CASCADES] = {0.0};
    for (size_t i = 0; i < points->count; i++) {
        const int cascade = points->cascade[i];
        if (cascade < maps->count) {
            double along[2][3], row[3][3];
            const double volume = surface_steps(maps, cascade, points->normal[i], along, row);
            least[cascade] = fmax(least[cascade], 1e-12 * fabs(volume));
        }
    }
    for (size_t i = 0; i < points->count; i++) {
        const int cascade = points->cascade[i];
        out[i] = 0.0;
        if (cascade < maps->count) {
            double slopes[2];
            surface_slopes(maps, cascade, points->normal[i], least[cascade], slopes);
            out[i] = blocker_distance(maps, cascade, points->point[i], slopes);
        }
    }
}

double csm_coarse_layered_share(const csm_coarse_maps *maps, const csm_coarse_points *points) {
    size_t full = 0, layered = 0;
    for (size_t i = 0; i < points->count; i++) {
        const int cascade = points->cascade[i];
        if (cascade >= maps->count) {
            continue;
        }
        double place[3], gap[AROUND], mean = 0.0, variance = 0.0;
        texel_place(maps, cascade, points->point[i], place);
        gaps_around(maps, cascade, place, 2, gap);
        bool covered = true;
        for (int k = 0; k < AROUND; k++) { /* nearer ones are the surface itself */
            covered &= gap[k] > 0.5 * maps->texel[cascade];
            mean += gap[k];
        }
        if (!covered) {
            continue;
        }
        mean /= AROUND;
        for (int k = 0; k < AROUND; k++) {
            variance += (gap[k] - mean) * (gap[k] - mean);
        }
        variance /= AROUND;
        full++;
        layered += variance > LAYERS_BLEED * (variance + mean * mean);
    }
    return full ? (double)layered / (double)full : 0.0;
}
