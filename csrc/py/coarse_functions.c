/* coarse_functions.c: what coarse pictures show, for Python.
 *
 * Arrays are checked against the camera that they belong to; loops over pictures run without the
 * GIL.
 */
#include "py_common.h"

#include <string.h>

/* What an array of results is: its name, its type, and columns, or 0 for none. */
typedef struct array_rule {
    const char *name;
    int type, columns;
} array_rule;

static PyObject *new_points(npy_intp count) {
    const npy_intp shape[2] = {count, 3};
    return PyArray_SimpleNew(2, shape, NPY_DOUBLE);
}

enum { VIEW_DEPTH, NORMAL, VALID, FACING, JUDGED, LIT, CASCADE, PICTURE_ARRAYS };

/* desc points into the rest. */
typedef struct picture_arguments {
    csm_coarse_picture desc;
    csm_camera camera;
    PyArrayObject *arrays[PICTURE_ARRAYS];
} picture_arguments;

static void release_picture(picture_arguments *in) {
    csm_py_release_arrays(in->arrays, PICTURE_ARRAYS);
}

/* objects: by the numbers above, NULL for those that the function does not read. */
static int parse_picture(PyObject *module, PyObject *camera,
                         PyObject *const objects[PICTURE_ARRAYS], picture_arguments *out) {
    static const csm_py_rule rules[PICTURE_ARRAYS] = {
        [VIEW_DEPTH] = {"view_depth", NPY_FLOAT, 2},
        [NORMAL] = {"normal", NPY_FLOAT, 3},
        [VALID] = {"valid", NPY_BOOL, 2},
        [FACING] = {"facing", NPY_BOOL, 2},
        [JUDGED] = {"judged", NPY_BOOL, 2},
        [LIT] = {"lit", NPY_BOOL, 2},
        [CASCADE] = {"cascade_index", NPY_UINT8, 2},
    };
    if (csm_py_checked_camera(module, camera, &out->camera) < 0) {
        return -1;
    }
    npy_intp shape[3] = {out->camera.height, out->camera.width, 3};
    const void *data[PICTURE_ARRAYS] = {NULL};
    if (csm_py_take(objects, rules, PICTURE_ARRAYS, shape, out->arrays, data) < 0) {
        return -1;
    }
    out->desc = (csm_coarse_picture){.camera = &out->camera,
                                     .view_depth = data[VIEW_DEPTH],
                                     .normal = data[NORMAL],
                                     .valid = data[VALID],
                                     .facing = data[FACING],
                                     .judged = data[JUDGED],
                                     .lit = data[LIT],
                                     .cascade = data[CASCADE]};
    return 0;
}

#define MAX_PICTURES 4

/* Of each tuple (camera, view_depth, facing). */
static int parse_pictures(PyObject *module, PyObject *object, picture_arguments *out, int *count) {
    const Py_ssize_t given = PyTuple_Check(object) ? PyTuple_GET_SIZE(object) : 0;
    if (given < 1 || given > MAX_PICTURES) {
        PyErr_Format(PyExc_ValueError, "pictures: expected a tuple of 1 to %d (got %R)",
                     MAX_PICTURES, object);
        return -1;
    }
    for (; *count < given; ++*count) {
        PyObject *camera, *arrays[PICTURE_ARRAYS] = {NULL},
                          *item = PyTuple_GET_ITEM(object, *count);
        if (!PyTuple_Check(item) || PyTuple_GET_SIZE(item) != 3) {
            PyErr_Format(PyExc_ValueError,
                         "pictures: expected tuples of camera, view_depth and facing (got %R)",
                         item);
            return -1;
        }
        camera = PyTuple_GET_ITEM(item, 0);
        arrays[VIEW_DEPTH] = PyTuple_GET_ITEM(item, 1);
        arrays[FACING] = PyTuple_GET_ITEM(item, 2);
        if (parse_picture(module, camera, arrays, &out[*count]) < 0) {
            release_picture(&out[*count]);
            return -1;
        }
    }
    return 0;
}

#define ENDS_NAME "csm.coarse_plane_ends"

static void free_ends(PyObject *capsule) {
    csm_plane_ends *ends = PyCapsule_GetPointer(capsule, ENDS_NAME);
    csm_plane_ends_free(ends);
    PyMem_Free(ends);
}

/* What coarse_plane_ends gave; NULL with an exception for anything else. */
static const csm_plane_ends *parse_ends(PyObject *object) {
    if (!PyCapsule_IsValid(object, ENDS_NAME)) {
        PyErr_Format(PyExc_TypeError, "ends: expected what coarse_plane_ends gives (got %R)",
                     object);
        return NULL;
    }
    return PyCapsule_GetPointer(object, ENDS_NAME);
}

PyDoc_STRVAR(coarse_outline_doc,
             "coarse_outline(pictures, ends, light_axes)\n--\n\n"
             "The outermost points (k, 3) across the light in slices of depth, of the facing "
             "pixels of pictures (camera, view_depth, facing) and past the ends of the first one's "
             "planes, or None.");

static PyObject *coarse_outline(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"pictures", "ends", "light_axes", NULL};
    PyObject *pictures, *ends_object, *axes_object, *out = NULL;
    picture_arguments in[MAX_PICTURES] = {{.arrays = {NULL}}};
    csm_coarse_picture descs[MAX_PICTURES];
    double axes[2][3], outline[CSM_OUTLINE_MAX][3];
    const csm_plane_ends *ends = NULL;
    int count = 0;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO:coarse_outline", names, &pictures,
                                     &ends_object, &axes_object) ||
        csm_py_vector(axes_object, "light_axes", 6, axes[0]) < 0 ||
        (ends_object != Py_None && !(ends = parse_ends(ends_object)))) {
        return NULL;
    }
    if (parse_pictures(module, pictures, in, &count) == 0) {
        for (int i = 0; i < count; i++) {
            descs[i] = in[i].desc;
        }
        size_t kept;
        Py_BEGIN_ALLOW_THREADS
        kept = csm_coarse_outline(descs, count, ends, (const double(*)[3])axes, outline);
        Py_END_ALLOW_THREADS
        out = new_points((npy_intp)kept);
        if (out) {
            memcpy(PyArray_DATA((PyArrayObject *)out), outline, kept * sizeof outline[0]);
        }
    }
    for (int i = 0; i < count; i++) {
        release_picture(&in[i]);
    }
    return out;
}

/* The ends as an object that owns them, and their horizon's box. */
static PyObject *new_ends(PyObject *module, const csm_camera *full,
                          const csm_coarse_picture *picture, const double bounds[6]) {
    csm_plane_ends *ends = PyMem_Malloc(sizeof *ends);
    if (!ends) {
        return PyErr_NoMemory();
    }
    csm_error err = {0};
    csm_status status;
    Py_BEGIN_ALLOW_THREADS
    status = csm_coarse_plane_ends(full, picture, bounds, ends, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        PyMem_Free(ends);
        return csm_py_raise(module, &err);
    }
    PyObject *capsule = PyCapsule_New(ends, ENDS_NAME, free_ends);
    if (!capsule) {
        csm_plane_ends_free(ends);
        PyMem_Free(ends);
        return NULL;
    }
    const int *box = ends->horizon_box;
    return ends->horizon ? Py_BuildValue("N(iiii)", capsule, box[0], box[1], box[2], box[3])
                         : Py_BuildValue("NO", capsule, Py_None);
}

PyDoc_STRVAR(coarse_plane_ends_doc,
             "coarse_plane_ends(camera, small, view_depth, valid, facing, bounds)\n--\n\n"
             "Ends of planes between the coarse pixels, for coarse_outline and coarse_end_points, "
             "and the first row and column and those after the last of the coarse pixels at the "
             "planes' horizon, or None.");

static PyObject *coarse_plane_ends(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", "small", "view_depth", "valid", "facing", "bounds", NULL};
    PyObject *camera, *small, *bounds_object, *arrays[PICTURE_ARRAYS] = {NULL}, *out = NULL;
    picture_arguments full = {.arrays = {NULL}}, in = {.arrays = {NULL}};
    double bounds[6];
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOO:coarse_plane_ends", names, &camera,
                                     &small, &arrays[VIEW_DEPTH], &arrays[VALID], &arrays[FACING],
                                     &bounds_object) ||
        csm_py_vector(bounds_object, "bounds", 6, bounds) < 0 ||
        parse_picture(module, camera, (PyObject *[PICTURE_ARRAYS]){NULL}, &full) < 0) {
        return NULL;
    }
    if (parse_picture(module, small, arrays, &in) == 0) {
        out = new_ends(module, &full.camera, &in.desc, bounds);
    }
    release_picture(&in);
    return out;
}

PyDoc_STRVAR(coarse_end_points_doc,
             "coarse_end_points(ends, /)\n--\n\n"
             "Points (k, 3) that pixels of the full camera's picture see past the ends of planes.");

static PyObject *coarse_end_points(PyObject *module, PyObject *object) {
    const csm_plane_ends *ends = parse_ends(object);
    (void)module;
    if (!ends) {
        return NULL;
    }
    PyObject *out = new_points((npy_intp)csm_plane_end_points(ends, NULL));
    if (out) {
        csm_plane_end_points(ends, PyArray_DATA((PyArrayObject *)out));
    }
    return out;
}

/* New arrays; false with an exception, and none of them, if there is no memory. */
static bool new_arrays(npy_intp count, const array_rule *rules, int array_count,
                       PyArrayObject **arrays, void **data) {
    for (int i = 0; i < array_count; i++) {
        const npy_intp shape[2] = {count, rules[i].columns};
        arrays[i] =
            (PyArrayObject *)PyArray_SimpleNew(rules[i].columns ? 2 : 1, shape, rules[i].type);
        if (!arrays[i]) {
            csm_py_release_arrays(arrays, array_count);
            return false;
        }
        data[i] = PyArray_DATA(arrays[i]);
    }
    return true;
}

/* A dict of them, which it holds from then on. */
static PyObject *named_arrays(const array_rule *rules, int array_count, PyArrayObject **arrays) {
    PyObject *out = PyDict_New();
    for (int i = 0; out && i < array_count; i++) {
        if (PyDict_SetItemString(out, rules[i].name, (PyObject *)arrays[i]) < 0) {
            Py_CLEAR(out);
        }
    }
    csm_py_release_arrays(arrays, array_count);
    return out;
}

enum { ROW, COLUMN, POINT, EDGE_NORMAL, ACROSS, LENGTH, EDGE_ARRAYS };

static PyObject *new_edges(PyObject *module, const csm_coarse_picture *picture, double shrink) {
    static const array_rule rules[EDGE_ARRAYS] = {
        [ROW] = {"rows", NPY_INT64, 0},       [COLUMN] = {"columns", NPY_INT64, 0},
        [POINT] = {"point", NPY_DOUBLE, 3},   [EDGE_NORMAL] = {"normal", NPY_DOUBLE, 3},
        [ACROSS] = {"across", NPY_DOUBLE, 2}, [LENGTH] = {"length", NPY_DOUBLE, 0},
    };
    PyArrayObject *arrays[EDGE_ARRAYS] = {NULL};
    void *data[EDGE_ARRAYS];
    size_t pairs;
    Py_BEGIN_ALLOW_THREADS
    pairs = csm_coarse_edge_pairs(picture);
    Py_END_ALLOW_THREADS
    if (!new_arrays((npy_intp)csm_coarse_edge_count(pairs), rules, EDGE_ARRAYS, arrays, data)) {
        return NULL;
    }
    const csm_coarse_edge_arrays edges = {.row = data[ROW],
                                          .column = data[COLUMN],
                                          .point = data[POINT],
                                          .normal = data[EDGE_NORMAL],
                                          .across = data[ACROSS],
                                          .length = data[LENGTH]};
    csm_error err = {0};
    csm_status status;
    Py_BEGIN_ALLOW_THREADS
    status = csm_coarse_edges(picture, shrink, pairs, &edges, &err);
    Py_END_ALLOW_THREADS
    if (status != CSM_OK) {
        csm_py_release_arrays(arrays, EDGE_ARRAYS);
        return csm_py_raise(module, &err);
    }
    return named_arrays(rules, EDGE_ARRAYS, arrays);
}

PyDoc_STRVAR(coarse_edges_doc,
             "coarse_edges(camera, view_depth, normal, judged, lit, shrink)\n--\n\n"
             "Places of shadow edges: rows, columns, point, normal, across, length.");

static PyObject *coarse_edges(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", "view_depth", "normal", "judged", "lit", "shrink", NULL};
    PyObject *camera, *arrays[PICTURE_ARRAYS] = {NULL}, *out = NULL;
    picture_arguments in = {.arrays = {NULL}};
    double shrink;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOd:coarse_edges", names, &camera,
                                     &arrays[VIEW_DEPTH], &arrays[NORMAL], &arrays[JUDGED],
                                     &arrays[LIT], &shrink)) {
        return NULL;
    }
    if (parse_picture(module, camera, arrays, &in) == 0) {
        out = new_edges(module, &in.desc, shrink);
    }
    release_picture(&in);
    return out;
}

enum { SEEN_POINT, SEEN_DEPTH, SLOPE, GRADIENT, SEEN_CASCADE, DARK, RECEIVER_ARRAYS };

static PyObject *new_receivers(const csm_coarse_picture *picture, const csm_coarse_light *light) {
    static const array_rule rules[RECEIVER_ARRAYS] = {
        [SEEN_POINT] = {"point", NPY_DOUBLE, 3},    [SEEN_DEPTH] = {"depth", NPY_DOUBLE, 0},
        [SLOPE] = {"slope", NPY_DOUBLE, 0},         [GRADIENT] = {"gradient", NPY_DOUBLE, 0},
        [SEEN_CASCADE] = {"cascade", NPY_UINT8, 0}, [DARK] = {"dark", NPY_BOOL, 0},
    };
    PyArrayObject *arrays[RECEIVER_ARRAYS] = {NULL};
    void *data[RECEIVER_ARRAYS];
    size_t facing;
    Py_BEGIN_ALLOW_THREADS
    facing = csm_coarse_facing_count(picture);
    Py_END_ALLOW_THREADS
    if (!new_arrays((npy_intp)csm_coarse_receiver_count(facing), rules, RECEIVER_ARRAYS, arrays,
                    data)) {
        return NULL;
    }
    const csm_coarse_receiver_arrays receivers = {.point = data[SEEN_POINT],
                                                  .depth = data[SEEN_DEPTH],
                                                  .slope = data[SLOPE],
                                                  .gradient = data[GRADIENT],
                                                  .cascade = data[SEEN_CASCADE],
                                                  .dark = data[DARK]};
    Py_BEGIN_ALLOW_THREADS
    csm_coarse_receivers(picture, facing, light, &receivers);
    Py_END_ALLOW_THREADS
    return named_arrays(rules, RECEIVER_ARRAYS, arrays);
}

PyDoc_STRVAR(coarse_receivers_doc,
             "coarse_receivers(camera, view_depth, normal, facing, lit, cascade_index, to_light, "
             "axes, least_cosine)\n--\n\n"
             "Some of the pixels that face the sun: point, depth, slope, gradient, cascade, dark.");

static PyObject *coarse_receivers(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera",        "view_depth", "normal", "facing",       "lit",
                            "cascade_index", "to_light",   "axes",   "least_cosine", NULL};
    PyObject *camera, *to_light, *axes, *arrays[PICTURE_ARRAYS] = {NULL}, *out = NULL;
    picture_arguments in = {.arrays = {NULL}};
    csm_coarse_light light;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOOOOd:coarse_receivers", names, &camera,
                                     &arrays[VIEW_DEPTH], &arrays[NORMAL], &arrays[FACING],
                                     &arrays[LIT], &arrays[CASCADE], &to_light, &axes,
                                     &light.least_cosine) ||
        csm_py_vector(to_light, "to_light", 3, light.to_light) < 0 ||
        csm_py_vector(axes, "axes", 6, light.axes[0]) < 0) {
        return NULL;
    }
    if (parse_picture(module, camera, arrays, &in) == 0) {
        out = new_receivers(&in.desc, &light);
    }
    release_picture(&in);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_coarse_methods[] = {
    METHOD(coarse_outline),
    METHOD(coarse_plane_ends),
    {"coarse_end_points", coarse_end_points, METH_O, coarse_end_points_doc},
    METHOD(coarse_edges),
    METHOD(coarse_receivers),
    {NULL, NULL, 0, NULL},
};
