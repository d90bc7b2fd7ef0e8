// answer.glsl: what a pass writes for a pixel, into buffers that the host reads.

#if CSM_OUT_MASK
layout(std430, binding = 2) writeonly buffer mask_block
{
    float mask[];
};
#endif
#if CSM_OUT_MASK_SINGLE
layout(std430, binding = 9) writeonly buffer mask_single_block
{
    float mask_single[];
};
#endif
#if CSM_OUT_VALID || CSM_OUT_CASCADE_INDEX
layout(std430, binding = 3) writeonly buffer index_block
{
    uint cascade_index[]; // valid in bit 8
};
#endif
#if CSM_OUT_VIEW_DEPTH
layout(std430, binding = 4) writeonly buffer view_depth_block
{
    float view_depth[];
};
#endif
#if CSM_OUT_NORMAL
layout(std430, binding = 5) writeonly buffer normal_block
{
    float normal[];
};
#endif

void write_answer(ivec2 pixel, receiver point, bool seen)
{
    // row 0 is on top outside, at the bottom in GL
    int place = (frame.image.y - 1 - pixel.y) * frame.image.x + pixel.x;
    int cascade = no_cascade;
#if CSM_OUT_MASK || CSM_OUT_MASK_SINGLE
    bool facing = dot(point.normal, frame.to_light.xyz) > facing_limit;
    verdict found = receiver_verdict(point);
    cascade = found.cascade;
#if CSM_OUT_MASK
    mask[place] = seen ? (facing ? found.visibility : 0.0) : 1.0;
#endif
#if CSM_OUT_MASK_SINGLE
    mask_single[place] = seen ? (facing ? found.single : 0.0) : 1.0;
#endif
#elif CSM_OUT_CASCADE_INDEX
    cascade = receiver_cascade(point);
#endif
#if CSM_OUT_VALID || CSM_OUT_CASCADE_INDEX
    cascade_index[place] = seen ? uint(cascade) | 256u : uint(no_cascade);
#endif
#if CSM_OUT_VIEW_DEPTH
    view_depth[place] = point.view_depth;
#endif
#if CSM_OUT_NORMAL
    normal[3 * place] = point.normal.x;
    normal[3 * place + 1] = point.normal.y;
    normal[3 * place + 2] = point.normal.z;
#endif
}
