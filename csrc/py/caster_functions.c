/* caster_functions.c: triangles of a scene across the light, for Python.
 *
 * Arrays are checked against each other; every loop runs without the GIL.
 */
#include "py_common.h"

#include <string.h>

int csm_py_windows(PyObject *object, double **out, npy_intp *count) {
    if (csm_py_matrices(object, "uvz_from_world", out, count) < 0) {
        return -1;
    }
    if (*count < 1 || *count > CSM_MAX_CASCADES) {
        PyErr_Format(PyExc_ValueError, "uvz_from_world must be 1 to %d matrices (got %zd)",
                     CSM_MAX_CASCADES, (Py_ssize_t)*count);
        return -1;
    }
    return 0;
}

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

static PyArrayObject *new_numbers(npy_intp count, int type) {
    return (PyArrayObject *)PyArray_SimpleNew(1, &count, type);
}

enum { CENTRE, HALF, AREA, CUT, WEIGHT, CASTER_ARRAYS };

typedef struct caster_arguments {
    csm_casters casters;
    PyArrayObject *arrays[CASTER_ARRAYS];
    double *matrices;
    npy_intp count;
} caster_arguments;

/* "casters" by attribute, as csm.caster_load.Casters has them. */
static int parse_casters(PyObject *object, PyObject *matrices, caster_arguments *in) {
    static const struct {
        const char *name;
        int type, columns;
    } kinds[CASTER_ARRAYS] = {{"centre", NPY_DOUBLE, 2},
                              {"half", NPY_DOUBLE, 2},
                              {"area", NPY_DOUBLE, 0},
                              {"cut", NPY_BOOL, 0},
                              {"weight", NPY_DOUBLE, 0}};
    double axes[6];
    if (csm_py_windows(matrices, &in->matrices, &in->count) < 0 ||
        csm_py_attribute_vector(object, "axes", 6, axes) < 0) {
        return -1;
    }
    memcpy(in->casters.axes, axes, sizeof in->casters.axes);
    for (int i = 0; i < CASTER_ARRAYS; i++) {
        PyObject *value = csm_py_attribute(object, kinds[i].name);
        if (value) {
            in->arrays[i] =
                i == CENTRE
                    ? csm_py_rows(value, kinds[i].name, kinds[i].type, kinds[i].columns)
                    : csm_py_counted_rows(value, kinds[i].name, kinds[i].type, kinds[i].columns,
                                          PyArray_DIM(in->arrays[CENTRE], 0));
            Py_DECREF(value);
        }
        if (!in->arrays[i]) {
            return -1;
        }
    }
    in->casters.count = (size_t)PyArray_DIM(in->arrays[CENTRE], 0);
    in->casters.centre = PyArray_DATA(in->arrays[CENTRE]);
    in->casters.half = PyArray_DATA(in->arrays[HALF]);
    in->casters.area = PyArray_DATA(in->arrays[AREA]);
    in->casters.cut = PyArray_DATA(in->arrays[CUT]);
    in->casters.weight = PyArray_DATA(in->arrays[WEIGHT]);
    return 0;
}

enum { MOST_KEPT = (CSM_MAX_CASCADES + 1) * CSM_KEPT_MOST }; /* much for a thread's stack */

static PyObject *thinned(PyObject *module, const caster_arguments *in, csm_kept kept) {
    csm_error err = {0};
    csm_status status;
    Py_BEGIN_ALLOW_THREADS
    status = csm_casters_thinned(&in->casters, (int)in->count, (const double(*)[16])in->matrices,
                                 &kept, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    PyArrayObject *made[] = {new_numbers((npy_intp)kept.count, NPY_INT64),
                             new_numbers((npy_intp)kept.count, NPY_DOUBLE)};
    if (!made[0] || !made[1]) {
        csm_py_release_arrays(made, 2);
        return NULL;
    }
    memcpy(PyArray_DATA(made[0]), kept.number, kept.count * sizeof *kept.number);
    memcpy(PyArray_DATA(made[1]), kept.weight, kept.count * sizeof *kept.weight);
    return Py_BuildValue("NN", made[0], made[1]);
}

PyDoc_STRVAR(casters_thinned_doc,
             "casters_thinned(casters, uvz_from_world)\n--\n\n"
             "Numbers (k,) of the casters to keep, and how many (k,) each of them stands for: of "
             "those that each window is the first to meet some hundreds; casters as "
             "csm.caster_load.Casters.");

static PyObject *casters_thinned(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"casters", "uvz_from_world", NULL};
    PyObject *object, *matrices, *out = NULL;
    caster_arguments in = {.matrices = NULL};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO:casters_thinned", names, &object,
                                     &matrices)) {
        return NULL;
    }
    if (parse_casters(object, matrices, &in) == 0) {
        int64_t *number = PyMem_Malloc(MOST_KEPT * sizeof *number);
        double *weight = PyMem_Malloc(MOST_KEPT * sizeof *weight);
        const csm_kept kept = {.number = number, .weight = weight};
        out = number && weight ? thinned(module, &in, kept) : PyErr_NoMemory();
        PyMem_Free(number);
        PyMem_Free(weight);
    }
    PyMem_Free(in.matrices);
    csm_py_release_arrays(in.arrays, CASTER_ARRAYS);
    return out;
}

static PyObject *loaded(const csm_caster_load *loads, npy_intp count) {
    const npy_intp kinds[3] = {count, 2, 2};
    PyArrayObject *layers = (PyArrayObject *)PyArray_SimpleNew(3, kinds, NPY_DOUBLE);
    PyArrayObject *lines = (PyArrayObject *)PyArray_SimpleNew(3, kinds, NPY_DOUBLE);
    PyArrayObject *triangles = new_numbers(count, NPY_DOUBLE);
    PyArrayObject *needed = new_numbers(count, NPY_DOUBLE);
    if (!layers || !lines || !triangles || !needed) {
        csm_py_release_arrays((PyArrayObject *[]){layers, lines, triangles, needed}, 4);
        return NULL;
    }
    for (npy_intp i = 0; i < count; i++) {
        memcpy((double *)PyArray_DATA(layers) + 4 * i, loads[i].layers, sizeof loads[i].layers);
        memcpy((double *)PyArray_DATA(lines) + 4 * i, loads[i].lines, sizeof loads[i].lines);
        ((double *)PyArray_DATA(triangles))[i] = loads[i].triangles;
        ((double *)PyArray_DATA(needed))[i] = loads[i].needed;
    }
    return Py_BuildValue("NNNN", layers, lines, triangles, needed);
}

PyDoc_STRVAR(casters_load_doc,
             "casters_load(casters, uvz_from_world)\n--\n\n"
             "(layers, lines, triangles, needed) of maps without a warp: (n, 2, 2), (n, 2, 2), "
             "(n,), (n,); casters as csm.caster_load.Casters.");

static PyObject *casters_load(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"casters", "uvz_from_world", NULL};
    PyObject *object, *matrices, *out = NULL;
    caster_arguments in = {.matrices = NULL};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO:casters_load", names, &object, &matrices)) {
        return NULL;
    }
    if (parse_casters(object, matrices, &in) == 0) {
        csm_caster_load loads[CSM_MAX_CASCADES];
        Py_BEGIN_ALLOW_THREADS
        csm_casters_load(&in.casters, (int)in.count, (const double(*)[16])in.matrices, loads);
        Py_END_ALLOW_THREADS
        out = loaded(loads, in.count);
    }
    PyMem_Free(in.matrices);
    csm_py_release_arrays(in.arrays, CASTER_ARRAYS);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_caster_methods[] = {
    METHOD(casters_across),
    METHOD(casters_thinned),
    METHOD(casters_load),
    {NULL, NULL, 0, NULL},
};
