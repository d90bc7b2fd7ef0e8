/* filters.h: what effects.c asks of filters.c. */
#ifndef CSM_FILTERS_H
#define CSM_FILTERS_H

#include "csm.h"

/* Problems of the filter's own settings. */
void csm_filter_validate(const csm_settings *settings, csm_error *err);

/* Whether it makes use of the receiver's plane: compares at texels of their own do, and what is not
 * linear in depth along a plane (docs/numerics.md 27). */
bool csm_filter_follows_plane(const csm_settings *settings);

/* The part of the canonical form that is the filter's. */
void csm_filter_canonical(csm_settings *settings);

/* What the automatic bias of a filter adds: texels of the receiver's slope, and a share of the
 * depth range (docs/numerics.md 28). */
double csm_filter_slope_texels(const csm_settings *settings);
double csm_filter_depth_offset(const csm_settings *settings);

#endif
