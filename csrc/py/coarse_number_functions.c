/* coarse_number_functions.c: percentiles, histograms and surface steps, for Python.
 *
 * Shapes and depths are checked here; what is worked out of them is so without the GIL.
 */
#include "py_common.h"

#include <math.h>

#define MAX_PERCENTILES 16

PyDoc_STRVAR(percentiles_doc,
             "percentiles(values, at)\n--\n\n"
             "Percentiles 0 to 100 (k,) of values (m,), linear between the nearest "
             "two; 0 of none.");

static PyObject *percentiles(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"values", "at", NULL};
    PyObject *values_object, *at_object, *out = NULL;
    double at[MAX_PERCENTILES];
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO:percentiles", names, &values_object,
                                     &at_object)) {
        return NULL;
    }
    const Py_ssize_t wanted = PySequence_Size(at_object);
    if (wanted < 0) {
        return NULL;
    }
    if (wanted < 1 || wanted > MAX_PERCENTILES) {
        PyErr_Format(PyExc_ValueError, "at: expected 1 to %d percentiles (got %zd)",
                     MAX_PERCENTILES, wanted);
        return NULL;
    }
    if (csm_py_vector(at_object, "at", (int)wanted, at) < 0) {
        return NULL;
    }
    for (Py_ssize_t i = 0; i < wanted; i++) {
        if (!(at[i] >= 0.0 && at[i] <= 100.0)) {
            PyErr_Format(PyExc_ValueError, "at: expected percentiles from 0 to 100 (got %R)",
                         at_object);
            return NULL;
        }
    }
    PyArrayObject *values =
        csm_py_shaped(values_object, "values", NPY_DOUBLE, 1, (const npy_intp[]){-1});
    if (values && (out = PyArray_SimpleNew(1, (const npy_intp[]){wanted}, NPY_DOUBLE))) {
        const double *data = PyArray_DATA(values);
        double *found = PyArray_DATA((PyArrayObject *)out);
        const size_t count = (size_t)PyArray_DIM(values, 0);
        csm_error err = {0};
        csm_status status;
        Py_BEGIN_ALLOW_THREADS
        status = csm_percentiles(count, data, (size_t)wanted, at, found, &err);
        Py_END_ALLOW_THREADS
        if (status != CSM_OK) {
            csm_py_raise(module, &err);
            Py_CLEAR(out);
        }
    }
    Py_XDECREF(values);
    return out;
}

PyDoc_STRVAR(
    depth_histogram_doc,
    "depth_histogram(depths)\n--\n\n"
    "Edges (25,) [m], from the nearest depth to the farthest in equal ratios, and how many "
    "(24,) of the depths (m,) lie between them.");

static PyObject *depth_histogram(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"depths", NULL};
    PyObject *object;
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O:depth_histogram", names, &object)) {
        return NULL;
    }
    PyArrayObject *depths = csm_py_shaped(object, "depths", NPY_DOUBLE, 1, (const npy_intp[]){-1});
    if (!depths) {
        return NULL;
    }
    for (npy_intp i = 0; i < PyArray_DIM(depths, 0); i++) {
        const double depth = ((const double *)PyArray_DATA(depths))[i];
        if (!(depth > 0.0 && depth < INFINITY)) {
            PyErr_Format(PyExc_ValueError, "depths must be positive and finite (got %R)", object);
            Py_DECREF(depths);
            return NULL;
        }
    }
    PyObject *edges = PyArray_SimpleNew(1, (const npy_intp[]){CSM_COARSE_BINS + 1}, NPY_DOUBLE);
    PyObject *counts = PyArray_SimpleNew(1, (const npy_intp[]){CSM_COARSE_BINS}, NPY_INT64);
    if (edges && counts) {
        const double *data = PyArray_DATA(depths);
        double *borders = PyArray_DATA((PyArrayObject *)edges);
        int64_t *found = PyArray_DATA((PyArrayObject *)counts);
        const size_t count = (size_t)PyArray_DIM(depths, 0);
        Py_BEGIN_ALLOW_THREADS
        csm_depth_histogram(count, data, borders, found);
        Py_END_ALLOW_THREADS
    }
    PyObject *out = edges && counts ? PyTuple_Pack(2, edges, counts) : NULL;
    Py_XDECREF(edges);
    Py_XDECREF(counts);
    Py_DECREF(depths);
    return out;
}

PyDoc_STRVAR(
    surface_steps_doc,
    "surface_steps(camera, points, normals, gradients)\n--\n\n"
    "How a step of one along either of two coordinates moves points (m, 3) of surfaces in "
    "the picture: (m, 2, 2) [pixels], [point, right or down, coordinate]; gradients (2, 3) "
    "per metre.");

static PyObject *surface_steps(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", "points", "normals", "gradients", NULL};
    static const csm_py_rule rules[2] = {{"points", NPY_DOUBLE, 2}, {"normals", NPY_DOUBLE, 2}};
    PyObject *camera_object, *objects[2], *gradients_object, *out = NULL;
    PyArrayObject *arrays[2] = {NULL};
    csm_camera camera;
    double gradients[2][3];
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOO:surface_steps", names, &camera_object,
                                     &objects[0], &objects[1], &gradients_object) ||
        csm_py_checked_camera(module, camera_object, &camera) < 0 ||
        csm_py_vector(gradients_object, "gradients", 6, gradients[0]) < 0) {
        return NULL;
    }
    npy_intp shape[2] = {-1, 3};
    const void *data[2];
    if (csm_py_take(objects, rules, 2, shape, arrays, data) == 0) {
        const npy_intp out_shape[3] = {shape[0], 2, 2};
        out = PyArray_SimpleNew(3, out_shape, NPY_DOUBLE);
        if (out) {
            void *steps = PyArray_DATA((PyArrayObject *)out);
            Py_BEGIN_ALLOW_THREADS
            csm_surface_steps(&camera, (size_t)shape[0], data[0], data[1],
                              (const double(*)[3])gradients, steps);
            Py_END_ALLOW_THREADS
        }
    }
    csm_py_release_arrays(arrays, 2);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_coarse_number_methods[] = {
    METHOD(percentiles),
    METHOD(depth_histogram),
    METHOD(surface_steps),
    {NULL, NULL, 0, NULL},
};
