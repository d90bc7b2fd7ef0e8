/* errors.c: exception classes in module state, and the one map from a status to an exception. */
#include "py_common.h"

#include <string.h>

static const struct {
    const char *name, *doc;
} exceptions[CSM_PY_EXCEPTION_COUNT] = {
    [CSM_PY_CSM_ERROR] = {"csm.CsmError", "Root of the exceptions that are csm's own."},
    [CSM_PY_CONTEXT_ERROR] = {"csm.ContextError", "There is no OpenGL context, or not any more."},
    [CSM_PY_SHADER_ERROR] = {"csm.ShaderError",
                             "A shader does not compile or link: pass_name, defines, log."},
    [CSM_PY_LIMIT_ERROR] = {"csm.LimitError", "The driver cannot hold what was asked for."},
    [CSM_PY_GL_ERROR] = {"csm.GLError", "OpenGL reported an error."},
    [CSM_PY_GL_WARNING] = {"csm.GLWarning", "OpenGL reported a problem of medium severity."},
};

int csm_py_add_exceptions(PyObject *module) {
    csm_module_state *state = PyModule_GetState(module);
    for (int i = 0; i < CSM_PY_EXCEPTION_COUNT; i++) {
        PyObject *base = i == CSM_PY_CSM_ERROR    ? PyExc_RuntimeError
                         : i == CSM_PY_GL_WARNING ? PyExc_RuntimeWarning
                                                  : state->exceptions[CSM_PY_CSM_ERROR];
        state->exceptions[i] =
            PyErr_NewExceptionWithDoc(exceptions[i].name, exceptions[i].doc, base, NULL);
        if (!state->exceptions[i] ||
            PyModule_AddObjectRef(module, strchr(exceptions[i].name, '.') + 1,
                                  state->exceptions[i]) < 0) {
            return -1;
        }
    }
    return 0;
}

/* The class a status names in csm_status_exception. */
static PyObject *class_of(PyObject *module, const char *name) {
    const csm_module_state *state = PyModule_GetState(module);
    for (int i = 0; i < CSM_PY_EXCEPTION_COUNT; i++) {
        if (!strcmp(strchr(exceptions[i].name, '.') + 1, name)) {
            return state->exceptions[i];
        }
    }
    return !strcmp(name, "MemoryError") ? PyExc_MemoryError : PyExc_ValueError;
}

PyObject *csm_py_text(const char *text) {
    return PyUnicode_DecodeUTF8(text, (Py_ssize_t)strlen(text), "replace");
}

/* "pass: log" as attributes, for people who read logs by program. */
static void raise_shader_error(PyObject *class, const char *text) {
    const char *colon = strchr(text, ':');
    PyObject *whole = csm_py_text(text);
    PyObject *error = whole ? PyObject_CallOneArg(class, whole) : NULL;
    PyObject *pass_name = PyUnicode_FromStringAndSize(text, colon ? (Py_ssize_t)(colon - text) : 0);
    PyObject *log = csm_py_text(colon ? colon + 1 + strspn(colon + 1, " ") : text);
    if (error && pass_name && log && PyObject_SetAttrString(error, "pass_name", pass_name) == 0 &&
        PyObject_SetAttrString(error, "log", log) == 0) {
        PyErr_SetObject(class, error);
    }
    Py_XDECREF(whole);
    Py_XDECREF(error);
    Py_XDECREF(pass_name);
    Py_XDECREF(log);
}

PyObject *csm_py_raise(PyObject *module, const csm_error *err) {
    if (PyErr_Occurred()) {
        return NULL; /* a signal handler's exception is what stopped the call */
    }
    if (err->status == CSM_ERROR_INTERRUPTED) {
        PyErr_SetNone(PyExc_KeyboardInterrupt);
        return NULL;
    }
    PyObject *class = class_of(module, csm_status_exception(err->status));
    if (err->status == CSM_ERROR_SHADER) {
        raise_shader_error(class, err->text);
    } else {
        PyObject *text = csm_py_text(err->text);
        if (text) {
            PyErr_SetObject(class, text);
            Py_DECREF(text);
        }
    }
    return NULL;
}
