/* pass_shadow_map.c: the casters of one cascade into its layer of the depth array. */
#include "gl_internal.h"

#include <math.h>
#include <stdlib.h>

static const char *const timing_names[CSM_MAX_CASCADES] = {
    "shadow_map_0", "shadow_map_1", "shadow_map_2", "shadow_map_3",
    "shadow_map_4", "shadow_map_5", "shadow_map_6", "shadow_map_7",
};

/* Texels around the visible slice whose casters still matter: the kernel, and one for the rounding
 * of receivers and casters to float32. */
static double cull_margin_texels(const csm_settings *settings) {
    return csm_settings_kernel_radius(settings) + fabs(settings->normal_offset_texels) + 1.0;
}

/* Texels of a map's rim where a receiver may yet be answered by a coarser one: the kernel's border,
 * the normal offset that moves the tested point, and one for the point's rounding to float32. */
static double unanswered_texels(const csm_settings *settings) {
    bool bordered = settings->effects[CSM_EFFECT_SELECT] == CSM_SELECT_MAP;
    int border = bordered ? csm_settings_kernel_radius(settings) : 0;
    return border + fabs(settings->normal_offset_texels) + 1.0;
}

static csm_status fill_draw_list(csm_frame *frame, int cascade, csm_error *err) {
    const csm_render_desc *desc = frame->desc;
    const csm_geometry *geometry = &desc->scene->geometry;
    const csm_settings *settings = &frame->settings;
    csm_cull_volume volume;
    uint32_t *items = malloc(geometry->item_count * sizeof *items);
    if (!items) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to cull cascade %d", cascade);
    }
    const int mode = settings->effects[CSM_EFFECT_CULL];
    const bool cull = mode != CSM_CULL_NONE;
    if (cull) {
        /* points may lie outside the picture, where casters matter that the picture does not miss
         */
        bool whole = desc->outputs & CSM_OUT_POINTS;
        csm_cull_volume_make(&frame->out->cascades, cascade, &desc->camera,
                             settings->effects[CSM_EFFECT_SELECT], cull_margin_texels(settings),
                             whole, &volume);
    }
    if (mode == CSM_CULL_EXCLUSIVE) {
        csm_cull_volume_exclude(&frame->out->cascades, cascade, unanswered_texels(settings),
                                &volume);
    }
    size_t in_finer;
    size_t kept = csm_cull_items(geometry, cull ? &volume : NULL, items, &in_finer);
    frame->out->items_in_finer[cascade] = (int)in_finer;
    csm_status status = csm_draw_list_fill(frame->renderer, desc->scene, items, kept, err);
    free(items);
    frame->out->items_drawn[cascade] = frame->renderer->draws.item_count;
    frame->out->triangles_drawn[cascade] = frame->renderer->draws.triangle_count;
    return status;
}

csm_status csm_pass_shadow_map(csm_frame *frame, int cascade, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const float farthest = 1.0f;
    int size = frame->settings.map_size[cascade];
    GLuint program;

    csm_status status = csm_program_get(frame, CSM_STEP_SHADOW_MAP, &program, err);
    if (status == CSM_OK) {
        status = fill_draw_list(frame, cascade, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    csm_timer_start(renderer);
    GLuint framebuffer = renderer->map_framebuffer;
    gl->NamedFramebufferTextureLayer(framebuffer, GL_DEPTH_ATTACHMENT,
                                     renderer->targets[CSM_TARGET_SHADOW_MAPS].texture, 0, cascade);
    gl->BindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    gl->Viewport(0, 0, size, size);
    if (frame->settings.effects[CSM_EFFECT_PANCAKE]) {
        gl->Enable(GL_DEPTH_CLAMP);
    } else {
        gl->Disable(GL_DEPTH_CLAMP);
    }
    gl->Enable(GL_DEPTH_TEST);
    gl->DepthFunc(GL_LESS);
    /* a smaller map is a corner of its layer, and alone is cleared and drawn */
    if (size < renderer->targets[CSM_TARGET_SHADOW_MAPS].wanted.width) {
        gl->Scissor(0, 0, size, size);
        gl->Enable(GL_SCISSOR_TEST);
    }
    gl->ClearNamedFramebufferfv(framebuffer, GL_DEPTH, 0, &farthest);
    gl->UseProgram(program);
    gl->Uniform1i(0, cascade);
    if (renderer->draws.command_count) {
        status = csm_draw_list_submit(frame, frame->desc->scene, err);
    }
    gl->Disable(GL_SCISSOR_TEST);
    csm_timer_stop(renderer, frame->out, timing_names[cascade]);
    return status;
}
