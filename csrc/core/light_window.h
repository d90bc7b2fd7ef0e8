/* light_window.h: what a clip matrix says about a shadow map, whoever made it. */
#ifndef CSM_LIGHT_WINDOW_H
#define CSM_LIGHT_WINDOW_H

#include "csm.h"

enum { WINDOW_X, WINDOW_Y, WINDOW_Z, WINDOW_W };
enum { WINDOW_SIDES = 4, WINDOW_PLANES = 6 }; /* left, right, bottom, top, then near, far */

/* Clip coordinates as affine functions of a point relative to an origin near the view, where they
 * lose nothing: rows[r] . (p, 1). */
typedef struct light_window {
    double rows[4][4];
    double size;        /* texels along a side */
    double to_light[3]; /* direction of the columns, unit length, against growing z */
    double depth_slope; /* clip z (times w) per metre along a column */
    double rounding_texels, rounding_depth; /* of doubles, at this distance: texels, z */
} light_window;

/* reach [m]: how far from the origin points will lie. Fails on a matrix that is not finite, has no
 * columns of parallel light or no depth. */
csm_status light_window_make(const double clip_from_world[16], int map_size, const double origin[3],
                             double reach, light_window *out, csm_error *err);

/* Planes (dot(n, p) + d >= 0 inside) of the window less a border, in texels, with the depth range
 * widened by depth_slack of itself. */
void light_window_planes(const light_window *window, double border, double depth_slack,
                         double out[WINDOW_PLANES][4]);

/* Clip coordinates of a point. */
void light_window_clip(const light_window *window, const double p[3], double out[4]);

/* Place of a point on the map in texels, (0, 0) at the lower left corner; false where w <= 0. */
bool light_window_texel(const light_window *window, const double p[3], double out[2]);

/* How far a point lies outside the window less a border, in texels; negative inside, INFINITY
 * where w <= 0. */
double light_window_outside(const light_window *window, const double p[3], double border);

/* Change of the place on the map per metre, at a point: texel x and y, each a world vector. */
void light_window_gradients(const light_window *window, const double p[3], double out[2][3]);

/* The point of a column through the window's centre nearest to the origin. */
void light_window_centre(const light_window *window, double out[3]);

#endif
