/* renderer_type.c: _core.Renderer, a thin handle on csm_renderer; csm/renderer.py is what users
 * hold.
 *
 * The GIL is dropped first, then the renderer takes its lock; the stop callback takes the GIL back
 * for a moment while the lock is held, which is safe because nobody waits for the lock with the
 * GIL.
 */
#include "py_common.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SCENE_CAPSULE "csm_gpu_scene"
#define READ_SIZE 16384

typedef struct renderer_object {
    PyObject_HEAD csm_renderer *renderer;
    char *shader_folder;
} renderer_object;

static PyObject *module_of(PyObject *self) {
    return PyType_GetModule(Py_TYPE(self));
}

/* -- callbacks of the core, without the GIL
 * -------------------------------------------------------- */

static bool read_shader(void *user, const char *name, char **out_text) {
    char path[4096];
    const char *folder = user;
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path) {
        return false;
    }
    FILE *file = fopen(path, "rb");
    if (!file) {
        return false;
    }
    char *text = NULL;
    size_t used = 0, got = 0;
    bool complete;
    do {
        char *grown = realloc(text, used + READ_SIZE + 1);
        complete = grown != NULL;
        if (complete) {
            text = grown;
            got = fread(text + used, 1, READ_SIZE, file);
            used += got;
            complete = !ferror(file); /* opening a folder works, reading it does not */
        }
    } while (complete && got);
    fclose(file);
    if (!complete) {
        free(text);
        return false;
    }
    text[used] = '\0';
    *out_text = text;
    return true;
}

/* Signals are handled on the main thread alone; elsewhere this only looks. */
static bool signal_arrived(void *user) {
    (void)user;
    PyGILState_STATE gil = PyGILState_Ensure();
    bool stop = PyErr_CheckSignals() < 0;
    PyGILState_Release(gil);
    return stop;
}

/* -- life -----------------------------------------------------------------------------------------
 */

static PyObject *renderer_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"backend", "debug", "shader_folder", NULL};
    int backend, debug;
    const char *folder;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "ips:Renderer", names, &backend, &debug,
                                     &folder)) {
        return NULL;
    }
    renderer_object *self = (renderer_object *)type->tp_alloc(type, 0);
    if (!self) {
        return NULL;
    }
    self->shader_folder = strdup(folder);
    if (!self->shader_folder) {
        Py_DECREF(self);
        return PyErr_NoMemory();
    }
    csm_renderer_desc desc = {backend, debug, read_shader, self->shader_folder};
    csm_error err = {0};
    csm_status status;
    Py_BEGIN_ALLOW_THREADS
    status = csm_renderer_create(&desc, &self->renderer, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        csm_py_raise(PyType_GetModule(type), &err);
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static PyObject *renderer_close(PyObject *object, PyObject *unused) {
    (void)unused;
    renderer_object *self = (renderer_object *)object;
    csm_renderer *renderer = self->renderer;
    self->renderer = NULL;
    Py_BEGIN_ALLOW_THREADS
    csm_renderer_destroy(renderer);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

static void renderer_dealloc(PyObject *object) {
    renderer_object *self = (renderer_object *)object;
    PyTypeObject *type = Py_TYPE(object);
    csm_renderer_destroy(self->renderer);
    free(self->shader_folder);
    type->tp_free(object);
    Py_DECREF(type);
}

static csm_renderer *open_renderer(PyObject *object) {
    csm_renderer *renderer = ((renderer_object *)object)->renderer;
    if (!renderer) {
        csm_error err = {0};
        csm_fail(&err, CSM_ERROR_CONTEXT_LOST, "renderer is closed");
        csm_py_raise(module_of(object), &err);
    }
    return renderer;
}

/* -- small methods --------------------------------------------------------------------------------
 */

static PyObject *renderer_describe(PyObject *object, PyObject *unused) {
    (void)unused;
    csm_renderer *renderer = open_renderer(object);
    csm_renderer_info info;
    csm_error err = {0};
    csm_status status;
    if (!renderer) {
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    status = csm_renderer_describe(renderer, &info, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        return csm_py_raise(module_of(object), &err);
    }
    return Py_BuildValue(
        "{s:s,s:s,s:s,s:s,s:s,s:s,s:N,s:s,s:i,s:i,s:i,s:i,s:L,s:i,s:i}", "backend", info.backend,
        "platform", info.platform, "vendor", info.vendor, "renderer", info.renderer, "version",
        info.version, "glsl", info.glsl, "software", PyBool_FromLong(info.software), "stage",
        info.stage == CSM_STAGE_FRAGMENT ? "fragment" : "compute", "max_texture_size",
        info.max_texture_size, "max_cube_size", info.max_cube_size, "max_layers", info.max_layers,
        "max_samples", info.max_samples, "max_buffer_bytes", (long long)info.max_buffer_bytes,
        "programs_compiled", info.programs_compiled, "live_objects", info.live_objects);
}

static PyObject *renderer_set_stage(PyObject *object, PyObject *value) {
    csm_renderer *renderer = open_renderer(object);
    const long stage = renderer ? PyLong_AsLong(value) : -1;
    csm_error err = {0};
    csm_status status;
    if (!renderer || PyErr_Occurred()) {
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    status = csm_renderer_set_stage(renderer, (int)stage, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        return csm_py_raise(module_of(object), &err);
    }
    Py_RETURN_NONE;
}

static PyObject *renderer_reload(PyObject *object, PyObject *unused) {
    (void)unused;
    csm_renderer *renderer = open_renderer(object);
    csm_error err = {0};
    csm_status status;
    if (!renderer) {
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    status = csm_renderer_reload(renderer, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        return csm_py_raise(module_of(object), &err);
    }
    Py_RETURN_NONE;
}

/* Runs with the renderer's lock held and without the GIL, like every callback. */
static void append_message(void *user, unsigned id, const char *severity, const char *text) {
    PyGILState_STATE gil = PyGILState_Ensure();
    PyObject *list = user;
    PyObject *item =
        PyErr_Occurred() ? NULL : Py_BuildValue("(IsN)", id, severity, csm_py_text(text));
    if (item) {
        PyList_Append(list, item); /* a failure stays set for renderer_messages */
        Py_DECREF(item);
    }
    PyGILState_Release(gil);
}

static PyObject *renderer_messages(PyObject *object, PyObject *unused) {
    (void)unused;
    csm_renderer *renderer = open_renderer(object);
    PyObject *list = renderer ? PyList_New(0) : NULL;
    if (list) {
        Py_BEGIN_ALLOW_THREADS
        csm_renderer_drain_messages(renderer, append_message, list);
        Py_END_ALLOW_THREADS
        if (PyErr_Occurred()) {
            Py_CLEAR(list);
        }
    }
    return list;
}

/* -- scenes ---------------------------------------------------------------------------------------
 */

static PyObject *renderer_upload(PyObject *object, PyObject *args) {
    csm_renderer *renderer = open_renderer(object);
    csm_py_scene scene;
    csm_geometry geometry = {0};
    csm_gpu_scene *uploaded = NULL;
    csm_error err = {0};
    csm_status status;
    if (!renderer) {
        return NULL;
    }
    if (csm_py_parse_scene(args, "O!OOO:upload", &scene) < 0) {
        csm_py_release_scene(&scene);
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    status = csm_geometry_build(&scene.desc, &geometry, &err);
    if (status == CSM_OK) {
        status = csm_renderer_upload(renderer, &geometry, scene.desc.origin, &uploaded, &err);
    }
    csm_geometry_destroy(&geometry);
    Py_END_ALLOW_THREADS
    csm_py_release_scene(&scene);
    if (status != CSM_OK) {
        return csm_py_raise(module_of(object), &err);
    }
    PyObject *capsule = PyCapsule_New(uploaded, SCENE_CAPSULE, NULL);
    if (!capsule) {
        csm_renderer_drop(renderer, uploaded, NULL);
    }
    return capsule;
}

static PyObject *renderer_drop(PyObject *object, PyObject *capsule) {
    csm_renderer *renderer = open_renderer(object);
    csm_gpu_scene *scene = renderer ? PyCapsule_GetPointer(capsule, SCENE_CAPSULE) : NULL;
    csm_error err = {0};
    csm_status status;
    if (!scene) {
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    status = csm_renderer_drop(renderer, scene, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        return csm_py_raise(module_of(object), &err);
    }
    Py_RETURN_NONE;
}

/* -- rendering ------------------------------------------------------------------------------------
 */

/* The data of a writable, contiguous array of the type and element count, or NULL if there is none;
 * *ok is false with an exception if the array is not as it must be. */
static void *array_data(PyObject *value, const char *name, int type, npy_intp count, bool *ok) {
    if (!value || !*ok) {
        return NULL;
    }
    PyArrayObject *array = (PyArrayObject *)value;
    if (!PyArray_Check(value) || PyArray_TYPE(array) != type || PyArray_SIZE(array) != count ||
        !PyArray_ISCARRAY(array)) {
        PyErr_Format(PyExc_ValueError,
                     "out: %s must be a writable, contiguous array of %zd elements", name,
                     (Py_ssize_t)count);
        *ok = false;
        return NULL;
    }
    return PyArray_DATA(array);
}

static void *output(PyObject *arrays, const char *name, int type, npy_intp count, bool *ok) {
    return array_data(PyDict_GetItemString(arrays, name), name, type, count, ok);
}

/* One array of equal maps, or a tuple of maps, of so many numbers a texel. */
static void bind_maps(PyObject *arrays, const char *name, const csm_settings *settings,
                      npy_intp numbers, float **out, bool *ok) {
    PyObject *value = PyDict_GetItemString(arrays, name);
    const int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    const bool apart = value && PyTuple_Check(value);
    if (apart && PyTuple_GET_SIZE(value) != count) {
        PyErr_Format(PyExc_ValueError, "out: %s must be %d arrays", name, count);
        *ok = false;
    }
    const npy_intp first = (npy_intp)settings->map_size[0] * settings->map_size[0] * numbers;
    float *whole = apart ? NULL : array_data(value, name, NPY_FLOAT32, count * first, ok);
    for (int i = 0; i < count && *ok; i++) {
        const npy_intp size = (npy_intp)settings->map_size[i] * settings->map_size[i] * numbers;
        out[i] = apart   ? array_data(PyTuple_GET_ITEM(value, i), name, NPY_FLOAT32, size, ok)
                 : whole ? whole + i * first
                         : NULL;
    }
}

static bool bind_arrays(PyObject *arrays, const csm_render_desc *desc, csm_render_out *out) {
    bool ok = true;
    npy_intp pixels = (npy_intp)desc->camera.width * desc->camera.height;
    npy_intp points = (npy_intp)desc->point_count;
    out->mask = output(arrays, "mask", NPY_FLOAT32, pixels, &ok);
    out->mask_single = output(arrays, "mask_single", NPY_FLOAT32, pixels, &ok);
    out->valid = output(arrays, "valid", NPY_BOOL, pixels, &ok);
    out->view_depth = output(arrays, "view_depth", NPY_FLOAT32, pixels, &ok);
    out->cascade_index = output(arrays, "cascade_index", NPY_UINT8, pixels, &ok);
    out->normal = output(arrays, "normal", NPY_FLOAT32, 3 * pixels, &ok);
    csm_settings canonical = desc->settings;
    csm_settings_canonical(&canonical);
    const csm_moments moments = csm_settings_moments(&canonical);
    bind_maps(arrays, "shadow_maps", &desc->settings, 1, out->shadow_maps, &ok);
    bind_maps(arrays, "moments", &desc->settings, moments.channels * moments.slices, out->moments,
              &ok);
    out->point_visibility = output(arrays, "point_visibility", NPY_FLOAT32, points, &ok);
    out->point_cascade = output(arrays, "point_cascade", NPY_UINT8, points, &ok);
    out->point_blend_weight = output(arrays, "point_blend_weight", NPY_FLOAT32, points, &ok);
    return ok;
}

static PyObject *lists_of(const csm_render_out *out, int cascades) {
    PyObject *timings = PyDict_New(), *items = PyList_New(0), *triangles = PyList_New(0),
             *in_finer = PyList_New(0);
    bool complete = timings && items && triangles && in_finer;
    for (int i = 0; i < out->timing_count && complete; i++) {
        PyObject *value = PyFloat_FromDouble(out->timing_ms[i]);
        complete = value && PyDict_SetItemString(timings, out->timing_names[i], value) == 0;
        Py_XDECREF(value);
    }
    for (int i = 0; i < cascades && complete; i++) {
        PyObject *item_count = PyLong_FromLong(out->items_drawn[i]);
        PyObject *triangle_count = PyLong_FromLongLong(out->triangles_drawn[i]);
        PyObject *in_finer_count = PyLong_FromLong(out->items_in_finer[i]);
        complete = item_count && triangle_count && in_finer_count &&
                   PyList_Append(items, item_count) == 0 &&
                   PyList_Append(triangles, triangle_count) == 0 &&
                   PyList_Append(in_finer, in_finer_count) == 0;
        Py_XDECREF(item_count);
        Py_XDECREF(triangle_count);
        Py_XDECREF(in_finer_count);
    }
    if (!complete) {
        Py_XDECREF(timings);
        Py_XDECREF(in_finer);
        Py_XDECREF(items);
        Py_XDECREF(triangles);
        return NULL;
    }
    return Py_BuildValue("{s:N,s:N,s:N,s:N}", "timings_ms", timings, "chunks_drawn", items,
                         "triangles_drawn", triangles, "chunks_in_finer", in_finer);
}

/* (action, shift u, shift v, texels saved, triangles saved) of every map; empty without maps. */
static PyObject *reuse_of(const csm_render_out *out) {
    PyObject *list = PyList_New(0);
    for (int i = 0; list && i < out->reused_count; i++) {
        const csm_map_reuse *one = &out->reused[i];
        PyObject *row =
            Py_BuildValue("(siiLL)", csm_reuse_name(one->action), one->shift[0], one->shift[1],
                          (long long)one->texels_saved, (long long)one->triangles_saved);
        if (!row || PyList_Append(list, row) < 0) {
            Py_CLEAR(list);
        }
        Py_XDECREF(row);
    }
    return list;
}

static PyObject *result_of(const csm_render_out *out, int reuse) {
    PyObject *lists = lists_of(out, out->cascades.count);
    PyObject *reused = lists && reuse != CSM_REUSE_MAPS_NEVER ? reuse_of(out) : NULL;
    if (reused && PyDict_SetItemString(lists, "reuse", reused) < 0) {
        Py_CLEAR(lists);
    }
    Py_XDECREF(reused);
    if (PyErr_Occurred()) {
        Py_CLEAR(lists);
    }
    PyObject *fitted = lists ? csm_py_new_cascades(&out->cascades) : NULL;
    if (!fitted) {
        Py_XDECREF(lists);
        return NULL;
    }
    return Py_BuildValue("{s:N,s:N,s:s,s:i,s:i,s:K,s:K,s:i}", "cascades", fitted, "lists", lists,
                         "clock", out->clock, "chunks", out->items_total, "chunks_viewed",
                         out->view_items_drawn, "bytes", (unsigned long long)out->bytes,
                         "scene_bytes", (unsigned long long)out->scene_bytes, "programs_compiled",
                         out->programs_compiled);
}

PyDoc_STRVAR(
    render_doc,
    "render(scene, camera, to_light, settings, scene_bounds, held, outputs, arrays, "
    "points, point_normals, angular_diameter, reuse=0, timed=True)\n--\n\nFits cascades, runs the "
    "plan, fills the arrays of the dict.");

static PyObject *renderer_render(PyObject *object, PyObject *args) {
    PyObject *capsule, *camera, *to_light, *settings, *bounds, *held, *arrays, *points, *normals;
    csm_renderer *renderer = open_renderer(object);
    csm_py_fit fit;
    csm_render_out out = {0};
    csm_error err = {0};
    csm_status status;
    unsigned outputs;
    double angular_diameter;
    int reuse = CSM_REUSE_MAPS_NEVER, timed = 1;
    if (!renderer ||
        !PyArg_ParseTuple(args, "OOOOOOIO!OOd|ip:render", &capsule, &camera, &to_light, &settings,
                          &bounds, &held, &outputs, &PyDict_Type, &arrays, &points, &normals,
                          &angular_diameter, &reuse, &timed) ||
        csm_py_parse_fit(camera, to_light, settings, bounds, held, Py_None, Py_None, &fit) < 0) {
        return NULL;
    }
    csm_render_desc desc = {.scene = PyCapsule_GetPointer(capsule, SCENE_CAPSULE),
                            .camera = fit.desc.camera,
                            .angular_diameter = angular_diameter,
                            .settings = fit.settings,
                            .scene_bounds = fit.desc.scene_bounds,
                            .held = fit.desc.held,
                            .outputs = outputs,
                            .reuse = reuse,
                            .untimed = !timed,
                            .stop = signal_arrived};
    PyArrayObject *point_rows = NULL, *normal_rows = NULL;
    if (!desc.scene) {
        return NULL;
    }
    memcpy(desc.to_light, fit.desc.to_light, sizeof desc.to_light);
    if (points != Py_None) {
        point_rows = csm_py_rows(points, "points", NPY_DOUBLE, 3);
        if (!point_rows) {
            return NULL;
        }
        desc.points = PyArray_DATA(point_rows);
        desc.point_count = (size_t)PyArray_DIM(point_rows, 0);
    }
    if (point_rows && normals != Py_None) {
        normal_rows = csm_py_rows(normals, "point_normals", NPY_DOUBLE, 3);
        if (!normal_rows || PyArray_DIM(normal_rows, 0) != PyArray_DIM(point_rows, 0)) {
            if (normal_rows) {
                PyErr_SetString(PyExc_ValueError, "point_normals must be as many as points");
            }
            goto fail;
        }
        desc.point_normals = PyArray_DATA(normal_rows);
    }
    if (!bind_arrays(arrays, &desc, &out)) {
        goto fail;
    }
    Py_BEGIN_ALLOW_THREADS
    status = csm_renderer_render(renderer, &desc, &out, &err);
    Py_END_ALLOW_THREADS
    Py_XDECREF(point_rows);
    Py_XDECREF(normal_rows);
    return status == CSM_OK ? result_of(&out, reuse) : csm_py_raise(module_of(object), &err);
fail:
    Py_XDECREF(point_rows);
    Py_XDECREF(normal_rows);
    return NULL;
}

PyDoc_STRVAR(visibility_doc,
             "visibility(points, normals, mask, cascade_index, blend_weight)\n--\n\n"
             "Fills the arrays with what the maps of the last render say.");

static PyObject *renderer_visibility(PyObject *object, PyObject *args) {
    PyObject *points, *normals, *mask, *cascade, *weight;
    csm_renderer *renderer = open_renderer(object);
    csm_error err = {0};
    csm_status status;
    if (!renderer ||
        !PyArg_ParseTuple(args, "OOOOO:visibility", &points, &normals, &mask, &cascade, &weight)) {
        return NULL;
    }
    PyArrayObject *point_rows = csm_py_rows(points, "points", NPY_DOUBLE, 3);
    PyArrayObject *normal_rows = NULL;
    PyObject *result = NULL;
    bool ok = point_rows != NULL;
    if (ok && normals != Py_None) {
        normal_rows = csm_py_rows(normals, "normals", NPY_DOUBLE, 3);
        ok = normal_rows != NULL;
        if (ok && PyArray_DIM(normal_rows, 0) != PyArray_DIM(point_rows, 0)) {
            PyErr_SetString(PyExc_ValueError, "normals must be as many as points");
            ok = false;
        }
    }
    if (ok) {
        const npy_intp count = PyArray_DIM(point_rows, 0);
        float *out_mask = array_data(mask, "mask", NPY_FLOAT32, count, &ok);
        uint8_t *out_cascade = array_data(cascade, "cascade_index", NPY_UINT8, count, &ok);
        float *out_weight = array_data(weight, "blend_weight", NPY_FLOAT32, count, &ok);
        const csm_visibility_desc desc = {.points = PyArray_DATA(point_rows),
                                          .normals = normal_rows ? PyArray_DATA(normal_rows) : NULL,
                                          .point_count = (size_t)count,
                                          .stop = signal_arrived};
        if (ok) {
            Py_BEGIN_ALLOW_THREADS
            status =
                csm_renderer_visibility(renderer, &desc, out_mask, out_cascade, out_weight, &err);
            Py_END_ALLOW_THREADS
            result = status == CSM_OK ? Py_NewRef(Py_None) : csm_py_raise(module_of(object), &err);
        }
    }
    Py_XDECREF(point_rows);
    Py_XDECREF(normal_rows);
    return result;
}

static PyMethodDef renderer_methods[] = {
    {"close", renderer_close, METH_NOARGS,
     "close()\n--\n\nDestroys the context; again does nothing."},
    {"describe", renderer_describe, METH_NOARGS, "describe()\n--\n\nDriver, limits and counts."},
    {"set_stage", renderer_set_stage, METH_O,
     "set_stage(stage)\n--\n\nWhere passes over pixels and texels run: 0 compute, 1 fragment."},
    {"reload", renderer_reload, METH_NOARGS, "reload()\n--\n\nForgets every program."},
    {"messages", renderer_messages, METH_NOARGS,
     "messages()\n--\n\n(id, severity, text) of the driver since the last call."},
    {"upload", renderer_upload, METH_VARARGS,
     "upload(meshes, instance_mesh, world_from_instance, origin)\n--\n\nA handle on a scene."},
    {"drop", renderer_drop, METH_O, "drop(scene)\n--\n\nFrees an uploaded scene."},
    {"render", renderer_render, METH_VARARGS, render_doc},
    {"visibility", renderer_visibility, METH_VARARGS, visibility_doc},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot renderer_slots[] = {
    {Py_tp_new, renderer_new},
    {Py_tp_dealloc, renderer_dealloc},
    {Py_tp_methods, renderer_methods},
    {Py_tp_doc, "Renderer(backend, debug, shader_folder)\n--\n\nA context and what is on it."},
    {0, NULL},
};

static PyType_Spec renderer_spec = {
    .name = "csm._core.Renderer",
    .basicsize = sizeof(renderer_object),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = renderer_slots,
};

int csm_py_add_renderer_type(PyObject *module) {
    csm_module_state *state = PyModule_GetState(module);
    state->renderer_type = (PyTypeObject *)PyType_FromModuleAndSpec(module, &renderer_spec, NULL);
    return state->renderer_type ? PyModule_AddType(module, state->renderer_type) : -1;
}
