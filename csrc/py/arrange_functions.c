/* arrange_functions.c: what windows of cascades make of a coarse view, for Python. */
#include "py_common.h"

#include <string.h>

enum { POINTS, DEPTHS, GRADIENTS, STEPS, LENGTHS, VIEW_ARRAYS };

typedef struct view_arguments {
    csm_coarse_view view;
    PyArrayObject *arrays[VIEW_ARRAYS];
} view_arguments;

static PyArrayObject *view_array(PyObject *object, const char *name, int columns, npy_intp count) {
    PyObject *value = csm_py_attribute(object, name);
    PyArrayObject *array = !value ? NULL
                           : count < 0
                               ? csm_py_rows(value, name, NPY_DOUBLE, columns)
                               : csm_py_counted_rows(value, name, NPY_DOUBLE, columns, count);
    Py_XDECREF(value);
    return array;
}

/* "view" by attribute, as csm.signals.View has them. Release the arrays, also after a failure. */
static int parse_view(PyObject *object, view_arguments *in) {
    PyArrayObject **arrays = in->arrays;
    double axes[6];
    if (csm_py_attribute_vector(object, "axes", 6, axes) < 0 ||
        !(arrays[POINTS] = view_array(object, "held", 3, -1)) ||
        !(arrays[GRADIENTS] = view_array(object, "gradients", 0, -1)) ||
        !(arrays[LENGTHS] = view_array(object, "edge_lengths", 0, -1))) {
        return -1;
    }
    const npy_intp points = PyArray_DIM(arrays[POINTS], 0);
    const npy_intp receivers = PyArray_DIM(arrays[GRADIENTS], 0);
    const npy_intp edges = PyArray_DIM(arrays[LENGTHS], 0);
    if (!(arrays[DEPTHS] = view_array(object, "held_depths", 0, points)) ||
        !(arrays[STEPS] = view_array(object, "steps_across", 2, edges))) {
        return -1;
    }
    if (points < receivers + edges) {
        PyErr_Format(PyExc_ValueError,
                     "held must begin with the points of %zd gradients and %zd lengths (got %zd)",
                     (Py_ssize_t)receivers, (Py_ssize_t)edges, (Py_ssize_t)points);
        return -1;
    }
    in->view = (csm_coarse_view){
        .points = PyArray_DATA(arrays[POINTS]),
        .depths = PyArray_DATA(arrays[DEPTHS]),
        .ends = {(size_t)receivers, (size_t)(receivers + edges), (size_t)points},
        .gradients = PyArray_DATA(arrays[GRADIENTS]),
        .steps_across = PyArray_DATA(arrays[STEPS]),
        .lengths = PyArray_DATA(arrays[LENGTHS]),
    };
    memcpy(in->view.axes, axes, sizeof in->view.axes);
    return 0;
}

/* The fit of settings round what a view shows. */
static int parse_fit(PyObject *object, PyObject *settings, PyObject *bounds, PyObject *boxes,
                     const view_arguments *in, csm_py_fit *out) {
    PyObject *camera = csm_py_attribute(object, "camera");
    PyObject *sun = camera ? csm_py_attribute(object, "sun") : NULL;
    PyObject *to_light = sun ? csm_py_attribute(sun, "to_light") : NULL;
    int status = -1;
    if (to_light &&
        csm_py_parse_fit(camera, to_light, settings, bounds, Py_None, Py_None, boxes, out) == 0) {
        out->receivers = (csm_receivers){.points = in->view.points,
                                         .point_count = in->view.ends[CSM_SEEN_OTHERS],
                                         .depths = in->view.depths,
                                         .run_ends = in->view.ends,
                                         .run_count = CSM_SEEN_KINDS};
        out->desc.receivers = &out->receivers;
        status = 0;
    }
    Py_XDECREF(to_light);
    Py_XDECREF(sun);
    Py_XDECREF(camera);
    return status;
}

/* (uvz_from_world, splits, sides, displaced, held) */
static PyObject *new_windows(const csm_cascades *cascades, const double *sides,
                             const double *displaced, const bool *held) {
    const npy_intp count = cascades->count, splits = count + 1;
    PyObject *made[] = {
        csm_py_new_mat4_array(cascades->count), PyArray_SimpleNew(1, &splits, NPY_DOUBLE),
        PyArray_SimpleNew(1, &count, NPY_DOUBLE), PyList_New(count), PyList_New(count)};
    bool complete = made[0] && made[1] && made[2] && made[3] && made[4];
    if (complete) {
        memcpy(PyArray_DATA((PyArrayObject *)made[0]), cascades->uvz_from_world,
               (size_t)count * sizeof *cascades->uvz_from_world);
        memcpy(PyArray_DATA((PyArrayObject *)made[1]), cascades->splits,
               (size_t)splits * sizeof *cascades->splits);
        memcpy(PyArray_DATA((PyArrayObject *)made[2]), sides, (size_t)count * sizeof *sides);
    }
    for (npy_intp i = 0; complete && i < count; i++) {
        PyObject *area = PyFloat_FromDouble(displaced[i]);
        complete = area && PyList_SetItem(made[3], i, area) == 0 &&
                   PyList_SetItem(made[4], i, PyBool_FromLong(held[i])) == 0;
    }
    if (complete) {
        return Py_BuildValue("NNNNN", made[0], made[1], made[2], made[3], made[4]);
    }
    for (size_t i = 0; i < sizeof made / sizeof *made; i++) {
        Py_XDECREF(made[i]);
    }
    return NULL;
}

/* What displacements hang on, of windows that have just been fitted. */
static PyObject *displaced(PyObject *module, const view_arguments *in, const csm_py_fit *fit,
                           double most_moved) {
    double sides[CSM_MAX_CASCADES], area[CSM_MAX_CASCADES];
    bool held[CSM_MAX_CASCADES];
    csm_cascades cascades;
    csm_error err = {0};
    csm_status status = csm_cascades_fit(&fit->desc, &cascades, &err);
    if (status == CSM_OK) {
        for (int i = 0; i < cascades.count; i++) {
            sides[i] =
                fmax(cascades.texel_size[i][0], cascades.texel_size[i][1]) * cascades.map_size[i];
        }
        const csm_arrangement windows = {
            .count = cascades.count,
            .uvz_from_world = (const double(*)[16])cascades.uvz_from_world,
            .splits = cascades.splits,
            .sides = sides,
            .by_interval = fit->settings.effects[CSM_EFFECT_SELECT] == CSM_SELECT_INTERVAL,
            .most_moved = most_moved,
        };
        status = csm_sum_displaced(&in->view, &windows, area, held, &err);
    }
    return status == CSM_OK ? new_windows(&cascades, sides, area, held)
                            : csm_py_raise(module, &err);
}

PyDoc_STRVAR(arrange_doc,
             "arrange(view, settings, scene_bounds, boxes, most_moved)\n--\n\n"
             "(uvz_from_world (n, 4, 4), splits (n + 1,), sides (n,), displaced, held) of windows "
             "round what a csm.signals.View shows: longer sides [m]; lists of lengths of edges "
             "times displacements by maps of one texel, and whether points lie between splits.");

static PyObject *arrange(PyObject *module, PyObject *args) {
    PyObject *view, *settings, *bounds, *boxes, *out = NULL;
    double most_moved;
    view_arguments in = {.arrays = {NULL}};
    csm_py_fit fit = {.points = NULL};
    if (!PyArg_ParseTuple(args, "OOOOd:arrange", &view, &settings, &bounds, &boxes, &most_moved)) {
        return NULL;
    }
    if (parse_view(view, &in) == 0 && parse_fit(view, settings, bounds, boxes, &in, &fit) == 0) {
        out = displaced(module, &in, &fit, most_moved);
    }
    csm_py_release_fit(&fit);
    csm_py_release_arrays(in.arrays, VIEW_ARRAYS);
    return out;
}

static PyObject *arranged(PyObject *module, const csm_coarse_view *view,
                          const csm_arrangement *windows) {
    enum { MOVED, REACH, EDGE_CASCADE, BIAS, RECEIVER_CASCADE, OUT };
    static const int types[OUT] = {NPY_DOUBLE, NPY_DOUBLE, NPY_INT, NPY_DOUBLE, NPY_INT};
    const npy_intp receivers = (npy_intp)view->ends[CSM_SEEN_RECEIVERS];
    const npy_intp edges = (npy_intp)view->ends[CSM_SEEN_EDGES] - receivers;
    PyArrayObject *made[OUT] = {NULL};
    for (int i = 0; i < OUT; i++) {
        made[i] = (PyArrayObject *)PyArray_SimpleNew(1, i < BIAS ? &edges : &receivers, types[i]);
        if (!made[i]) {
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
    if (csm_arrange(view, windows, &out, &err) != CSM_OK) {
        csm_py_release_arrays(made, OUT);
        return csm_py_raise(module, &err);
    }
    return Py_BuildValue("NNNNN", made[MOVED], made[REACH], made[EDGE_CASCADE], made[BIAS],
                         made[RECEIVER_CASCADE]);
}

PyDoc_STRVAR(
    arranged_points_doc,
    "arranged_points(view, uvz_from_world, splits, sides, by_interval, bias_texels, steepest)"
    "\n--\n\n"
    "(moved, reach, edge_cascade, receiver_bias, receiver_cascade) of a csm.signals.View by maps "
    "of one texel: (e,), (e,), (e,), (m,), (m,).");

static PyObject *arranged_points(PyObject *module, PyObject *args) {
    PyObject *view, *matrices, *splits, *sides, *out = NULL;
    double *uvz = NULL, depths[CSM_MAX_CASCADES + 1], longer[CSM_MAX_CASCADES];
    int by_interval;
    npy_intp count;
    view_arguments in = {.arrays = {NULL}};
    csm_arrangement windows = {.splits = depths, .sides = longer};
    if (!PyArg_ParseTuple(args, "OOOOpdd:arranged_points", &view, &matrices, &splits, &sides,
                          &by_interval, &windows.bias_texels, &windows.steepest)) {
        return NULL;
    }
    if (csm_py_windows(matrices, &uvz, &count) == 0 &&
        csm_py_vector(splits, "splits", (int)count + 1, depths) == 0 &&
        csm_py_vector(sides, "sides", (int)count, longer) == 0 && parse_view(view, &in) == 0) {
        windows.count = (int)count;
        windows.uvz_from_world = (const double(*)[16])uvz;
        windows.by_interval = by_interval;
        out = arranged(module, &in.view, &windows);
    }
    PyMem_Free(uvz);
    csm_py_release_arrays(in.arrays, VIEW_ARRAYS);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, name, METH_VARARGS, name##_doc }

PyMethodDef csm_py_arrange_methods[] = {
    METHOD(arrange),
    METHOD(arranged_points),
    {NULL, NULL, 0, NULL},
};
