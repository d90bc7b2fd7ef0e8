// view.frag: which triangle of which instance is seen. Without instances the target holds the triangle alone.
#if CSM_ALPHA_TEST
#include "include/cutout.glsl"
#endif

layout(location = 0) flat in uvec2 ids;

layout(location = 0) out uvec2 seen;

void main()
{
#if CSM_ALPHA_TEST
    if (cut_out()) {
        discard;
    }
#endif
    seen = ids;
}
