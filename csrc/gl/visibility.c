/* visibility.c: points looked up in the maps of the last render, by the functions of its mask.
 *
 * Maps that hold only what shadows the picture are drawn whole first, once. Nothing that a frame
 * hands out or holds on to is touched, and the next frame draws its own maps.
 */
#include "gl_internal.h"

#include <string.h>

static csm_status check_last(const csm_renderer *renderer, csm_error *err) {
    const csm_last_render *last = &renderer->last;
    if (!last->done) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "visibility needs the maps of a render before it, on the same renderer, "
                        "that did not fail");
    }
    const bool shadowed = last->settings.effects[CSM_EFFECT_FILTER] != CSM_FILTER_NONE;
    if (shadowed && !last->whole && !last->scene) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "visibility needs the scene of the last render: its maps were culled to "
                        "the picture, and the scene to draw them whole is gone");
    }
    return CSM_OK;
}

/* Casters that the picture did not need, and what is made of the maps. */
static csm_status draw_whole(csm_frame *frame, csm_error *err) {
    csm_status status = csm_targets_fit(frame->renderer, &frame->plan, err);
    csm_draw_list_begin(frame->renderer, frame->desc->scene);
    for (int i = 0; i < frame->plan.step_count && status == CSM_OK; i++) {
        const csm_plan_step *step = &frame->plan.steps[i];
        if (step->pass < CSM_STEP_SHADOW_MAP || step->pass > CSM_STEP_SHADOW_MIPS) {
            continue;
        }
        status = csm_frame_stopped(frame) ? csm_interrupted(err) : CSM_OK;
        if (status == CSM_OK) {
            status = csm_frame_run_step(frame, step, err);
        }
    }
    /* half-drawn maps are nobody's */
    frame->renderer->last.done = frame->renderer->last.whole = status == CSM_OK;
    return status;
}

static csm_status look_up(csm_frame *frame, csm_error *err) {
    static const csm_plan_step points = {.pass = CSM_STEP_SHADOW_POINTS, .cascade = -1};
    csm_renderer *renderer = frame->renderer;
    for (int kind = 0; kind < CSM_BUFFER_COUNT; kind++) {
        renderer->buffers[kind].used = 0;
    }
    csm_frame_bind_uniforms(frame);
    csm_frame_upload_uniforms(frame);
    csm_status status = renderer->last.whole ? CSM_OK : draw_whole(frame, err);
    if (status == CSM_OK) {
        status = csm_frame_run_step(frame, &points, err);
    }
    if (status == CSM_OK) {
        csm_host_buffers_fetch(renderer);
    }
    return status;
}

static csm_status visibility_bound(csm_renderer *renderer, const csm_visibility_desc *wanted,
                                   csm_render_out *out, csm_error *err) {
    const csm_last_render *last = &renderer->last;
    csm_status status = check_last(renderer, err);
    if (status != CSM_OK) {
        return status;
    }
    csm_render_desc desc = {.scene = last->scene,
                            .camera = last->camera,
                            .angular_diameter = last->angular_diameter,
                            .settings = last->settings,
                            .outputs = last->outputs | CSM_OUT_POINTS,
                            .points = wanted->points,
                            .point_normals = wanted->normals,
                            .point_count = wanted->point_count,
                            .untimed = true, /* nobody gets its times */
                            .stop = wanted->stop,
                            .stop_user = wanted->stop_user};
    csm_frame frame = {.renderer = renderer,
                       .desc = &desc,
                       .out = out,
                       .settings = last->settings,
                       .uniforms = last->uniforms};
    memcpy(frame.origin, last->origin, sizeof frame.origin);
    out->cascades = last->cascades;
    status = csm_frame_plan(&frame, desc.outputs, err);
    if (status == CSM_OK && last->settings.effects[CSM_EFFECT_FILTER] != CSM_FILTER_NONE &&
        wanted->point_count) {
        status = look_up(&frame, err);
    }
    if (status == CSM_OK) {
        csm_points_read(&frame);
        status = csm_debug_check(renderer, "visibility", err);
    }
    return status;
}

csm_status csm_renderer_visibility(csm_renderer *renderer, const csm_visibility_desc *desc,
                                   float *out_mask, uint8_t *out_cascade, float *out_blend_weight,
                                   csm_error *err) {
    csm_saved_binding saved;
    csm_render_out out = {.point_visibility = out_mask,
                          .point_cascade = out_cascade,
                          .point_blend_weight = out_blend_weight};
    csm_status status = csm_renderer_enter(renderer, &saved, err);
    if (status == CSM_OK) {
        status = visibility_bound(renderer, desc, &out, err);
        csm_draw_list_distrust(renderer, status);
        csm_renderer_leave(renderer, &saved);
    }
    return status;
}
