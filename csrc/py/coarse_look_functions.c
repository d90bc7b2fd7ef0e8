/* coarse_look_functions.c: which pixels of coarse frames face the sun and are lit, for Python.
 *
 * Arrays are checked against each other; every loop runs without the GIL.
 */
#include "py_common.h"

enum { VALID, NORMAL, MASK, CASCADE, SHOWN_ARRAYS };

/* desc points into the rest. */
typedef struct shown_arguments {
    csm_coarse_shown desc;
    PyArrayObject *arrays[SHOWN_ARRAYS];
    npy_intp shape[3];
} shown_arguments;

/* Arrays of one picture; a NULL among objects is left out. Release what came of it, also after a
 * failure. */
static int parse_shown(PyObject *const objects[SHOWN_ARRAYS], PyObject *to_light,
                       shown_arguments *out) {
    static const csm_py_rule rules[SHOWN_ARRAYS] = {
        [VALID] = {"valid", NPY_BOOL, 2},
        [NORMAL] = {"normal", NPY_FLOAT, 3},
        [MASK] = {"mask", NPY_FLOAT, 2},
        [CASCADE] = {"cascade_index", NPY_UINT8, 2},
    };
    const void *data[SHOWN_ARRAYS] = {NULL};
    if (csm_py_vector(to_light, "to_light", 3, out->desc.to_light) < 0) {
        return -1;
    }
    out->arrays[VALID] =
        csm_py_shaped(objects[VALID], "valid", NPY_BOOL, 2, (const npy_intp[]){-1, -1});
    if (!out->arrays[VALID]) {
        return -1;
    }
    out->shape[0] = PyArray_DIM(out->arrays[VALID], 0);
    out->shape[1] = PyArray_DIM(out->arrays[VALID], 1);
    out->shape[2] = 3;
    if (csm_py_take(objects + 1, rules + 1, SHOWN_ARRAYS - 1, out->shape, out->arrays + 1,
                    data + 1) < 0) {
        return -1;
    }
    out->desc.pixels = (size_t)(out->shape[0] * out->shape[1]);
    out->desc.valid = PyArray_DATA(out->arrays[VALID]);
    out->desc.normal = data[NORMAL];
    out->desc.mask = data[MASK];
    out->desc.cascade = data[CASCADE];
    return 0;
}

PyDoc_STRVAR(coarse_facing_doc, "coarse_facing(valid, normal, to_light, least_cosine)\n--\n\n"
                                "Which pixels (h, w) show a surface that faces the sun.");

static PyObject *coarse_facing(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"valid", "normal", "to_light", "least_cosine", NULL};
    PyObject *objects[SHOWN_ARRAYS] = {NULL}, *to_light, *out = NULL;
    shown_arguments in = {.arrays = {NULL}};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOd:coarse_facing", names, &objects[VALID],
                                     &objects[NORMAL], &to_light, &in.desc.least_cosine)) {
        return NULL;
    }
    if (parse_shown(objects, to_light, &in) == 0 &&
        (out = PyArray_SimpleNew(2, in.shape, NPY_BOOL))) {
        csm_coarse_read read = {.facing = PyArray_DATA((PyArrayObject *)out)};
        Py_BEGIN_ALLOW_THREADS
        csm_coarse_look(&in.desc, &read);
        Py_END_ALLOW_THREADS
    }
    csm_py_release_arrays(in.arrays, SHOWN_ARRAYS);
    return out;
}

static PyObject *counts_of(const csm_coarse_read *read, int cascade_count) {
    PyObject *out = PyTuple_New(cascade_count);
    for (int i = 0; out && i < cascade_count; i++) {
        PyObject *count = PyLong_FromSize_t(read->of_cascade[i]);
        if (!count) {
            Py_CLEAR(out);
            break;
        }
        PyTuple_SET_ITEM(out, i, count);
    }
    return out;
}

static PyObject *new_look(const shown_arguments *in) {
    PyObject *facing = PyArray_SimpleNew(2, in->shape, NPY_BOOL);
    PyObject *judged = PyArray_SimpleNew(2, in->shape, NPY_BOOL);
    PyObject *lit = PyArray_SimpleNew(2, in->shape, NPY_BOOL);
    PyObject *counts = NULL, *out = NULL;
    if (facing && judged && lit) {
        csm_coarse_read read = {.facing = PyArray_DATA((PyArrayObject *)facing),
                                .judged = PyArray_DATA((PyArrayObject *)judged),
                                .lit = PyArray_DATA((PyArrayObject *)lit)};
        Py_BEGIN_ALLOW_THREADS
        csm_coarse_look(&in->desc, &read);
        Py_END_ALLOW_THREADS
        counts = counts_of(&read, in->desc.cascade_count);
        out = counts ? Py_BuildValue("OOOnnnO", facing, judged, lit, (Py_ssize_t)read.seen_count,
                                     (Py_ssize_t)read.facing_count, (Py_ssize_t)read.shadowed_count,
                                     counts)
                     : NULL;
    }
    Py_XDECREF(facing);
    Py_XDECREF(judged);
    Py_XDECREF(lit);
    Py_XDECREF(counts);
    return out;
}

PyDoc_STRVAR(
    coarse_look_doc,
    "coarse_look(valid, normal, mask, cascade_index, to_light, least_cosine, least_lit, "
    "cascade_count)\n--\n\n"
    "Which pixels (h, w) face the sun, of these have a cascade, and are lit; how many show "
    "a surface, face the sun, are in shadow; and how many that face it each cascade has.");

static PyObject *coarse_look(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"valid",         "normal",        "mask",
                            "cascade_index", "to_light",      "least_cosine",
                            "least_lit",     "cascade_count", NULL};
    PyObject *objects[SHOWN_ARRAYS], *to_light, *out = NULL;
    shown_arguments in = {.arrays = {NULL}};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOddi:coarse_look", names, &objects[VALID],
                                     &objects[NORMAL], &objects[MASK], &objects[CASCADE], &to_light,
                                     &in.desc.least_cosine, &in.desc.least_lit,
                                     &in.desc.cascade_count)) {
        return NULL;
    }
    if (in.desc.cascade_count < 1 || in.desc.cascade_count > CSM_MAX_CASCADES) {
        PyErr_Format(PyExc_ValueError, "cascade_count must be 1 to %d (got %d)", CSM_MAX_CASCADES,
                     in.desc.cascade_count);
        return NULL;
    }
    if (parse_shown(objects, to_light, &in) == 0) {
        out = new_look(&in);
    }
    csm_py_release_arrays(in.arrays, SHOWN_ARRAYS);
    return out;
}

PyDoc_STRVAR(coarse_changed_doc, "coarse_changed(judged, one, other)\n--\n\n"
                                 "How many judged pixels (h, w) differ between two pictures.");

static PyObject *coarse_changed(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"judged", "one", "other", NULL};
    static const csm_py_rule rules[3] = {
        {"judged", NPY_BOOL, 2}, {"one", NPY_BOOL, 2}, {"other", NPY_BOOL, 2}};
    PyObject *objects[3], *out = NULL;
    PyArrayObject *arrays[3] = {NULL};
    const void *data[3];
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO:coarse_changed", names, &objects[0],
                                     &objects[1], &objects[2])) {
        return NULL;
    }
    arrays[0] = csm_py_shaped(objects[0], "judged", NPY_BOOL, 2, (const npy_intp[]){-1, -1});
    if (arrays[0]) {
        npy_intp shape[2] = {PyArray_DIM(arrays[0], 0), PyArray_DIM(arrays[0], 1)};
        data[0] = PyArray_DATA(arrays[0]);
        if (csm_py_take(objects + 1, rules + 1, 2, shape, arrays + 1, data + 1) == 0) {
            size_t count;
            Py_BEGIN_ALLOW_THREADS
            count = csm_coarse_changed((size_t)(shape[0] * shape[1]), data[0], data[1], data[2]);
            Py_END_ALLOW_THREADS
            out = PyLong_FromSize_t(count);
        }
    }
    csm_py_release_arrays(arrays, 3);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_coarse_look_methods[] = {
    METHOD(coarse_facing),
    METHOD(coarse_look),
    METHOD(coarse_changed),
    {NULL, NULL, 0, NULL},
};
