// moments.glsl: what is stored of a depth for a prefiltered filter, in each of its layers; with visibility.glsl the
// only file that branches on FILTER.

#if CSM_FILTER == CSM_FILTER_VSM
#include "include/moments_vsm.glsl"
#elif CSM_FILTER == CSM_FILTER_MSM
#include "include/moments_msm.glsl"
#elif CSM_FILTER == CSM_FILTER_FOURIER
#include "include/moments_fourier.glsl"
#elif CSM_SUMMED
#include "include/moments_sums.glsl"
#elif CSM_FILTER == CSM_FILTER_PCSS
#include "include/moments_pcss.glsl"
#endif
