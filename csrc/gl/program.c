/* program.c: the linked program of a pass, cached by its key.
 *
 * In: canonical settings. Out: a GL program. Driver logs speak of flat lines; they are rewritten to
 * the file and line the text came from: "0:123(" and "ERROR: 0:123:" (Mesa), "0(123)" (NVIDIA).
 */
#include "gl_internal.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_DEFINES 16384

typedef struct pass_file {
    const char *stage_files[2];
    GLenum stages[2];
} pass_file;

static const pass_file pass_files[CSM_STEP_COUNT] = {
    [CSM_STEP_VIEW] = {{"view.vert", "view.frag"}, {GL_VERTEX_SHADER, GL_FRAGMENT_SHADER}},
    [CSM_STEP_RECEIVER_RANGE] = {{"receiver_range.comp", NULL}, {GL_COMPUTE_SHADER, 0}},
    [CSM_STEP_RECEIVER_BOUNDS] = {{"receiver_bounds.comp", NULL}, {GL_COMPUTE_SHADER, 0}},
    [CSM_STEP_SHADOW_MAP] = {{"shadow_map.vert", "shadow_map.frag"},
                             {GL_VERTEX_SHADER, GL_FRAGMENT_SHADER}},
    [CSM_STEP_SHADOW_MOMENTS] = {{"shadow_moments.comp", NULL}, {GL_COMPUTE_SHADER, 0}},
    [CSM_STEP_SHADOW_BLUR] = {{"shadow_blur.comp", NULL}, {GL_COMPUTE_SHADER, 0}},
    [CSM_STEP_SHADOW_SUM] = {{"shadow_sum.comp", NULL}, {GL_COMPUTE_SHADER, 0}},
    [CSM_STEP_SHADOW_MASK] = {{"shadow_mask.comp", NULL}, {GL_COMPUTE_SHADER, 0}},
    [CSM_STEP_SHADOW_FORWARD] = {{"shadow_forward.vert", "shadow_forward.frag"},
                                 {GL_VERTEX_SHADER, GL_FRAGMENT_SHADER}},
    [CSM_STEP_SHADOW_POINTS] = {{"shadow_points.comp", NULL}, {GL_COMPUTE_SHADER, 0}},
};

/* The fragment entries of passes over pixels or texels. */
static const pass_file fragment_files[CSM_STEP_COUNT] = {
    [CSM_STEP_SHADOW_MOMENTS] = {{"cover.vert", "shadow_moments.frag"},
                                 {GL_VERTEX_SHADER, GL_FRAGMENT_SHADER}},
    [CSM_STEP_SHADOW_BLUR] = {{"cover.vert", "shadow_blur.frag"},
                              {GL_VERTEX_SHADER, GL_FRAGMENT_SHADER}},
    [CSM_STEP_SHADOW_SUM] = {{"cover.vert", "shadow_sum.frag"},
                             {GL_VERTEX_SHADER, GL_FRAGMENT_SHADER}},
    [CSM_STEP_SHADOW_MASK] = {{"cover.vert", "shadow_mask.frag"},
                              {GL_VERTEX_SHADER, GL_FRAGMENT_SHADER}},
};

static const pass_file *files_of(const csm_frame *frame, csm_pass pass) {
    const bool fragment = frame->settings.effects[CSM_EFFECT_STAGE] == CSM_STAGE_FRAGMENT;
    return fragment && fragment_files[pass].stage_files[0] ? &fragment_files[pass]
                                                           : &pass_files[pass];
}

/* The rasteriser's own depth serves every map that is not warped and of solid casters. */
static int stage_count(const csm_frame *frame, csm_pass pass) {
    const int *effects = frame->settings.effects;
    const bool own_depth = pass == CSM_STEP_SHADOW_MAP && !effects[CSM_EFFECT_WARPED] &&
                           !effects[CSM_EFFECT_ALPHA_TEST];
    return files_of(frame, pass)->stage_files[1] && !own_depth ? 2 : 1;
}

/* Number after "0:" or "0(" at the start of a log line; 0 if there is none. */
static long flat_line(const char *text, const char **after) {
    const char *at = strstr(text, "0:");
    const char *other = strstr(text, "0(");
    if (!at || (other && other < at)) {
        at = other;
    }
    if (!at || (at > text && isdigit((unsigned char)at[-1]))) {
        return 0;
    }
    char *end;
    long line = strtol(at + 2, &end, 10);
    *after = end + strspn(end, ":() 0123456789");
    return end > at + 2 ? line : 0;
}

static void rewrite_log(const char *log, const csm_shader_source *source, char *out, size_t size) {
    size_t used = 0;
    out[0] = '\0';
    while (*log && used + 1 < size) {
        size_t length = strcspn(log, "\n");
        char text[512];
        const char *rest = text;
        snprintf(text, sizeof text, "%.*s", (int)(length < 500 ? length : 500), log);
        long line = flat_line(text, &rest);
        int written;
        if (line >= 1 && (size_t)line <= source->line_count) {
            const csm_source_line *from = &source->lines[line - 1];
            written =
                snprintf(out + used, size - used, "%s:%d: %s\n", from->file, from->line, rest);
        } else {
            written = snprintf(out + used, size - used, "%s\n", text);
        }
        used += written > 0 ? (size_t)written : 0;
        log += length + (log[length] == '\n');
    }
}

static csm_status compile_stage(csm_frame *frame, csm_pass pass, const char *file, GLenum stage,
                                GLuint *out_shader, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    char defines[MAX_DEFINES];
    csm_shader_source source;
    size_t needed =
        csm_program_defines(pass, &frame->settings, frame->plan.outputs, defines, sizeof defines);
    if (needed >= sizeof defines) {
        return csm_fail(err, CSM_ERROR_SHADER, "%s: the defines of %s need %zu bytes",
                        csm_pass_name(pass), file, needed);
    }
    csm_error problem = {0};
    csm_status status = csm_shader_source_load(file, defines, renderer->read, renderer->read_user,
                                               &source, &problem);
    if (status != CSM_OK) {
        return csm_fail(err, status, "%s: %.900s", csm_pass_name(pass), problem.text);
    }
    GLuint shader = gl->CreateShader(stage);
    GLint compiled = 0;
    const char *text = source.text;
    gl->ShaderSource(shader, 1, &text, NULL);
    gl->CompileShader(shader);
    gl->GetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (!compiled) {
        char log[2048] = "", rewritten[CSM_ERROR_TEXT_SIZE];
        gl->GetShaderInfoLog(shader, sizeof log, NULL, log);
        rewrite_log(log, &source, rewritten, sizeof rewritten);
        gl->DeleteShader(shader);
        shader = 0;
        renderer->ring.failed = false; /* the debug output tells the same again */
        status = csm_fail(err, CSM_ERROR_SHADER, "%s: %s", csm_pass_name(pass), rewritten);
    } else if (renderer->ring.failed) {
        char warning[CSM_MESSAGE_SIZE]; /* Mesa warns with high severity: it fails the next check */
        snprintf(warning, sizeof warning, "%s", renderer->ring.error);
        rewrite_log(warning, &source, renderer->ring.error, sizeof renderer->ring.error);
    }
    csm_shader_source_destroy(&source);
    *out_shader = shader;
    return status;
}

static csm_status link_program(csm_frame *frame, csm_pass pass, GLuint *out_name, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    const GladGLContext *gl = &renderer->gl;
    GLuint shaders[2] = {0, 0}, name = 0;
    GLint linked = 0;
    csm_status status = CSM_OK;
    const int stages = stage_count(frame, pass);
    const pass_file *files = files_of(frame, pass);
    for (int i = 0; i < stages && status == CSM_OK; i++) {
        status =
            compile_stage(frame, pass, files->stage_files[i], files->stages[i], &shaders[i], err);
    }
    if (status == CSM_OK) {
        name = gl->CreateProgram();
        for (int i = 0; i < 2 && shaders[i]; i++) {
            gl->AttachShader(name, shaders[i]);
        }
        gl->LinkProgram(name);
        gl->GetProgramiv(name, GL_LINK_STATUS, &linked);
        if (!linked) {
            char log[512] = "";
            gl->GetProgramInfoLog(name, sizeof log, NULL, log);
            gl->DeleteProgram(name);
            name = 0;
            renderer->ring.failed = false;
            status =
                csm_fail(err, CSM_ERROR_SHADER, "%s: does not link: %s", csm_pass_name(pass), log);
        }
    }
    for (int i = 0; i < 2; i++) {
        if (shaders[i]) {
            gl->DeleteShader(shaders[i]);
        }
    }
    *out_name = name;
    return status;
}

csm_status csm_program_get(csm_frame *frame, csm_pass pass, GLuint *out_name, csm_error *err) {
    csm_renderer *renderer = frame->renderer;
    uint64_t key = csm_program_key(pass, &frame->settings, frame->plan.outputs);
    for (int i = 0; i < renderer->program_count; i++) {
        if (renderer->programs[i].key == key) {
            *out_name = renderer->programs[i].name;
            return CSM_OK;
        }
    }
    csm_program *grown =
        realloc(renderer->programs, ((size_t)renderer->program_count + 1) * sizeof *grown);
    if (!grown) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for a program");
    }
    renderer->programs = grown;
    csm_status status = link_program(frame, pass, out_name, err);
    if (status == CSM_OK) {
        csm_debug_label(renderer, GL_PROGRAM, *out_name, csm_pass_name(pass));
        renderer->programs[renderer->program_count++] = (csm_program){key, *out_name};
        renderer->info.programs_compiled++;
        renderer->info.live_objects++;
        frame->out->programs_compiled++;
    }
    return status;
}

csm_status csm_program_get_drawing(csm_frame *frame, csm_pass pass, GLuint out_names[2],
                                   csm_error *err) {
    csm_status status = csm_program_get(frame, pass, &out_names[1], err);
    out_names[0] = out_names[1];
    int *tested = &frame->settings.effects[CSM_EFFECT_ALPHA_TEST];
    if (status == CSM_OK && *tested) {
        *tested = 0;
        status = csm_program_get(frame, pass, &out_names[0], err);
        *tested = 1;
    }
    return status;
}

void csm_programs_drop(csm_renderer *renderer) {
    for (int i = 0; i < renderer->program_count; i++) {
        renderer->gl.DeleteProgram(renderer->programs[i].name);
        renderer->info.live_objects--;
    }
    free(renderer->programs);
    renderer->programs = NULL;
    renderer->program_count = 0;
}
