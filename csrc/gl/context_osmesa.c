/* context_osmesa.c: Mesa's off-screen back end: no window system at all. */
#include "gl_internal.h"

#include <stdio.h>
#include <stdlib.h>

enum {
    OSMESA_FORMAT = 0x22,
    OSMESA_RGBA = 0x1908,
    OSMESA_PROFILE = 0x33,
    OSMESA_CORE_PROFILE = 0x34,
    OSMESA_CONTEXT_MAJOR_VERSION = 0x36,
    OSMESA_CONTEXT_MINOR_VERSION = 0x37,
    SIDE = 4 /* the default framebuffer nobody draws to */
};

static struct {
    void *(*CreateContextAttribs)(const int *, void *);
    void (*DestroyContext)(void *);
    unsigned char (*MakeCurrent)(void *, void *, unsigned, int, int);
    csm_gl_function (*GetProcAddress)(const char *);
} osmesa; /* as in context_egl.c */

static csm_status load_library(csm_error *err) {
    static const char *const names[] = {"libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so", NULL};
    static const csm_library_function functions[] = {
        {"OSMesaCreateContextAttribs", (void **)&osmesa.CreateContextAttribs},
        {"OSMesaDestroyContext", (void **)&osmesa.DestroyContext},
        {"OSMesaMakeCurrent", (void **)&osmesa.MakeCurrent},
        {"OSMesaGetProcAddress", (void **)&osmesa.GetProcAddress},
    };
    void *library = csm_library_open(names, err);
    if (!library) {
        return CSM_ERROR_NO_CONTEXT;
    }
    return csm_library_functions(library, "libOSMesa", functions,
                                 sizeof functions / sizeof *functions, err);
}

static csm_status open_osmesa(csm_context *context, bool debug, csm_error *err) {
    (void)debug; /* OSMesa has no debug flag; KHR_debug output works without it */
    csm_status status = load_library(err);
    if (status != CSM_OK) {
        return status;
    }
    const int attributes[] = {OSMESA_FORMAT,
                              OSMESA_RGBA,
                              OSMESA_PROFILE,
                              OSMESA_CORE_PROFILE,
                              OSMESA_CONTEXT_MAJOR_VERSION,
                              4,
                              OSMESA_CONTEXT_MINOR_VERSION,
                              5,
                              0};
    context->handle = osmesa.CreateContextAttribs(attributes, NULL);
    context->pixels = calloc(SIDE * SIDE, 4);
    if (!context->handle || !context->pixels) {
        free(context->pixels);
        if (context->handle) {
            osmesa.DestroyContext(context->handle);
            context->handle = NULL;
        }
        return csm_fail(err, CSM_ERROR_NO_CONTEXT, "no OpenGL 4.5 core context");
    }
    snprintf(context->platform, sizeof context->platform, "off-screen");
    return CSM_OK;
}

static bool bind_osmesa(csm_context *context) {
    return osmesa.MakeCurrent(context->handle, context->pixels, GL_UNSIGNED_BYTE, SIDE, SIDE);
}

static void unbind_osmesa(csm_context *context) {
    (void)context;
    osmesa.MakeCurrent(NULL, NULL, GL_UNSIGNED_BYTE, 0, 0);
}

static void close_osmesa(csm_context *context) {
    osmesa.DestroyContext(context->handle);
    free(context->pixels);
}

static csm_gl_function load_osmesa(const char *name) {
    return osmesa.GetProcAddress(name);
}

const csm_backend csm_backend_osmesa = {open_osmesa, bind_osmesa, unbind_osmesa, close_osmesa,
                                        load_osmesa};
