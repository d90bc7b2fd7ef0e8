/* forecast_sum_functions.c: sums over the points of a coarse view, a number a size, for Python. */
#include "py_common.h"

enum { WINDOW, SIDES, VALUES, FIRST, SECOND, SUM_ARRAYS };

typedef struct sum_arguments {
    csm_sized sized;
    PyArrayObject *arrays[SUM_ARRAYS];
    bool alone; /* one size */
    PyArrayObject *out;
} sum_arguments;

static int check_windows(const csm_sized *sized) {
    for (size_t i = 0; i < sized->point_count && sized->columns > 1; i++) {
        if (sized->window[i] < 0 || (size_t)sized->window[i] >= sized->columns) {
            PyErr_Format(PyExc_ValueError,
                         "window must be 0 to %zu, a column of sides (got %d at %zu)",
                         sized->columns - 1, sized->window[i], i);
            return -1;
        }
    }
    return 0;
}

/* What every sum is given, and room for the answer. `names`: of VALUES, FIRST and SECOND, NULL for
 * one that the sum does not ask for. */
static int parse_sum(PyObject *const objects[SUM_ARRAYS], const char *const names[SUM_ARRAYS],
                     int out_type, sum_arguments *in) {
    in->arrays[VALUES] = csm_py_rows(objects[VALUES], names[VALUES], NPY_DOUBLE, 0);
    in->arrays[SIDES] =
        (PyArrayObject *)PyArray_FROMANY(objects[SIDES], NPY_DOUBLE, 1, 2, NPY_ARRAY_CARRAY_RO);
    if (!in->arrays[VALUES] || !in->arrays[SIDES]) {
        return -1;
    }
    const npy_intp count = PyArray_DIM(in->arrays[VALUES], 0);
    in->arrays[WINDOW] = csm_py_counted_rows(objects[WINDOW], "window", NPY_INT, 0, count);
    if (!in->arrays[WINDOW]) {
        return -1;
    }
    for (int i = FIRST; i <= SECOND; i++) {
        if (names[i] &&
            !(in->arrays[i] = csm_py_counted_rows(objects[i], names[i], NPY_DOUBLE, 0, count))) {
            return -1;
        }
    }
    in->alone = PyArray_NDIM(in->arrays[SIDES]) == 1;
    const npy_intp sizes = in->alone ? 1 : PyArray_DIM(in->arrays[SIDES], 0);
    in->sized.point_count = (size_t)count;
    in->sized.size_count = (size_t)sizes;
    in->sized.columns = (size_t)PyArray_DIM(in->arrays[SIDES], in->alone ? 0 : 1);
    in->sized.window = PyArray_DATA(in->arrays[WINDOW]);
    in->sized.sides = PyArray_DATA(in->arrays[SIDES]);
    if (in->sized.columns < 1) {
        PyErr_SetString(PyExc_ValueError, "sides must have a column");
        return -1;
    }
    if (check_windows(&in->sized) < 0) {
        return -1;
    }
    in->out = (PyArrayObject *)PyArray_SimpleNew(1, &sizes, out_type);
    return in->out ? 0 : -1;
}

/* The answer, or the exception of a failure. */
static PyObject *finish_sum(PyObject *module, sum_arguments *in, bool parsed, csm_status status,
                            const csm_error *err) {
    csm_py_release_arrays(in->arrays, SUM_ARRAYS);
    if (parsed && status == CSM_OK && !in->alone) {
        return (PyObject *)in->out;
    }
    if (parsed && status == CSM_OK) {
        PyObject *number = PyArray_GETITEM(in->out, PyArray_DATA(in->out));
        Py_DECREF(in->out);
        return number;
    }
    Py_XDECREF(in->out);
    return parsed ? csm_py_raise(module, err) : NULL;
}

PyDoc_STRVAR(sum_capped_doc,
             "sum_capped(window, sides, values, weights, most)\n--\n\n"
             "(k,) sums of weights * min(values / side, most) over points, for "
             "sides (k, 1) or, of their windows, (k, n); of (1,) or (n,) a number.");

static PyObject *sum_capped(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *keywords[] = {"window", "sides", "values", "weights", "most", NULL};
    static const char *const names[SUM_ARRAYS] = {[VALUES] = "values", [FIRST] = "weights"};
    PyObject *objects[SUM_ARRAYS] = {NULL};
    sum_arguments in = {.out = NULL};
    double most;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOd:sum_capped", keywords, &objects[WINDOW],
                                     &objects[SIDES], &objects[VALUES], &objects[FIRST], &most)) {
        return NULL;
    }
    csm_error err = {0};
    csm_status status = CSM_OK;
    const bool parsed = parse_sum(objects, names, NPY_DOUBLE, &in) == 0;
    if (parsed) {
        const double *values = PyArray_DATA(in.arrays[VALUES]);
        const double *weights = PyArray_DATA(in.arrays[FIRST]);
        double *sums = PyArray_DATA(in.out);
        Py_BEGIN_ALLOW_THREADS
        status = csm_sum_capped(&in.sized, values, weights, most, sums, &err);
        Py_END_ALLOW_THREADS
    }
    return finish_sum(module, &in, parsed, status, &err);
}

PyDoc_STRVAR(sum_missing_doc, "sum_missing(window, sides, values, wide, weights)\n--\n\n"
                              "(k,) sums of weights * max(wide - values / side, 0) over points, "
                              "for sides as in sum_capped.");

static PyObject *sum_missing(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *keywords[] = {"window", "sides", "values", "wide", "weights", NULL};
    static const char *const names[SUM_ARRAYS] = {
        [VALUES] = "values", [FIRST] = "wide", [SECOND] = "weights"};
    PyObject *objects[SUM_ARRAYS] = {NULL};
    sum_arguments in = {.out = NULL};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOO:sum_missing", keywords, &objects[WINDOW],
                                     &objects[SIDES], &objects[VALUES], &objects[FIRST],
                                     &objects[SECOND])) {
        return NULL;
    }
    csm_error err = {0};
    csm_status status = CSM_OK;
    const bool parsed = parse_sum(objects, names, NPY_DOUBLE, &in) == 0;
    if (parsed) {
        const double *values = PyArray_DATA(in.arrays[VALUES]);
        const double *wide = PyArray_DATA(in.arrays[FIRST]);
        const double *weights = PyArray_DATA(in.arrays[SECOND]);
        double *sums = PyArray_DATA(in.out);
        Py_BEGIN_ALLOW_THREADS
        status = csm_sum_missing(&in.sized, values, wide, weights, sums, &err);
        Py_END_ALLOW_THREADS
    }
    return finish_sum(module, &in, parsed, status, &err);
}

PyDoc_STRVAR(count_less_doc, "count_less(window, sides, gaps, values)\n--\n\n"
                             "(k,) points of which gaps < values / side, for sides as in "
                             "sum_capped.");

static PyObject *count_less(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *keywords[] = {"window", "sides", "gaps", "values", NULL};
    static const char *const names[SUM_ARRAYS] = {[VALUES] = "values", [FIRST] = "gaps"};
    PyObject *objects[SUM_ARRAYS] = {NULL};
    sum_arguments in = {.out = NULL};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOO:count_less", keywords, &objects[WINDOW],
                                     &objects[SIDES], &objects[FIRST], &objects[VALUES])) {
        return NULL;
    }
    csm_error err = {0};
    csm_status status = CSM_OK;
    const bool parsed = parse_sum(objects, names, NPY_INT64, &in) == 0;
    if (parsed) {
        const double *gaps = PyArray_DATA(in.arrays[FIRST]);
        const double *values = PyArray_DATA(in.arrays[VALUES]);
        int64_t *counts = PyArray_DATA(in.out);
        Py_BEGIN_ALLOW_THREADS
        status = csm_count_less(&in.sized, gaps, values, counts, &err);
        Py_END_ALLOW_THREADS
    }
    return finish_sum(module, &in, parsed, status, &err);
}

PyDoc_STRVAR(least_part_doc, "least_part(values, wide, weights, allowed)\n--\n\n"
                             "Least q >= 0 for which weights * max(wide - q * values, 0), summed "
                             "up, is at most allowed >= 0.");

static PyObject *least_part(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *keywords[] = {"values", "wide", "weights", "allowed", NULL};
    PyObject *objects[3], *out = NULL;
    PyArrayObject *arrays[3] = {NULL};
    double allowed;
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOd:least_part", keywords, &objects[0],
                                     &objects[1], &objects[2], &allowed)) {
        return NULL;
    }
    if (!(allowed >= 0.0)) {
        PyErr_SetString(PyExc_ValueError, "allowed must be >= 0");
        return NULL;
    }
    bool parsed = (arrays[0] = csm_py_rows(objects[0], keywords[0], NPY_DOUBLE, 0)) != NULL;
    for (int i = 1; i < 3 && parsed; i++) {
        arrays[i] =
            csm_py_counted_rows(objects[i], keywords[i], NPY_DOUBLE, 0, PyArray_DIM(arrays[0], 0));
        parsed = arrays[i] != NULL;
    }
    if (parsed) {
        const size_t count = (size_t)PyArray_DIM(arrays[0], 0);
        const double *values = PyArray_DATA(arrays[0]), *wide = PyArray_DATA(arrays[1]);
        const double *weights = PyArray_DATA(arrays[2]);
        double part;
        Py_BEGIN_ALLOW_THREADS
        part = csm_least_part(count, values, wide, weights, allowed);
        Py_END_ALLOW_THREADS
        out = PyFloat_FromDouble(part);
    }
    csm_py_release_arrays(arrays, 3);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_forecast_sum_methods[] = {
    METHOD(sum_capped), METHOD(sum_missing),   METHOD(count_less),
    METHOD(least_part), {NULL, NULL, 0, NULL},
};
