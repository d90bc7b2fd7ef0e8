/* forecast_functions.c: what windows and sizes make of a coarse view, for Python. */
#include "py_common.h"

#include <string.h>

/* 1 to CSM_MAX_CASCADES windows, from PyMem_Malloc; 0, or -1 with an exception. */
static int parse_windows(PyObject *object, double **out, npy_intp *count) {
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

/* -- arrange ---------------------------------------------------------------------------------- */

enum { POINTS, GRADIENTS, STEPS, LENGTHS, VIEW_ARRAYS };

typedef struct arrange_arguments {
    csm_coarse_view view;
    csm_arrangement windows;
    double *matrices, splits[CSM_MAX_CASCADES + 1], sides[CSM_MAX_CASCADES];
    PyArrayObject *arrays[VIEW_ARRAYS];
} arrange_arguments;

static int parse_view(PyObject *const objects[VIEW_ARRAYS], PyObject *axes, arrange_arguments *in) {
    double flat[6];
    in->arrays[POINTS] = csm_py_rows(objects[POINTS], "points", NPY_DOUBLE, 3);
    in->arrays[GRADIENTS] = csm_py_rows(objects[GRADIENTS], "gradients", NPY_DOUBLE, 0);
    in->arrays[LENGTHS] = csm_py_rows(objects[LENGTHS], "lengths", NPY_DOUBLE, 0);
    if (!in->arrays[POINTS] || !in->arrays[GRADIENTS] || !in->arrays[LENGTHS] ||
        csm_py_vector(axes, "axes", 6, flat) < 0) {
        return -1;
    }
    const npy_intp points = PyArray_DIM(in->arrays[POINTS], 0);
    const npy_intp receivers = PyArray_DIM(in->arrays[GRADIENTS], 0);
    const npy_intp edges = PyArray_DIM(in->arrays[LENGTHS], 0);
    in->arrays[STEPS] = csm_py_counted_rows(objects[STEPS], "steps_across", NPY_DOUBLE, 2, edges);
    if (!in->arrays[STEPS]) {
        return -1;
    }
    if (points < receivers + edges) {
        PyErr_Format(PyExc_ValueError,
                     "points must begin with those of %zd gradients and %zd lengths (got %zd)",
                     (Py_ssize_t)receivers, (Py_ssize_t)edges, (Py_ssize_t)points);
        return -1;
    }
    memcpy(in->view.axes, flat, sizeof in->view.axes);
    in->view.points = PyArray_DATA(in->arrays[POINTS]);
    in->view.gradients = PyArray_DATA(in->arrays[GRADIENTS]);
    in->view.steps_across = PyArray_DATA(in->arrays[STEPS]);
    in->view.lengths = PyArray_DATA(in->arrays[LENGTHS]);
    in->view.point_count = (size_t)points;
    in->view.receiver_count = (size_t)receivers;
    in->view.edge_count = (size_t)edges;
    return 0;
}

static int parse_arrangement(PyObject *matrices, PyObject *splits, PyObject *sides,
                             arrange_arguments *in) {
    npy_intp count;
    if (parse_windows(matrices, &in->matrices, &count) < 0 ||
        csm_py_vector(splits, "splits", (int)count + 1, in->splits) < 0 ||
        csm_py_vector(sides, "sides", (int)count, in->sides) < 0) {
        return -1;
    }
    in->windows.count = (int)count;
    in->windows.uvz_from_world = (const double(*)[16])in->matrices;
    in->windows.splits = in->splits;
    in->windows.sides = in->sides;
    return 0;
}

static PyObject *arranged(PyObject *module, const arrange_arguments *in) {
    enum { MOVED, REACH, EDGE_CASCADE, BIAS, RECEIVER_CASCADE, DISPLACED, HELD, OUT };
    const npy_intp edges = (npy_intp)in->view.edge_count;
    const npy_intp receivers = (npy_intp)in->view.receiver_count, count = in->windows.count;
    const struct {
        npy_intp count;
        int type;
    } kinds[OUT] = {{edges, NPY_DOUBLE},     {edges, NPY_DOUBLE},  {edges, NPY_INT},
                    {receivers, NPY_DOUBLE}, {receivers, NPY_INT}, {count, NPY_DOUBLE},
                    {count, NPY_BOOL}};
    PyArrayObject *made[OUT] = {NULL};
    for (int i = 0; i < OUT; i++) {
        if (!(made[i] = new_numbers(kinds[i].count, kinds[i].type))) {
            csm_py_release_arrays(made, OUT);
            return NULL;
        }
    }
    csm_arranged out = {.moved = PyArray_DATA(made[MOVED]),
                        .reach = PyArray_DATA(made[REACH]),
                        .edge_cascade = PyArray_DATA(made[EDGE_CASCADE]),
                        .receiver_bias = PyArray_DATA(made[BIAS]),
                        .receiver_cascade = PyArray_DATA(made[RECEIVER_CASCADE])};
    csm_error err = {0};
    csm_status status;
    Py_BEGIN_ALLOW_THREADS
    status = csm_arrange(&in->view, &in->windows, &out, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        csm_py_release_arrays(made, OUT);
        return csm_py_raise(module, &err);
    }
    memcpy(PyArray_DATA(made[DISPLACED]), out.displaced, (size_t)count * sizeof *out.displaced);
    memcpy(PyArray_DATA(made[HELD]), out.held, (size_t)count * sizeof *out.held);
    return Py_BuildValue("NNNNNNN", made[MOVED], made[REACH], made[EDGE_CASCADE], made[BIAS],
                         made[RECEIVER_CASCADE], made[DISPLACED], made[HELD]);
}

PyDoc_STRVAR(
    arrange_doc,
    "arrange(camera, uvz_from_world, splits, sides, by_interval, points, gradients, axes, "
    "steps_across, lengths, bias_texels, steepest, most_moved)\n--\n\n"
    "(moved, reach, edge_cascade, receiver_bias, receiver_cascade, displaced, held) of a view by "
    "maps of one texel: (e,), (e,), (e,), (m,), (m,), (n,), (n,). points begin with the m "
    "receivers, of these gradients, and the e edges, of these steps (e, 2) and lengths.");

static PyObject *arrange(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera",       "uvz_from_world",
                            "splits",       "sides",
                            "by_interval",  "points",
                            "gradients",    "axes",
                            "steps_across", "lengths",
                            "bias_texels",  "steepest",
                            "most_moved",   NULL};
    PyObject *camera, *matrices, *splits, *sides, *axes, *objects[VIEW_ARRAYS];
    int by_interval;
    arrange_arguments in = {.matrices = NULL};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOpOOOOOddd:arrange", names, &camera,
                                     &matrices, &splits, &sides, &by_interval, &objects[POINTS],
                                     &objects[GRADIENTS], &axes, &objects[STEPS], &objects[LENGTHS],
                                     &in.windows.bias_texels, &in.windows.steepest,
                                     &in.windows.most_moved)) {
        return NULL;
    }
    in.windows.by_interval = by_interval;
    PyObject *out = NULL;
    if (csm_py_parse_camera(camera, &in.view.camera) == 0 &&
        parse_arrangement(matrices, splits, sides, &in) == 0 &&
        parse_view(objects, axes, &in) == 0) {
        out = arranged(module, &in);
    }
    PyMem_Free(in.matrices);
    csm_py_release_arrays(in.arrays, VIEW_ARRAYS);
    return out;
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
    if (parse_windows(matrices, &in->matrices, &in->count) < 0 ||
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
    METHOD(arrange),       METHOD(casters_load),  METHOD(casters_first),
    METHOD(casters_order), {NULL, NULL, 0, NULL},
};
