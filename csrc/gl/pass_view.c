/* pass_view.c: the camera's visible triangles: which triangle of which instance each pixel sees.
 *
 * The mask pass turns ids into points and normals from the triangles' planes, so positions do not
 * suffer from a depth buffer's rounding. Depth is reversed (near 1, far 0): with 32 float bits its
 * error is relative to the distance, also at near/far of 10^6.
 */
#include "gl_internal.h"

#include <stdlib.h>

csm_status csm_view_draws_fill(csm_frame *frame, int *out_items, csm_error *err) {
    const csm_gpu_scene *scene = frame->desc->scene;
    uint32_t *items = malloc(scene->geometry.item_count * sizeof *items);
    if (!items) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to cull the view");
    }
    size_t kept = csm_cull_items_view(&scene->geometry, &frame->desc->camera, items);
    csm_status status = csm_draw_list_fill(frame->renderer, scene, items, kept, err);
    free(items);
    *out_items = (int)kept;
    return status;
}

csm_status csm_pass_view(csm_frame *frame, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const csm_gpu_scene *scene = frame->desc->scene;
    const csm_camera *camera = &frame->desc->camera;
    const GLuint nothing[4] = {0xffffffffu, 0xffffffffu};
    const float farthest = 0.0f;
    GLuint programs[2];

    const GLuint framebuffer = renderer->view_framebuffer;
    gl->NamedFramebufferTexture(framebuffer, GL_COLOR_ATTACHMENT0,
                                renderer->targets[CSM_TARGET_VIEW_IDS].texture, 0);
    gl->NamedFramebufferTexture(framebuffer, GL_DEPTH_ATTACHMENT,
                                renderer->targets[CSM_TARGET_VIEW_DEPTH].texture, 0);
    gl->BindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    if (csm_kept_shows(frame)) {
        frame->out->view_items_drawn = renderer->view.items_drawn;
        return CSM_OK;
    }
    csm_kept_forget_view(renderer); /* until it is drawn */
    csm_status status = csm_program_get_drawing(frame, CSM_STEP_VIEW, programs, err);
    if (status == CSM_OK) {
        status = csm_view_draws_fill(frame, &frame->out->view_items_drawn, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    csm_timer_start(frame);
    gl->Viewport(0, 0, camera->width, camera->height);
    gl->Disable(GL_DEPTH_CLAMP);
    gl->Enable(GL_DEPTH_TEST);
    gl->DepthFunc(GL_GREATER);
    gl->ClearNamedFramebufferuiv(framebuffer, GL_COLOR, 0, nothing);
    gl->ClearNamedFramebufferfv(framebuffer, GL_DEPTH, 0, &farthest);
    if (renderer->draws.command_count) {
        status = csm_draw_list_submit(frame, scene, programs, err);
    }
    csm_timer_stop(frame, "view");
    if (status == CSM_OK) {
        renderer->view = (csm_kept_view){scene, *camera, frame->out->view_items_drawn};
    }
    return status;
}
