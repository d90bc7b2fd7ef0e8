// shadow_sum.comp: sums along whole rows or columns, an invocation a line. The fragments of texels_sum.glsl come to the
// same sums by steps: whole numbers have no order.
#include "include/texels_sum.glsl"
#include "include/texel_target.glsl"

layout(local_size_x = 64) in;

void main()
{
    int line = int(gl_GlobalInvocationID.x);
    if (line < place.z) {
        ivec2 texel = line * (ivec2(1) - stride);
        uvec4 sum = uvec4(0u);
        for (int i = 0; i < place.z; i++) {
            sum += texelFetch(source, ivec3(texel, place.y), 0);
            store_texel(texel, sum);
            texel += stride;
        }
    }
}
