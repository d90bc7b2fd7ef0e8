/* target.c: the textures a plan names, no more and no fewer, and the buffers outputs come back in.
 */
#include "gl_internal.h"

#include <string.h>

static const struct {
    const char *name;
    GLenum format;
} formats[] = {
    {"r32ui", GL_R32UI},
    {"rg32ui", GL_RG32UI},
    {"d32f", GL_DEPTH_COMPONENT32F},
    {"d24", GL_DEPTH_COMPONENT24},
    {"d16", GL_DEPTH_COMPONENT16},
    {"r32f", GL_R32F},
    {"rg32f", GL_RG32F},
    {"rgba32f", GL_RGBA32F},
    {"r16f", GL_R16F},
    {"rg16f", GL_RG16F},
    {"rgba16f", GL_RGBA16F},
    {"r16", GL_R16},
    {"rg16", GL_RG16},
    {"rgba16", GL_RGBA16},
};

static const char *const target_names[CSM_TARGET_COUNT] = {
    [CSM_TARGET_VIEW_IDS] = "view_ids",
    [CSM_TARGET_VIEW_DEPTH] = "view_depth",
    [CSM_TARGET_SHADOW_MAPS] = "shadow_maps",
    [CSM_TARGET_SEPARATE] = "shadow_maps_0",
    [CSM_TARGET_SEPARATE + 1] = "shadow_maps_1",
    [CSM_TARGET_SEPARATE + 2] = "shadow_maps_2",
    [CSM_TARGET_SEPARATE + 3] = "shadow_maps_3",
    [CSM_TARGET_SEPARATE + 4] = "shadow_maps_4",
    [CSM_TARGET_SEPARATE + 5] = "shadow_maps_5",
    [CSM_TARGET_SEPARATE + 6] = "shadow_maps_6",
    [CSM_TARGET_SEPARATE + 7] = "shadow_maps_7",
    [CSM_TARGET_SHADOW_TILE] = "shadow_tile",
    [CSM_TARGET_SHADOW_SAMPLES] = "shadow_samples",
    [CSM_TARGET_SHADOW_SCROLL] = "shadow_scroll",
    [CSM_TARGET_MOMENTS] = "moments",
    [CSM_TARGET_MOMENTS_BETWEEN] = "moments_between",
};

GLenum csm_format_named(const char *name) {
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++) {
        if (!strcmp(formats[i].name, name)) {
            return formats[i].format;
        }
    }
    return GL_NONE;
}

/* What maps, or the view, were made into comes or goes. */
static void forget_kept(csm_renderer *renderer, const csm_target *target) {
    if (target >= &renderer->targets[CSM_TARGET_SHADOW_MAPS]) {
        csm_kept_forget(renderer);
    } else {
        csm_kept_forget_view(renderer);
    }
}

static void drop(csm_renderer *renderer, csm_target *target) {
    const GladGLContext *gl = &renderer->gl;
    if (target->texture) {
        forget_kept(renderer, target);
        /* deleting detaches a texture from bound framebuffers alone: elsewhere it would live on */
        gl->NamedFramebufferTexture(renderer->view_framebuffer, GL_COLOR_ATTACHMENT0, 0, 0);
        gl->NamedFramebufferTexture(renderer->view_framebuffer, GL_DEPTH_ATTACHMENT, 0, 0);
        gl->NamedFramebufferTexture(renderer->map_framebuffer, GL_DEPTH_ATTACHMENT, 0, 0);
        gl->NamedFramebufferTexture(renderer->filter_framebuffer, GL_COLOR_ATTACHMENT0, 0, 0);
        gl->NamedFramebufferTexture(renderer->filter_framebuffer, GL_DEPTH_ATTACHMENT, 0, 0);
        gl->DeleteTextures(1, &target->texture);
        renderer->info.live_objects--;
    }
    memset(target, 0, sizeof *target);
}

static csm_status make(csm_renderer *renderer, csm_target *target, const csm_plan_texture *wanted,
                       csm_error *err) {
    const GladGLContext *gl = &renderer->gl;
    int largest = wanted->width > wanted->height ? wanted->width : wanted->height;
    if (wanted->kind == CSM_TEXTURE_CUBE && largest > renderer->info.max_cube_size) {
        return csm_fail(err, CSM_ERROR_LIMIT, "%s %d x %d exceeds GL_MAX_CUBE_MAP_TEXTURE_SIZE %d",
                        wanted->name, wanted->width, wanted->height, renderer->info.max_cube_size);
    }
    if (largest > renderer->info.max_texture_size || wanted->layers > renderer->info.max_layers) {
        return csm_fail(err, CSM_ERROR_LIMIT, "%s %d x %d x %d exceeds GL_MAX_TEXTURE_SIZE %d",
                        wanted->name, wanted->width, wanted->height, wanted->layers,
                        renderer->info.max_texture_size);
    }
    if (wanted->samples > renderer->info.max_samples) {
        return csm_fail(err, CSM_ERROR_LIMIT, "samples %d exceeds the driver's %d for depths",
                        wanted->samples, renderer->info.max_samples);
    }
    const GLenum format = csm_format_named(wanted->format);
    const GLenum kind = wanted->samples > 1                 ? GL_TEXTURE_2D_MULTISAMPLE
                        : wanted->kind == CSM_TEXTURE_ARRAY ? GL_TEXTURE_2D_ARRAY
                        : wanted->kind == CSM_TEXTURE_CUBE  ? GL_TEXTURE_CUBE_MAP
                                                            : GL_TEXTURE_2D;
    forget_kept(renderer, target);
    gl->CreateTextures(kind, 1, &target->texture);
    renderer->info.live_objects++;
    if (kind == GL_TEXTURE_2D_MULTISAMPLE) {
        gl->TextureStorage2DMultisample(target->texture, wanted->samples, format, wanted->width,
                                        wanted->height, GL_TRUE);
    } else if (kind == GL_TEXTURE_2D_ARRAY) {
        gl->TextureStorage3D(target->texture, wanted->levels, format, wanted->width, wanted->height,
                             wanted->layers);
    } else {
        gl->TextureStorage2D(target->texture, wanted->levels, format, wanted->width,
                             wanted->height);
    }
    csm_debug_label(renderer, GL_TEXTURE, target->texture, wanted->name);
    if (!strncmp(wanted->name, "moments", 7)) {
        /* beyond a smaller map's rim lookups weigh texels by 0, which NaN would survive */
        const bool whole = !strcmp(wanted->format, "rg32ui");
        gl->ClearTexImage(target->texture, 0, whole ? GL_RG_INTEGER : GL_RGBA,
                          whole ? GL_UNSIGNED_INT : GL_FLOAT, NULL);
    }
    target->wanted = *wanted;
    return csm_debug_check(renderer, wanted->name, err);
}

csm_status csm_targets_fit(csm_renderer *renderer, const csm_plan *plan, csm_error *err) {
    const csm_plan_texture *wanted[CSM_TARGET_COUNT] = {NULL};
    for (int i = 0; i < plan->texture_count; i++) {
        for (int t = 0; t < CSM_TARGET_COUNT; t++) {
            if (!strcmp(plan->textures[i].name, target_names[t])) {
                wanted[t] = &plan->textures[i];
            }
        }
    }
    /* first everything that goes, so that old and new never exist together */
    for (int t = 0; t < CSM_TARGET_COUNT; t++) {
        csm_target *target = &renderer->targets[t];
        if (!wanted[t] || memcmp(&target->wanted, wanted[t], sizeof *wanted[t])) {
            drop(renderer, target);
        }
    }
    for (int t = 0; t < CSM_TARGET_COUNT; t++) {
        csm_target *target = &renderer->targets[t];
        if (wanted[t] && !target->texture) {
            csm_status status = make(renderer, target, wanted[t], err);
            if (status != CSM_OK) {
                drop(renderer, target);
                return status;
            }
        }
    }
    return CSM_OK;
}

static void drop_buffer(csm_renderer *renderer, csm_host_buffer *buffer) {
    if (buffer->name != buffer->host) {
        csm_buffer_drop(renderer, &buffer->name);
    }
    csm_buffer_drop(renderer, &buffer->host);
    memset(buffer, 0, sizeof *buffer);
}

void csm_targets_drop(csm_renderer *renderer) {
    for (int t = 0; t < CSM_TARGET_COUNT; t++) {
        drop(renderer, &renderer->targets[t]);
    }
    for (int kind = 0; kind < CSM_BUFFER_COUNT; kind++) {
        drop_buffer(renderer, &renderer->buffers[kind]);
    }
}

GLuint csm_buffer_make(csm_renderer *renderer, const char *label, GLsizeiptr size, const void *data,
                       GLbitfield flags) {
    GLuint name = 0;
    renderer->gl.CreateBuffers(1, &name);
    renderer->gl.NamedBufferStorage(name, size > 0 ? size : 4, data, flags);
    renderer->info.live_objects++;
    csm_debug_label(renderer, GL_BUFFER, name, label);
    return name;
}

void csm_buffer_drop(csm_renderer *renderer, GLuint *name) {
    if (*name) {
        renderer->gl.DeleteBuffers(1, name);
        renderer->info.live_objects--;
        *name = 0;
    }
}

/* On software GL the passes write the mapped buffer itself, the driver's own memory. On hardware
 * they write device memory and csm_host_buffers_fetch copies over the bus at once: a shader's own
 * scattered writes across it cost ten times the pass. Maps are read into host memory by the copy
 * engine, not by a shader. A smaller frame uses the front of a larger buffer. */
csm_status csm_host_buffer_fit(csm_renderer *renderer, int kind, size_t size, csm_error *err) {
    static const char *const labels[CSM_BUFFER_COUNT] = {
        "mask",           "cascade_index", "view_depth", "normal", "points", "receiver_bounds",
        "receiver_range", "mask_single",   "shadow_maps"};
    csm_host_buffer *buffer = &renderer->buffers[kind];
    const GLbitfield flags = GL_MAP_READ_BIT | GL_MAP_PERSISTENT_BIT;
    if (buffer->size >= (GLsizeiptr)size) {
        buffer->used = (GLsizeiptr)size;
        return CSM_OK;
    }
    if ((int64_t)size > renderer->info.max_buffer_bytes) {
        return csm_fail(err, CSM_ERROR_LIMIT, "%s needs %zu bytes, the driver allows %lld",
                        labels[kind], size, (long long)renderer->info.max_buffer_bytes);
    }
    drop_buffer(renderer, buffer);
    buffer->host = csm_buffer_make(renderer, labels[kind], (GLsizeiptr)size, NULL,
                                   flags | GL_CLIENT_STORAGE_BIT);
    buffer->mapped = renderer->gl.MapNamedBufferRange(buffer->host, 0, (GLsizeiptr)size, flags);
    if (!buffer->mapped) {
        drop_buffer(renderer, buffer);
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu bytes of %s", size,
                        labels[kind]);
    }
    buffer->name = renderer->info.software || kind == CSM_BUFFER_MAPS
                       ? buffer->host
                       : csm_buffer_make(renderer, labels[kind], (GLsizeiptr)size, NULL, 0);
    csm_status status = csm_debug_check(renderer, labels[kind], err);
    if (status != CSM_OK) {
        drop_buffer(renderer, buffer);
        return status;
    }
    buffer->used = buffer->size = (GLsizeiptr)size;
    return CSM_OK;
}

void csm_host_buffers_fetch(csm_renderer *renderer) {
    const GladGLContext *gl = &renderer->gl;
    for (int kind = 0; kind < CSM_BUFFER_COUNT; kind++) {
        csm_host_buffer *buffer = &renderer->buffers[kind];
        if (buffer->used && buffer->name != buffer->host) {
            gl->CopyNamedBufferSubData(buffer->name, buffer->host, 0, 0, buffer->used);
        }
        buffer->used = 0;
    }
    gl->MemoryBarrier(GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT);
    gl->Finish(); /* mapped memory is read without another call to the driver */
}
