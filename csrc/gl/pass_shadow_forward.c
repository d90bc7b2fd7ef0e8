/* pass_shadow_forward.c: the mask as a forward renderer makes it: the view's triangles are drawn
 * once more, with their light-space position interpolated between vertices (docs/numerics.md 24).
 *
 * A fragment answers only where the view pass saw its own triangle, so no depth is compared. The
 * answers go where the compute pass writes them.
 */
#include "gl_internal.h"

/* What nothing seen looks like: lit, no cascade, infinitely far, no normal. */
static void clear_outputs(csm_frame *frame) {
    static const float lit = 1.0f, infinite = __builtin_inff();
    static const GLuint no_cascade = 255u;
    static const struct {
        int kind;
        GLenum format, pixel, type;
        const void *value;
    } kinds[] = {
        {CSM_BUFFER_MASK, GL_R32F, GL_RED, GL_FLOAT, &lit},
        {CSM_BUFFER_MASK_SINGLE, GL_R32F, GL_RED, GL_FLOAT, &lit},
        {CSM_BUFFER_INDEX, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, &no_cascade},
        {CSM_BUFFER_DEPTH, GL_R32F, GL_RED, GL_FLOAT, &infinite},
        {CSM_BUFFER_NORMAL, GL_R32F, GL_RED, GL_FLOAT, NULL},
    };
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        const csm_host_buffer *buffer = &frame->renderer->buffers[kinds[i].kind];
        if (buffer->used) {
            frame->renderer->gl.ClearNamedBufferSubData(buffer->name, kinds[i].format, 0,
                                                        buffer->used, kinds[i].pixel, kinds[i].type,
                                                        kinds[i].value);
        }
    }
}

csm_status csm_pass_shadow_forward(csm_frame *frame, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    GLuint programs[2]; /* the same: where a triangle is cut out the view saw another */
    int items;
    csm_status status = csm_program_get_drawing(frame, CSM_STEP_SHADOW_FORWARD, programs, err);
    if (status == CSM_OK) {
        status = csm_mask_bind_outputs(frame, err);
    }
    if (status == CSM_OK) {
        status = csm_view_draws_fill(frame, &items, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    csm_timer_start(frame);
    clear_outputs(frame);
    csm_mask_bind_inputs(frame);
    csm_mask_set_image(frame, 0, 0);
    /* no attachment: the ids of the view are read, and nothing is drawn but the buffers */
    csm_no_attachment(frame);
    gl->Disable(GL_DEPTH_CLAMP);
    gl->Disable(GL_DEPTH_TEST);
    if (renderer->draws.command_count) {
        status = csm_draw_list_submit(frame, frame->desc->scene, programs, err);
    }
    gl->MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    csm_timer_stop(frame, "shadow_forward");
    return status;
}
