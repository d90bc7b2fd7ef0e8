// moments.glsl: what is stored of a depth for a prefiltered filter, in each of its layers; with visibility.glsl the
// only file that branches on FILTER.
#include "include/depth_warps.glsl"

#if CSM_FILTER == CSM_FILTER_VSM || CSM_FILTER == CSM_FILTER_PCSS && CSM_SUMMED == 0
#include "include/moments_vsm.glsl"
#elif CSM_FILTER == CSM_FILTER_EVSM2 || CSM_FILTER == CSM_FILTER_EVSM4
#include "include/moments_evsm.glsl"
#elif CSM_FILTER == CSM_FILTER_ESM
#include "include/moments_esm.glsl"
#elif CSM_FILTER == CSM_FILTER_LVSM
#include "include/moments_lvsm.glsl"
#elif CSM_FILTER == CSM_FILTER_MSM
#include "include/moments_msm.glsl"
#elif CSM_FILTER == CSM_FILTER_FOURIER
#include "include/moments_fourier.glsl"
#elif CSM_SUMMED
#include "include/moments_sums.glsl"
#endif
