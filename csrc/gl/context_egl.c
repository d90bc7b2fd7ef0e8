/* context_egl.c: EGL without a window: the device platform of a GPU if there is one, Mesa's
 * surfaceless platform otherwise, any device as the last resort.
 */
#include "gl_internal.h"

#include <stdio.h>
#include <string.h>

typedef void *egl_handle;
typedef int32_t egl_int;

enum {
    EGL_NONE = 0x3038,
    EGL_VENDOR = 0x3053,
    EGL_EXTENSIONS = 0x3055,
    EGL_OPENGL_API = 0x30A2,
    EGL_CONTEXT_MAJOR_VERSION = 0x3098,
    EGL_CONTEXT_MINOR_VERSION = 0x30FB,
    EGL_CONTEXT_OPENGL_PROFILE_MASK = 0x30FD,
    EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT = 1,
    EGL_CONTEXT_OPENGL_DEBUG = 0x31B0,
    EGL_PLATFORM_DEVICE_EXT = 0x313F,
    EGL_PLATFORM_SURFACELESS_MESA = 0x31DD,
    MAX_DEVICES = 16
};

static struct {
    csm_gl_function (*GetProcAddress)(const char *);
    const char *(*QueryString)(egl_handle, egl_int);
    unsigned (*Initialize)(egl_handle, egl_int *, egl_int *);
    unsigned (*BindAPI)(unsigned);
    egl_handle (*CreateContext)(egl_handle, egl_handle, egl_handle, const egl_int *);
    unsigned (*DestroyContext)(egl_handle, egl_handle);
    unsigned (*MakeCurrent)(egl_handle, egl_handle, egl_handle, egl_handle);
    egl_int (*GetError)(void);
    egl_handle (*GetPlatformDisplayEXT)(unsigned, egl_handle, const egl_int *);
    unsigned (*QueryDevicesEXT)(egl_int, egl_handle *, egl_int *);
    const char *(*QueryDeviceStringEXT)(egl_handle, egl_int);
} egl; /* function pointers of one library: written once with the same values by whoever is first */

static void load_extension(const char *name, void *slot) {
    csm_gl_function function = egl.GetProcAddress(name);
    memcpy(slot, &function, sizeof function);
}

static csm_status load_library(csm_error *err) {
    static const char *const names[] = {"libEGL.so.1", "libEGL.so", NULL};
    static const csm_library_function core[] = {
        {"eglGetProcAddress", (void **)&egl.GetProcAddress},
        {"eglQueryString", (void **)&egl.QueryString},
        {"eglInitialize", (void **)&egl.Initialize},
        {"eglBindAPI", (void **)&egl.BindAPI},
        {"eglCreateContext", (void **)&egl.CreateContext},
        {"eglDestroyContext", (void **)&egl.DestroyContext},
        {"eglMakeCurrent", (void **)&egl.MakeCurrent},
        {"eglGetError", (void **)&egl.GetError},
    };
    void *library = csm_library_open(names, err);
    if (!library) {
        return CSM_ERROR_NO_CONTEXT;
    }
    csm_status status =
        csm_library_functions(library, "libEGL", core, sizeof core / sizeof *core, err);
    if (status != CSM_OK) {
        return status;
    }
    load_extension("eglGetPlatformDisplayEXT", &egl.GetPlatformDisplayEXT);
    load_extension("eglQueryDevicesEXT", &egl.QueryDevicesEXT);
    load_extension("eglQueryDeviceStringEXT", &egl.QueryDeviceStringEXT);
    if (!egl.GetPlatformDisplayEXT) {
        return csm_fail(err, CSM_ERROR_NO_CONTEXT, "libEGL has no eglGetPlatformDisplayEXT");
    }
    return CSM_OK;
}

static csm_status make_context(csm_context *context, egl_handle display, bool debug,
                               csm_error *err) {
    static const egl_int minors[] = {6, 5};
    if (!display || !egl.Initialize(display, NULL, NULL)) {
        return csm_fail(err, CSM_ERROR_NO_CONTEXT, "eglInitialize failed (0x%04x)", egl.GetError());
    }
    const char *extensions = egl.QueryString(display, EGL_EXTENSIONS);
    if (!extensions || !strstr(extensions, "EGL_KHR_surfaceless_context")) {
        return csm_fail(err, CSM_ERROR_NO_CONTEXT, "no EGL_KHR_surfaceless_context");
    }
    if (!egl.BindAPI(EGL_OPENGL_API)) {
        return csm_fail(err, CSM_ERROR_NO_CONTEXT, "this EGL has no desktop OpenGL");
    }
    for (size_t i = 0; i < sizeof minors / sizeof *minors; i++) {
        egl_int attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                4,
                                EGL_CONTEXT_MINOR_VERSION,
                                minors[i],
                                EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                EGL_CONTEXT_OPENGL_DEBUG,
                                debug,
                                EGL_NONE};
        context->handle = egl.CreateContext(display, NULL, NULL, attributes);
        if (context->handle) {
            context->display = display;
            return CSM_OK;
        }
    }
    return csm_fail(err, CSM_ERROR_NO_CONTEXT, "no OpenGL 4.5 core context (EGL error 0x%04x)",
                    egl.GetError());
}

static bool is_software(egl_handle device) {
    const char *extensions =
        egl.QueryDeviceStringEXT ? egl.QueryDeviceStringEXT(device, EGL_EXTENSIONS) : NULL;
    return !extensions || strstr(extensions, "EGL_MESA_device_software");
}

/* Tries the devices of one kind; the software one is not a GPU's. */
static csm_status open_device(csm_context *context, bool software, bool debug, csm_error *err) {
    egl_handle devices[MAX_DEVICES];
    egl_int count = 0;
    csm_status status =
        csm_fail(err, CSM_ERROR_NO_CONTEXT, "no %s EGL device", software ? "software" : "hardware");
    if (!egl.QueryDevicesEXT || !egl.QueryDevicesEXT(MAX_DEVICES, devices, &count)) {
        return status;
    }
    for (egl_int i = 0; i < count && status != CSM_OK; i++) {
        if (is_software(devices[i]) == software) {
            egl_handle display =
                egl.GetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, devices[i], NULL);
            status = make_context(context, display, debug, err);
        }
    }
    return status;
}

static csm_status open_egl(csm_context *context, bool debug, csm_error *err) {
    csm_error hardware = {0}, surfaceless = {0}, software = {0};
    csm_status status = load_library(err);
    if (status != CSM_OK) {
        return status;
    }
    if (open_device(context, false, debug, &hardware) == CSM_OK) {
        snprintf(context->platform, sizeof context->platform, "device");
        return CSM_OK;
    }
    egl_handle display = egl.GetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, NULL, NULL);
    if (make_context(context, display, debug, &surfaceless) == CSM_OK) {
        snprintf(context->platform, sizeof context->platform, "surfaceless");
        return CSM_OK;
    }
    if (open_device(context, true, debug, &software) == CSM_OK) {
        snprintf(context->platform, sizeof context->platform, "software device");
        return CSM_OK;
    }
    return csm_fail(err, CSM_ERROR_NO_CONTEXT,
                    "device: %.200s; surfaceless: %.200s; software: %.200s", hardware.text,
                    surfaceless.text, software.text);
}

static bool bind_egl(csm_context *context) {
    egl.BindAPI(EGL_OPENGL_API); /* the bound API is a state of the thread */
    return egl.MakeCurrent(context->display, NULL, NULL, context->handle);
}

static void unbind_egl(csm_context *context) {
    egl.MakeCurrent(context->display, NULL, NULL, NULL);
}

static void close_egl(csm_context *context) {
    /* the display is the process's own, shared with every other user of EGL: it stays initialised
     */
    egl.DestroyContext(context->display, context->handle);
}

static csm_gl_function load_egl(const char *name) {
    return egl.GetProcAddress(name);
}

const csm_backend csm_backend_egl = {open_egl, bind_egl, unbind_egl, close_egl, load_egl};
