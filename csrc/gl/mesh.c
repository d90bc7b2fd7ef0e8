/* mesh.c: geometry on the GPU, and the list of what one pass draws.
 *
 * One indirect call draws everything a pass needs. The instance's number is an attribute that steps
 * once per instance, picked by baseInstance; a scene without instances has no such attribute.
 * Meshes with a cut-out come last and are drawn by a program of their own. Triangle t ends in
 * vertex t, so gl_VertexID of the provoking vertex is the triangle.
 */
#include "gl_internal.h"

#include <stdlib.h>
#include <string.h>

typedef struct csm_draw_command {
    GLuint index_count, instance_count, first_index, base_vertex, base_instance;
} draw_command;

/* What runs between two looks at the stop callback: some tenths of a second on software GL. */
#define BATCH_TRIANGLES (1 << 19)
/* Longest merged command, so that batches can be cut between commands. */
#define COMMAND_INDICES (3u << 18)

/* Of a buffer of draws: as it is made, and where it grows no further for a frame's sake. */
#define LEAST_DRAW_BYTES (1 << 12)
#define PLENTY_DRAW_BYTES (1 << 17)

enum { ATTRIBUTE_POSITION, ATTRIBUTE_INSTANCE, ATTRIBUTE_TEXELS, ATTRIBUTE_CUTOUT };
enum { BINDING_POSITION, BINDING_INSTANCE, BINDING_CUTOUT };

#define UNIT_CUTOUTS 7 /* of include/cutout.glsl */

static void make_vertex_array(csm_renderer *renderer, csm_gpu_scene *scene) {
    const GladGLContext *gl = &renderer->gl;
    gl->CreateVertexArrays(1, &scene->vertex_array);
    renderer->info.live_objects++;
    gl->VertexArrayElementBuffer(scene->vertex_array, scene->indices);
    gl->VertexArrayVertexBuffer(scene->vertex_array, BINDING_POSITION, scene->positions, 0,
                                3 * sizeof(float));
    gl->EnableVertexArrayAttrib(scene->vertex_array, ATTRIBUTE_POSITION);
    gl->VertexArrayAttribFormat(scene->vertex_array, ATTRIBUTE_POSITION, 3, GL_FLOAT, GL_FALSE, 0);
    gl->VertexArrayAttribBinding(scene->vertex_array, ATTRIBUTE_POSITION, BINDING_POSITION);
    if (scene->geometry.instance_count > 1) {
        gl->EnableVertexArrayAttrib(scene->vertex_array, ATTRIBUTE_INSTANCE);
        gl->VertexArrayAttribIFormat(scene->vertex_array, ATTRIBUTE_INSTANCE, 1, GL_UNSIGNED_INT,
                                     0);
        gl->VertexArrayAttribBinding(scene->vertex_array, ATTRIBUTE_INSTANCE, BINDING_INSTANCE);
        gl->VertexArrayBindingDivisor(scene->vertex_array, BINDING_INSTANCE, 1);
    }
    if (scene->cutout_vertices) {
        const GLuint array = scene->vertex_array;
        gl->VertexArrayVertexBuffer(array, BINDING_CUTOUT, scene->cutout_vertices, 0,
                                    sizeof(csm_cutout_vertex));
        gl->EnableVertexArrayAttrib(array, ATTRIBUTE_TEXELS);
        gl->VertexArrayAttribFormat(array, ATTRIBUTE_TEXELS, 2, GL_FLOAT, GL_FALSE,
                                    offsetof(csm_cutout_vertex, texels));
        gl->VertexArrayAttribBinding(array, ATTRIBUTE_TEXELS, BINDING_CUTOUT);
        gl->EnableVertexArrayAttrib(array, ATTRIBUTE_CUTOUT);
        gl->VertexArrayAttribIFormat(array, ATTRIBUTE_CUTOUT, 2, GL_UNSIGNED_INT,
                                     offsetof(csm_cutout_vertex, first));
        gl->VertexArrayAttribBinding(array, ATTRIBUTE_CUTOUT, BINDING_CUTOUT);
    }
    csm_debug_label(renderer, GL_VERTEX_ARRAY, scene->vertex_array, "scene");
}

/* Chunks and items stay for culling; vertex data lives on the GPU alone. */
static csm_status keep_for_culling(const csm_geometry *geometry, csm_gpu_scene *scene,
                                   csm_error *err) {
    csm_geometry *kept = &scene->geometry;
    *kept = *geometry;
    kept->positions = kept->planes = kept->instances = NULL;
    kept->indices = kept->cutouts = NULL;
    kept->cutout_vertices = NULL;
    kept->chunks = malloc(geometry->chunk_count * sizeof *kept->chunks);
    kept->items = malloc(geometry->item_count * sizeof *kept->items);
    if (!kept->chunks || !kept->items) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu chunks",
                        geometry->chunk_count);
    }
    memcpy(kept->chunks, geometry->chunks, geometry->chunk_count * sizeof *kept->chunks);
    memcpy(kept->items, geometry->items, geometry->item_count * sizeof *kept->items);
    return CSM_OK;
}

static GLuint make_buffer_texture(csm_renderer *renderer, GLenum format, GLuint buffer) {
    GLuint texture;
    renderer->gl.CreateTextures(GL_TEXTURE_BUFFER, 1, &texture);
    renderer->gl.TextureBuffer(texture, format, buffer);
    renderer->info.live_objects++;
    return texture;
}

static csm_status check_limits(csm_renderer *renderer, const csm_geometry *geometry,
                               csm_error *err) {
    GLint most = 0;
    renderer->gl.GetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &most);
    if (geometry->triangle_count > (size_t)most) {
        return csm_fail(err, CSM_ERROR_LIMIT,
                        "a scene of %zu stored triangles exceeds GL_MAX_TEXTURE_BUFFER_SIZE %d: "
                        "instance what repeats, or split the scene",
                        geometry->triangle_count, most);
    }
    const int64_t instance_bytes = (int64_t)geometry->instance_count * 12 * (int64_t)sizeof(float);
    if (instance_bytes > renderer->info.max_buffer_bytes) {
        return csm_fail(err, CSM_ERROR_LIMIT,
                        "%d instances need %lld bytes, GL_MAX_SHADER_STORAGE_BLOCK_SIZE is %lld",
                        geometry->instance_count, (long long)instance_bytes,
                        (long long)renderer->info.max_buffer_bytes);
    }
    if (geometry->cutout_word_count > (size_t)most) {
        return csm_fail(err, CSM_ERROR_LIMIT,
                        "cut-outs of %zu words of 32 texels exceed GL_MAX_TEXTURE_BUFFER_SIZE %d",
                        geometry->cutout_word_count, most);
    }
    return CSM_OK;
}

csm_status csm_gpu_scene_make(csm_renderer *renderer, const csm_geometry *geometry,
                              const double origin[3], csm_gpu_scene **out, csm_error *err) {
    csm_status status = check_limits(renderer, geometry, err);
    if (status != CSM_OK) {
        return status;
    }
    csm_gpu_scene *scene = calloc(1, sizeof *scene);
    if (!scene) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for a scene");
    }
    status = keep_for_culling(geometry, scene, err);
    if (status == CSM_OK) {
        const struct {
            GLuint *name;
            const char *label;
            size_t bytes;
            const void *data;
        } buffers[] = {
            {&scene->positions, "positions", geometry->vertex_count * 3 * sizeof(float),
             geometry->positions},
            {&scene->indices, "indices", geometry->triangle_count * 3 * sizeof(uint32_t),
             geometry->indices},
            {&scene->planes, "planes", geometry->triangle_count * 4 * sizeof(float),
             geometry->planes},
            {&scene->instances, "instances", (size_t)geometry->instance_count * 12 * sizeof(float),
             geometry->instances},
            {&scene->cutout_vertices, "cut-out vertices",
             geometry->vertex_count * sizeof *geometry->cutout_vertices, geometry->cutout_vertices},
            {&scene->cutouts, "cut-outs", geometry->cutout_word_count * sizeof *geometry->cutouts,
             geometry->cutouts},
        };
        const size_t kinds = sizeof buffers / sizeof *buffers;
        for (size_t i = 0; i < (geometry->cutouts ? kinds : kinds - 2); i++) {
            *buffers[i].name = csm_buffer_make(renderer, buffers[i].label,
                                               (GLsizeiptr)buffers[i].bytes, buffers[i].data, 0);
            scene->bytes += buffers[i].bytes;
        }
        memcpy(scene->origin, origin, sizeof scene->origin);
        scene->plane_texture = make_buffer_texture(renderer, GL_RGBA32F, scene->planes);
        if (scene->cutouts) {
            scene->cutout_texture = make_buffer_texture(renderer, GL_R32UI, scene->cutouts);
        }
        make_vertex_array(renderer, scene);
        status = csm_debug_check(renderer, "upload", err);
    }
    if (status != CSM_OK) {
        csm_gpu_scene_destroy(renderer, scene);
        return status;
    }
    scene->next = renderer->scenes;
    renderer->scenes = scene;
    *out = scene;
    return CSM_OK;
}

void csm_gpu_scene_destroy(csm_renderer *renderer, csm_gpu_scene *scene) {
    if (renderer->last.scene == scene) {
        renderer->last.scene = NULL;
    }
    if (renderer->kept.scene == scene) { /* another may get its address */
        csm_kept_forget(renderer);
    }
    if (renderer->view.scene == scene) {
        csm_kept_forget_view(renderer);
    }
    for (csm_gpu_scene **link = &renderer->scenes; *link; link = &(*link)->next) {
        if (*link == scene) {
            *link = scene->next;
            break;
        }
    }
    GLuint *const textures[] = {&scene->plane_texture, &scene->cutout_texture};
    for (size_t i = 0; i < sizeof textures / sizeof *textures; i++) {
        if (*textures[i]) {
            renderer->gl.DeleteTextures(1, textures[i]);
            renderer->info.live_objects--;
        }
    }
    csm_buffer_drop(renderer, &scene->positions);
    csm_buffer_drop(renderer, &scene->indices);
    csm_buffer_drop(renderer, &scene->planes);
    csm_buffer_drop(renderer, &scene->instances);
    csm_buffer_drop(renderer, &scene->cutout_vertices);
    csm_buffer_drop(renderer, &scene->cutouts);
    if (scene->vertex_array) {
        renderer->gl.DeleteVertexArrays(1, &scene->vertex_array);
        renderer->info.live_objects--;
    }
    csm_geometry_destroy(&scene->geometry);
    free(scene);
}

/* Kept items come in ascending order, so instances of a chunk stand together and share a command,
 * and neighbouring chunks of baked meshes merge into one. */
static void write_draws(const csm_gpu_scene *scene, const uint32_t *items, size_t item_count,
                        draw_command *commands, GLuint *instances, csm_draw_list *list) {
    const csm_geometry *geometry = &scene->geometry;
    uint32_t last_chunk = UINT32_MAX, instance_count = 0;
    bool last_baked = false;
    for (size_t i = 0; i < item_count; i++) {
        const csm_item *item = &geometry->items[items[i]];
        const csm_chunk *chunk = &geometry->chunks[item->chunk];
        draw_command *last = list->command_count ? &commands[list->command_count - 1] : NULL;
        bool baked = item->instance == 0;
        bool solid = item->chunk < geometry->cutout_chunk;
        last = solid || list->solid_count < list->command_count ? last : NULL;
        list->triangle_count += chunk->triangle_count;
        if (last && !baked && item->chunk == last_chunk &&
            last->instance_count < COMMAND_INDICES / last->index_count) {
            last->instance_count++;
            instances[instance_count++] = item->instance;
        } else if (last && baked && last_baked && last->index_count < COMMAND_INDICES &&
                   last->first_index + last->index_count == 3 * chunk->first_triangle) {
            last->index_count += 3 * chunk->triangle_count;
        } else {
            commands[list->command_count++] = (draw_command){
                3 * chunk->triangle_count, 1, 3 * chunk->first_triangle, 0, instance_count};
            instances[instance_count++] = item->instance;
        }
        list->solid_count = solid ? list->command_count : list->solid_count;
        last_chunk = item->chunk;
        last_baked = baked;
    }
}

/* Where the data lies in the buffer. A pass writes behind what those before it may still read. What
 * is written over, by the next frame or by lists that are long for a whole one, the driver puts in
 * order. A buffer that is replaced lives on until its draws are done. */
static GLintptr put(csm_renderer *renderer, csm_draw_buffer *buffer, const char *label,
                    const void *data, GLsizeiptr bytes) {
    if (buffer->size - buffer->used < bytes) {
        buffer->used = 0;
        if (buffer->size < bytes || buffer->size < PLENTY_DRAW_BYTES) {
            GLsizeiptr size = buffer->size ? 2 * buffer->size : LEAST_DRAW_BYTES;
            size = size < bytes ? bytes : size;
            csm_buffer_drop(renderer, &buffer->name);
            buffer->name = csm_buffer_make(renderer, label, size, NULL, GL_DYNAMIC_STORAGE_BIT);
            buffer->size = size;
        }
    }
    const GLintptr first = buffer->used;
    renderer->gl.NamedBufferSubData(buffer->name, first, bytes, data);
    buffer->used += bytes;
    return first;
}

static void drop_draw_buffer(csm_renderer *renderer, csm_draw_buffer *buffer) {
    csm_buffer_drop(renderer, &buffer->name);
    memset(buffer, 0, sizeof *buffer);
}

void csm_draw_list_begin(csm_renderer *renderer, const csm_gpu_scene *scene) {
    csm_draw_list *list = &renderer->draws;
    list->commands.used = list->instances.used = 0;
    if (scene->geometry.instance_count <= 1) {
        drop_draw_buffer(renderer, &list->instances);
    }
}

/* The list is empty; its buffers stay. */
static void clear(csm_draw_list *list) {
    free(list->host_commands);
    *list = (csm_draw_list){.commands = list->commands, .instances = list->instances};
}

csm_status csm_draw_list_fill(csm_renderer *renderer, const csm_gpu_scene *scene,
                              const uint32_t *items, size_t item_count, csm_error *err) {
    csm_draw_list *list = &renderer->draws;
    clear(list);
    if (!item_count) {
        return CSM_OK;
    }
    draw_command *commands = malloc(item_count * sizeof *commands);
    GLuint *instances = malloc(item_count * sizeof *instances);
    csm_status status = CSM_OK;
    if (commands && instances) {
        list->item_count = (int)item_count;
        write_draws(scene, items, item_count, commands, instances, list);
        list->first_command = put(renderer, &list->commands, "draw commands", commands,
                                  list->command_count * (GLsizeiptr)sizeof *commands);
        if (scene->geometry.instance_count > 1) {
            list->first_instance = put(renderer, &list->instances, "drawn instances", instances,
                                       (GLsizeiptr)(item_count * sizeof *instances));
        }
    } else {
        status = csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to draw %zu chunks", item_count);
    }
    free(instances);
    if (status == CSM_OK) {
        list->host_commands = commands;
    } else {
        free(commands);
    }
    return status;
}

csm_status csm_draw_list_submit(csm_frame *frame, const csm_gpu_scene *scene,
                                const GLuint programs[2], csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    csm_draw_list *list = &renderer->draws;
    if (scene->geometry.instance_count > 1) {
        gl->VertexArrayVertexBuffer(scene->vertex_array, BINDING_INSTANCE, list->instances.name,
                                    list->first_instance, sizeof(GLuint));
    }
    gl->BindVertexArray(scene->vertex_array);
    gl->BindBuffer(GL_DRAW_INDIRECT_BUFFER, list->commands.name);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, scene->instances);
    if (scene->cutout_texture) {
        gl->BindTextureUnit(UNIT_CUTOUTS, scene->cutout_texture);
    }
    GLsizei first = 0;
    while (first < list->command_count) {
        const bool solid = first < list->solid_count;
        const GLsizei last = solid ? list->solid_count : list->command_count;
        GLsizei count = 0;
        int64_t triangles = 0;
        while (first + count < last && triangles < BATCH_TRIANGLES) {
            const draw_command *command = &list->host_commands[first + count++];
            triangles += (int64_t)command->instance_count * command->index_count / 3;
        }
        if (first > 0 && csm_frame_stopped_after_finish(frame)) {
            return csm_interrupted(err);
        }
        gl->UseProgram(programs[solid ? 0 : 1]);
        gl->MultiDrawElementsIndirect(GL_TRIANGLES, GL_UNSIGNED_INT,
                                      (const char *)NULL + list->first_command +
                                          (size_t)first * sizeof(draw_command),
                                      count, 0);
        first += count;
    }
    return CSM_OK;
}

void csm_draw_list_drop(csm_renderer *renderer) {
    clear(&renderer->draws);
    drop_draw_buffer(renderer, &renderer->draws.commands);
    drop_draw_buffer(renderer, &renderer->draws.instances);
}

void csm_draw_list_distrust(csm_renderer *renderer, csm_status status) {
    /* an interrupt comes before the driver is asked whether it had the memory */
    if (status == CSM_ERROR_OUT_OF_MEMORY || status == CSM_ERROR_INTERRUPTED) {
        csm_draw_list_drop(renderer);
    }
}
