/* forecast_functions.c: what casters lay on windows, for Python. */
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

static PyArrayObject *new_numbers(npy_intp count, int type) {
    return (PyArrayObject *)PyArray_SimpleNew(1, &count, type);
}

/* -- casters ----------------------------------------------------------------------------------- */

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

PyDoc_STRVAR(casters_first_doc, "casters_first(casters, uvz_from_world)\n--\n\n"
                                "(t,) number of the first map that each one's box meets, n where "
                                "none does; maps without a warp.");

static PyObject *casters_first(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"casters", "uvz_from_world", NULL};
    PyObject *object, *matrices;
    PyArrayObject *out = NULL;
    caster_arguments in = {.matrices = NULL};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO:casters_first", names, &object, &matrices)) {
        return NULL;
    }
    if (parse_casters(object, matrices, &in) == 0 &&
        (out = new_numbers((npy_intp)in.casters.count, NPY_INT))) {
        int *first = PyArray_DATA(out);
        Py_BEGIN_ALLOW_THREADS
        csm_casters_first(&in.casters, (int)in.count, (const double(*)[16])in.matrices, first);
        Py_END_ALLOW_THREADS
    }
    PyMem_Free(in.matrices);
    csm_py_release_arrays(in.arrays, CASTER_ARRAYS);
    return (PyObject *)out;
}

/* Whether all kinds lie in 0 to CSM_MAX_CASCADES; out: one more than the largest. */
static bool parse_kinds(const int *kind, npy_intp count, int *out) {
    *out = 0;
    for (npy_intp i = 0; i < count; i++) {
        if (kind[i] < 0 || kind[i] > CSM_MAX_CASCADES) {
            PyErr_Format(PyExc_ValueError, "kind must be 0 to %d (got %d)", CSM_MAX_CASCADES,
                         kind[i]);
            return false;
        }
        *out = kind[i] + 1 > *out ? kind[i] + 1 : *out;
    }
    return true;
}

PyDoc_STRVAR(casters_order_doc, "casters_order(area, kind)\n--\n\n"
                                "(t,) numbers of casters, kind by kind, of each the largest first, "
                                "equal ones in order; kind as from casters_first.");

static PyObject *casters_order(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"area", "kind", NULL};
    PyObject *area_object, *kind_object;
    PyArrayObject *area = NULL, *kind = NULL, *out = NULL;
    csm_error err = {0};
    csm_status status = CSM_OK;
    int kinds;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO:casters_order", names, &area_object,
                                     &kind_object)) {
        return NULL;
    }
    if ((area = csm_py_rows(area_object, "area", NPY_DOUBLE, 0)) &&
        (kind = csm_py_counted_rows(kind_object, "kind", NPY_INT, 0, PyArray_DIM(area, 0))) &&
        parse_kinds(PyArray_DATA(kind), PyArray_DIM(kind, 0), &kinds) &&
        (out = new_numbers(PyArray_DIM(area, 0), NPY_INT64))) {
        const size_t count = (size_t)PyArray_DIM(area, 0);
        const double *areas = PyArray_DATA(area);
        const int *of = PyArray_DATA(kind);
        int64_t *order = PyArray_DATA(out);
        /* under the lock: kinds were checked, and are the caller's */
        status = csm_casters_order(count, areas, of, kinds, order, &err);
    }
    Py_XDECREF(area);
    Py_XDECREF(kind);
    if (status != CSM_OK) {
        Py_DECREF(out);
        return csm_py_raise(module, &err);
    }
    return (PyObject *)out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_forecast_methods[] = {
    METHOD(casters_load),
    METHOD(casters_first),
    METHOD(casters_order),
    {NULL, NULL, 0, NULL},
};
