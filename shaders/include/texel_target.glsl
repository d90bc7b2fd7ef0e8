// texel_target.glsl: where a pass over texels writes: an image in compute, the attachment of a fragment.

#if CSM_STAGE == CSM_STAGE_COMPUTE
#if CSM_SUMMED
layout(binding = 0) writeonly uniform uimage2D target;
#else
layout(binding = 0) writeonly uniform image2D target;
#endif
#elif CSM_SUMMED
layout(location = 0) out uvec4 target;
#else
layout(location = 0) out vec4 target;
#endif

#if CSM_SUMMED
void store_texel(ivec2 texel, uvec4 value)
#else
void store_texel(ivec2 texel, vec4 value)
#endif
{
#if CSM_STAGE == CSM_STAGE_COMPUTE
    imageStore(target, texel, value);
#else
    target = value;
#endif
}
