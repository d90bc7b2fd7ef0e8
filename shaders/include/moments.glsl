// moments.glsl: what is stored of a depth for a prefiltered filter, in each of its layers; with visibility.glsl the
// only file that branches on FILTER.

#if CSM_FILTER == CSM_FILTER_VSM
#include "include/moments_vsm.glsl"
#endif
