/* frustum.h: clipping a camera's frustum with a box, for the range and the culling of core. */
#ifndef CSM_FRUSTUM_H
#define CSM_FRUSTUM_H

#include "csm.h"

/* 12 faces of 4 vertices. A plane adds one vertex to a convex polygon; where rounding makes a
 * degenerate one look otherwise, it adds at most half of what is there: 4 6 9 13 19 28 42. */
#define CSM_CLIP_POLYGON_MAX 42
#define CSM_CLIP_MAX (12 * CSM_CLIP_POLYGON_MAX)

/* Points whose convex hull is the part of the frustum [near_depth, far_depth] inside a finite box:
 * every vertex of it, several times over. World axes, relative to the camera's eye [m], so that
 * nothing is lost far from the world origin. Returns their number, 0 if frustum and box do not
 * meet. */
int csm_frustum_clip_box(const csm_camera *camera, double near_depth, double far_depth,
                         const double bounds[6], double out_points[CSM_CLIP_MAX][3]);

/* Whether a world box, widened by a margin, has a point on the inner side of each plane; planes
 * relative to the eye. Boxes beside an edge of the frustum may pass: it errs towards true. */
bool csm_planes_meet_box(const double planes[CSM_PLANE_COUNT][4], const double eye[3],
                         const double bounds[6], double margin);

#endif
