/* pass_shadow_mask.c: visibility of every pixel, in compute or by a full-screen triangle, or of any
 * points, in compute.
 *
 * On software GL compute into a mapped buffer takes 0.6 of the time of a full-screen triangle, on a
 * GPU less than a tenth (docs/architecture.md). Work goes in bands, so that a stop is noticed
 * between them.
 */
#include "gl_internal.h"

#include <string.h>

#define GROUP_WIDTH 128 /* 16 invocations of 8 pixels: shadow_mask.comp */
#define GROUP_HEIGHT 8
#define POINT_GROUP 256
#define MAX_GROUPS 65535
#define BAND_TAPS (1 << 26) /* compares between two looks at the stop callback */

enum { BLOCK_INSTANCES, BLOCK_POINTS, BLOCK_OUTPUT };
enum { UNIT_IDS, UNIT_MAPS, UNIT_COMPARE, UNIT_PLANES, UNIT_MOMENTS, UNIT_SEPARATE = 8 };

void csm_bind_view_inputs(csm_frame *frame) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const csm_gpu_scene *scene = frame->desc->scene;
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, BLOCK_INSTANCES, scene->instances);
    gl->BindTextureUnit(UNIT_IDS, renderer->targets[CSM_TARGET_VIEW_IDS].texture);
    gl->BindTextureUnit(UNIT_PLANES, scene->plane_texture);
    gl->BindSampler(UNIT_IDS, renderer->nearest_sampler);
}

/* Compares by the hardware in the order of the depths. */
static void set_compare(csm_frame *frame) {
    const bool reversed = frame->settings.effects[CSM_EFFECT_REVERSED_DEPTH];
    frame->renderer->gl.SamplerParameteri(frame->renderer->compare_sampler, GL_TEXTURE_COMPARE_FUNC,
                                          reversed ? GL_GEQUAL : GL_LEQUAL);
}

static void bind_separate(csm_frame *frame, GLuint unit, int cascade) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const bool compared = frame->settings.effects[CSM_EFFECT_FILTER] == CSM_FILTER_PCF &&
                          frame->settings.effects[CSM_EFFECT_FILTER_SIZE] == 2;
    gl->BindTextureUnit(unit, renderer->targets[CSM_TARGET_SEPARATE + cascade].texture);
    gl->BindSampler(unit, compared ? renderer->compare_sampler : renderer->nearest_sampler);
}

void csm_bind_maps(csm_frame *frame) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const GLuint maps = renderer->targets[CSM_TARGET_SHADOW_MAPS].texture;
    set_compare(frame);
    gl->BindTextureUnit(UNIT_MAPS, maps);
    gl->BindSampler(UNIT_MAPS, renderer->nearest_sampler);
    gl->BindTextureUnit(UNIT_COMPARE, maps);
    /* a compare sampler without a depth texture is undefined, even if no shader reads it */
    gl->BindSampler(UNIT_COMPARE, maps ? renderer->compare_sampler : renderer->nearest_sampler);
    if (frame->settings.effects[CSM_EFFECT_STORAGE] == CSM_STORAGE_SEPARATE) {
        for (int i = 0; i < frame->settings.effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
            bind_separate(frame, (GLuint)(UNIT_SEPARATE + i), i);
        }
    }
}

int csm_bind_map(csm_frame *frame, int cascade) {
    const csm_target *maps = &frame->renderer->targets[CSM_TARGET_SHADOW_MAPS];
    csm_bind_maps(frame);
    if (frame->settings.effects[CSM_EFFECT_STORAGE] == CSM_STORAGE_SEPARATE) {
        bind_separate(frame, UNIT_SEPARATE, cascade);
        return 0;
    }
    return maps->wanted.kind == CSM_TEXTURE_ARRAY && maps->wanted.layers == 1 ? 0 : cascade;
}

void csm_bind_looked_up(csm_frame *frame) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const GLuint moments = renderer->targets[CSM_TARGET_MOMENTS].texture;
    csm_bind_maps(frame);
    gl->BindTextureUnit(UNIT_MOMENTS, moments);
    gl->BindSampler(UNIT_MOMENTS, frame->moments.kind == CSM_LOOKS_AT_MOMENTS
                                      ? renderer->moments_sampler
                                      : renderer->nearest_sampler);
}

void csm_mask_bind_inputs(csm_frame *frame) {
    csm_bind_view_inputs(frame);
    csm_bind_looked_up(frame);
}

void csm_mask_set_image(csm_frame *frame, int first, int points) {
    const csm_camera *camera = &frame->desc->camera;
    const int32_t image[4] = {camera->width, camera->height, first, points};
    frame->renderer->gl.NamedBufferSubData(
        frame->renderer->frame_uniforms, offsetof(csm_frame_uniforms, image), sizeof image, image);
}

/* Buffers for the outputs asked for; one output buffer per kind at BLOCK_OUTPUT + kind. */
csm_status csm_mask_bind_outputs(csm_frame *frame, csm_error *err) {
    static const struct {
        unsigned output;
        int kind, bytes;
    } wanted[] = {
        {CSM_OUT_MASK, CSM_BUFFER_MASK, 4},
        {CSM_OUT_MASK_SINGLE, CSM_BUFFER_MASK_SINGLE, 4},
        {CSM_OUT_VALID | CSM_OUT_CASCADE_INDEX, CSM_BUFFER_INDEX, 4},
        {CSM_OUT_VIEW_DEPTH, CSM_BUFFER_DEPTH, 4},
        {CSM_OUT_NORMAL, CSM_BUFFER_NORMAL, 12},
    };
    csm_renderer *renderer = frame->renderer;
    size_t pixels = (size_t)frame->desc->camera.width * (size_t)frame->desc->camera.height;
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        if (!(frame->plan.outputs & wanted[i].output)) {
            continue;
        }
        size_t bytes = pixels * (size_t)wanted[i].bytes;
        csm_status status = csm_host_buffer_fit(renderer, wanted[i].kind, bytes, err);
        if (status != CSM_OK) {
            return status;
        }
        renderer->gl.BindBufferRange(GL_SHADER_STORAGE_BUFFER,
                                     (GLuint)(BLOCK_OUTPUT + wanted[i].kind),
                                     renderer->buffers[wanted[i].kind].name, 0, (GLsizeiptr)bytes);
    }
    return CSM_OK;
}

void csm_no_attachment(csm_frame *frame) {
    const GladGLContext *gl = &frame->renderer->gl;
    const csm_camera *camera = &frame->desc->camera;
    const GLuint framebuffer = frame->renderer->map_framebuffer;
    gl->NamedFramebufferTexture(framebuffer, GL_DEPTH_ATTACHMENT, 0, 0);
    gl->NamedFramebufferParameteri(framebuffer, GL_FRAMEBUFFER_DEFAULT_WIDTH, camera->width);
    gl->NamedFramebufferParameteri(framebuffer, GL_FRAMEBUFFER_DEFAULT_HEIGHT, camera->height);
    gl->BindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    gl->Viewport(0, 0, camera->width, camera->height);
}

/* The fragment entry: it writes the same buffers, so nothing is drawn but them. */
static void cover_rows(csm_frame *frame, int first, int rows) {
    const GladGLContext *gl = &frame->renderer->gl;
    csm_no_attachment(frame);
    gl->Scissor(0, first, frame->desc->camera.width, rows);
    gl->Enable(GL_SCISSOR_TEST);
    csm_cover_pixels(frame->renderer);
    gl->Disable(GL_SCISSOR_TEST);
}

csm_status csm_pass_shadow_mask(csm_frame *frame, csm_error *err) {
    const bool fragment = frame->settings.effects[CSM_EFFECT_STAGE] == CSM_STAGE_FRAGMENT;
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    int width = frame->desc->camera.width, height = frame->desc->camera.height;
    GLuint program;
    csm_status status = csm_program_get(frame, CSM_STEP_SHADOW_MASK, &program, err);
    if (status == CSM_OK) {
        status = csm_mask_bind_outputs(frame, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    csm_mask_bind_inputs(frame);
    gl->UseProgram(program);
    int64_t taps_per_row = (int64_t)width * csm_settings_taps(&frame->settings);
    int band = (int)(BAND_TAPS / taps_per_row) / GROUP_HEIGHT * GROUP_HEIGHT;
    band = band < GROUP_HEIGHT ? GROUP_HEIGHT : band;
    csm_timer_start(frame);
    for (int first = 0; first < height; first += band) {
        int rows = height - first < band ? height - first : band;
        if (first > 0 && csm_frame_stopped_after_finish(frame)) {
            status = csm_interrupted(err);
            break;
        }
        csm_mask_set_image(frame, first, 0);
        if (fragment) {
            cover_rows(frame, first, rows);
        } else {
            gl->DispatchCompute((GLuint)((width + GROUP_WIDTH - 1) / GROUP_WIDTH),
                                (GLuint)((rows + GROUP_HEIGHT - 1) / GROUP_HEIGHT), 1);
        }
    }
    gl->MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    csm_timer_stop(frame, "shadow_mask");
    return status;
}

/* Points arrive as the difference to the scene's origin, subtracted in double. */
static csm_status upload_points(csm_frame *frame, GLsizeiptr bytes, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const csm_render_desc *desc = frame->desc;
    if (bytes > renderer->info.max_buffer_bytes) {
        return csm_fail(err, CSM_ERROR_LIMIT, "%zu points need %lld bytes, the driver allows %lld",
                        desc->point_count, (long long)bytes,
                        (long long)renderer->info.max_buffer_bytes);
    }
    if (renderer->points_in_size < bytes) {
        csm_buffer_drop(renderer, &renderer->points_in);
        renderer->points_in = csm_buffer_make(renderer, "points in", bytes, NULL, GL_MAP_WRITE_BIT);
        renderer->points_in_size = bytes;
    }
    float *mapped = gl->MapNamedBufferRange(renderer->points_in, 0, bytes,
                                            GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
    if (!mapped) {
        csm_buffer_drop(renderer, &renderer->points_in);
        renderer->points_in_size = 0;
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu points",
                        desc->point_count);
    }
    for (size_t i = 0; i < 3 * desc->point_count; i++) {
        float *out = mapped + 6 * (i / 3) + i % 3;
        out[0] = (float)(desc->points[i] - frame->origin[i % 3]);
        out[3] = desc->point_normals ? (float)desc->point_normals[i] : 0.0f;
    }
    gl->UnmapNamedBuffer(renderer->points_in);
    return CSM_OK;
}

csm_status csm_pass_shadow_points(csm_frame *frame, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    size_t count = frame->desc->point_count;
    GLsizeiptr in_bytes = (GLsizeiptr)(count * 6 * sizeof(float));
    size_t out_bytes = count * 4 * sizeof(float);
    GLuint program;
    csm_status status = csm_program_get(frame, CSM_STEP_SHADOW_POINTS, &program, err);
    if (status == CSM_OK && count) {
        status = upload_points(frame, in_bytes, err);
    }
    if (status == CSM_OK && count) {
        status = csm_host_buffer_fit(renderer, CSM_BUFFER_POINTS, out_bytes, err);
    }
    if (status != CSM_OK || !count) {
        return status;
    }
    csm_bind_looked_up(frame);
    gl->BindBufferRange(GL_SHADER_STORAGE_BUFFER, BLOCK_POINTS, renderer->points_in, 0, in_bytes);
    gl->BindBufferRange(GL_SHADER_STORAGE_BUFFER, BLOCK_OUTPUT + CSM_BUFFER_POINTS,
                        renderer->buffers[CSM_BUFFER_POINTS].name, 0, (GLsizeiptr)out_bytes);
    gl->UseProgram(program);
    csm_timer_start(frame);
    size_t band = (size_t)(BAND_TAPS / csm_settings_taps(&frame->settings)) / POINT_GROUP;
    band = (band < 1 ? 1 : band > MAX_GROUPS ? MAX_GROUPS : band) * POINT_GROUP;
    for (size_t first = 0; first < count; first += band) {
        size_t here = count - first < band ? count - first : band;
        if (first > 0 && csm_frame_stopped_after_finish(frame)) {
            status = csm_interrupted(err);
            break;
        }
        csm_mask_set_image(frame, (int)first, (int)count);
        gl->DispatchCompute((GLuint)((here + POINT_GROUP - 1) / POINT_GROUP), 1, 1);
    }
    gl->MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    csm_timer_stop(frame, "shadow_points");
    frame->out->bytes += out_bytes + (size_t)in_bytes;
    return status;
}
