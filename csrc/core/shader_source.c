/* shader_source.c: one text out of a shader file, its includes and the defines of its pass.
 *
 * In: names of files, read through a callback. Out: flat text without #line (Mesa 22 ignores its
 * source number) and a table from every flat line to its file and line, by which program.c rewrites
 * driver logs. Each file is included once per program; a file that includes itself on the way is an
 * error.
 */
#include "csm.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_DEPTH 16

typedef struct source_build {
    csm_shader_source *out;
    size_t text_size, text_room, line_room;
    csm_read_callback read;
    void *user;
    const char *open[MAX_DEPTH]; /* files being read, outermost first */
    int depth;
    csm_error *err;
} source_build;

static csm_status out_of_memory(source_build *build) {
    return csm_fail(build->err, CSM_ERROR_OUT_OF_MEMORY, "no memory for shader text");
}

static csm_status append_line(source_build *build, const char *text, size_t length,
                              const char *file, int line) {
    csm_shader_source *out = build->out;
    if (build->text_size + length + 2 > build->text_room) {
        size_t room = 2 * (build->text_room + length + 1024);
        char *grown = realloc(out->text, room);
        if (!grown) {
            return out_of_memory(build);
        }
        out->text = grown;
        build->text_room = room;
    }
    if (out->line_count == build->line_room) {
        size_t room = 2 * build->line_room + 256;
        csm_source_line *grown = realloc(out->lines, room * sizeof *grown);
        if (!grown) {
            return out_of_memory(build);
        }
        out->lines = grown;
        build->line_room = room;
    }
    memcpy(out->text + build->text_size, text, length);
    build->text_size += length;
    out->text[build->text_size++] = '\n';
    out->text[build->text_size] = '\0';
    out->lines[out->line_count++] = (csm_source_line){file, line};
    return CSM_OK;
}

static csm_status append_text(source_build *build, const char *text, const char *file) {
    int line = 1;
    while (*text) {
        size_t length = strcspn(text, "\n");
        csm_status status = append_line(build, text, length, file, line++);
        if (status != CSM_OK) {
            return status;
        }
        text += length + (text[length] == '\n');
    }
    return CSM_OK;
}

/* The file's name as owned by the result, or NULL if it was there before (*known) or memory is out.
 */
static const char *remember_file(csm_shader_source *out, const char *name, size_t length,
                                 bool *known) {
    *known = false;
    for (size_t i = 0; i < out->file_count; i++) {
        if (strlen(out->files[i]) == length && !strncmp(out->files[i], name, length)) {
            *known = true;
            return NULL;
        }
    }
    char **files = realloc(out->files, (out->file_count + 1) * sizeof *files);
    if (!files) {
        return NULL;
    }
    out->files = files;
    char *copy = malloc(length + 1);
    if (!copy) {
        return NULL;
    }
    memcpy(copy, name, length);
    copy[length] = '\0';
    out->files[out->file_count++] = copy;
    return copy;
}

/* Start and length of the quoted name if the line is an #include. */
static const char *include_name(const char *line, size_t length, size_t *name_length) {
    static const char word[] = "#include \"";
    size_t word_length = sizeof word - 1;
    if (length < word_length + 1 || strncmp(line, word, word_length)) {
        return NULL;
    }
    const char *name = line + word_length;
    const char *end = memchr(name, '"', length - word_length);
    if (!end) {
        return NULL;
    }
    *name_length = (size_t)(end - name);
    return name;
}

static csm_status append_file(source_build *build, const char *name, const char *from,
                              int from_line);

static csm_status append_include(source_build *build, const char *name, size_t length,
                                 const char *from, int line) {
    for (int i = 0; i < build->depth; i++) {
        if (strlen(build->open[i]) == length && !strncmp(build->open[i], name, length)) {
            return csm_fail(build->err, CSM_ERROR_SHADER, "%s:%d: %.*s includes itself", from, line,
                            (int)length, name);
        }
    }
    bool known;
    const char *file = remember_file(build->out, name, length, &known);
    if (known) {
        return CSM_OK;
    }
    return file ? append_file(build, file, from, line) : out_of_memory(build);
}

static csm_status append_file(source_build *build, const char *name, const char *from,
                              int from_line) {
    if (build->depth == MAX_DEPTH) {
        return csm_fail(build->err, CSM_ERROR_SHADER, "%s:%d: includes are nested deeper than %d",
                        from, from_line, MAX_DEPTH);
    }
    char *text = NULL;
    if (!build->read(build->user, name, &text)) {
        return csm_fail(build->err, CSM_ERROR_SHADER, "%s:%d: no shader file %s", from, from_line,
                        name);
    }
    build->open[build->depth++] = name;
    csm_status status = CSM_OK;
    int line = 1;
    for (const char *at = text; *at && status == CSM_OK; line++) {
        size_t length = strcspn(at, "\n");
        size_t included;
        const char *include = include_name(at, length, &included);
        status = include ? append_include(build, include, included, name, line)
                         : append_line(build, at, length, name, line);
        at += length + (at[length] == '\n');
    }
    build->depth--;
    free(text);
    return status;
}

csm_status csm_shader_source_load(const char *name, const char *defines, csm_read_callback read,
                                  void *user, csm_shader_source *out, csm_error *err) {
    memset(out, 0, sizeof *out);
    source_build build = {.out = out, .read = read, .user = user, .err = err};
    bool known;
    csm_status status = append_text(&build, "#version 450 core\n", "(version)");
    if (status == CSM_OK) {
        status = append_text(&build, defines, "(defines)");
    }
    if (status == CSM_OK) {
        const char *file = remember_file(out, name, strlen(name), &known);
        status = file ? append_file(&build, file, "(program)", 0) : out_of_memory(&build);
    }
    if (status != CSM_OK) {
        csm_shader_source_destroy(out);
    }
    return status;
}

void csm_shader_source_destroy(csm_shader_source *source) {
    for (size_t i = 0; i < source->file_count; i++) {
        free(source->files[i]);
    }
    free(source->files);
    free(source->lines);
    free(source->text);
    memset(source, 0, sizeof *source);
}
