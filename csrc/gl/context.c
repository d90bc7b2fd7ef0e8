/* context.c: one interface over three back ends.
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
