/* coarse_functions.c: what coarse pictures and their maps show, for Python.
 *
 * Arrays are checked against the camera or the maps that they belong to; every loop runs without
 * the GIL.
 */
#include "py_common.h"

#include <math.h>
#include <string.h>

/* An aligned, C-contiguous array of exactly this shape; a new reference, or NULL with an exception
 * that names the argument. A side of -1 may have any length. */
static PyArrayObject *parse_array(PyObject *object, const char *name, int type, int dimensions,
                                  const npy_intp *shape) {
    PyArrayObject *array = (PyArrayObject *)PyArray_FromAny(object, PyArray_DescrFromType(type), 0,
                                                            0, NPY_ARRAY_CARRAY_RO, NULL);
    if (!array) {
        return NULL;
    }
    bool same = PyArray_NDIM(array) == dimensions;
    for (int i = 0; same && i < dimensions; i++) {
        same = shape[i] < 0 || PyArray_DIM(array, i) == shape[i];
    }
    if (same) {
        return array;
    }
    PyObject *got = PyObject_GetAttrString((PyObject *)array, "shape");
    PyObject *expected = PyTuple_New(dimensions);
    for (int i = 0; expected && i < dimensions; i++) {
        PyObject *side = shape[i] < 0 ? PyUnicode_FromString("any") : PyLong_FromSsize_t(shape[i]);
        if (!side) {
            Py_CLEAR(expected);
            break;
        }
        PyTuple_SET_ITEM(expected, i, side);
    }
    if (got && expected) {
        PyErr_Format(PyExc_ValueError, "%s: expected shape %R, got %R", name, expected, got);
    }
    Py_XDECREF(got);
    Py_XDECREF(expected);
    Py_DECREF(array);
    return NULL;
}

static PyObject *new_points(npy_intp count) {
    const npy_intp shape[2] = {count, 3};
    return PyArray_SimpleNew(2, shape, NPY_DOUBLE);
}

/* -- pictures ---------------------------------------------------------------------------------- */

enum { VIEW_DEPTH, NORMAL, VALID, FACING, JUDGED, LIT, PICTURE_ARRAYS };

/* desc points into the rest. */
typedef struct picture_arguments {
    csm_coarse_picture desc;
    csm_camera camera;
    PyArrayObject *arrays[PICTURE_ARRAYS];
} picture_arguments;

static void release_picture(picture_arguments *in) {
    for (int i = 0; i < PICTURE_ARRAYS; i++) {
        Py_CLEAR(in->arrays[i]);
    }
}

/* objects: by the numbers above, NULL for those that the function does not read. */
static int parse_picture(PyObject *module, PyObject *camera,
                         PyObject *const objects[PICTURE_ARRAYS], picture_arguments *out) {
    static const struct {
        const char *name;
        int type, dimensions;
    } rules[PICTURE_ARRAYS] = {
        [VIEW_DEPTH] = {"view_depth", NPY_FLOAT, 2},
        [NORMAL] = {"normal", NPY_FLOAT, 3},
        [VALID] = {"valid", NPY_BOOL, 2},
        [FACING] = {"facing", NPY_BOOL, 2},
        [JUDGED] = {"judged", NPY_BOOL, 2},
        [LIT] = {"lit", NPY_BOOL, 2},
    };
    csm_error err = {0};
    if (csm_py_parse_camera(camera, &out->camera) < 0) {
        return -1;
    }
    if (csm_camera_validate(&out->camera, &err) != CSM_OK) {
        csm_py_raise(module, &err);
        return -1;
    }
    const npy_intp shape[3] = {out->camera.height, out->camera.width, 3};
    const void *data[PICTURE_ARRAYS] = {NULL};
    for (int i = 0; i < PICTURE_ARRAYS; i++) {
        if (objects[i]) {
            out->arrays[i] =
                parse_array(objects[i], rules[i].name, rules[i].type, rules[i].dimensions, shape);
            if (!out->arrays[i]) {
                return -1;
            }
            data[i] = PyArray_DATA(out->arrays[i]);
        }
    }
    out->desc = (csm_coarse_picture){.camera = &out->camera,
                                     .view_depth = data[VIEW_DEPTH],
                                     .normal = data[NORMAL],
                                     .valid = data[VALID],
                                     .facing = data[FACING],
                                     .judged = data[JUDGED],
                                     .lit = data[LIT]};
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

PyDoc_STRVAR(coarse_outline_doc,
             "coarse_outline(pictures, points, light_axes)\n--\n\n"
             "The outermost points (k, 3) across the light in slices of depth, of the facing "
             "pixels of pictures (camera, view_depth, facing) and of points (m, 3).");

static PyObject *coarse_outline(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"pictures", "points", "light_axes", NULL};
    PyObject *pictures, *points_object, *axes_object, *out = NULL;
    picture_arguments in[MAX_PICTURES] = {{.arrays = {NULL}}};
    csm_coarse_picture descs[MAX_PICTURES];
    double axes[2][3], outline[CSM_OUTLINE_MAX][3];
    int count = 0;
    PyArrayObject *points = NULL;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO:coarse_outline", names, &pictures,
                                     &points_object, &axes_object) ||
        csm_py_vector(axes_object, "light_axes", 6, axes[0]) < 0) {
        return NULL;
    }
    if (parse_pictures(module, pictures, in, &count) == 0) {
        points = parse_array(points_object, "points", NPY_DOUBLE, 2, (const npy_intp[]){-1, 3});
    }
    if (points) {
        for (int i = 0; i < count; i++) {
            descs[i] = in[i].desc;
        }
        size_t kept;
        Py_BEGIN_ALLOW_THREADS
        kept =
            csm_coarse_outline(descs, count, PyArray_DATA(points), (size_t)PyArray_DIM(points, 0),
                               (const double(*)[3])axes, outline);
        Py_END_ALLOW_THREADS
        out = new_points((npy_intp)kept);
        if (out) {
            memcpy(PyArray_DATA((PyArrayObject *)out), outline, kept * sizeof outline[0]);
        }
    }
    for (int i = 0; i < count; i++) {
        release_picture(&in[i]);
    }
    Py_XDECREF(points);
    return out;
}

PyDoc_STRVAR(coarse_plane_ends_doc,
             "coarse_plane_ends(camera, small, view_depth, valid, facing, bounds)\n--\n\n"
             "Points (k, 3) of the full camera's picture past the last coarse pixels of planes, "
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
        csm_plane_ends ends;
        csm_error err = {0};
        csm_status status;
        Py_BEGIN_ALLOW_THREADS
        status = csm_coarse_plane_ends(&full.camera, &in.desc, bounds, &ends, &err);
        Py_END_ALLOW_THREADS
        PyObject *points = NULL;
        if (status != CSM_OK) {
            csm_py_raise(module, &err);
        } else {
            points = new_points((npy_intp)ends.count);
        }
        if (points) {
            memcpy(PyArray_DATA((PyArrayObject *)points), ends.points,
                   ends.count * sizeof ends.points[0]);
            const int *box = ends.horizon_box;
            out = ends.horizon ? Py_BuildValue("N(iiii)", points, box[0], box[1], box[2], box[3])
                               : Py_BuildValue("NO", points, Py_None);
        }
        csm_plane_ends_free(&ends);
    }
    release_picture(&in);
    return out;
}

enum { ROW, COLUMN, POINT, EDGE_NORMAL, ACROSS, LENGTH, EDGE_ARRAYS };

static PyObject *new_edges(PyObject *module, const csm_coarse_picture *picture, double shrink) {
    static const struct {
        int type, columns;
    } rules[EDGE_ARRAYS] = {{NPY_INT64, 0},  {NPY_INT64, 0},  {NPY_DOUBLE, 3},
                            {NPY_DOUBLE, 3}, {NPY_DOUBLE, 2}, {NPY_DOUBLE, 0}};
    size_t pairs;
    Py_BEGIN_ALLOW_THREADS
    pairs = csm_coarse_edge_pairs(picture);
    Py_END_ALLOW_THREADS
    PyObject *arrays[EDGE_ARRAYS] = {NULL}, *out = NULL;
    void *data[EDGE_ARRAYS];
    bool complete = true;
    for (int i = 0; complete && i < EDGE_ARRAYS; i++) {
        const npy_intp shape[2] = {(npy_intp)csm_coarse_edge_count(pairs), rules[i].columns};
        arrays[i] = PyArray_SimpleNew(rules[i].columns ? 2 : 1, shape, rules[i].type);
        complete = arrays[i] != NULL;
        data[i] = complete ? PyArray_DATA((PyArrayObject *)arrays[i]) : NULL;
    }
    if (complete) {
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
            csm_py_raise(module, &err);
        } else {
            out =
                Py_BuildValue("{s:O,s:O,s:O,s:O,s:O,s:O}", "rows", arrays[ROW], "columns",
                              arrays[COLUMN], "point", arrays[POINT], "normal", arrays[EDGE_NORMAL],
                              "across", arrays[ACROSS], "length", arrays[LENGTH]);
        }
    }
    for (int i = 0; i < EDGE_ARRAYS; i++) {
        Py_XDECREF(arrays[i]);
    }
    return out;
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

/* -- maps -------------------------------------------------------------------------------------- */

/* desc points into the rest. */
typedef struct maps_arguments {
    csm_coarse_maps desc;
    double *matrices;
    PyArrayObject *depths[CSM_MAX_CASCADES];
} maps_arguments;

static void release_maps(maps_arguments *in) {
    PyMem_Free(in->matrices);
    in->matrices = NULL;
    for (int i = 0; i < CSM_MAX_CASCADES; i++) {
        Py_CLEAR(in->depths[i]);
    }
}

static int parse_map(PyObject *object, int i, maps_arguments *out) {
    out->depths[i] = parse_array(object, "shadow_maps", NPY_FLOAT, 2, (const npy_intp[]){-1, -1});
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
    for (int i = 0; i < POINT_ARRAYS; i++) {
        Py_CLEAR(in->arrays[i]);
    }
}

/* objects: by the numbers above, NULL for those that the function does not read. Release what came
 * of it, also after a failure. */
static int parse_lookup(PyObject *maps, PyObject *const objects[POINT_ARRAYS],
                        lookup_arguments *out) {
    static const struct {
        const char *name;
        int type, dimensions;
    } rules[POINT_ARRAYS] = {
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
    for (int i = 0; i < POINT_ARRAYS; i++) {
        if (objects[i]) {
            out->arrays[i] =
                parse_array(objects[i], rules[i].name, rules[i].type, rules[i].dimensions, shape);
            if (!out->arrays[i]) {
                return -1;
            }
            data[i] = PyArray_DATA(out->arrays[i]);
            shape[0] = PyArray_DIM(out->arrays[i], 0); /* the others have as many */
        }
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

PyMethodDef csm_py_coarse_methods[] = {
    METHOD(coarse_outline),    METHOD(coarse_plane_ends),    METHOD(coarse_edges),
    METHOD(coarse_thin_share), METHOD(coarse_layered_share), METHOD(coarse_gaps),
    METHOD(coarse_blockers),   {NULL, NULL, 0, NULL},
};
