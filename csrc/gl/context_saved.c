/* context_saved.c: the binding that a thread had before ours, whoever's it is.
 *
 * Its library is one that somebody else has loaded. To ask for one that nobody has, is to look for
 * its file in every folder: 55 system calls for those of this file, at every call of a renderer. So
 * what was found is kept until a library comes or goes.
 */
#define _GNU_SOURCE /* dl_iterate_phdr */
#include "gl_internal.h"

#include <dlfcn.h>
#include <link.h>
#include <stddef.h>
#include <string.h>

#define EGL_LIBRARY "libEGL.so.1"
#define GLX_LIBRARY "libGL.so.1"
#define OSMESA_LIBRARY "libOSMesa.so.8"

/* Functions of libraries that are there; NULL of others. */
typedef struct loaded_functions {
    void *(*egl_context)(void), *(*egl_display)(void), *(*egl_surface)(int which);
    unsigned (*egl_bind)(void *display, void *draw, void *read, void *context);
    void *(*glx_context)(void), *(*glx_display)(void);
    unsigned long (*glx_drawable)(void);
    int (*glx_bind)(void *display, unsigned long drawable, void *context);
    void *(*osmesa_context)(void);
    unsigned char (*osmesa_buffer)(void *, int *, int *, int *, void **);
    unsigned char (*osmesa_bind)(void *, void *, unsigned, int, int);
} loaded_functions;

/* Libraries that came and went so far; none came where the loader does not say. */
typedef struct load_count {
    unsigned long long came, went;
} load_count;

static int count_loads(struct dl_phdr_info *info, size_t size, void *user) {
    if (size >= offsetof(struct dl_phdr_info, dlpi_subs) + sizeof info->dlpi_subs) {
        *(load_count *)user = (load_count){info->dlpi_adds, info->dlpi_subs};
    }
    return 1; /* each library says it for all */
}

/* Slots of functions of a library, if somebody has loaded it. */
static void find(const char *library_name, const csm_library_function *functions, size_t count) {
    void *library = dlopen(library_name, RTLD_NOW | RTLD_NOLOAD);
    if (!library) {
        return;
    }
    for (size_t i = 0; i < count; i++) {
        *functions[i].slot = dlsym(library, functions[i].name);
    }
    dlclose(library); /* drops only the reference of this look-up */
}

static void find_all(loaded_functions *out) {
    memset(out, 0, sizeof *out);
    find(EGL_LIBRARY,
         (csm_library_function[]){{"eglGetCurrentContext", (void **)&out->egl_context},
                                  {"eglGetCurrentDisplay", (void **)&out->egl_display},
                                  {"eglGetCurrentSurface", (void **)&out->egl_surface},
                                  {"eglMakeCurrent", (void **)&out->egl_bind}},
         4);
    find(GLX_LIBRARY,
         (csm_library_function[]){{"glXGetCurrentContext", (void **)&out->glx_context},
                                  {"glXGetCurrentDisplay", (void **)&out->glx_display},
                                  {"glXGetCurrentDrawable", (void **)&out->glx_drawable},
                                  {"glXMakeCurrent", (void **)&out->glx_bind}},
         4);
    find(OSMESA_LIBRARY,
         (csm_library_function[]){{"OSMesaGetCurrentContext", (void **)&out->osmesa_context},
                                  {"OSMesaGetColorBuffer", (void **)&out->osmesa_buffer},
                                  {"OSMesaMakeCurrent", (void **)&out->osmesa_bind}},
         3);
}

/* Kept by each thread: a lock of ours might be held by nobody after a fork. */
static const loaded_functions *loaded(void) {
    static _Thread_local loaded_functions known;
    static _Thread_local load_count seen;
    load_count now = {0, 0};
    dl_iterate_phdr(count_loads, &now);
    if (!now.came || now.came != seen.came || now.went != seen.went) {
        find_all(&known);
        seen = now;
    }
    return &known;
}

static void save_egl(const loaded_functions *gl, csm_saved_binding *saved) {
    if (gl->egl_context && gl->egl_display && gl->egl_surface && gl->egl_bind &&
        (saved->egl_context = gl->egl_context())) {
        saved->egl_display = gl->egl_display();
        saved->egl_draw = gl->egl_surface(0x3059); /* EGL_DRAW */
        saved->egl_read = gl->egl_surface(0x305A); /* EGL_READ */
    }
}

static void save_glx(const loaded_functions *gl, csm_saved_binding *saved) {
    if (gl->glx_context && gl->glx_display && gl->glx_drawable && gl->glx_bind &&
        (saved->glx_context = gl->glx_context())) {
        saved->glx_display = gl->glx_display();
        saved->glx_drawable = gl->glx_drawable();
    }
}

static void save_osmesa(const loaded_functions *gl, csm_saved_binding *saved) {
    int format;
    if (gl->osmesa_context && gl->osmesa_buffer && gl->osmesa_bind &&
        (saved->osmesa_context = gl->osmesa_context()) &&
        !gl->osmesa_buffer(saved->osmesa_context, &saved->osmesa_width, &saved->osmesa_height,
                           &format, &saved->osmesa_pixels)) {
        saved->osmesa_context = NULL;
    }
}

/* GLX ends the process with an X error when it binds while the thread has a context of EGL, and
 * EGL refuses beside GLX: whatever was there is released first. */
static void release_saved(const loaded_functions *gl, const csm_saved_binding *saved) {
    if (saved->egl_context) {
        gl->egl_bind(saved->egl_display, NULL, NULL, NULL);
    }
    if (saved->glx_context) {
        gl->glx_bind(saved->glx_display, 0, NULL);
    }
}

void csm_binding_save(csm_saved_binding *saved) {
    const loaded_functions *gl = loaded();
    memset(saved, 0, sizeof *saved);
    save_egl(gl, saved);
    save_glx(gl, saved);
    release_saved(gl, saved);
    save_osmesa(gl, saved); /* last: Mesa hands out a current context of GLX as OSMesa's */
}

void csm_binding_restore(const csm_saved_binding *saved) {
    const loaded_functions *gl = loaded();
    if (saved->egl_context && gl->egl_bind) {
        gl->egl_bind(saved->egl_display, saved->egl_draw, saved->egl_read, saved->egl_context);
    }
    if (saved->glx_context && gl->glx_bind) {
        gl->glx_bind(saved->glx_display, saved->glx_drawable, saved->glx_context);
    }
    if (saved->osmesa_context && gl->osmesa_bind) {
        gl->osmesa_bind(saved->osmesa_context, saved->osmesa_pixels, 0x1401 /* GL_UNSIGNED_BYTE */,
                        saved->osmesa_width, saved->osmesa_height);
    }
}
