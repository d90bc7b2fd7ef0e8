/* context.c: one interface over three back ends, and the binding a thread had before ours.
 *
 * Libraries are opened when a context is asked for, so importing csm needs none of them, and stay
 * open: drivers keep threads and thread-local state that does not survive dlclose.
 */
#include "gl_internal.h"

#include <dlfcn.h>
#include <string.h>

static const csm_backend *const backends[CSM_BACKEND_COUNT] = {
    [CSM_BACKEND_EGL] = &csm_backend_egl,
    [CSM_BACKEND_OSMESA] = &csm_backend_osmesa,
    [CSM_BACKEND_GLFW] = &csm_backend_glfw,
};

const char *csm_backend_name(int backend) {
    static const char *const names[CSM_BACKEND_COUNT] = {"egl", "osmesa", "glfw"};
    return backend >= 0 && backend < CSM_BACKEND_COUNT ? names[backend] : "unknown";
}

void *csm_library_open(const char *const *names, csm_error *err) {
    const char *first = *names;
    for (; *names; names++) {
        void *library = dlopen(*names, RTLD_NOW | RTLD_LOCAL);
        if (library) {
            return library;
        }
    }
    csm_fail(err, CSM_ERROR_NO_CONTEXT, "%s not found", first);
    return NULL;
}

csm_status csm_library_functions(void *library, const char *library_name,
                                 const csm_library_function *functions, size_t count,
                                 csm_error *err) {
    for (size_t i = 0; i < count; i++) {
        *functions[i].slot = dlsym(library, functions[i].name);
        if (!*functions[i].slot) {
            return csm_fail(err, CSM_ERROR_NO_CONTEXT, "%s is too old: it has no %s", library_name,
                            functions[i].name);
        }
    }
    return CSM_OK;
}

csm_status csm_context_open(csm_context *context, int backend, bool debug, csm_error *err) {
    if (backend < 0 || backend >= CSM_BACKEND_COUNT) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT, "backend must be 0 to %d (got %d)",
                        CSM_BACKEND_COUNT - 1, backend);
    }
    memset(context, 0, sizeof *context);
    context->backend = backend;
    return backends[backend]->open(context, debug, err);
}

bool csm_context_bind(csm_context *context) {
    return backends[context->backend]->bind(context);
}

void csm_context_unbind(csm_context *context) {
    backends[context->backend]->unbind(context);
}

void csm_context_close(csm_context *context) {
    if (context->handle) {
        backends[context->backend]->close(context);
    }
    memset(context, 0, sizeof *context);
}

csm_gl_function csm_context_load(int backend, const char *name) {
    return backends[backend]->load(name);
}

/* A function of a library that somebody has loaded already; NULL if nobody has. */
static void *loaded_function(const char *library_name, const char *function) {
    void *library = dlopen(library_name, RTLD_NOW | RTLD_NOLOAD);
    if (!library) {
        return NULL;
    }
    void *found = dlsym(library, function);
    dlclose(library); /* drops only the reference of this look-up */
    return found;
}

#define LOADED(type, library, function) ((type)loaded_function(library, function))
#define EGL_LIBRARY "libEGL.so.1"
#define GLX_LIBRARY "libGL.so.1"
#define OSMESA_LIBRARY "libOSMesa.so.8"

typedef void *(*get_pointer)(void);
typedef void *(*get_surface)(int which);
typedef unsigned long (*get_drawable)(void);
typedef unsigned (*egl_make_current)(void *display, void *draw, void *read, void *context);
typedef int (*glx_make_current)(void *display, unsigned long drawable, void *context);
typedef unsigned char (*osmesa_color_buffer)(void *, int *, int *, int *, void **);
typedef unsigned char (*osmesa_make_current)(void *, void *, unsigned, int, int);

static void save_egl(csm_saved_binding *saved) {
    get_pointer context = LOADED(get_pointer, EGL_LIBRARY, "eglGetCurrentContext");
    get_pointer display = LOADED(get_pointer, EGL_LIBRARY, "eglGetCurrentDisplay");
    get_surface surface = LOADED(get_surface, EGL_LIBRARY, "eglGetCurrentSurface");
    if (context && display && surface && (saved->egl_context = context())) {
        saved->egl_display = display();
        saved->egl_draw = surface(0x3059); /* EGL_DRAW */
        saved->egl_read = surface(0x305A); /* EGL_READ */
    }
}

static void save_glx(csm_saved_binding *saved) {
    get_pointer context = LOADED(get_pointer, GLX_LIBRARY, "glXGetCurrentContext");
    get_pointer display = LOADED(get_pointer, GLX_LIBRARY, "glXGetCurrentDisplay");
    get_drawable drawable = LOADED(get_drawable, GLX_LIBRARY, "glXGetCurrentDrawable");
    if (context && display && drawable && (saved->glx_context = context())) {
        saved->glx_display = display();
        saved->glx_drawable = drawable();
    }
}

static void save_osmesa(csm_saved_binding *saved) {
    get_pointer context = LOADED(get_pointer, OSMESA_LIBRARY, "OSMesaGetCurrentContext");
    osmesa_color_buffer buffer =
        LOADED(osmesa_color_buffer, OSMESA_LIBRARY, "OSMesaGetColorBuffer");
    int format;
    if (context && buffer && (saved->osmesa_context = context()) &&
        !buffer(saved->osmesa_context, &saved->osmesa_width, &saved->osmesa_height, &format,
                &saved->osmesa_pixels)) {
        saved->osmesa_context = NULL;
    }
}

/* GLX ends the process with an X error when it binds while the thread has a context of EGL, and
 * EGL refuses beside GLX: whatever was there is released first. */
static void release_saved(const csm_saved_binding *saved) {
    if (saved->egl_context) {
        egl_make_current bind = LOADED(egl_make_current, EGL_LIBRARY, "eglMakeCurrent");
        bind(saved->egl_display, NULL, NULL, NULL);
    }
    if (saved->glx_context) {
        glx_make_current bind = LOADED(glx_make_current, GLX_LIBRARY, "glXMakeCurrent");
        bind(saved->glx_display, 0, NULL);
    }
}

void csm_binding_save(csm_saved_binding *saved) {
    memset(saved, 0, sizeof *saved);
    save_egl(saved);
    save_glx(saved);
    release_saved(saved);
    save_osmesa(saved); /* last: Mesa hands out a current context of GLX as if it were OSMesa's */
}

void csm_binding_restore(const csm_saved_binding *saved) {
    if (saved->egl_context) {
        egl_make_current bind = LOADED(egl_make_current, EGL_LIBRARY, "eglMakeCurrent");
        bind(saved->egl_display, saved->egl_draw, saved->egl_read, saved->egl_context);
    }
    if (saved->glx_context) {
        glx_make_current bind = LOADED(glx_make_current, GLX_LIBRARY, "glXMakeCurrent");
        bind(saved->glx_display, saved->glx_drawable, saved->glx_context);
    }
    if (saved->osmesa_context) {
        osmesa_make_current bind = LOADED(osmesa_make_current, OSMESA_LIBRARY, "OSMesaMakeCurrent");
        bind(saved->osmesa_context, saved->osmesa_pixels, 0x1401 /* GL_UNSIGNED_BYTE */,
             saved->osmesa_width, saved->osmesa_height);
    }
}
