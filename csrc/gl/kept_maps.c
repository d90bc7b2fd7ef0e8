/* kept_maps.c: shadow maps, and the camera's view, that stay from one render to the next.
 *
 * What every map in the targets holds is noted when it was drawn. Core chooses from the note and
 * what the next frame wants; whoever draws maps without noting, drops their textures or their scene
 * makes the notes void.
 */
#include "gl_internal.h"

#include <stdlib.h>
#include <string.h>

void csm_kept_forget(csm_renderer *renderer) {
    for (int i = 0; i < CSM_MAX_CASCADES; i++) {
        free(renderer->kept.items[i]);
    }
    memset(&renderer->kept, 0, sizeof renderer->kept);
}

void csm_kept_forget_view(csm_renderer *renderer) {
    renderer->view.scene = NULL;
}

bool csm_kept_shows(const csm_frame *frame) {
    const csm_kept_view *view = &frame->renderer->view;
    return frame->desc->reuse && view->scene == frame->desc->scene &&
           csm_camera_equal(&view->camera, &frame->desc->camera);
}

static csm_status choose(csm_frame *frame, int cascade, unsigned allowed, uint32_t *items,
                         csm_error *err) {
    const csm_kept_maps *kept = &frame->renderer->kept;
    const csm_geometry *geometry = &frame->desc->scene->geometry;
    csm_map_work *work = &frame->work[cascade];
    csm_map_content *wanted = &work->wanted;
    csm_map_content_make(&frame->out->cascades, cascade, &frame->desc->camera, &frame->settings,
                         wanted);
    csm_casters_cull(frame, cascade, items, &wanted->item_count);
    work->lists = malloc(5 * wanted->item_count * sizeof *items + 1);
    if (!work->lists) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to choose casters of cascade %d",
                        cascade);
    }
    memcpy(work->lists, items, wanted->item_count * sizeof *items);
    wanted->items = work->lists;
    csm_reuse_choose(geometry, &frame->out->cascades, cascade,
                     kept->held[cascade] ? &kept->content[cascade] : NULL, wanted, allowed,
                     work->lists + wanted->item_count, &work->reuse);
    return CSM_OK;
}

/* What is spared, for those who ask. */
static void tell(csm_frame *frame, int cascade) {
    const csm_map_work *work = &frame->work[cascade];
    const csm_geometry *geometry = &frame->desc->scene->geometry;
    csm_map_reuse *out = &frame->out->reused[cascade];
    out->action = work->reuse.action;
    memcpy(out->shift, work->reuse.shift, sizeof out->shift);
    out->texels_saved = (int64_t)work->wanted.map_size * work->wanted.map_size;
    out->triangles_saved =
        csm_items_triangles(geometry, work->wanted.items, work->wanted.item_count);
    for (int i = 0; i < work->reuse.part_count; i++) {
        const csm_reuse_part *part = &work->reuse.parts[i];
        out->texels_saved -= part->cleared ? (int64_t)part->width * part->height : 0;
        out->triangles_saved -= csm_items_triangles(geometry, part->items, part->item_count);
    }
}

csm_status csm_kept_choose(csm_frame *frame, csm_error *err) {
    csm_kept_maps *kept = &frame->renderer->kept;
    const csm_gpu_scene *scene = frame->desc->scene;
    if (kept->scene != scene || !csm_settings_equal(&kept->settings, &frame->settings)) {
        csm_kept_forget(frame->renderer);
        kept->scene = scene;
        kept->settings = frame->settings;
    }
    const unsigned allowed =
        csm_reuse_allowed(&frame->settings, frame->desc->reuse == CSM_REUSE_MAPS_SCROLLED);
    const int count = frame->settings.effects[CSM_EFFECT_CASCADE_COUNT];
    uint32_t *items = malloc(scene->geometry.item_count * sizeof *items);
    frame->work = calloc((size_t)count, sizeof *frame->work);
    csm_status status = items && frame->work ? CSM_OK
                                             : csm_fail(err, CSM_ERROR_OUT_OF_MEMORY,
                                                        "no memory to choose what is kept");
    for (int i = 0; i < count && status == CSM_OK; i++) {
        status = choose(frame, i, allowed, items, err);
        if (status == CSM_OK) {
            tell(frame, i);
            frame->out->reused_count = i + 1;
        }
    }
    free(items);
    return status;
}

void csm_kept_finish(csm_frame *frame) {
    for (int i = 0; frame->work && i < frame->settings.effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        free(frame->work[i].lists);
    }
    free(frame->work);
    frame->work = NULL;
}

bool csm_kept_whole(const csm_frame *frame, int cascade) {
    return frame->work && frame->work[cascade].reuse.action == CSM_REUSE_KEEP;
}

void csm_kept_begin(csm_frame *frame, int cascade) {
    if (frame->work) {
        frame->renderer->kept.held[cascade] = false;
    } else {
        csm_kept_forget(frame->renderer);
    }
}

csm_status csm_kept_note(csm_frame *frame, int cascade, csm_error *err) {
    csm_kept_maps *kept = &frame->renderer->kept;
    const csm_map_work *work = &frame->work[cascade];
    csm_map_content *content = &kept->content[cascade];
    const size_t before = work->reuse.action == CSM_REUSE_ADD ? content->item_count : 0;
    uint32_t *items = malloc((before + work->wanted.item_count) * sizeof *items + 1);
    if (!items) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to note the casters of cascade %d",
                        cascade);
    }
    const size_t count = csm_items_joined(kept->items[cascade], before, work->wanted.items,
                                          work->wanted.item_count, items);
    free(kept->items[cascade]);
    kept->items[cascade] = items;
    *content = work->wanted;
    content->items = items;
    content->item_count = count;
    kept->held[cascade] = true;
    return CSM_OK;
}

/* Through a texture of its own: a copy inside one must not overlap itself. */
void csm_kept_scroll(csm_frame *frame, int cascade) {
    csm_renderer *renderer = frame->renderer;
    const csm_target *maps = &renderer->targets[CSM_TARGET_SHADOW_MAPS];
    const csm_place place = frame->places[cascade];
    const int *shift = frame->work[cascade].reuse.shift;
    const int layer = maps->wanted.layers > 1 ? place.layer : 0;
    const GLuint between = renderer->targets[CSM_TARGET_SHADOW_SCROLL].texture;
    GLuint texture = maps->texture;
    GLenum kind = maps->wanted.kind == CSM_TEXTURE_ARRAY  ? GL_TEXTURE_2D_ARRAY
                  : maps->wanted.kind == CSM_TEXTURE_CUBE ? GL_TEXTURE_CUBE_MAP
                                                          : GL_TEXTURE_2D;
    if (frame->settings.effects[CSM_EFFECT_STORAGE] == CSM_STORAGE_SEPARATE) {
        texture = renderer->targets[CSM_TARGET_SEPARATE + place.layer].texture;
        kind = GL_TEXTURE_2D;
    }
    int from[2], to[2], sides[2];
    for (int axis = 0; axis < 2; axis++) {
        from[axis] = shift[axis] > 0 ? shift[axis] : 0;
        to[axis] = shift[axis] < 0 ? -shift[axis] : 0;
        sides[axis] = place.size - from[axis] - to[axis];
    }
    renderer->gl.CopyImageSubData(texture, kind, 0, place.x + from[0], place.y + from[1], layer,
                                  between, GL_TEXTURE_2D, 0, 0, 0, 0, sides[0], sides[1], 1);
    renderer->gl.CopyImageSubData(between, GL_TEXTURE_2D, 0, 0, 0, 0, texture, kind, 0,
                                  place.x + to[0], place.y + to[1], layer, sides[0], sides[1], 1);
}
