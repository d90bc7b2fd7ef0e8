/* coverage.h: what the files of coverage share: a view and the windows over it. */
#ifndef CSM_COVERAGE_H
#define CSM_COVERAGE_H

#include "light_window.h"

/* Points are relative to the camera's eye: a place far from the world origin then costs the digits
 * of the matrices alone. */
typedef struct view {
    const csm_coverage_desc *desc;
    csm_coverage *out; /* of every cascade */
    light_window windows[CSM_MAX_CASCADES];
    double planes[CSM_MAX_CASCADES][WINDOW_PLANES][4]; /* less the border, plus the tolerances */
    double pixel; /* side of a pixel [m]; perspective: per metre of depth */
    double gap_sizes[CSM_MAX_CASCADES][CSM_GAP_POINTS];
} view;

/* A point of a slice against the slice's own window. */
void coverage_judge_point(view *v, int slice, const double p[3]);

/* A point of a slice against the depth range of the slice's own window. */
void coverage_judge_depth(view *v, int slice, const double p[3]);

/* A point of a slice that no window holds; size ranks the examples. */
void coverage_add_gap(view *v, int slice, const double p[3], double size);

/* A gap reaches as far outside the slice's own window as its farthest point. */
void coverage_widen_gap(view *v, int slice, const double p[3]);

/* coverage_slices.c: everything about one slice as a body. */
csm_status coverage_measure_slice(view *v, int slice, csm_error *err);

#endif
