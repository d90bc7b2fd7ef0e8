/* tetrahedra.h: slices of the view as tetrahedra, which a plane cuts into tetrahedra again. */
#ifndef CSM_TETRAHEDRA_H
#define CSM_TETRAHEDRA_H

#include "csm.h"

typedef struct tetrahedron {
    double corners[4][3];
} tetrahedron;

/* What a cut leaves on either side. */
typedef struct tetrahedron_cut {
    int inside_count, outside_count;
    tetrahedron inside[3], outside[3];
} tetrahedron_cut;

typedef void (*tetrahedron_visit)(void *user, const tetrahedron *piece);

double tetrahedron_volume(const tetrahedron *t);
void tetrahedron_centre(const tetrahedron *t, double out[3]);

/* Parts where dot(plane, p) + plane[3] >= 0 and where it is not. A plane that misses t leaves it
 * whole on its side. */
void tetrahedron_split(const tetrahedron *t, const double plane[4], tetrahedron_cut *out);

/* Visits the pieces of t that lie inside every plane: together they are exactly that part. */
void tetrahedron_clip(const tetrahedron *t, const double (*planes)[4], int count,
                      tetrahedron_visit visit, void *user);

/* A convex body with six flat faces, its corners in the order of csm_corner, as six tetrahedra. */
void tetrahedra_of_slice(const double corners[CSM_CORNER_COUNT][3], tetrahedron out[6]);

#endif
