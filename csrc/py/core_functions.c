/* core_functions.c: the pure functions of core, for Python.
 *
 * In: cameras and settings as attributes, vectors and boxes as arrays. Out: numpy arrays that numpy
 * owns. Calls of microseconds keep the GIL; culling many boxes lets it go.
 */
#include "py_common.h"

#include <limits.h>
#include <math.h>

static PyObject *new_array(int dimensions, const npy_intp *shape, int type, const void *source) {
    PyObject *array = PyArray_SimpleNew(dimensions, shape, type);
    if (array) {
        PyArrayObject *values = (PyArrayObject *)array;
        memcpy(PyArray_DATA(values), source, (size_t)PyArray_NBYTES(values));
    }
    return array;
}

static PyObject *new_matrices(const double (*source)[16], int count) {
    PyObject *array = csm_py_new_mat4_array(count);
    if (array) {
        memcpy(PyArray_DATA((PyArrayObject *)array), source, (size_t)count * sizeof *source);
    }
    return array;
}

static PyObject *new_matrix(const double source[16]) {
    PyObject *stack = new_matrices((const double(*)[16])source, 1);
    PyObject *matrix = stack ? PySequence_GetItem(stack, 0) : NULL;
    Py_XDECREF(stack);
    return matrix;
}

/* None, or a held step. */
static int parse_step(PyObject *held, int *out) {
    *out = INT_MIN;
    if (held == Py_None) {
        return 0;
    }
    const long step = PyLong_AsLong(held);
    if (step == -1 && PyErr_Occurred()) {
        return -1;
    }
    *out = step > INT_MIN && step < INT_MAX ? (int)step : INT_MIN;
    return 0;
}

PyDoc_STRVAR(split_distances_doc,
             "split_distances(near, far, count, scheme, lam)\n--\n\n"
             "(count + 1,) ascending view depths [m]; scheme is the number of a split scheme.");

static PyObject *split_distances(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"near", "far", "count", "scheme", "lam", NULL};
    double near_depth, far_depth, lam, splits[CSM_MAX_CASCADES + 1];
    int count, scheme;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "ddiid:split_distances", names, &near_depth,
                                     &far_depth, &count, &scheme, &lam)) {
        return NULL;
    }
    csm_error err = {0};
    if (csm_splits_compute(near_depth, far_depth, count, scheme, lam, splits, &err) != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    const npy_intp shape[1] = {count + 1};
    return new_array(1, shape, NPY_DOUBLE, splits);
}

PyDoc_STRVAR(range_round_up_doc,
             "range_round_up(near, depth, held_step=None)\n--\n\n"
             "(far, step): far = near * 2^(step / 4) with the least step >= 1 that reaches depth, "
             "or held_step where that is one more.");

static PyObject *range_round_up(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"near", "depth", "held_step", NULL};
    double near_depth, depth;
    PyObject *held = Py_None;
    int held_step, step;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "dd|O:range_round_up", names, &near_depth,
                                     &depth, &held) ||
        parse_step(held, &held_step) < 0) {
        return NULL;
    }
    if (!(near_depth > 0.0) || !isfinite(near_depth) || !isfinite(depth)) {
        csm_error err = {0};
        csm_fail(&err, CSM_ERROR_INVALID_ARGUMENT,
                 "near must be > 0, near and depth finite (got near %g, depth %g)", near_depth,
                 depth);
        return csm_py_raise(module, &err);
    }
    const double far_depth = csm_range_round_up(near_depth, depth, held_step, &step);
    return Py_BuildValue("di", far_depth, step);
}

PyDoc_STRVAR(light_basis_doc, "light_basis(to_light)\n--\n\n"
                              "light_from_world (4, 4): a rotation whose third row is to_light.");

static PyObject *light_basis(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"to_light", NULL};
    PyObject *object;
    double to_light[3], basis[16];
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O:light_basis", names, &object) ||
        csm_py_vector(object, "to_light", 3, to_light) < 0) {
        return NULL;
    }
    csm_error err = {0};
    if (csm_light_basis_orthonormal(to_light, basis, &err) != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    return new_matrix(basis);
}

PyDoc_STRVAR(camera_matrices_doc, "camera_matrices(camera)\n--\n\n"
                                  "(view_from_world, clip_from_view), each (4, 4).");

static PyObject *camera_matrices(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", NULL};
    PyObject *object;
    csm_camera camera;
    double matrices[2][16];
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O:camera_matrices", names, &object) ||
        csm_py_checked_camera(module, object, &camera) < 0) {
        return NULL;
    }
    csm_camera_view_from_world(&camera, matrices[0]);
    csm_camera_clip_from_view(&camera, matrices[1]);
    return Py_BuildValue("NN", new_matrix(matrices[0]), new_matrix(matrices[1]));
}

/* What the functions of a slice share: camera, near, far. */
static int parse_slice(PyObject *module, PyObject *args, PyObject *kwargs, csm_camera *camera,
                       double *near_depth, double *far_depth) {
    static char *names[] = {"camera", "near", "far", NULL};
    PyObject *object;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "Odd", names, &object, near_depth, far_depth) ||
        csm_py_checked_camera(module, object, camera) < 0) {
        return -1;
    }
    if (!isfinite(*near_depth) || !isfinite(*far_depth) || !(*far_depth > *near_depth)) {
        csm_error err = {0};
        csm_fail(&err, CSM_ERROR_INVALID_ARGUMENT,
                 "far must be > near, both finite (got near %g, far %g)", *near_depth, *far_depth);
        csm_py_raise(module, &err);
        return -1;
    }
    return 0;
}

PyDoc_STRVAR(frustum_corners_doc, "frustum_corners(camera, near, far)\n--\n\n"
                                  "(8, 3) world corners: LBN LTN RTN RBN LBF LTF RTF RBF.");

static PyObject *frustum_corners(PyObject *module, PyObject *args, PyObject *kwargs) {
    csm_camera camera;
    double near_depth, far_depth, corners[CSM_CORNER_COUNT][3];
    if (parse_slice(module, args, kwargs, &camera, &near_depth, &far_depth) < 0) {
        return NULL;
    }
    csm_frustum_corners(&camera, near_depth, far_depth, corners);
    const npy_intp shape[2] = {CSM_CORNER_COUNT, 3};
    return new_array(2, shape, NPY_DOUBLE, corners);
}

PyDoc_STRVAR(frustum_planes_doc, "frustum_planes(camera, near, far)\n--\n\n"
                                 "(6, 4) world planes: left right bottom top near far, normals "
                                 "inwards.");

static PyObject *frustum_planes(PyObject *module, PyObject *args, PyObject *kwargs) {
    csm_camera camera;
    double near_depth, far_depth, planes[CSM_PLANE_COUNT][4];
    if (parse_slice(module, args, kwargs, &camera, &near_depth, &far_depth) < 0) {
        return NULL;
    }
    csm_frustum_planes(&camera, near_depth, far_depth, planes);
    const npy_intp shape[2] = {CSM_PLANE_COUNT, 4};
    return new_array(2, shape, NPY_DOUBLE, planes);
}

PyDoc_STRVAR(fit_sphere_doc, "fit_sphere(camera, near, far)\n--\n\n"
                             "(centre_depth, radius) [m] of a slice's smallest sphere.");

static PyObject *fit_sphere(PyObject *module, PyObject *args, PyObject *kwargs) {
    csm_camera camera;
    double near_depth, far_depth;
    csm_ball ball;
    if (parse_slice(module, args, kwargs, &camera, &near_depth, &far_depth) < 0) {
        return NULL;
    }
    csm_fit_sphere(&camera, near_depth, far_depth, &ball);
    return Py_BuildValue("dd", ball.centre[2], ball.radius);
}

PyDoc_STRVAR(fit_shifted_doc,
             "fit_shifted(camera, near, far)\n--\n\n"
             "(centre_depth, radius, whole_from, whole_until) [m]: the smallest sphere of a slice, "
             "shifted along the view as far as it keeps the near corners, and the view depths "
             "between which it holds the whole cross-section.");

static PyObject *fit_shifted(PyObject *module, PyObject *args, PyObject *kwargs) {
    csm_camera camera;
    double near_depth, far_depth;
    csm_ball ball;
    if (parse_slice(module, args, kwargs, &camera, &near_depth, &far_depth) < 0) {
        return NULL;
    }
    csm_fit_shifted(&camera, near_depth, far_depth, &ball);
    return Py_BuildValue("dddd", ball.centre[2], ball.radius, ball.whole[0], ball.whole[1]);
}

PyDoc_STRVAR(
    fit_spheres_doc,
    "fit_spheres(camera, splits, shifted)\n--\n\n"
    "(centres, radii, whole) of the spheres of all slices: (n, 3) right and up of the view "
    "axis and view depth, (n,), (n, 2) view depths between which each holds the whole "
    "cross-section [m]; splits (n + 1,) must ascend.");

static PyObject *fit_spheres(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", "splits", "shifted", NULL};
    PyObject *object, *splits_object;
    int shifted;
    csm_camera camera;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOp:fit_spheres", names, &object,
                                     &splits_object, &shifted) ||
        csm_py_checked_camera(module, object, &camera) < 0) {
        return NULL;
    }
    PyArrayObject *splits = csm_py_rows(splits_object, "splits", NPY_DOUBLE, 0);
    if (!splits) {
        return NULL;
    }
    const double *depths = PyArray_DATA(splits);
    const npy_intp count = PyArray_DIM(splits, 0) - 1;
    bool ascend = count >= 1 && count <= CSM_MAX_CASCADES && isfinite(depths[0]) &&
                  (camera.orthographic || depths[0] > 0.0);
    for (npy_intp i = 0; ascend && i < count; i++) {
        ascend = isfinite(depths[i + 1]) && depths[i + 1] > depths[i];
    }
    if (!ascend) {
        Py_DECREF(splits);
        return PyErr_Format(PyExc_ValueError,
                            "splits must be 2 to %d ascending view depths, > 0 for a perspective "
                            "camera (got %R)",
                            CSM_MAX_CASCADES + 1, splits_object);
    }
    csm_ball balls[CSM_MAX_CASCADES];
    if (shifted) {
        csm_fit_shifted_chain(&camera, depths, (int)count, balls);
    }
    double centres[CSM_MAX_CASCADES][3], radii[CSM_MAX_CASCADES], whole[CSM_MAX_CASCADES][2];
    for (npy_intp i = 0; i < count; i++) {
        if (!shifted) {
            csm_fit_sphere(&camera, depths[i], depths[i + 1], &balls[i]);
        }
        memcpy(centres[i], balls[i].centre, sizeof centres[i]);
        radii[i] = balls[i].radius;
        memcpy(whole[i], balls[i].whole, sizeof whole[i]);
    }
    Py_DECREF(splits);
    const npy_intp threes[2] = {count, 3}, ones[1] = {count}, pairs[2] = {count, 2};
    return Py_BuildValue("NNN", new_array(2, threes, NPY_DOUBLE, centres),
                         new_array(1, ones, NPY_DOUBLE, radii),
                         new_array(2, pairs, NPY_DOUBLE, whole));
}

PyDoc_STRVAR(fit_diameter_doc, "fit_diameter(camera, near, far)\n--\n\n"
                               "Largest distance [m] between two corners of a slice.");

static PyObject *fit_diameter(PyObject *module, PyObject *args, PyObject *kwargs) {
    csm_camera camera;
    double near_depth, far_depth;
    if (parse_slice(module, args, kwargs, &camera, &near_depth, &far_depth) < 0) {
        return NULL;
    }
    return PyFloat_FromDouble(csm_fit_diameter(&camera, near_depth, far_depth));
}

PyDoc_STRVAR(frustum_depth_of_box_doc,
             "frustum_depth_of_box(camera, bounds)\n--\n\n"
             "Largest view depth [m] of the camera's frustum inside a box, None if they do not "
             "meet; bounds (2, 3) or (6,): min, max.");

static PyObject *frustum_depth_of_box(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", "bounds", NULL};
    PyObject *object, *bounds_object;
    csm_camera camera;
    double bounds[6], depth;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO:frustum_depth_of_box", names, &object,
                                     &bounds_object) ||
        csm_py_checked_camera(module, object, &camera) < 0 ||
        csm_py_vector(bounds_object, "bounds", 6, bounds) < 0) {
        return NULL;
    }
    if (!csm_frustum_depth_of_box(&camera, bounds, &depth)) {
        Py_RETURN_NONE;
    }
    return PyFloat_FromDouble(depth);
}

PyDoc_STRVAR(snap_window_doc,
             "snap_window(centre, half_extent, map_size, padding_texels, snap)\n--\n\n"
             "(corner, texel_size, lattice) of a light window, each (2,).");

static PyObject *snap_window(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"centre", "half_extent", "map_size", "padding_texels", "snap", NULL};
    PyObject *centre, *half_extent;
    int map_size, padding_texels, snap;
    csm_window window;
    double corner[2], texel_size[2];
    int64_t lattice[2];
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOiii:snap_window", names, &centre,
                                     &half_extent, &map_size, &padding_texels, &snap) ||
        csm_py_vector(centre, "centre", 2, window.centre) < 0 ||
        csm_py_vector(half_extent, "half_extent", 2, window.half_extent) < 0) {
        return NULL;
    }
    csm_error err = {0};
    if (csm_snap_window(&window, map_size, padding_texels, snap, corner, texel_size, lattice,
                        &err) != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    const npy_intp shape[1] = {2};
    return Py_BuildValue("NNN", new_array(1, shape, NPY_DOUBLE, corner),
                         new_array(1, shape, NPY_DOUBLE, texel_size),
                         new_array(1, shape, NPY_INT64, lattice));
}

PyDoc_STRVAR(
    make_warp_doc,
    "make_warp(camera, to_light, near, far, warp, map_size, padding_texels)\n--\n\n"
    "dict of a slice's warp: light_from_world, origin, extent, strength, clip_from_local.");

static PyObject *make_warp(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", "to_light", "near",           "far",
                            "warp",   "map_size", "padding_texels", NULL};
    PyObject *object, *to_light_object;
    csm_camera camera;
    double near_depth, far_depth, to_light[3], basis[16], corners[CSM_CORNER_COUNT][3];
    int kind, map_size, padding_texels;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOddiii:make_warp", names, &object,
                                     &to_light_object, &near_depth, &far_depth, &kind, &map_size,
                                     &padding_texels) ||
        csm_py_checked_camera(module, object, &camera) < 0 ||
        csm_py_vector(to_light_object, "to_light", 3, to_light) < 0) {
        return NULL;
    }
    csm_warp warp;
    csm_error err = {0};
    memset(camera.eye, 0, sizeof camera.eye); /* points are relative to it */
    csm_frustum_corners(&camera, near_depth, far_depth, corners);
    if (csm_light_basis_orthonormal(to_light, basis, &err) != CSM_OK ||
        csm_warp_make(kind, &camera, basis, (const double(*)[3])corners, CSM_CORNER_COUNT, map_size,
                      padding_texels, &warp, &err) != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    const npy_intp pair[1] = {2};
    return Py_BuildValue("{s:N,s:N,s:N,s:d,s:N}", "light_from_world",
                         new_matrix(warp.light_from_world), "origin",
                         new_array(1, pair, NPY_DOUBLE, warp.origin), "extent",
                         new_array(1, pair, NPY_DOUBLE, warp.extent), "strength", warp.strength,
                         "clip_from_local", new_matrix(warp.clip_from_local));
}

PyDoc_STRVAR(snap_level_doc,
             "snap_level(ratio, spacing, count, hysteresis=0, held=None)\n--\n\n"
             "(size, level): the least level of approximate snapping of at least ratio, both as "
             "shares of the base window, or the held level.");

static PyObject *snap_level(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"ratio", "spacing", "count", "hysteresis", "held", NULL};
    double ratio;
    int spacing, count, hysteresis = 0, held_level, level;
    PyObject *held = Py_None;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "dii|iO:snap_level", names, &ratio, &spacing,
                                     &count, &hysteresis, &held) ||
        parse_step(held, &held_level) < 0) {
        return NULL;
    }
    const double size = csm_snap_level(ratio, spacing, count, hysteresis, held_level, &level);
    if (!isfinite(size)) {
        csm_error err = {0};
        csm_fail(&err, CSM_ERROR_INVALID_ARGUMENT, "ratio must be > 0 and finite (got %g)", ratio);
        return csm_py_raise(module, &err);
    }
    return Py_BuildValue("di", size, level);
}

PyDoc_STRVAR(sun_step_doc, "sun_step(to_light, step_deg)\n--\n\n"
                           "(3,) unit vector: the nearest direction of an even lattice.");

static PyObject *sun_step(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"to_light", "step_deg", NULL};
    PyObject *object;
    double to_light[3], step_deg;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "Od:sun_step", names, &object, &step_deg) ||
        csm_py_vector(object, "to_light", 3, to_light) < 0) {
        return NULL;
    }
    (void)module;
    csm_sun_step(step_deg, to_light);
    const npy_intp shape[1] = {3};
    return new_array(1, shape, NPY_DOUBLE, to_light);
}

/* The bytes that csm_py_new_cascades gave out. */
static int parse_hold(PyObject *held, csm_hold *out) {
    char *bytes;
    Py_ssize_t size;
    if (PyBytes_AsStringAndSize(held, &bytes, &size) < 0) {
        return -1;
    }
    if (size != (Py_ssize_t)sizeof *out) {
        PyErr_SetString(PyExc_ValueError, "held must be cascades of this version of csm");
        return -1;
    }
    memcpy(out, bytes, sizeof *out);
    return 0;
}

void csm_py_release_fit(csm_py_fit *fit) {
    Py_CLEAR(fit->points);
    Py_CLEAR(fit->boxes);
}

int csm_py_parse_fit(PyObject *camera, PyObject *to_light, PyObject *settings, PyObject *bounds,
                     PyObject *held, PyObject *receivers, PyObject *boxes, csm_py_fit *out) {
    memset(out, 0, sizeof *out);
    if (csm_py_parse_camera(camera, &out->desc.camera) < 0 ||
        csm_py_vector(to_light, "to_light", 3, out->desc.to_light) < 0 ||
        csm_py_parse_settings(settings, &out->settings) < 0) {
        return -1;
    }
    if (held != Py_None) {
        if (parse_hold(held, &out->held) < 0) {
            return -1;
        }
        out->desc.held = &out->held;
    }
    if (receivers != Py_None) {
        out->points = csm_py_rows(receivers, "receivers", NPY_DOUBLE, 3);
        if (!out->points) {
            return -1;
        }
        out->receivers.points = PyArray_DATA(out->points);
        out->receivers.point_count = (size_t)PyArray_DIM(out->points, 0);
        out->desc.receivers = &out->receivers;
    }
    if (boxes != Py_None) {
        out->boxes = csm_py_rows(boxes, "boxes", NPY_DOUBLE, 6);
        if (!out->boxes) {
            return -1;
        }
        out->desc.boxes = PyArray_DATA(out->boxes);
        out->desc.box_count = (size_t)PyArray_DIM(out->boxes, 0);
        out->desc.box_stride = 6 * sizeof(double);
    }
    out->desc.settings = &out->settings;
    if (bounds != Py_None) {
        if (csm_py_vector(bounds, "scene_bounds", 6, out->bounds) < 0) {
            return -1;
        }
        out->desc.scene_bounds = out->bounds;
    }
    return 0;
}

PyObject *csm_py_new_cascades(const csm_cascades *cascades) {
    const int n = cascades->count;
    const npy_intp edges[1] = {n + 1}, each[1] = {n}, pairs[2] = {n, 2};
    PyObject *range_step = cascades->range_step == INT_MIN ? Py_NewRef(Py_None)
                                                           : PyLong_FromLong(cascades->range_step);
    return Py_BuildValue("{s:N,s:N,s:N,s:N,s:N,s:N,s:N,s:N,s:N,s:N,s:N,s:y#}", "splits",
                         new_array(1, edges, NPY_DOUBLE, cascades->splits), "light_from_world",
                         new_matrices(cascades->light_from_world, n), "clip_from_light",
                         new_matrices(cascades->clip_from_light, n), "clip_from_world",
                         new_matrices(cascades->clip_from_world, n), "uvz_from_world",
                         new_matrices(cascades->uvz_from_world, n), "texel_size",
                         new_array(2, pairs, NPY_DOUBLE, cascades->texel_size), "lattice",
                         new_array(2, pairs, NPY_INT64, cascades->lattice), "depth_range",
                         new_array(2, pairs, NPY_DOUBLE, cascades->depth_range), "map_size",
                         new_array(1, each, NPY_INT, cascades->map_size), "range_step", range_step,
                         "pancake", PyBool_FromLong(cascades->pancake), "hold",
                         (const char *)&cascades->hold, (Py_ssize_t)sizeof cascades->hold);
}

PyDoc_STRVAR(fit_cascades_doc,
             "fit_cascades(camera, to_light, settings, scene_bounds=None, held=None, "
             "receivers=None, boxes=None)\n--\n\n"
             "dict of the arrays of csm.Cascades, range_step (None if the range was not "
             "rounded) and hold; scene_bounds (2, 3) or (6,): min, max; held: an earlier hold.");

static PyObject *fit_cascades(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera", "to_light",  "settings", "scene_bounds",
                            "held",   "receivers", "boxes",    NULL};
    PyObject *camera, *to_light, *settings, *bounds = Py_None, *held = Py_None;
    PyObject *receivers = Py_None, *boxes = Py_None;
    csm_py_fit arguments;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO|OOOO:fit_cascades", names, &camera,
                                     &to_light, &settings, &bounds, &held, &receivers, &boxes)) {
        return NULL;
    }
    csm_cascades cascades;
    csm_error err = {0};
    PyObject *out = NULL;
    if (csm_py_parse_fit(camera, to_light, settings, bounds, held, receivers, boxes, &arguments) ==
        0) {
        const csm_status status = csm_cascades_fit(&arguments.desc, &cascades, &err);
        out = status == CSM_OK ? csm_py_new_cascades(&cascades) : csm_py_raise(module, &err);
    }
    csm_py_release_fit(&arguments);
    return out;
}

/* Boxes (m, 6) as the items of a geometry; items are PyMem_Malloc'ed. */
static int parse_boxes(PyObject *object, const double bounds[6], csm_geometry *out) {
    PyArrayObject *boxes = csm_py_rows(object, "boxes", NPY_DOUBLE, 6);
    if (!boxes) {
        return -1;
    }
    out->item_count = (size_t)PyArray_DIM(boxes, 0);
    out->items = PyMem_Calloc(out->item_count + 1, sizeof *out->items);
    if (!out->items) {
        Py_DECREF(boxes);
        PyErr_NoMemory();
        return -1;
    }
    const double *values = PyArray_DATA(boxes);
    for (size_t i = 0; i < out->item_count; i++) {
        memcpy(out->items[i].bounds, values + 6 * i, sizeof out->items[i].bounds);
    }
    memcpy(out->bounds, bounds, sizeof out->bounds);
    Py_DECREF(boxes);
    return 0;
}

PyDoc_STRVAR(cull_boxes_doc,
             "cull_boxes(camera, to_light, settings, scene_bounds, boxes, cascade, "
             "margin_texels=0.0, whole_window=False, border_texels=None)\n--\n\n"
             "Indices of the boxes (m, 6) that a cascade must draw; cascade -1: that the camera "
             "sees. With border_texels also without those inside a finer cascade's window.");

static PyObject *cull_boxes(PyObject *module, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"camera",  "to_light",      "settings",     "scene_bounds",  "boxes",
                            "cascade", "margin_texels", "whole_window", "border_texels", NULL};
    PyObject *camera, *to_light, *settings, *bounds, *boxes, *border = Py_None;
    int cascade, whole_window = 0;
    double margin_texels = 0.0;
    csm_py_fit arguments;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOi|dpO:cull_boxes", names, &camera,
                                     &to_light, &settings, &bounds, &boxes, &cascade,
                                     &margin_texels, &whole_window, &border) ||
        csm_py_parse_fit(camera, to_light, settings, bounds, Py_None, Py_None, Py_None,
                         &arguments) < 0) {
        return NULL;
    }
    csm_cascades cascades;
    csm_error err = {0};
    if (csm_cascades_fit(&arguments.desc, &cascades, &err) != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    if (cascade < -1 || cascade >= cascades.count) {
        return PyErr_Format(PyExc_ValueError, "cascade must be -1 to %d (got %d)",
                            cascades.count - 1, cascade);
    }
    const double border_texels = border == Py_None ? 0.0 : PyFloat_AsDouble(border);
    if (PyErr_Occurred()) {
        return NULL;
    }
    csm_geometry geometry = {0};
    if (parse_boxes(boxes, arguments.bounds, &geometry) < 0) {
        return NULL;
    }
    uint32_t *kept = PyMem_Malloc((geometry.item_count + 1) * sizeof *kept);
    PyObject *out = NULL;
    if (!kept) {
        PyErr_NoMemory();
    } else {
        const csm_camera *view = &arguments.desc.camera;
        csm_settings canonical = arguments.settings;
        csm_settings_canonical(&canonical);
        const double band = csm_settings_band(&canonical);
        csm_cull_volume volume;
        if (cascade >= 0) {
            csm_cull_volume_make(&cascades, cascade, view, canonical.effects[CSM_EFFECT_SELECT],
                                 band, margin_texels, whole_window, &volume);
            if (border != Py_None) {
                csm_cull_volume_exclude(&cascades, cascade, border_texels, band, &volume);
            }
        }
        npy_intp count[1];
        Py_BEGIN_ALLOW_THREADS
        count[0] = (npy_intp)(cascade < 0 ? csm_cull_items_view(&geometry, view, kept)
                                          : csm_cull_items(&geometry, &volume, kept, NULL));
        Py_END_ALLOW_THREADS
        out = new_array(1, count, NPY_UINT32, kept);
    }
    PyMem_Free(kept);
    PyMem_Free(geometry.items);
    return out;
}

#define METHOD(name)                                                                               \
    { #name, (PyCFunction)(void (*)(void))name, METH_VARARGS | METH_KEYWORDS, name##_doc }

PyMethodDef csm_py_core_methods[] = {
    METHOD(split_distances),
    METHOD(range_round_up),
    METHOD(light_basis),
    METHOD(camera_matrices),
    METHOD(frustum_corners),
    METHOD(frustum_planes),
    METHOD(fit_sphere),
    METHOD(fit_shifted),
    METHOD(fit_spheres),
    METHOD(fit_diameter),
    METHOD(frustum_depth_of_box),
    METHOD(snap_window),
    METHOD(snap_level),
    METHOD(sun_step),
    METHOD(make_warp),
    METHOD(fit_cascades),
    METHOD(cull_boxes),
    {NULL, NULL, 0, NULL},
};
