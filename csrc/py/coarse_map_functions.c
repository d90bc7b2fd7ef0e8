/* coarse_map_functions.c: what the maps of a coarse frame hold, for Python.
 *
 * Arrays are checked against each other; every loop runs without the GIL.
 */
#include "py_common.h"

#include <math.h>

/* desc points into the rest. */
typedef struct maps_arguments {
    csm_coarse_maps desc;
    double *matrices;
    PyArrayObject *depths[CSM_MAX_CASCADES];
} maps_arguments;

static void release_maps(maps_arguments *in) {
    PyMem_Free(in->matrices);
    in->matrices = NULL;
    csm_py_release_arrays(in->depths, CSM_MAX_CASCADES);
}

static int parse_map(PyObject *object, int i, maps_arguments *out) {
    out->depths[i] = csm_py_shaped(object, "shadow_maps", NPY_FLOAT, 2, (const npy_intp[]){-1, -1});
    if (!out->depths[i]) {
        return -1;
    }
    const npy_intp *shape = PyArray_DIMS(out->depths[i]);
    if (shape[0] != shape[1] || shape[0] < CSM_COARSE_MAP_MIN || shape[0] > 65536) {
        PyErr_Format(PyExc_ValueError,
                     "shadow_maps must be square, of at least %d texels along a side (got %zd x "
                     "%zd)",
                     CSM_COARSE_MAP_MIN, (Py_ssize_t)shape[0], (Py_ssize_t)shape[1]);
        return -1;
    }
    out->desc.depths[i] = PyArray_DATA(out->depths[i]);
    out->desc.size[i] = (int)shape[0];
    return 0;
}

static int parse_sizes(PyObject *texel_object, PyObject *range_object, maps_arguments *out) {
    double texel[2 * CSM_MAX_CASCADES], range[2 * CSM_MAX_CASCADES];
    const int count = out->desc.count;
    if (csm_py_vector(texel_object, "texel_size", 2 * count, texel) < 0 ||
        csm_py_vector(range_object, "depth_range", 2 * count, range) < 0) {
        return -1;
    }
    for (int i = 0; i < count; i++) {
        out->desc.texel[i] = fmax(texel[2 * i], texel[2 * i + 1]);
        out->desc.span[i] = range[2 * i + 1] - range[2 * i];
    }
    return 0;
}

/* A tuple of shadow_maps, uvz_from_world, texel_size, depth_range. Release what came of it, also
 * after a failure. */
static int parse_maps(PyObject *object, maps_arguments *out) {
    if (!PyTuple_Check(object) || PyTuple_GET_SIZE(object) != 4) {
        PyErr_Format(PyExc_ValueError,
                     "maps: expected a tuple of shadow_maps, uvz_from_world, texel_size and "
                     "depth_range (got %R)",
                     (PyObject *)Py_TYPE(object));
        return -1;
    }
    PyObject *given = PyTuple_GET_ITEM(object, 0);
    const Py_ssize_t count = PySequence_Size(given);
    npy_intp matrices;
    if (count < 0 || csm_py_matrices(PyTuple_GET_ITEM(object, 1), "uvz_from_world", &out->matrices,
                                     &matrices) < 0) {
        return -1;
    }
    if (count < 1 || count > CSM_MAX_CASCADES || matrices != count) {
        PyErr_Format(PyExc_ValueError,
                     "shadow_maps: expected 1 to %d, and as many of uvz_from_world (got %zd and "
                     "%zd)",
                     CSM_MAX_CASCADES, count, (Py_ssize_t)matrices);
        return -1;
    }
    out->desc.count = (int)count;
    out->desc.uvz_from_world = (const double(*)[16])out->matrices;
    for (int i = 0; i < out->desc.count; i++) {
        PyObject *map = PySequence_GetItem(given, i);
        const int status = map ? parse_map(map, i, out) : -1;
        Py_XDECREF(map);
        if (status < 0) {
            return -1;
        }
    }
    return parse_sizes(PyTuple_GET_ITEM(object, 2), PyTuple_GET_ITEM(object, 3), out);
}

enum { POINTS, NORMALS, CASCADE, DARK, POINT_ARRAYS };

/* Maps, and points that are looked up in them. */
typedef struct lookup_arguments {
    maps_arguments maps;
    csm_coarse_points points;
    PyArrayObject *arrays[POINT_ARRAYS];
} lookup_arguments;

static void release_lookup(lookup_arguments *in) {
    release_maps(&in->maps);
    csm_py_release_arrays(in->arrays, POINT_ARRAYS);
}

/* objects: by the numbers above, NULL for those that the function does not read. Release what came
 * of it, also after a failure. */
static int parse_lookup(PyObject *maps, PyObject *const objects[POINT_ARRAYS],
                        lookup_arguments *out) {
    static const csm_py_rule rules[POINT_ARRAYS] = {
        [POINTS] = {"points", NPY_DOUBLE, 2},
        [NORMALS] = {"normals", NPY_DOUBLE, 2},
        [CASCADE] = {"cascade_index", NPY_UINT8, 1},
        [DARK] = {"dark", NPY_BOOL, 1},
    };
    if (parse_maps(maps, &out->maps) < 0) {
        return -1;
    }
    npy_intp shape[2] = {-1, 3};
    const void *data[POINT_ARRAYS] = {NULL};
    if (csm_py_take(objects, rules, POINT_ARRAYS, shape, out->arrays, data) < 0) {
        return -1;
    }
    out->points = (csm_coarse_points){.point = data[POINTS],
                                      .normal = data[NORMALS],
                                      .cascade = data[CASCADE],
                                      .dark = data[DARK],
                                      .count = (size_t)shape[0]};
    return 0;
}

PyDoc_STRVAR(coarse_thin_share_doc,
             "coarse_thin_share(maps)\n--\n\n"
             "Share of the texels of outlines before something else on both sides within two "
             "texels; maps: (shadow_maps, uvz_from_world, texel_size, depth_range).");

static PyObject *coarse_thin_share(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"maps", NULL};
    PyObject *maps, *out = NULL;
    maps_arguments in = {.matrices = NULL};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O:coarse_thin_share", names, &maps)) {
        return NULL;
    }
    if (parse_maps(maps, &in) == 0) {
        double share;
        Py_BEGIN_ALLOW_THREADS
        share = csm_coarse_thin_share(&in.desc);
        Py_END_ALLOW_THREADS
        out = PyFloat_FromDouble(share);
    }
    release_maps(&in);
    return out;
}

PyDoc_STRVAR(coarse_layered_share_doc,
             "coarse_layered_share(maps, points, cascade_index)\n--\n\n"
             "Share of the points in full shadow that a variance map would light by more than a "
             "tenth; maps as for coarse_thin_share.");

static PyObject *coarse_layered_share(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"maps", "points", "cascade_index", NULL};
    PyObject *maps, *objects[POINT_ARRAYS] = {NULL}, *out = NULL;
    lookup_arguments in = {.arrays = {NULL}};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO:coarse_layered_share", names, &maps,
                                     &objects[POINTS], &objects[CASCADE])) {
        return NULL;
    }
    if (parse_lookup(maps, objects, &in) == 0) {
        double share;
        Py_BEGIN_ALLOW_THREADS
        share = csm_coarse_layered_share(&in.maps.desc, &in.points);
        Py_END_ALLOW_THREADS
        out = PyFloat_FromDouble(share);
    }
    release_lookup(&in);
    return out;
}

/* A number of every point. */
static PyObject *new_distances(PyObject *maps, PyObject *const objects[POINT_ARRAYS],
                               void (*measure)(const csm_coarse_maps *, const csm_coarse_points *,
                                               double *)) {
    PyObject *out = NULL;
    lookup_arguments in = {.arrays = {NULL}};
    if (parse_lookup(maps, objects, &in) == 0) {
        const npy_intp shape[1] = {(npy_intp)in.points.count};
        out = PyArray_SimpleNew(1, shape, NPY_DOUBLE);
    }
    if (out) {
        double *distances = PyArray_DATA((PyArrayObject *)out);
        Py_BEGIN_ALLOW_THREADS
        measure(&in.maps.desc, &in.points, distances);
        Py_END_ALLOW_THREADS
    }
    release_lookup(&in);
    return out;
}

PyDoc_STRVAR(coarse_gaps_doc, "coarse_gaps(maps, points, cascade_index, dark)\n--\n\n"
                              "From dark points to what their map holds before them (m,) [m], inf "
                              "for others; maps as for coarse_thin_share.");

static PyObject *coarse_gaps(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"maps", "points", "cascade_index", "dark", NULL};
    PyObject *maps, *objects[POINT_ARRAYS] = {NULL};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOO:coarse_gaps", names, &maps,
                                     &objects[POINTS], &objects[CASCADE], &objects[DARK])) {
        return NULL;
    }
    return new_distances(maps, objects, csm_coarse_gaps);
}

PyDoc_STRVAR(coarse_blockers_doc,
             "coarse_blockers(maps, points, normals, cascade_index)\n--\n\n"
             "From points at the dark side of edges to their occluders (m,) [m]; maps as for "
             "coarse_thin_share.");

static PyObject *coarse_blockers(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"maps", "points", "normals", "cascade_index", NULL};
    PyObject *maps, *objects[POINT_ARRAYS] = {NULL};
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOO:coarse_blockers", names, &maps,
                                     &objects[POINTS], &objects[NORMALS], &objects[CASCADE])) {
        return NULL;
    }
    return new_distances(maps, objects, csm_coarse_blockers);
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_coarse_map_methods[] = {
    METHOD(coarse_thin_share), METHOD(coarse_layered_share), METHOD(coarse_gaps),
    METHOD(coarse_blockers),   {NULL, NULL, 0, NULL},
};
