/* caster_functions.c: triangles of a scene across the light, for Python.
 *
 * Arrays are checked against each other; every loop runs without the GIL.
 */
#include "py_common.h"

#include <string.h>

static PyObject *new_boxes(const csm_sample *sample) {
    const npy_intp shape[2] = {(npy_intp)sample->count, 2};
    PyObject *centre = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
    PyObject *half = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
    PyObject *area = PyArray_SimpleNew(1, shape, NPY_DOUBLE);
    PyObject *out = NULL;
    if (centre && half && area) {
        void *centres = PyArray_DATA((PyArrayObject *)centre);
        void *halves = PyArray_DATA((PyArrayObject *)half);
        double *areas = PyArray_DATA((PyArrayObject *)area);
        Py_BEGIN_ALLOW_THREADS
        csm_casters_across(sample, centres, halves, areas);
        Py_END_ALLOW_THREADS
        out = PyTuple_Pack(3, centre, half, area);
    }
    Py_XDECREF(centre);
    Py_XDECREF(half);
    Py_XDECREF(area);
    return out;
}

PyDoc_STRVAR(casters_across_doc,
             "casters_across(x, y, side)\n--\n\n"
             "Triangles across the light: their boxes' centre (t, 2) and half (t, 2) [m], and area "
             "(t,) [m2], positive towards the light; x, y (3, t) of their corners along the axes, "
             "side (t,) -1 where mirrored, else 1.");

static PyObject *casters_across(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"x", "y", "side", NULL};
    PyObject *objects[2], *side, *out = NULL;
    PyArrayObject *arrays[3] = {NULL};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO:casters_across", names, &objects[0],
                                     &objects[1], &side)) {
        return NULL;
    }
    arrays[2] = csm_py_shaped(side, "side", NPY_DOUBLE, 1, (const npy_intp[]){-1});
    for (int i = 0; arrays[2] && i < 2; i++) {
        arrays[i] = csm_py_shaped(objects[i], names[i], NPY_DOUBLE, 2,
                                  (const npy_intp[]){3, PyArray_DIM(arrays[2], 0)});
        if (!arrays[i]) {
            break;
        }
    }
    if (arrays[0] && arrays[1]) {
        const csm_sample sample = {.count = (size_t)PyArray_DIM(arrays[2], 0),
                                   .along = {PyArray_DATA(arrays[0]), PyArray_DATA(arrays[1])},
                                   .side = PyArray_DATA(arrays[2])};
        out = new_boxes(&sample);
    }
    csm_py_release_arrays(arrays, 3);
    return out;
}

enum { CENTRE, HALF, AREA, BOX_ARRAYS };

/* desc points into the rest. */
typedef struct box_arguments {
    csm_casters desc;
    PyArrayObject *arrays[BOX_ARRAYS];
    double *matrices;
    npy_intp count;
} box_arguments;

/* Release what came of it, also after a failure. */
static int parse_boxes(PyObject *const objects[BOX_ARRAYS], PyObject *axes_object,
                       PyObject *matrices, box_arguments *out) {
    double axes[6];
    if (csm_py_matrices(matrices, "uvz_from_world", &out->matrices, &out->count) < 0 ||
        csm_py_vector(axes_object, "axes", 6, axes) < 0) {
        return -1;
    }
    if (out->count < 1 || out->count > CSM_MAX_CASCADES) {
        PyErr_Format(PyExc_ValueError, "uvz_from_world must be 1 to %d matrices (got %zd)",
                     CSM_MAX_CASCADES, (Py_ssize_t)out->count);
        return -1;
    }
    for (int i = 0; i < BOX_ARRAYS; i++) {
        static const char *const names[BOX_ARRAYS] = {"centre", "half", "area"};
        const npy_intp shape[2] = {i ? PyArray_DIM(out->arrays[0], 0) : -1, 2};
        out->arrays[i] = csm_py_shaped(objects[i], names[i], NPY_DOUBLE, i == AREA ? 1 : 2, shape);
        if (!out->arrays[i]) {
            return -1;
        }
    }
    out->desc = (csm_casters){.count = (size_t)PyArray_DIM(out->arrays[CENTRE], 0),
                              .centre = PyArray_DATA(out->arrays[CENTRE]),
                              .half = PyArray_DATA(out->arrays[HALF]),
                              .area = PyArray_DATA(out->arrays[AREA])};
    memcpy(out->desc.axes, axes, sizeof out->desc.axes);
    return 0;
}

PyDoc_STRVAR(casters_thinned_doc,
             "casters_thinned(centre, half, area, axes, uvz_from_world)\n--\n\n"
             "Numbers (k,) of the casters to keep, and how many (k,) each of them stands for: of "
             "those that each window is the first to meet some hundreds.");

static PyObject *casters_thinned(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"centre", "half", "area", "axes", "uvz_from_world", NULL};
    PyObject *objects[BOX_ARRAYS], *axes, *matrices, *out = NULL;
    box_arguments in = {.arrays = {NULL}};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOO:casters_thinned", names, &objects[CENTRE],
                                     &objects[HALF], &objects[AREA], &axes, &matrices)) {
        return NULL;
    }
    if (parse_boxes(objects, axes, matrices, &in) == 0) {
        int64_t number[(CSM_MAX_CASCADES + 1) * CSM_KEPT_MOST];
        double weight[(CSM_MAX_CASCADES + 1) * CSM_KEPT_MOST];
        csm_kept kept = {.number = number, .weight = weight};
        csm_error err = {0};
        csm_status status;
        Py_BEGIN_ALLOW_THREADS
        status = csm_casters_thinned(&in.desc, (int)in.count, (const double(*)[16])in.matrices,
                                     &kept, &err);
        Py_END_ALLOW_THREADS
        const npy_intp shape[1] = {(npy_intp)kept.count};
        PyObject *numbers = NULL, *weights = NULL;
        if (status != CSM_OK) {
            csm_py_raise(module, &err);
        } else if ((numbers = PyArray_SimpleNew(1, shape, NPY_INT64)) &&
                   (weights = PyArray_SimpleNew(1, shape, NPY_DOUBLE))) {
            memcpy(PyArray_DATA((PyArrayObject *)numbers), number, kept.count * sizeof *number);
            memcpy(PyArray_DATA((PyArrayObject *)weights), weight, kept.count * sizeof *weight);
            out = PyTuple_Pack(2, numbers, weights);
        }
        Py_XDECREF(numbers);
        Py_XDECREF(weights);
    }
    PyMem_Free(in.matrices);
    csm_py_release_arrays(in.arrays, BOX_ARRAYS);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_caster_methods[] = {
    METHOD(casters_across),
    METHOD(casters_thinned),
    {NULL, NULL, 0, NULL},
};
