/* context_glfw.c: a hidden window through GLFW, for machines whose only driver needs a display.
 *
 * Windows must be opened and closed on the main thread (GLFW's rule, checked by the caller);
 * drawing may happen on any.
 */
#include "gl_internal.h"

#include <stdio.h>

enum {
    GLFW_VISIBLE = 0x00020004,
    GLFW_CONTEXT_VERSION_MAJOR = 0x00022002,
    GLFW_CONTEXT_VERSION_MINOR = 0x00022003,
    GLFW_OPENGL_DEBUG_CONTEXT = 0x00022007,
    GLFW_OPENGL_PROFILE = 0x00022008,
    GLFW_OPENGL_CORE_PROFILE = 0x00032001
};

static struct {
    int (*Init)(void);
    int (*GetError)(const char **);
    void (*DefaultWindowHints)(void);
    void (*WindowHint)(int, int);
    void *(*CreateWindow)(int, int, const char *, void *, void *);
    void (*DestroyWindow)(void *);
    void (*MakeContextCurrent)(void *);
    void *(*GetCurrentContext)(void);
    csm_gl_function (*GetProcAddress)(const char *);
} glfw; /* as in context_egl.c */

static csm_status load_library(csm_error *err) {
    static const char *const names[] = {"libglfw.so.3", "libglfw.so", NULL};
    static const csm_library_function functions[] = {
        {"glfwInit", (void **)&glfw.Init},
        {"glfwGetError", (void **)&glfw.GetError},
        {"glfwDefaultWindowHints", (void **)&glfw.DefaultWindowHints},
        {"glfwWindowHint", (void **)&glfw.WindowHint},
        {"glfwCreateWindow", (void **)&glfw.CreateWindow},
        {"glfwDestroyWindow", (void **)&glfw.DestroyWindow},
        {"glfwMakeContextCurrent", (void **)&glfw.MakeContextCurrent},
        {"glfwGetCurrentContext", (void **)&glfw.GetCurrentContext},
        {"glfwGetProcAddress", (void **)&glfw.GetProcAddress},
    };
    void *library = csm_library_open(names, err);
    if (!library) {
        return CSM_ERROR_NO_CONTEXT;
    }
    return csm_library_functions(library, "libglfw (3.3 or newer is needed)", functions,
                                 sizeof functions / sizeof *functions, err);
}

static csm_status fail_glfw(const char *what, csm_error *err) {
    const char *text = NULL;
    glfw.GetError(&text);
    return csm_fail(err, CSM_ERROR_NO_CONTEXT, "%s: %s", what, text ? text : "no reason given");
}

static csm_status open_glfw(csm_context *context, bool debug, csm_error *err) {
    csm_status status = load_library(err);
    if (status != CSM_OK) {
        return status;
    }
    if (!glfw.Init()) {
        return fail_glfw("glfwInit", err);
    }
    glfw.DefaultWindowHints();
    glfw.WindowHint(GLFW_VISIBLE, 0);
    glfw.WindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
    glfw.WindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
    glfw.WindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfw.WindowHint(GLFW_OPENGL_DEBUG_CONTEXT, debug);
    context->handle = glfw.CreateWindow(4, 4, "csm", NULL, NULL);
    if (!context->handle) {
        return fail_glfw("glfwCreateWindow", err);
    }
    snprintf(context->platform, sizeof context->platform, "hidden window");
    return CSM_OK;
}

static bool bind_glfw(csm_context *context) {
    glfw.MakeContextCurrent(context->handle);
    return glfw.GetCurrentContext() == context->handle;
}

static void unbind_glfw(csm_context *context) {
    (void)context;
    glfw.MakeContextCurrent(NULL);
}

static void close_glfw(csm_context *context) {
    glfw.DestroyWindow(context->handle);
}

static csm_gl_function load_glfw(const char *name) {
    return glfw.GetProcAddress(name);
}

const csm_backend csm_backend_glfw = {open_glfw, bind_glfw, unbind_glfw, close_glfw, load_glfw};
