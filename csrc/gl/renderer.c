/* renderer.c: owns the context and everything on it; executes a plan; reads back.
 *
 * Every entry takes the lock, binds the context, works, unbinds, restores what the thread had
 * bound.
 */
#include "gl_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define FACING_LIMIT 1e-5 /* receiver.glsl */

#define MAPS_AT_ONCE_BYTES ((size_t)64 << 20) /* four maps of 2048 x 2048 */

/* -- entering and leaving -------------------------------------------------------------------------
 */

static csm_status lock(csm_renderer *renderer, csm_error *err) {
    if (renderer->owner != getpid()) {
        return csm_fail(err, CSM_ERROR_CONTEXT_LOST,
                        "renderer was made before a fork: a context does not survive it, make "
                        "another in a process that was started anew");
    }
    if (pthread_mutex_lock(&renderer->lock)) {
        return csm_fail(
            err, CSM_ERROR_CONTEXT_LOST,
            "renderer is already at work in this thread (called from a signal handler?)");
    }
    return CSM_OK;
}

csm_status csm_renderer_enter(csm_renderer *renderer, csm_saved_binding *saved, csm_error *err) {
    const csm_status status = lock(renderer, err);
    if (status != CSM_OK) {
        return status;
    }
    csm_binding_save(saved);
    if (!csm_context_bind(&renderer->context)) {
        csm_binding_restore(saved);
        pthread_mutex_unlock(&renderer->lock);
        return csm_fail(err, CSM_ERROR_CONTEXT_LOST, "the driver refuses to bind the context");
    }
    return CSM_OK;
}

void csm_renderer_leave(csm_renderer *renderer, const csm_saved_binding *saved) {
    /* textures may go before the next draw, and drivers look at what a program in use samples */
    if (renderer->gl.VERSION_4_5) { /* not where the driver turned out to have less */
        renderer->gl.UseProgram(0);
    }
    /* a call that failed before its check must not fail the next one */
    csm_debug_check(renderer, "leaving", NULL);
    csm_context_unbind(&renderer->context);
    csm_binding_restore(saved);
    pthread_mutex_unlock(&renderer->lock);
}

/* -- making and destroying ------------------------------------------------------------------------
 */

static GLADapiproc load_for_glad(void *user, const char *name) {
    return (GLADapiproc)csm_context_load(*(const int *)user, name);
}

static void copy_string(const GladGLContext *gl, GLenum what, char *out, size_t size) {
    const char *text = (const char *)gl->GetString(what);
    snprintf(out, size, "%s", text ? text : "");
}

static void read_info(csm_renderer *renderer) {
    const GladGLContext *gl = &renderer->gl;
    csm_renderer_info *info = &renderer->info;
    GLint64 buffer_bytes = 0;
    info->backend = csm_backend_name(renderer->context.backend);
    snprintf(info->platform, sizeof info->platform, "%s", renderer->context.platform);
    copy_string(gl, GL_VENDOR, info->vendor, sizeof info->vendor);
    copy_string(gl, GL_RENDERER, info->renderer, sizeof info->renderer);
    copy_string(gl, GL_VERSION, info->version, sizeof info->version);
    copy_string(gl, GL_SHADING_LANGUAGE_VERSION, info->glsl, sizeof info->glsl);
    info->software = strstr(info->renderer, "llvmpipe") || strstr(info->renderer, "softpipe") ||
                     strstr(info->renderer, "swrast") || strstr(info->renderer, "Software");
    gl->GetIntegerv(GL_MAX_TEXTURE_SIZE, &info->max_texture_size);
    gl->GetIntegerv(GL_MAX_CUBE_MAP_TEXTURE_SIZE, &info->max_cube_size);
    gl->GetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &info->max_layers);
    gl->GetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &buffer_bytes);
    info->max_buffer_bytes = buffer_bytes;
    gl->GetIntegerv(GL_MAX_DEPTH_TEXTURE_SAMPLES, &info->max_samples);
}

static GLuint make_sampler(csm_renderer *renderer, GLenum filter, const char *label) {
    const GladGLContext *gl = &renderer->gl;
    GLuint name;
    gl->CreateSamplers(1, &name);
    gl->SamplerParameteri(name, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    gl->SamplerParameteri(name, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    gl->SamplerParameteri(name, GL_TEXTURE_MIN_FILTER, (GLint)filter);
    gl->SamplerParameteri(name, GL_TEXTURE_MAG_FILTER, (GLint)filter);
    csm_debug_label(renderer, GL_SAMPLER, name, label);
    renderer->info.live_objects++;
    return name;
}

static void make_samplers(csm_renderer *renderer) {
    const GladGLContext *gl = &renderer->gl;
    renderer->nearest_sampler = make_sampler(renderer, GL_NEAREST, "nearest");
    renderer->moments_sampler = make_sampler(renderer, GL_LINEAR, "moments");
    gl->SamplerParameteri(renderer->moments_sampler, GL_TEXTURE_MIN_FILTER,
                          GL_LINEAR_MIPMAP_LINEAR);
    renderer->compare_sampler = make_sampler(renderer, GL_LINEAR, "compare");
    gl->SamplerParameteri(renderer->compare_sampler, GL_TEXTURE_COMPARE_MODE,
                          GL_COMPARE_REF_TO_TEXTURE);
}

static GLuint make_framebuffer(csm_renderer *renderer, GLenum draws, const char *label) {
    const GladGLContext *gl = &renderer->gl;
    GLuint name;
    gl->CreateFramebuffers(1, &name);
    gl->NamedFramebufferDrawBuffer(name, draws);
    gl->NamedFramebufferReadBuffer(name, draws);
    csm_debug_label(renderer, GL_FRAMEBUFFER, name, label);
    renderer->info.live_objects++;
    return name;
}

static csm_status set_up(csm_renderer *renderer, csm_error *err) {
    GladGLContext *gl = &renderer->gl;
    if (!gladLoadGLContextUserPtr(gl, load_for_glad, &renderer->context.backend) ||
        !gl->VERSION_4_5) {
        return csm_fail(err, CSM_ERROR_NO_CONTEXT, "%s: the driver has no OpenGL 4.5",
                        csm_backend_name(renderer->context.backend));
    }
    csm_debug_start(renderer);
    read_info(renderer);
    gl->ClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    gl->PixelStorei(GL_PACK_ALIGNMENT, 1);
    gl->Enable(GL_TEXTURE_CUBE_MAP_SEAMLESS);
    renderer->view_framebuffer = make_framebuffer(renderer, GL_COLOR_ATTACHMENT0, "view");
    renderer->map_framebuffer = make_framebuffer(renderer, GL_NONE, "shadow_map");
    renderer->filter_framebuffer =
        make_framebuffer(renderer, GL_COLOR_ATTACHMENT0, "shadow_filter");
    make_samplers(renderer);
    gl->CreateVertexArrays(1, &renderer->no_vertices);
    csm_debug_label(renderer, GL_VERTEX_ARRAY, renderer->no_vertices, "no vertices");
    gl->CreateQueries(GL_TIME_ELAPSED, 1, &renderer->timer.query);
    renderer->timer.queries = !renderer->info.software;
    renderer->info.live_objects += 2;
    renderer->frame_uniforms = csm_buffer_make(renderer, "frame", sizeof(csm_frame_uniforms), NULL,
                                               GL_DYNAMIC_STORAGE_BIT);
    return csm_debug_check(renderer, "set-up", err);
}

static void tear_down(csm_renderer *renderer) {
    const GladGLContext *gl = &renderer->gl;
    while (renderer->scenes) {
        csm_gpu_scene_destroy(renderer, renderer->scenes);
    }
    csm_targets_drop(renderer);
    csm_kept_forget(renderer);
    csm_programs_drop(renderer);
    csm_draw_list_drop(renderer);
    csm_buffer_drop(renderer, &renderer->points_in);
    csm_buffer_drop(renderer, &renderer->frame_uniforms);
    csm_buffer_drop(renderer, &renderer->warp_uniforms);
    gl->DeleteFramebuffers(1, &renderer->view_framebuffer);
    gl->DeleteFramebuffers(1, &renderer->map_framebuffer);
    gl->DeleteFramebuffers(1, &renderer->filter_framebuffer);
    gl->DeleteSamplers(1, &renderer->nearest_sampler);
    gl->DeleteSamplers(1, &renderer->compare_sampler);
    gl->DeleteSamplers(1, &renderer->moments_sampler);
    gl->DeleteVertexArrays(1, &renderer->no_vertices);
    gl->DeleteQueries(1, &renderer->timer.query);
}

csm_status csm_renderer_create(const csm_renderer_desc *desc, csm_renderer **out, csm_error *err) {
    csm_saved_binding saved;
    pthread_mutexattr_t attributes;
    csm_renderer *renderer = calloc(1, sizeof *renderer);
    if (!renderer) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for a renderer");
    }
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_settype(&attributes, PTHREAD_MUTEX_ERRORCHECK);
    pthread_mutex_init(&renderer->lock, &attributes);
    pthread_mutexattr_destroy(&attributes);
    renderer->owner = getpid();
    renderer->debug = desc->debug;
    renderer->info.stage = CSM_STAGE_COMPUTE;
    renderer->read = desc->read;
    renderer->read_user = desc->read_user;

    csm_binding_save(&saved);
    csm_status status = csm_context_open(&renderer->context, desc->backend, desc->debug, err);
    csm_binding_restore(&saved);
    if (status == CSM_OK) {
        status = csm_renderer_enter(renderer, &saved, err);
        if (status == CSM_OK) {
            status = set_up(renderer, err);
            if (status != CSM_OK && renderer->gl.VERSION_4_5) {
                tear_down(renderer);
            }
            csm_renderer_leave(renderer, &saved);
        }
    }
    if (status != CSM_OK) {
        csm_context_close(&renderer->context);
        pthread_mutex_destroy(&renderer->lock);
        free(renderer);
        return status;
    }
    *out = renderer;
    return CSM_OK;
}

void csm_renderer_destroy(csm_renderer *renderer) {
    csm_saved_binding saved;
    if (!renderer) {
        return;
    }
    if (renderer->owner != getpid()) {
        return; /* the parent's context: not ours to touch, leak quietly */
    }
    if (csm_renderer_enter(renderer, &saved, NULL) == CSM_OK) {
        tear_down(renderer);
        csm_context_unbind(&renderer->context);
        csm_context_close(&renderer->context);
        csm_binding_restore(&saved);
        pthread_mutex_unlock(&renderer->lock);
        pthread_mutex_destroy(&renderer->lock);
        free(renderer);
    }
}

/* -- small entries --------------------------------------------------------------------------------
 */

csm_status csm_renderer_describe(csm_renderer *renderer, csm_renderer_info *out, csm_error *err) {
    const csm_status status = lock(renderer, err);
    if (status == CSM_OK) { /* what is known already: the driver is not asked */
        *out = renderer->info;
        pthread_mutex_unlock(&renderer->lock);
    }
    return status;
}

csm_status csm_renderer_set_stage(csm_renderer *renderer, int stage, csm_error *err) {
    csm_saved_binding saved;
    csm_status status = csm_renderer_enter(renderer, &saved, err);
    if (status == CSM_OK) {
        renderer->info.stage = stage;
        csm_renderer_leave(renderer, &saved);
    }
    return status;
}

csm_status csm_renderer_reload(csm_renderer *renderer, csm_error *err) {
    csm_saved_binding saved;
    csm_status status = csm_renderer_enter(renderer, &saved, err);
    if (status == CSM_OK) {
        csm_programs_drop(renderer);
        csm_kept_forget(renderer);
        csm_kept_forget_view(renderer);
        csm_renderer_leave(renderer, &saved);
    }
    return status;
}

csm_status csm_renderer_upload(csm_renderer *renderer, const csm_geometry *geometry,
                               const double origin[3], csm_gpu_scene **out, csm_error *err) {
    csm_saved_binding saved;
    csm_status status = csm_renderer_enter(renderer, &saved, err);
    if (status == CSM_OK) {
        status = csm_gpu_scene_make(renderer, geometry, origin, out, err);
        csm_renderer_leave(renderer, &saved);
    }
    return status;
}

csm_status csm_renderer_drop(csm_renderer *renderer, csm_gpu_scene *scene, csm_error *err) {
    csm_saved_binding saved;
    csm_status status = csm_renderer_enter(renderer, &saved, err);
    if (status == CSM_OK) {
        csm_gpu_scene_destroy(renderer, scene);
        csm_renderer_leave(renderer, &saved);
    }
    return status;
}

/* -- one frame ------------------------------------------------------------------------------------
 */

bool csm_frame_stopped(const csm_frame *frame) {
    return frame->desc->stop && frame->desc->stop(frame->desc->stop_user);
}

bool csm_frame_stopped_after_finish(const csm_frame *frame) {
    frame->renderer->gl.Finish();
    return csm_frame_stopped(frame);
}

csm_status csm_interrupted(csm_error *err) {
    return csm_fail(err, CSM_ERROR_INTERRUPTED, "%s", csm_status_text(CSM_ERROR_INTERRUPTED));
}

static bool all_kept(const csm_frame *frame) {
    bool kept = true;
    for (int i = 0; i < frame->settings.effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        kept = kept && csm_kept_whole(frame, i);
    }
    return kept;
}

csm_status csm_frame_run_step(csm_frame *frame, const csm_plan_step *step, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    csm_status status = CSM_OK;
    const char *name = csm_pass_name(step->pass);
    if (step->cascade >= 0 && csm_kept_whole(frame, step->cascade)) {
        return CSM_OK;
    }
    csm_debug_push(renderer, name);
    switch (step->pass) {
    case CSM_STEP_VIEW:
        status = csm_pass_view(frame, err);
        break;
    case CSM_STEP_RECEIVER_RANGE:
        status = csm_pass_receiver_range(frame, err);
        break;
    case CSM_STEP_RECEIVER_BOUNDS:
        status = csm_pass_receiver_bounds(frame, err);
        break;
    case CSM_STEP_SHADOW_MAP:
        status = csm_pass_shadow_map(frame, step->cascade, err);
        break;
    case CSM_STEP_SHADOW_MOMENTS:
        status = csm_pass_shadow_moments(frame, step->cascade, err);
        break;
    case CSM_STEP_SHADOW_BLUR:
        status = csm_pass_shadow_blur(frame, step->cascade, err);
        break;
    case CSM_STEP_SHADOW_SUM:
        status = csm_pass_shadow_sum(frame, step->cascade, err);
        break;
    case CSM_STEP_SHADOW_MIPS:
        status = all_kept(frame) ? CSM_OK : csm_pass_shadow_mips(frame, err);
        break;
    case CSM_STEP_SHADOW_MASK:
        status = csm_pass_shadow_mask(frame, err);
        break;
    case CSM_STEP_SHADOW_FORWARD:
        status = csm_pass_shadow_forward(frame, err);
        break;
    case CSM_STEP_SHADOW_POINTS:
        status = csm_pass_shadow_points(frame, err);
        break;
    case CSM_STEP_COUNT:
        break;
    }
    csm_debug_pop(renderer);
    return status == CSM_OK ? csm_debug_check(renderer, name, err) : status;
}

/* Where to: memory, or a place in the buffer that is bound for it. */
static void read_map(csm_frame *frame, int cascade, void *to) {
    const GladGLContext *gl = &frame->renderer->gl;
    const csm_place place = csm_map_attach(frame, cascade);
    gl->BindFramebuffer(GL_READ_FRAMEBUFFER, frame->renderer->map_framebuffer);
    gl->ReadPixels(place.x, place.y, place.size, place.size, GL_DEPTH_COMPONENT, GL_FLOAT, to);
}

static size_t map_texels(const csm_frame *frame, int cascade) {
    return (size_t)frame->places[cascade].size * (size_t)frame->places[cascade].size;
}

/* Bytes of all maps, where they are read with whatever else comes back: into memory of the caller
 * each waits for the GPU. Software GL has nothing to wait for, and a copy would cost; of large maps
 * the wait is little beside the way, and pinned memory is dear. */
static size_t bytes_at_once(const csm_frame *frame) {
    size_t texels = 0;
    for (int i = 0; i < frame->settings.effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        texels += map_texels(frame, i);
    }
    const size_t bytes = texels * sizeof(float);
    const bool wanted = frame->out->shadow_maps[0] && !frame->renderer->info.software;
    return wanted && bytes <= MAPS_AT_ONCE_BYTES ? bytes : 0;
}

/* Whether maps of so many bytes will come with the rest; where there is no such memory they are
 * read by themselves. */
static bool queue_maps(csm_frame *frame, size_t bytes) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    csm_error refused = {0};
    if (!bytes || csm_host_buffer_fit(renderer, CSM_BUFFER_MAPS, bytes, &refused) != CSM_OK) {
        return false;
    }
    gl->BindBuffer(GL_PIXEL_PACK_BUFFER, renderer->buffers[CSM_BUFFER_MAPS].host);
    size_t before = 0;
    for (int i = 0; i < frame->settings.effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        read_map(frame, i, (void *)(uintptr_t)(before * sizeof(float)));
        before += map_texels(frame, i);
    }
    gl->BindBuffer(GL_PIXEL_PACK_BUFFER, 0); /* moments are read into memory */
    return true;
}

static void read_maps(csm_frame *frame, bool queued) {
    const bool reversed = frame->settings.effects[CSM_EFFECT_REVERSED_DEPTH];
    const float *mapped = frame->renderer->buffers[CSM_BUFFER_MAPS].mapped;
    for (int i = 0; i < frame->settings.effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        float *out = frame->out->shadow_maps[i];
        const size_t texels = map_texels(frame, i);
        if (queued) {
            memcpy(out, mapped, texels * sizeof *out);
            mapped += texels;
        } else {
            read_map(frame, i, out);
        }
        for (size_t t = 0; reversed && t < texels; t++) {
            out[t] = 1.0f - out[t];
        }
    }
}

static void copy_mapped(csm_frame *frame, int kind, void *out, size_t bytes) {
    if (out) {
        memcpy(out, frame->renderer->buffers[kind].mapped, bytes);
    }
}

/* Without maps a point is lit unless its surface does not face the sun. */
static float lit_by_facing(const csm_frame *frame, size_t i) {
    const double *normal = frame->desc->point_normals;
    double facing = 1.0;
    if (normal) {
        facing = 0.0;
        for (size_t axis = 0; axis < 3; axis++) {
            facing += normal[3 * i + axis] * (double)frame->uniforms.to_light[axis];
        }
    }
    return facing > FACING_LIMIT ? 1.0f : 0.0f;
}

void csm_points_read(const csm_frame *frame) {
    const bool shadowed = frame->settings.effects[CSM_EFFECT_FILTER] != CSM_FILTER_NONE;
    const float *answers = frame->renderer->buffers[CSM_BUFFER_POINTS].mapped;
    csm_render_out *out = frame->out;
    for (size_t i = 0; i < frame->desc->point_count; i++) {
        if (out->point_visibility) {
            out->point_visibility[i] = shadowed ? answers[4 * i] : lit_by_facing(frame, i);
        }
        if (out->point_cascade) {
            out->point_cascade[i] = shadowed ? (uint8_t)answers[4 * i + 1] : 255;
        }
        if (out->point_blend_weight) {
            out->point_blend_weight[i] = shadowed ? answers[4 * i + 2] : 0.0f;
        }
    }
}

static csm_status read_back(csm_frame *frame, csm_error *err) {
    csm_render_out *out = frame->out;
    const csm_render_desc *desc = frame->desc;
    size_t pixels = (size_t)desc->camera.width * (size_t)desc->camera.height;
    double start = csm_clock_ms();
    csm_status status = CSM_OK;
    const bool queued = queue_maps(frame, bytes_at_once(frame));
    csm_host_buffers_fetch(frame->renderer);
    copy_mapped(frame, CSM_BUFFER_MASK, out->mask, pixels * sizeof(float));
    copy_mapped(frame, CSM_BUFFER_MASK_SINGLE, out->mask_single, pixels * sizeof(float));
    copy_mapped(frame, CSM_BUFFER_DEPTH, out->view_depth, pixels * sizeof(float));
    copy_mapped(frame, CSM_BUFFER_NORMAL, out->normal, 3 * pixels * sizeof(float));
    const uint32_t *packed = frame->renderer->buffers[CSM_BUFFER_INDEX].mapped;
    for (size_t i = 0; i < pixels && out->cascade_index; i++) {
        out->cascade_index[i] = (uint8_t)packed[i];
    }
    for (size_t i = 0; i < pixels && out->valid; i++) {
        out->valid[i] = packed[i] >> 8 & 1u;
    }
    if (out->shadow_maps[0]) {
        read_maps(frame, queued);
    }
    const int count = frame->settings.effects[CSM_EFFECT_CASCADE_COUNT];
    for (int i = 0; i < count && out->moments[i] && status == CSM_OK; i++) {
        status = csm_moments_read(frame, i, out->moments[i], err);
    }
    csm_points_read(frame);
    if (out->timing_count < CSM_MAX_TIMINGS) {
        out->timing_names[out->timing_count] = "readback";
        out->timing_ms[out->timing_count++] = csm_clock_ms() - start;
    }
    return status;
}

void csm_frame_upload_uniforms(csm_frame *frame) {
    frame->renderer->gl.NamedBufferSubData(frame->renderer->frame_uniforms, 0,
                                           sizeof frame->uniforms, &frame->uniforms);
}

void csm_frame_bind_uniforms(csm_frame *frame) {
    const csm_renderer *renderer = frame->renderer;
    renderer->gl.BindBufferBase(GL_UNIFORM_BUFFER, 0, renderer->frame_uniforms);
    if (renderer->warp_uniforms) {
        renderer->gl.BindBufferBase(GL_UNIFORM_BUFFER, 1, renderer->warp_uniforms);
    }
}

static bool shadowed(const csm_frame *frame) {
    return frame->settings.effects[CSM_EFFECT_FILTER] != CSM_FILTER_NONE;
}

csm_cascades_desc csm_frame_fit_desc(const csm_frame *frame, csm_settings *settings) {
    const csm_render_desc *desc = frame->desc;
    const csm_geometry *geometry = &desc->scene->geometry;
    *settings = desc->settings;
    if (!shadowed(frame)) {
        /* no map asks for these cascades: they must not refuse a camera, nor ask what is seen */
        settings->effects[CSM_EFFECT_SPLIT] = CSM_SPLIT_UNIFORM;
        settings->effects[CSM_EFFECT_FIT] = CSM_FIT_SPHERE;
        memcpy(settings->map_size, csm_settings_default().map_size, sizeof settings->map_size);
        settings->first_split = settings->max_distance = 0.0;
    }
    csm_cascades_desc fit = {.camera = desc->camera,
                             .settings = settings,
                             .scene_bounds = desc->scene_bounds,
                             .boxes = geometry->item_count ? geometry->items->bounds : NULL,
                             .box_count = geometry->item_count,
                             .box_stride = sizeof *geometry->items,
                             .receivers = &frame->receivers,
                             .held = desc->held};
    memcpy(fit.to_light, desc->to_light, sizeof fit.to_light);
    return fit;
}

static csm_status place_cascades(csm_frame *frame, csm_error *err) {
    csm_settings settings;
    const csm_cascades_desc fit = csm_frame_fit_desc(frame, &settings);
    csm_status status = csm_cascades_fit(&fit, &frame->out->cascades, err);
    if (status == CSM_OK && shadowed(frame)) {
        csm_frame_write_cascades(frame);
    }
    if (status == CSM_OK && frame->settings.effects[CSM_EFFECT_WARPED]) {
        csm_warp_uniforms warps;
        csm_frame_write_warps(frame, &warps);
        frame->renderer->warp_uniforms =
            csm_buffer_make(frame->renderer, "warp", sizeof warps, &warps, 0);
    }
    csm_frame_bind_uniforms(frame);
    csm_frame_upload_uniforms(frame);
    return status;
}

static bool has_step(const csm_plan *plan, csm_pass pass) {
    for (int i = 0; i < plan->step_count; i++) {
        if (plan->steps[i].pass == pass) {
            return true;
        }
    }
    return false;
}

static bool sums_up_receivers(const csm_plan *plan) {
    return has_step(plan, CSM_STEP_RECEIVER_RANGE) || has_step(plan, CSM_STEP_RECEIVER_BOUNDS);
}

static bool looks_up_moments(const csm_frame *frame) {
    return frame->moments.kind > CSM_LOOKS_AT_DEPTHS;
}

/* What csm_renderer_visibility goes on from. */
static void keep_last(const csm_frame *frame) {
    csm_last_render *last = &frame->renderer->last;
    const csm_render_desc *desc = frame->desc;
    const csm_pass made = looks_up_moments(frame) ? CSM_STEP_SHADOW_MOMENTS : CSM_STEP_SHADOW_MAP;
    const bool complete = (desc->outputs & CSM_OUT_POINTS) ||
                          frame->settings.effects[CSM_EFFECT_CULL] == CSM_CULL_NONE;
    *last = (csm_last_render){.done = true,
                              .whole = complete && has_step(&frame->plan, made),
                              .scene = desc->scene,
                              .camera = desc->camera,
                              .angular_diameter = desc->angular_diameter,
                              .settings = frame->settings,
                              .outputs = desc->outputs,
                              .cascades = frame->out->cascades,
                              .uniforms = frame->uniforms};
    memcpy(last->origin, frame->origin, sizeof last->origin);
}

static csm_status render_bound(csm_frame *frame, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    for (int kind = 0; kind < CSM_BUFFER_COUNT; kind++) {
        renderer->buffers[kind].used = 0; /* an interrupted frame leaves them set */
    }
    renderer->last.done = false;
    csm_draw_list_begin(renderer, frame->desc->scene);
    csm_buffer_drop(renderer, &renderer->warp_uniforms);
    csm_status status = csm_targets_fit(renderer, &frame->plan, err);
    if (status != CSM_OK) {
        return status;
    }
    frame->out->bytes = frame->plan.bytes;
    frame->out->scene_bytes = frame->desc->scene->bytes;
    frame->out->clock = frame->desc->untimed      ? "none: passes were not timed"
                        : renderer->timer.queries ? "timer query"
                                                  : "wall clock around glFinish";
    frame->out->items_total = (int)frame->desc->scene->geometry.item_count;
    csm_frame_write_view(frame);
    /* What reads no pixels is refused before a pixel is drawn. */
    bool placed = !sums_up_receivers(&frame->plan);
    if (placed) {
        status = place_cascades(frame, err);
        if (status != CSM_OK) {
            return status;
        }
    } else {
        csm_frame_upload_uniforms(frame);
    }
    csm_frame_bind_uniforms(frame);
    for (int i = 0; i < frame->plan.step_count && status == CSM_OK; i++) {
        const csm_plan_step *step = &frame->plan.steps[i];
        status = csm_frame_stopped(frame) ? csm_interrupted(err) : CSM_OK;
        if (status == CSM_OK && !placed && step->pass > CSM_STEP_RECEIVER_BOUNDS) {
            status = place_cascades(frame, err);
            placed = true;
        }
        if (status == CSM_OK && frame->desc->reuse && step->pass == CSM_STEP_SHADOW_MAP &&
            !frame->work) {
            status = csm_kept_choose(frame, err);
        }
        if (status == CSM_OK) {
            status = csm_frame_run_step(frame, step, err);
        }
    }
    if (status == CSM_OK) {
        status = read_back(frame, err);
    }
    if (status == CSM_OK) {
        status = csm_debug_check(renderer, "readback", err);
    }
    if (status == CSM_OK) {
        keep_last(frame);
    }
    return status;
}

static csm_status check_render(const csm_render_desc *desc, csm_error *err) {
    csm_status status = csm_settings_validate(&desc->settings, err);
    if (status == CSM_OK) {
        status = csm_camera_validate(&desc->camera, err);
    }
    return status;
}

csm_status csm_frame_plan(csm_frame *frame, unsigned outputs, csm_error *err) {
    const csm_camera *camera = &frame->desc->camera;
    int size[2];
    csm_storage_places(&frame->settings, frame->places, size);
    frame->moments = csm_settings_moments(&frame->settings);
    return csm_plan_make(&frame->settings, camera->width, camera->height, outputs, &frame->plan,
                         err);
}

/* Whether maps may be scrolled, which takes a texture more. */
static bool scrolls(const csm_frame *frame) {
    const bool wanted = frame->desc->reuse == CSM_REUSE_MAPS_SCROLLED;
    return has_step(&frame->plan, CSM_STEP_SHADOW_MAP) &&
           (csm_reuse_allowed(&frame->settings, wanted) & CSM_REUSE_MAY_SCROLL);
}

csm_status csm_renderer_render(csm_renderer *renderer, const csm_render_desc *desc,
                               csm_render_out *out, csm_error *err) {
    csm_saved_binding saved;
    csm_frame frame = {.renderer = renderer, .desc = desc, .out = out, .settings = desc->settings};
    csm_status status = check_render(desc, err);
    if (status == CSM_OK) {
        memcpy(frame.origin, desc->scene->origin, sizeof frame.origin);
        frame.settings.effects[CSM_EFFECT_INSTANCES] = desc->scene->geometry.instance_count > 1;
        frame.settings.effects[CSM_EFFECT_STAGE] = renderer->info.stage;
        frame.settings.effects[CSM_EFFECT_ALPHA_TEST] = desc->scene->cutout_texture != 0;
        csm_settings_canonical(&frame.settings);
        status = csm_frame_plan(&frame, desc->outputs, err);
    }
    if (status == CSM_OK && scrolls(&frame)) {
        csm_plan_add_scroll(&frame.settings, &frame.plan);
    }
    if (status == CSM_OK) {
        status = csm_renderer_enter(renderer, &saved, err);
    }
    if (status != CSM_OK) {
        return status;
    }
    status = render_bound(&frame, err);
    csm_kept_finish(&frame);
    if (status != CSM_OK) {
        csm_kept_forget(renderer); /* moments may not be those of their map */
        csm_kept_forget_view(renderer);
    }
    csm_draw_list_distrust(renderer, status);
    csm_renderer_leave(renderer, &saved);
    return status;
}
