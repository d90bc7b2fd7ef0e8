// visibility.glsl: from a receiver to its visibility and cascade; the only file that branches on FILTER.
#include "include/receiver.glsl"

#if CSM_FILTER != CSM_FILTER_NONE

layout(binding = 1) uniform sampler2DArray shadow_maps;
layout(binding = 2) uniform sampler2DArrayShadow shadow_compare;

#include "include/shadow_bias.glsl"
#include "include/cascade_select.glsl"

#if CSM_FILTER == CSM_FILTER_HARD
#include "include/filter_hard.glsl"
#elif CSM_FILTER == CSM_FILTER_PCF
#include "include/filter_pcf.glsl"
#endif

float receiver_visibility(receiver point, out int cascade)
{
    map_receiver at = select_cascade(point);
    cascade = at.cascade;
    at.cascade = min(at.cascade, CSM_CASCADE_COUNT - 1);
    float visibility = filter_visibility(at);
    return cascade == no_cascade ? 1.0 : visibility;
}

int receiver_cascade(receiver point)
{
    return choose_cascade(point).cascade;
}

#else

float receiver_visibility(receiver point, out int cascade)
{
    cascade = no_cascade;
    return 1.0;
}

int receiver_cascade(receiver point)
{
    return no_cascade;
}

#endif
