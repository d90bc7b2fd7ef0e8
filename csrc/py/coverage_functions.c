/* coverage_functions.c: the measurements of coverage, for Python. */
#include "py_common.h"

#include <string.h>

/* What the arrays of a call become; matrices and receivers are the caller's to free. */
typedef struct coverage_arguments {
    csm_coverage_desc desc;
    double *matrices;
    PyArrayObject *receivers;
    int map_size[CSM_MAX_CASCADES];
    double splits[CSM_MAX_CASCADES + 1], bounds[6];
} coverage_arguments;

static int parse_cascades(PyObject *matrices, PyObject *splits, PyObject *map_size,
                          coverage_arguments *out) {
    npy_intp count;
    double sizes[CSM_MAX_CASCADES];
    if (csm_py_matrices(matrices, "clip_from_world", &out->matrices, &count) < 0) {
        return -1;
    }
    if (count < 1 || count > CSM_MAX_CASCADES) {
        PyErr_Format(PyExc_ValueError, "there must be 1 to %d cascades (got %zd)", CSM_MAX_CASCADES,
                     (Py_ssize_t)count);
        return -1;
    }
    if (csm_py_vector(splits, "splits", (int)count + 1, out->splits) < 0 ||
        csm_py_vector(map_size, "map_size", (int)count, sizes) < 0) {
        return -1;
    }
    for (npy_intp i = 0; i < count; i++) {
        out->map_size[i] = sizes[i] >= 1.0 && sizes[i] <= 65536.0 ? (int)sizes[i] : 0;
    }
    out->desc.count = (int)count;
    out->desc.clip_from_world = (const double(*)[16])out->matrices;
    out->desc.map_size = out->map_size;
    out->desc.splits = out->splits;
    return 0;
}

static int parse_seen(PyObject *bounds, PyObject *receivers, coverage_arguments *out) {
    if (bounds != Py_None) {
        if (csm_py_vector(bounds, "scene_bounds", 6, out->bounds) < 0) {
            return -1;
        }
        out->desc.scene_bounds = out->bounds;
    }
    if (receivers != Py_None) {
        out->receivers = csm_py_rows(receivers, "receivers", NPY_DOUBLE, 3);
        if (!out->receivers) {
            return -1;
        }
        out->desc.receivers = PyArray_DATA(out->receivers);
        out->desc.receiver_count = (size_t)PyArray_DIM(out->receivers, 0);
    }
    return 0;
}

static PyObject *new_worst(const csm_coverage_worst *worst) {
    return Py_BuildValue("d(ddd)", worst->amount, worst->point[0], worst->point[1],
                         worst->point[2]);
}

static PyObject *new_doubles(int dimensions, const npy_intp *shape, const double *source) {
    PyObject *array = PyArray_SimpleNew(dimensions, shape, NPY_DOUBLE);
    if (array) {
        PyArrayObject *values = (PyArrayObject *)array;
        memcpy(PyArray_DATA(values), source, (size_t)PyArray_NBYTES(values));
    }
    return array;
}

static PyObject *new_coverage(const csm_coverage *c, int count) {
    const npy_intp points[2] = {c->gap_point_count, 3}, each[1] = {count};
    return Py_BuildValue(
        "{s:N,s:N,s:N,s:N,s:d,s:d,s:N,s:d,s:d,s:d,s:N,s:(dd),s:(ddd),s:N,s:(dd),s:d,s:n}",
        "overflow", new_worst(&c->overflow), "before", new_worst(&c->before), "behind",
        new_worst(&c->behind), "caster", new_worst(&c->caster), "gap_texels", c->gap_texels,
        "gap_share", c->gap_share, "gap_points", new_doubles(2, points, c->gap_points[0]),
        "tolerance_texels", c->tolerance_texels, "tolerance_depth", c->tolerance_depth,
        "utilisation", c->utilisation, "overlap", new_doubles(1, each, c->overlap),
        "texels_per_pixel", c->texels_per_pixel[0], c->texels_per_pixel[1], "to_light",
        c->to_light[0], c->to_light[1], c->to_light[2], "mirrored", PyBool_FromLong(c->mirrored),
        "texel_size", c->texel_size[0], c->texel_size[1], "depth_span", c->depth_span,
        "receiver_count", (Py_ssize_t)c->receiver_count);
}

PyDoc_STRVAR(coverage_doc,
             "coverage(camera, clip_from_world, splits, map_size, first_map, border_texels, "
             "tolerance_texels, scene_bounds=None, receivers=None)\n--\n\n"
             "One dict of measurements per cascade; clip z of the matrices (n, 4, 4) in [0, 1].");

static PyObject *coverage(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {
        "camera",        "clip_from_world",  "splits",       "map_size",  "first_map",
        "border_texels", "tolerance_texels", "scene_bounds", "receivers", NULL};
    PyObject *camera, *matrices, *splits, *map_size, *bounds = Py_None, *receivers = Py_None;
    int first_map;
    coverage_arguments in = {.matrices = NULL};
    PyObject *out = NULL;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOpdd|OO:coverage", names, &camera, &matrices,
                                     &splits, &map_size, &first_map, &in.desc.border_texels,
                                     &in.desc.tolerance_texels, &bounds, &receivers)) {
        return NULL;
    }
    in.desc.first_map = first_map;
    if (csm_py_checked_camera(module, camera, &in.desc.camera) == 0 &&
        parse_cascades(matrices, splits, map_size, &in) == 0 &&
        parse_seen(bounds, receivers, &in) == 0) {
        csm_coverage measured[CSM_MAX_CASCADES];
        csm_error err = {0};
        csm_status status;
        Py_BEGIN_ALLOW_THREADS
        status = csm_coverage_measure(&in.desc, measured, &err);
        Py_END_ALLOW_THREADS
        if (status != CSM_OK) {
            csm_py_raise(module, &err);
        } else {
            out = PyList_New(in.desc.count);
        }
        for (int i = 0; out && i < in.desc.count; i++) {
            PyObject *cascade = new_coverage(&measured[i], in.desc.count);
            if (!cascade) {
                Py_CLEAR(out);
                break;
            }
            PyList_SET_ITEM(out, i, cascade);
        }
    }
    PyMem_Free(in.matrices);
    Py_XDECREF(in.receivers);
    return out;
}

/* One (4, 4) matrix, column-major. */
static int parse_matrix(PyObject *object, const char *name, double out[16]) {
    double rows[16];
    if (csm_py_vector(object, name, 16, rows) < 0) {
        return -1;
    }
    for (int i = 0; i < 16; i++) {
        out[4 * (i % 4) + i / 4] = rows[i];
    }
    return 0;
}

PyDoc_STRVAR(coverage_move_doc,
             "coverage_move(camera, near, far, before, size_before, after, size_after)\n--\n\n"
             "What happened to a texel grid between two clip matrices (4, 4), seen from the "
             "corners of the view between two depths before.");

static PyObject *coverage_move(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera",      "near",  "far",        "before",
                            "size_before", "after", "size_after", NULL};
    PyObject *object, *before_object, *after_object;
    csm_camera camera;
    double near_depth, far_depth, before[16], after[16];
    int size_before, size_after;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OddOiOi:coverage_move", names, &object,
                                     &near_depth, &far_depth, &before_object, &size_before,
                                     &after_object, &size_after) ||
        csm_py_checked_camera(module, object, &camera) < 0 ||
        parse_matrix(before_object, "before", before) < 0 ||
        parse_matrix(after_object, "after", after) < 0) {
        return NULL;
    }
    csm_grid_move move;
    csm_error err = {0};
    if (csm_coverage_move(&camera, near_depth, far_depth, before, size_before, after, size_after,
                          &move, &err) != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    return Py_BuildValue("{s:((dd)(dd)),s:d,s:d,s:(ddd),s:d,s:d}", "texel_size",
                         move.texel_size[0][0], move.texel_size[0][1], move.texel_size[1][0],
                         move.texel_size[1][1], "texels", move.texels, "depth", move.depth,
                         "depth_quanta", move.depth_quanta[0], move.depth_quanta[1],
                         move.depth_quanta[2], "rounding_texels", move.rounding_texels,
                         "rounding_depth", move.rounding_depth);
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_coverage_methods[] = {
    METHOD(coverage),
    METHOD(coverage_move),
    {NULL, NULL, 0, NULL},
};
