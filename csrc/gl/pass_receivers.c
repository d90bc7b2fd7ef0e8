/* pass_receivers.c: what the camera sees that faces the sun, summed up for the fit.
 *
 * The view's pixels are taken in runs of a column; each gives its range of depths, or a light-space
 * box per cascade. The host reads what they give, a few megabytes at most, and core turns it into
 * splits and windows.
 */
#include "gl_internal.h"

#include <math.h>
#include <string.h>

#define GROUP 64 /* runs in a work group: the shaders' local size */
#define BLOCK_OUTPUT 7

static csm_status reduce(csm_frame *frame, csm_pass pass, const char *timing, int kind,
                         size_t bytes, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const csm_camera *camera = &frame->desc->camera;
    GLuint program;
    csm_status status = csm_program_get(frame, pass, &program, err);
    if (status == CSM_OK) {
        status = csm_host_buffer_fit(renderer, kind, bytes, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    GLuint buffer = renderer->buffers[kind].name;
    if (pass == CSM_STEP_RECEIVER_RANGE) { /* the histogram adds up */
        gl->ClearNamedBufferSubData(buffer, GL_R32UI, 0, CSM_DEPTH_BINS * sizeof(uint32_t),
                                    GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
        gl->MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    }
    csm_bind_view_inputs(frame);
    gl->BindBufferRange(GL_SHADER_STORAGE_BUFFER, BLOCK_OUTPUT, buffer, 0, (GLsizeiptr)bytes);
    gl->UseProgram(program);
    csm_timer_start(frame);
    const size_t runs = csm_receiver_runs(camera->width, camera->height);
    gl->DispatchCompute((GLuint)((runs + GROUP - 1) / GROUP), 1, 1);
    gl->MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    csm_timer_stop(frame, timing);
    csm_host_buffers_fetch(renderer);
    return CSM_OK;
}

csm_status csm_pass_receiver_range(csm_frame *frame, csm_error *err) {
    const csm_camera *camera = &frame->desc->camera;
    csm_receivers *receivers = &frame->receivers;
    csm_status status =
        reduce(frame, CSM_STEP_RECEIVER_RANGE, "receiver_range", CSM_BUFFER_RECEIVER_RANGE,
               csm_receiver_range_bytes(camera->width, camera->height), err);
    if (status != CSM_OK) {
        return status;
    }
    const uint32_t *mapped = frame->renderer->buffers[CSM_BUFFER_RECEIVER_RANGE].mapped;
    const float *ranges = (const float *)(mapped + CSM_DEPTH_BINS);
    receivers->depth_histogram = mapped;
    receivers->depth_range[0] = INFINITY;
    receivers->depth_range[1] = -INFINITY;
    for (size_t i = 0; i < csm_receiver_runs(camera->width, camera->height); i++) {
        receivers->depth_range[0] = fmin(receivers->depth_range[0], ranges[2 * i]);
        receivers->depth_range[1] = fmax(receivers->depth_range[1], ranges[2 * i + 1]);
    }
    receivers->seen = receivers->depth_range[0] <= receivers->depth_range[1];
    return CSM_OK;
}

/* A second time with the axes turned: the boxes of the first tell the angles well enough, but a
 * box turned is looser than one taken along the turned axes. */
static csm_status turn_axes(csm_frame *frame, const csm_cascades_desc *fit, csm_error *err) {
    csm_receivers *receivers = &frame->receivers;
    csm_status status = csm_receivers_turns(fit, &frame->out->cascades, receivers->turns, err);
    for (int i = 0; status == CSM_OK && i < frame->out->cascades.count; i++) {
        frame->uniforms.turn[i][0] = (float)cos(receivers->turns[i]);
        frame->uniforms.turn[i][1] = (float)sin(receivers->turns[i]);
    }
    receivers->turned = true;
    return status;
}

csm_status csm_pass_receiver_bounds(csm_frame *frame, csm_error *err) {
    const csm_camera *camera = &frame->desc->camera;
    csm_receivers *receivers = &frame->receivers;
    const bool again = receivers->boxes != NULL;
    csm_settings settings;
    const csm_cascades_desc fit = csm_frame_fit_desc(frame, &settings);
    csm_status status;
    if (again) {
        status = turn_axes(frame, &fit, err);
    } else {
        status = csm_cascades_place(&fit, &frame->out->cascades, err);
        csm_frame_write_light(frame);
        for (int i = 0; i < CSM_MAX_CASCADES; i++) {
            frame->uniforms.turn[i][0] = 1.0f;
        }
    }
    if (status != CSM_OK) {
        return status;
    }
    csm_frame_upload_uniforms(frame);
    status = reduce(
        frame, CSM_STEP_RECEIVER_BOUNDS, again ? "receiver_bounds_turned" : "receiver_bounds",
        CSM_BUFFER_RECEIVER_BOUNDS,
        csm_receiver_bounds_bytes(camera->width, camera->height, frame->out->cascades.count), err);
    if (status == CSM_OK) {
        receivers->boxes = frame->renderer->buffers[CSM_BUFFER_RECEIVER_BOUNDS].mapped;
        memcpy(receivers->box_origin, frame->desc->scene->origin, sizeof receivers->box_origin);
        receivers->box_count = csm_receiver_runs(camera->width, camera->height);
    }
    return status;
}
