/* placement.h: the steps of a fit, in the order in which csm_cascades_fit takes them. */
#ifndef CSM_PLACEMENT_H
#define CSM_PLACEMENT_H

#include "csm.h"
#include "hull.h"

/* What a window must hold, in light space: x, y, z [m]. */
typedef struct csm_slab {
    double centre[3], half[3];
} csm_slab;

/* view_range.c: out->splits, out->range_step and the held steps of the range. */
csm_status csm_place_splits(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err);

/* A part of the view range and the cascades that share it, `first` to `first + count - 1`. */
typedef struct csm_share {
    double near_depth, far_depth; /* [m] */
    int first, count;
} csm_share;

/* splits_resolution.c: the count + 1 splits of a share for which texel over pixel at the near end
 * is the same in every cascade (docs/numerics.md 17). range_near: of the whole view range [m]. */
void csm_splits_resolution(const csm_cascades_desc *desc, double range_near, const csm_share *share,
                           double *out_splits);

/* splits_histogram.c: the count + 1 splits of a share with as many receivers in every cascade, cut
 * on rungs (docs/numerics.md 17). The steps of the cuts are held. */
csm_status csm_splits_histogram(const csm_cascades_desc *desc,
                                const uint32_t histogram[CSM_DEPTH_BINS], const csm_share *share,
                                double *out_splits, csm_hold *hold, csm_error *err);

/* splits.c: depths that ranges and cuts are rounded to, so that they do not wander: rung k of a
 * camera is near * 2^(k/4), or, where near is not positive, near + (far - near) k/64; k need not be
 * whole. And its inverse. */
double csm_rung_depth(const csm_camera *camera, double rung);
double csm_rung_of(const csm_camera *camera, double depth);

/* light_basis.c: the axes that windows start from, and what of them is held. */
csm_status csm_place_light(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err);

/* receivers.c: what the receivers of each cascade span in light x, y, along the axes of its window:
 * relative to the eye or, summed up, to box_origin. Each point is met once. */
void csm_receivers_enclose(const csm_cascades_desc *desc, const csm_cascades *cascades,
                           csm_rectangle out[CSM_MAX_CASCADES]);

/* fits.c: what the window of cascade i must hold; out->splits and light_from_world[i] are set.
 * rectangles: of csm_receivers_enclose, read under fit = visible alone. */
csm_status csm_fit_slab(const csm_cascades_desc *desc, const csm_rectangle *rectangles,
                        csm_cascades *out, int i, csm_slab *slab, csm_error *err);

/* fits.c: light-space box of a slice. Taken relative to the eye, so that its sides depend on the
 * camera's orientation alone and stay equal to the last bit while it only moves. */
csm_slab csm_slice_bounds(const csm_camera *camera, const double light_from_world[16],
                          double near_depth, double far_depth);

/* receivers.c: the same for fit = visible: where nothing is seen, a window of the slice's own. May
 * turn light_from_world[i] about light z. */
csm_status csm_fit_visible(const csm_cascades_desc *desc, const csm_rectangle *rectangles,
                           csm_cascades *out, int i, csm_slab *slab, csm_error *err);

/* receivers.c: least and largest view depth of what is seen, within the camera's range; false if
 * nothing is. histogram may be NULL. */
bool csm_receivers_depths(const csm_cascades_desc *desc, double out_range[2],
                          uint32_t histogram[CSM_DEPTH_BINS]);

/* clipped.c: the same for fit = clipped and focus. */
void csm_fit_clipped(const csm_cascades_desc *desc, csm_cascades *out, int i, csm_slab *slab);

/* snap.c: the half side of a window whose size changes with the view: as it is, or, snapped
 * exactly, rounded up to a size that it keeps while the view moves a little. */
double csm_settle_half(const csm_cascades_desc *desc, int i, int axis, double half,
                       csm_cascades *out);

/* Padding of a window in texels: the kernel, and how far a receiver may be moved where a length may
 * be stretch times longer in light space. */
int csm_window_padding(const csm_settings *settings, double stretch);

/* snap.c: under snap = approximate the least level for the half extents of window i, or the held
 * one. */
csm_status csm_snap_sizes(const csm_cascades_desc *desc, csm_cascades *out, int i, int padding,
                          csm_window *window, csm_error *err);

/* depth_range.c: light-view depth of z = 0 and the span to z = 1 [m] of cascade i. sides: of the
 * window in light x, y, from its lower corner [m]. */
void csm_choose_depth_range(const csm_cascades_desc *desc, csm_cascades *out, int i,
                            const csm_slab *slice, const double corner[2], const double sides[2],
                            double *out_near, double *out_span);

#endif
