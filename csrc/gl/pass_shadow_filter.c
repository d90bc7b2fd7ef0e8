/* pass_shadow_filter.c: depths of one cascade to what a prefiltered filter looks up: moments, their
 * blur along x and y, their summed areas, and smaller levels of all.
 *
 * Every step is one function of a texel in GLSL with two thin entries: compute writes an image, a
 * fragment its attachment.
 */
#include "gl_internal.h"

#include <stdlib.h>

#define GROUP 8       /* invocations along a side of a work group: shadow_*.comp */
#define LINE_GROUP 64 /* lines of a work group: shadow_sum.comp */

enum { UNIT_SOURCE = 4, UNIT_SAMPLES = 5 };
enum { UNIFORM_PLACE, UNIFORM_STEP, UNIFORM_WRITTEN };
enum { IMAGE_TARGET };

typedef struct filter_texture {
    GLuint texture;
    int layer;
} filter_texture;

static filter_texture moments_of(const csm_frame *frame, int cascade, int slice) {
    return (filter_texture){frame->renderer->targets[CSM_TARGET_MOMENTS].texture,
                            cascade * frame->moments.slices + slice};
}

static filter_texture between(const csm_frame *frame) {
    return (filter_texture){frame->renderer->targets[CSM_TARGET_MOMENTS_BETWEEN].texture, 0};
}

/* Texels along a side that the last step writes: with smaller levels a map that is a part of its
 * layer goes on beyond its rim, so that no level takes in what lies there. */
static int filled_size(const csm_frame *frame, int size) {
    return frame->moments.mipmapped ? frame->renderer->targets[CSM_TARGET_MOMENTS].wanted.width
                                    : size;
}

static bool in_compute(const csm_frame *frame) {
    return frame->settings.effects[CSM_EFFECT_STAGE] == CSM_STAGE_COMPUTE;
}

static void dispatch_to(csm_frame *frame, filter_texture out, int across, int along) {
    const GladGLContext *gl = &frame->renderer->gl;
    gl->BindImageTexture(IMAGE_TARGET, out.texture, 0, GL_FALSE, out.layer, GL_WRITE_ONLY,
                         csm_format_named(frame->moments.format));
    gl->DispatchCompute((GLuint)across, (GLuint)along, 1);
    gl->MemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_SHADER_IMAGE_ACCESS_BARRIER_BIT |
                      GL_FRAMEBUFFER_BARRIER_BIT);
}

static void run_on_texels(csm_frame *frame, filter_texture out, int size) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    if (in_compute(frame)) {
        const int groups = (size + GROUP - 1) / GROUP;
        gl->Uniform1i(UNIFORM_WRITTEN, size);
        dispatch_to(frame, out, groups, groups);
        return;
    }
    gl->NamedFramebufferTextureLayer(renderer->filter_framebuffer, GL_COLOR_ATTACHMENT0,
                                     out.texture, 0, out.layer);
    gl->BindFramebuffer(GL_FRAMEBUFFER, renderer->filter_framebuffer);
    gl->Viewport(0, 0, size, size);
    csm_cover_pixels(renderer);
}

void csm_cover_pixels(csm_renderer *renderer) {
    const GladGLContext *gl = &renderer->gl;
    gl->Disable(GL_DEPTH_TEST);
    gl->Disable(GL_DEPTH_CLAMP);
    gl->BindVertexArray(renderer->no_vertices);
    gl->DrawArrays(GL_TRIANGLES, 0, 3);
}

csm_status csm_pass_shadow_moments(csm_frame *frame, int cascade, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const int size = frame->settings.map_size[cascade];
    GLuint program;
    csm_status status = csm_program_get(frame, CSM_STEP_SHADOW_MOMENTS, &program, err);
    if (status != CSM_OK) {
        return status;
    }
    const int written = frame->moments.blurred ? size : filled_size(frame, size);
    const int map = csm_bind_map(frame, cascade);
    gl->BindTextureUnit(UNIT_SAMPLES, renderer->targets[CSM_TARGET_SHADOW_SAMPLES].texture);
    gl->UseProgram(program);
    csm_timer_start(frame);
    for (int slice = 0; slice < frame->moments.slices; slice++) {
        gl->Uniform4i(UNIFORM_PLACE, cascade, slice, size, map);
        run_on_texels(frame, moments_of(frame, cascade, slice), written);
    }
    csm_timer_stop(frame, csm_step_name(CSM_STEP_SHADOW_MOMENTS, cascade));
    return status;
}

static void read_along(csm_frame *frame, filter_texture from, int size, int axis, int step,
                       int cascade) {
    const GladGLContext *gl = &frame->renderer->gl;
    gl->BindTextureUnit(UNIT_SOURCE, from.texture);
    gl->BindSampler(UNIT_SOURCE, frame->renderer->nearest_sampler);
    gl->Uniform4i(UNIFORM_PLACE, cascade, from.layer, size, 0);
    gl->Uniform2i(UNIFORM_STEP, axis == 0 ? step : 0, axis == 1 ? step : 0);
}

/* One step from a texture to another: reads around each texel along an axis, of size texels along a
 * side; what is written beyond them repeats the last. */
static void run_along(csm_frame *frame, filter_texture from, filter_texture to, int size,
                      int written, int axis, int step, int cascade) {
    read_along(frame, from, size, axis, step, cascade);
    run_on_texels(frame, to, written);
}

csm_status csm_pass_shadow_blur(csm_frame *frame, int cascade, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const int size = frame->settings.map_size[cascade];
    GLuint program;
    csm_status status = csm_program_get(frame, CSM_STEP_SHADOW_BLUR, &program, err);
    if (status != CSM_OK) {
        return status;
    }
    renderer->gl.UseProgram(program);
    csm_timer_start(frame);
    for (int slice = 0; slice < frame->moments.slices; slice++) {
        const filter_texture moments = moments_of(frame, cascade, slice);
        run_along(frame, moments, between(frame), size, size, 0, 1, cascade);
        run_along(frame, between(frame), moments, size, filled_size(frame, size), 1, 1, cascade);
        if (csm_frame_stopped_after_finish(frame)) {
            status = csm_interrupted(err);
            break;
        }
    }
    csm_timer_stop(frame, csm_step_name(CSM_STEP_SHADOW_BLUR, cascade));
    return status;
}

/* In compute an invocation sums up a whole line. Of fragments every step adds the eight sums that
 * end 0 to 7 strides before a texel; strides grow eightfold, until one step has seen the whole row.
 * As many steps along y as along x: the sums end up where the texels were. */
csm_status csm_pass_shadow_sum(csm_frame *frame, int cascade, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const int size = frame->settings.map_size[cascade];
    GLuint program;
    csm_status status = csm_program_get(frame, CSM_STEP_SHADOW_SUM, &program, err);
    if (status != CSM_OK) {
        return status;
    }
    renderer->gl.UseProgram(program);
    csm_timer_start(frame);
    filter_texture from = moments_of(frame, cascade, 0), to = between(frame);
    for (int axis = 0; axis < 2; axis++) {
        const int strides = in_compute(frame) ? 1 : size - 1;
        for (int stride = 1; stride <= strides; stride *= 8) {
            read_along(frame, from, size, axis, stride, cascade);
            if (in_compute(frame)) {
                dispatch_to(frame, to, (size + LINE_GROUP - 1) / LINE_GROUP, 1);
            } else {
                run_on_texels(frame, to, size);
            }
            const filter_texture swap = from;
            from = to;
            to = swap;
        }
    }
    csm_timer_stop(frame, csm_step_name(CSM_STEP_SHADOW_SUM, cascade));
    return status;
}

csm_status csm_pass_shadow_mips(csm_frame *frame, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    (void)err;
    csm_timer_start(frame);
    renderer->gl.GenerateTextureMipmap(renderer->targets[CSM_TARGET_MOMENTS].texture);
    csm_timer_stop(frame, csm_step_name(CSM_STEP_SHADOW_MIPS, -1));
    return CSM_OK;
}

/* A texel of summed areas, of 32 bits that wrap around: what the texel itself added, as depth from
 * -1/2 to 1/2 and its square. */
static bool read_sums(csm_frame *frame, int size, float *out) {
    const GladGLContext *gl = &frame->renderer->gl;
    const double step = 1.0 / (double)(float)frame->moments.sum_steps;
    uint32_t *sums = malloc((size_t)size * (size_t)size * 2 * sizeof *sums);
    if (!sums) {
        return false;
    }
    gl->ReadPixels(0, 0, size, size, GL_RG_INTEGER, GL_UNSIGNED_INT, sums);
    for (int y = 0; y < size; y++) {
        for (int x = 0; x < size; x++) {
            for (int channel = 0; channel < 2; channel++) {
                const size_t at = ((size_t)y * (size_t)size + (size_t)x) * 2 + (size_t)channel;
                const size_t row = (size_t)size * 2;
                uint32_t own = sums[at];
                own -= x > 0 ? sums[at - 2] : 0;
                own -= y > 0 ? sums[at - row] : 0;
                own += x > 0 && y > 0 ? sums[at - row - 2] : 0;
                out[at] = (float)(channel == 0 ? (int32_t)own * step : 0.25 * own * step);
            }
        }
    }
    free(sums);
    return true;
}

/* A row at a time: slices of a texel stand side by side outside. */
static bool read_slice(csm_frame *frame, int size, int slice, float *out) {
    static const GLenum formats[] = {GL_RED, GL_RG, GL_RGB, GL_RGBA};
    const csm_moments *moments = &frame->moments;
    const int stride = moments->channels * moments->slices;
    float *row = malloc((size_t)size * (size_t)moments->channels * sizeof *row);
    if (!row) {
        return false;
    }
    for (int y = 0; y < size; y++) {
        frame->renderer->gl.ReadPixels(0, y, size, 1, formats[moments->channels - 1], GL_FLOAT,
                                       row);
        for (int i = 0; i < size * moments->channels; i++) {
            const int x = i / moments->channels, channel = i % moments->channels;
            out[((size_t)y * (size_t)size + (size_t)x) * (size_t)stride +
                (size_t)(slice * moments->channels + channel)] = row[i];
        }
    }
    free(row);
    return true;
}

csm_status csm_moments_read(csm_frame *frame, int cascade, float *out, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    const csm_moments *moments = &frame->moments;
    const int size = frame->settings.map_size[cascade];
    bool read = true;
    gl->BindFramebuffer(GL_READ_FRAMEBUFFER, renderer->filter_framebuffer);
    for (int slice = 0; slice < moments->slices && read; slice++) {
        const filter_texture from = moments_of(frame, cascade, slice);
        gl->NamedFramebufferTextureLayer(renderer->filter_framebuffer, GL_COLOR_ATTACHMENT0,
                                         from.texture, 0, from.layer);
        read = moments->kind == CSM_LOOKS_AT_SUMS ? read_sums(frame, size, out)
                                                  : read_slice(frame, size, slice, out);
    }
    return read ? CSM_OK
                : csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to read moments of %d x %d",
                           size, size);
}
