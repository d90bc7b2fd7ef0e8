/* pass_shadow_map.c: the casters of one cascade into its layer of the depth array. */
#include "gl_internal.h"

#include <math.h>
#include <stdlib.h>

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
        if (frame->moments.kind > CSM_LOOKS_AT_DEPTHS) {
            volume.lowest_z = -INFINITY; /* means are of what lies behind receivers too */
        }
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

csm_place csm_map_attach(csm_frame *frame, int cascade) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const GLuint framebuffer = renderer->map_framebuffer;
    const csm_target *targets = renderer->targets;
    const csm_target *maps = &targets[CSM_TARGET_SHADOW_MAPS];
    const csm_place place = frame->places[cascade];
    switch (frame->settings.effects[CSM_EFFECT_STORAGE]) {
    case CSM_STORAGE_ATLAS:
        gl->NamedFramebufferTexture(framebuffer, GL_DEPTH_ATTACHMENT, maps->texture, 0);
        break;
    case CSM_STORAGE_SEPARATE:
        gl->NamedFramebufferTexture(framebuffer, GL_DEPTH_ATTACHMENT,
                                    targets[CSM_TARGET_SEPARATE + place.layer].texture, 0);
        break;
    default: /* one layer may serve all cascades in turn */
        gl->NamedFramebufferTextureLayer(framebuffer, GL_DEPTH_ATTACHMENT, maps->texture, 0,
                                         maps->wanted.layers > 1 ? place.layer : 0);
    }
    return place;
}

/* What casters are drawn into: the map's place, or a texture of its own that is copied there. */
static csm_place attach_target(csm_frame *frame, int cascade) {
    csm_renderer *renderer = frame->renderer;
    const csm_target *targets = renderer->targets;
    csm_place place = frame->places[cascade];
    GLuint texture = targets[CSM_TARGET_SHADOW_SAMPLES].texture;
    if (!texture) {
        texture = targets[CSM_TARGET_SHADOW_TILE].texture;
    }
    if (!texture) {
        return csm_map_attach(frame, cascade);
    }
    renderer->gl.NamedFramebufferTexture(renderer->map_framebuffer, GL_DEPTH_ATTACHMENT, texture,
                                         0);
    place.x = place.y = 0;
    return place;
}

static void copy_to_place(csm_frame *frame, int cascade) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const csm_target *targets = renderer->targets;
    const csm_place place = frame->places[cascade];
    if (targets[CSM_TARGET_SHADOW_TILE].texture) {
        gl->CopyImageSubData(targets[CSM_TARGET_SHADOW_TILE].texture, GL_TEXTURE_2D, 0, 0, 0, 0,
                             targets[CSM_TARGET_SHADOW_MAPS].texture, GL_TEXTURE_2D, 0, place.x,
                             place.y, 0, place.size, place.size, 1);
    }
    if (targets[CSM_TARGET_SHADOW_SAMPLES].texture && targets[CSM_TARGET_SHADOW_MAPS].texture) {
        /* of several samples the driver keeps one: what comes out as shadow_maps */
        const GLuint from = renderer->filter_framebuffer;
        gl->NamedFramebufferTexture(from, GL_COLOR_ATTACHMENT0, 0, 0);
        gl->NamedFramebufferTexture(from, GL_DEPTH_ATTACHMENT,
                                    targets[CSM_TARGET_SHADOW_SAMPLES].texture, 0);
        csm_map_attach(frame, cascade);
        gl->BlitNamedFramebuffer(from, renderer->map_framebuffer, 0, 0, place.size, place.size, 0,
                                 0, place.size, place.size, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
        gl->NamedFramebufferTexture(from, GL_DEPTH_ATTACHMENT, 0, 0);
    }
}

static void set_state(csm_frame *frame, const csm_place *place) {
    const GladGLContext *gl = &frame->renderer->gl;
    const int *effects = frame->settings.effects;
    const bool reversed = effects[CSM_EFFECT_REVERSED_DEPTH];
    const float farthest = reversed ? 0.0f : 1.0f;
    const int faces = effects[CSM_EFFECT_CASTER_FACES];
    gl->BindFramebuffer(GL_FRAMEBUFFER, frame->renderer->map_framebuffer);
    gl->Viewport(place->x, place->y, place->size, place->size);
    (effects[CSM_EFFECT_PANCAKE] ? gl->Enable : gl->Disable)(GL_DEPTH_CLAMP);
    gl->Enable(GL_DEPTH_TEST);
    gl->DepthFunc(reversed ? GL_GREATER : GL_LESS);
    if (faces != CSM_CASTER_FACES_BOTH) {
        gl->Enable(GL_CULL_FACE);
        gl->CullFace(faces == CSM_CASTER_FACES_FRONT ? GL_BACK : GL_FRONT);
    }
    /* a map that is a part of its texture is cleared and drawn alone */
    gl->Scissor(place->x, place->y, place->size, place->size);
    gl->Enable(GL_SCISSOR_TEST);
    gl->ClearNamedFramebufferfv(frame->renderer->map_framebuffer, GL_DEPTH, 0, &farthest);
}

/* Borders of tiles are empty: cleared once a frame, with the whole atlas. */
static void clear_borders(csm_frame *frame) {
    const GladGLContext *gl = &frame->renderer->gl;
    const float farthest = frame->settings.effects[CSM_EFFECT_REVERSED_DEPTH] ? 0.0f : 1.0f;
    csm_map_attach(frame, 0);
    gl->ClearNamedFramebufferfv(frame->renderer->map_framebuffer, GL_DEPTH, 0, &farthest);
}

csm_status csm_pass_shadow_map(csm_frame *frame, int cascade, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    GLuint programs[2];

    csm_status status = csm_program_get_drawing(frame, CSM_STEP_SHADOW_MAP, programs, err);
    if (status == CSM_OK) {
        status = fill_draw_list(frame, cascade, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    csm_timer_start(renderer);
    if (cascade == 0 && frame->settings.effects[CSM_EFFECT_TILE_BORDER]) {
        clear_borders(frame);
    }
    const csm_place place = attach_target(frame, cascade);
    set_state(frame, &place);
    for (int i = 0; i < 2; i++) {
        gl->ProgramUniform1i(programs[i], 0, cascade);
        if (frame->settings.effects[CSM_EFFECT_WARPED]) {
            gl->ProgramUniform1i(programs[i], 1, place.y);
        }
    }
    if (renderer->draws.command_count) {
        status = csm_draw_list_submit(frame, frame->desc->scene, programs, err);
    }
    gl->Disable(GL_SCISSOR_TEST);
    gl->Disable(GL_CULL_FACE);
    copy_to_place(frame, cascade);
    csm_timer_stop(renderer, frame->out, csm_step_name(CSM_STEP_SHADOW_MAP, cascade));
    return status;
}
