/* pass_shadow_map.c: the casters of one cascade into its map, wherever that lies. */
#include "gl_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { UNIFORM_CASCADE, UNIFORM_CORNER, UNIFORM_BIAS };

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

/* What a cascade draws. Front faces of mirrored items run the other way round: where the side
 * matters they come last and are drawn apart. */
typedef struct caster_list {
    uint32_t *items;
    size_t count, upright;
} caster_list;

static void part_mirrored(const csm_geometry *geometry, uint32_t *spare, caster_list *casters) {
    size_t mirrored = 0;
    casters->upright = 0;
    for (size_t i = 0; i < casters->count; i++) {
        const uint32_t item = casters->items[i];
        if (geometry->items[item].mirrored) {
            spare[mirrored++] = item;
        } else {
            casters->items[casters->upright++] = item;
        }
    }
    memcpy(casters->items + casters->upright, spare, mirrored * sizeof *spare);
}

void csm_casters_cull(csm_frame *frame, int cascade, uint32_t *out_items, size_t *out_count) {
    const csm_render_desc *desc = frame->desc;
    const csm_settings *settings = &frame->settings;
    csm_cull_volume volume;
    const int mode = settings->effects[CSM_EFFECT_CULL];
    const bool cull = mode != CSM_CULL_NONE;
    const double band = csm_settings_band(settings);
    if (cull) {
        /* points may lie outside the picture, where casters matter that the picture does not miss
         */
        bool whole = desc->outputs & CSM_OUT_POINTS;
        csm_cull_volume_make(&frame->out->cascades, cascade, &desc->camera,
                             settings->effects[CSM_EFFECT_SELECT], band,
                             cull_margin_texels(settings), whole, &volume);
        if (frame->moments.kind > CSM_LOOKS_AT_DEPTHS) {
            volume.lowest_z = -INFINITY; /* means are of what lies behind receivers too */
        }
    }
    if (mode == CSM_CULL_EXCLUSIVE) {
        csm_cull_volume_exclude(&frame->out->cascades, cascade, unanswered_texels(settings), band,
                                &volume);
    }
    size_t in_finer;
    *out_count =
        csm_cull_items(&desc->scene->geometry, cull ? &volume : NULL, out_items, &in_finer);
    frame->out->items_in_finer[cascade] = (int)in_finer;
}

static csm_status fill_draw_list(csm_frame *frame, int cascade, const uint32_t *items, size_t count,
                                 csm_error *err) {
    csm_status status = csm_draw_list_fill(frame->renderer, frame->desc->scene, items, count, err);
    frame->out->items_drawn[cascade] += frame->renderer->draws.item_count;
    frame->out->triangles_drawn[cascade] += frame->renderer->draws.triangle_count;
    return status;
}

static csm_status submit(csm_frame *frame, const GLuint programs[2], csm_error *err) {
    return frame->renderer->draws.command_count
               ? csm_draw_list_submit(frame, frame->desc->scene, programs, err)
               : CSM_OK;
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
    gl->Enable(GL_SCISSOR_TEST); /* what is a part of its texture is cleared and drawn alone */
}

/* Borders of tiles are empty: cleared once a frame, with the whole atlas; nothing is drawn there,
 * so they still are while a tile is kept. */
static void clear_borders(csm_frame *frame) {
    const GladGLContext *gl = &frame->renderer->gl;
    for (int i = 0; i < CSM_MAX_CASCADES; i++) {
        if (frame->renderer->kept.held[i]) {
            return;
        }
    }
    const float farthest = frame->settings.effects[CSM_EFFECT_REVERSED_DEPTH] ? 0.0f : 1.0f;
    csm_map_attach(frame, 0);
    gl->ClearNamedFramebufferfv(frame->renderer->map_framebuffer, GL_DEPTH, 0, &farthest);
}

/* Biases on the side of the casters (docs/numerics.md 30): the constant one shifts depths in the
 * shader, exactly, since the unit of glPolygonOffset is none for float depths; the rasteriser adds
 * the slope's, or, where a warped map writes its own depth, the shader does. Shifted towards the
 * light depths stop at the near end, so what really lies before it is clipped by hand. */
static void set_bias(csm_frame *frame, int cascade, const GLuint programs[2]) {
    const GladGLContext *gl = &frame->renderer->gl;
    const int *effects = frame->settings.effects;
    const csm_bias bias = csm_settings_bias(&frame->settings);
    const csm_cascades *cascades = &frame->out->cascades;
    const double *texel = cascades->texel_size[cascade], *range = cascades->depth_range[cascade];
    if (effects[CSM_EFFECT_BIAS_SIDE] != CSM_BIAS_CASTER) {
        return;
    }
    const bool warped = effects[CSM_EFFECT_WARPED];
    const double metres = bias.caster_constant_texels * fmax(texel[0], texel[1]);
    const double constant = warped ? bias.caster_constant_texels : metres / (range[1] - range[0]);
    for (int i = 0; i < 2; i++) {
        gl->ProgramUniform2f(programs[i], UNIFORM_BIAS, (float)constant,
                             (float)bias.caster_slope_texels);
    }
    if (warped) {
        return;
    }
    const double sign = effects[CSM_EFFECT_REVERSED_DEPTH] ? -1.0 : 1.0;
    gl->Enable(GL_POLYGON_OFFSET_FILL);
    gl->PolygonOffset((float)(sign * bias.caster_slope_texels), 0.0f);
    if (!effects[CSM_EFFECT_PANCAKE]) {
        gl->Enable(GL_DEPTH_CLAMP);
        gl->Enable(GL_CLIP_DISTANCE0);
    }
}

static void reset_state(csm_frame *frame) {
    const GladGLContext *gl = &frame->renderer->gl;
    gl->Disable(GL_SCISSOR_TEST);
    gl->Disable(GL_CULL_FACE);
    gl->FrontFace(GL_CCW);
    gl->Disable(GL_POLYGON_OFFSET_FILL);
    gl->Disable(GL_CLIP_DISTANCE0);
}

/* Casters of a part of the map, by the scissor. */
static csm_status draw_part(csm_frame *frame, int cascade, const csm_place *place,
                            const csm_reuse_part *part, const GLuint programs[2], csm_error *err) {
    const GladGLContext *gl = &frame->renderer->gl;
    const csm_geometry *geometry = &frame->desc->scene->geometry;
    const float farthest = frame->settings.effects[CSM_EFFECT_REVERSED_DEPTH] ? 0.0f : 1.0f;
    const bool sided = frame->settings.effects[CSM_EFFECT_CASTER_FACES] != CSM_CASTER_FACES_BOTH;
    caster_list casters = {.count = part->item_count, .upright = part->item_count};
    casters.items = malloc(2 * part->item_count * sizeof *casters.items + 1);
    if (!casters.items) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to draw cascade %d", cascade);
    }
    memcpy(casters.items, part->items, part->item_count * sizeof *casters.items);
    if (sided) {
        part_mirrored(geometry, casters.items + part->item_count, &casters);
    }
    gl->Scissor(place->x + part->x, place->y + part->y, part->width, part->height);
    if (part->cleared) {
        gl->ClearNamedFramebufferfv(frame->renderer->map_framebuffer, GL_DEPTH, 0, &farthest);
    }
    gl->FrontFace(GL_CCW);
    csm_status status = fill_draw_list(frame, cascade, casters.items, casters.upright, err);
    status = status == CSM_OK ? submit(frame, programs, err) : status;
    if (status == CSM_OK && casters.upright < casters.count) {
        gl->FrontFace(GL_CW);
        status = fill_draw_list(frame, cascade, casters.items + casters.upright,
                                casters.count - casters.upright, err);
        status = status == CSM_OK ? submit(frame, programs, err) : status;
    }
    free(casters.items);
    return status;
}

static csm_status draw_parts(csm_frame *frame, int cascade, const csm_reuse *reuse,
                             const GLuint programs[2], csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    csm_status status = CSM_OK;
    csm_timer_start(frame);
    if (cascade == 0 && frame->settings.effects[CSM_EFFECT_TILE_BORDER]) {
        clear_borders(frame);
    }
    if (reuse->action == CSM_REUSE_SCROLL) {
        csm_kept_scroll(frame, cascade);
    }
    const csm_place place = attach_target(frame, cascade);
    set_state(frame, &place);
    for (int i = 0; i < 2; i++) {
        gl->ProgramUniform1i(programs[i], UNIFORM_CASCADE, cascade);
        if (frame->settings.effects[CSM_EFFECT_WARPED]) {
            gl->ProgramUniform2i(programs[i], UNIFORM_CORNER, place.x, place.y);
        }
    }
    set_bias(frame, cascade, programs);
    for (int i = 0; i < reuse->part_count && status == CSM_OK; i++) {
        status = draw_part(frame, cascade, &place, &reuse->parts[i], programs, err);
    }
    reset_state(frame);
    copy_to_place(frame, cascade);
    csm_timer_stop(frame, csm_step_name(CSM_STEP_SHADOW_MAP, cascade));
    return status;
}

/* All casters, where nothing may be kept. */
static csm_status draw_whole_map(csm_frame *frame, int cascade, const GLuint programs[2],
                                 csm_error *err) {
    const int size = frame->places[cascade].size;
    uint32_t *items = malloc(frame->desc->scene->geometry.item_count * sizeof *items);
    if (!items) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to cull cascade %d", cascade);
    }
    csm_reuse whole = {
        .action = CSM_REUSE_DRAW, .part_count = 1, .parts = {{0, 0, size, size, true, items, 0}}};
    csm_casters_cull(frame, cascade, items, &whole.parts[0].item_count);
    const csm_status status = draw_parts(frame, cascade, &whole, programs, err);
    free(items);
    return status;
}

csm_status csm_pass_shadow_map(csm_frame *frame, int cascade, csm_error *err) {
    GLuint programs[2];
    csm_kept_begin(frame, cascade);
    csm_status status = csm_program_get_drawing(frame, CSM_STEP_SHADOW_MAP, programs, err);
    if (status != CSM_OK) {
        return status;
    }
    if (!frame->work) {
        return draw_whole_map(frame, cascade, programs, err);
    }
    status = draw_parts(frame, cascade, &frame->work[cascade].reuse, programs, err);
    return status == CSM_OK ? csm_kept_note(frame, cascade, err) : status;
}
