/* module.c: csm._core. Multi-phase initialisation, everything kept in module state. */
#define CSM_PY_IMPORTS_ARRAY
#include "py_common.h"

static int add_constants(PyObject *module) {
    static const struct {
        const char *name;
        unsigned bit;
    } outputs[] = {
        {"mask", CSM_OUT_MASK},
        {"mask_single", CSM_OUT_MASK_SINGLE},
        {"moments", CSM_OUT_MOMENTS},
        {"valid", CSM_OUT_VALID},
        {"view_depth", CSM_OUT_VIEW_DEPTH},
        {"cascade_index", CSM_OUT_CASCADE_INDEX},
        {"shadow_maps", CSM_OUT_SHADOW_MAPS},
        {"normal", CSM_OUT_NORMAL},
        {"points", CSM_OUT_POINTS},
    };
    PyObject *bits = PyDict_New(), *backends = PyList_New(0);
    bool complete = bits && backends;
    for (size_t i = 0; i < sizeof outputs / sizeof *outputs && complete; i++) {
        PyObject *bit = PyLong_FromUnsignedLong(outputs[i].bit);
        complete = bit && PyDict_SetItemString(bits, outputs[i].name, bit) == 0;
        Py_XDECREF(bit);
    }
    for (int i = 0; i < CSM_BACKEND_COUNT && complete; i++) {
        PyObject *name = PyUnicode_FromString(csm_backend_name(i));
        complete = name && PyList_Append(backends, name) == 0;
        Py_XDECREF(name);
    }
    complete = complete && PyModule_AddObjectRef(module, "OUTPUTS", bits) == 0 &&
               PyModule_AddObjectRef(module, "BACKENDS", backends) == 0 &&
               PyModule_AddIntConstant(module, "MAX_CASCADES", CSM_MAX_CASCADES) == 0;
    Py_XDECREF(bits);
    Py_XDECREF(backends);
    return complete ? 0 : -1;
}

static int core_exec(PyObject *module) {
    if (PyArray_ImportNumPyAPI() < 0) {
        return -1;
    }
    if (csm_py_add_exceptions(module) < 0 || csm_py_add_renderer_type(module) < 0 ||
        PyModule_AddFunctions(module, csm_py_core_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_coverage_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_coarse_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_coarse_look_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_coarse_map_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_arrange_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_coarse_number_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_caster_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_forecast_sum_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_scene_methods) < 0 ||
        PyModule_AddFunctions(module, csm_py_settings_methods) < 0) {
        return -1;
    }
    return add_constants(module);
}

static int core_traverse(PyObject *module, visitproc visit, void *arg) {
    csm_module_state *state = PyModule_GetState(module);
    for (int i = 0; i < CSM_PY_EXCEPTION_COUNT; i++) {
        Py_VISIT(state->exceptions[i]);
    }
    Py_VISIT(state->renderer_type);
    return 0;
}

static int core_clear(PyObject *module) {
    csm_module_state *state = PyModule_GetState(module);
    for (int i = 0; i < CSM_PY_EXCEPTION_COUNT; i++) {
        Py_CLEAR(state->exceptions[i]);
    }
    Py_CLEAR(state->renderer_type);
    return 0;
}

static void core_free(void *module) {
    core_clear(module);
}

static PyModuleDef_Slot core_slots[] = {
    {Py_mod_exec, core_exec},
#ifdef Py_MOD_MULTIPLE_INTERPRETERS_NOT_SUPPORTED
    {Py_mod_multiple_interpreters, Py_MOD_MULTIPLE_INTERPRETERS_NOT_SUPPORTED}, /* nor does numpy */
#endif
    {0, NULL},
};

static struct PyModuleDef core_module = {
    PyModuleDef_HEAD_INIT,         .m_name = "csm._core",
    .m_doc = "The C core of csm.", .m_size = sizeof(csm_module_state),
    .m_slots = core_slots,         .m_traverse = core_traverse,
    .m_clear = core_clear,         .m_free = core_free,
};

PyMODINIT_FUNC PyInit__core(void) {
    return PyModuleDef_Init(&core_module);
}
