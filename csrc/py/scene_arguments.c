/* scene_arguments.c: the arrays of a csm.Scene as core takes them, and where its parts lie.
 *
 * In: (meshes, instance_mesh, world_from_instance, origin), as Renderer.upload is called. Out: a
 * csm_scene_desc that points into arrays which are held until it is released.
 */
#include "py_common.h"

#include <string.h>

#define ARRAYS 4 /* of a mesh, at most */

void csm_py_release_scene(csm_py_scene *scene) {
    for (int i = 0; scene->arrays && i < ARRAYS * scene->desc.mesh_count; i++) {
        Py_XDECREF(scene->arrays[i]);
    }
    Py_XDECREF(scene->instance_mesh);
    PyMem_Free(scene->arrays);
    PyMem_Free(scene->views);
    PyMem_Free(scene->transforms);
}

static int parse_cutout(PyObject *uv, PyObject *cutout, PyArrayObject **arrays,
                        csm_mesh_view *view) {
    arrays[0] = csm_py_rows(uv, "uv", NPY_DOUBLE, 2);
    arrays[1] = arrays[0]
                    ? (PyArrayObject *)PyArray_FROMANY(cutout, NPY_BOOL, 2, 2, NPY_ARRAY_CARRAY_RO)
                    : NULL;
    if (!arrays[1]) {
        return -1;
    }
    if ((size_t)PyArray_DIM(arrays[0], 0) != view->vertex_count) {
        PyErr_SetString(PyExc_ValueError, "uv and positions must have the same length");
        return -1;
    }
    if (PyArray_DIM(arrays[1], 0) > CSM_MAX_CUTOUT || PyArray_DIM(arrays[1], 1) > CSM_MAX_CUTOUT) {
        PyErr_Format(PyExc_ValueError, "a cut-out may have %d x %d texels (got %zd x %zd)",
                     CSM_MAX_CUTOUT, CSM_MAX_CUTOUT, (Py_ssize_t)PyArray_DIM(arrays[1], 1),
                     (Py_ssize_t)PyArray_DIM(arrays[1], 0));
        return -1;
    }
    view->uv = PyArray_DATA(arrays[0]);
    view->cutout = PyArray_DATA(arrays[1]);
    view->cutout_height = (int)PyArray_DIM(arrays[1], 0);
    view->cutout_width = (int)PyArray_DIM(arrays[1], 1);
    return 0;
}

/* (positions, triangles), or with (uv, cutout) behind them. */
static int parse_mesh(PyObject *mesh, PyArrayObject **arrays, csm_mesh_view *view) {
    PyObject *positions, *triangles, *uv = NULL, *cutout = NULL;
    if (!PyArg_ParseTuple(mesh, "OO|OO", &positions, &triangles, &uv, &cutout)) {
        return -1;
    }
    arrays[0] = csm_py_rows(positions, "positions", NPY_DOUBLE, 3);
    arrays[1] = csm_py_rows(triangles, "triangles", NPY_INT32, 3);
    if (!arrays[0] || !arrays[1]) {
        return -1;
    }
    *view = (csm_mesh_view){.positions = PyArray_DATA(arrays[0]),
                            .vertex_count = (size_t)PyArray_DIM(arrays[0], 0),
                            .triangles = PyArray_DATA(arrays[1]),
                            .triangle_count = (size_t)PyArray_DIM(arrays[1], 0)};
    return cutout ? parse_cutout(uv, cutout, arrays + 2, view) : 0;
}

static int parse_meshes(PyObject *meshes, csm_py_scene *scene) {
    Py_ssize_t count = PyTuple_GET_SIZE(meshes);
    scene->views = PyMem_Calloc((size_t)count + 1, sizeof *scene->views);
    scene->arrays = PyMem_Calloc(ARRAYS * (size_t)count + 1, sizeof(PyArrayObject *));
    if (!scene->views || !scene->arrays) {
        PyErr_NoMemory();
        return -1;
    }
    scene->desc.mesh_count = (int)count;
    for (Py_ssize_t i = 0; i < count; i++) {
        if (parse_mesh(PyTuple_GET_ITEM(meshes, i), scene->arrays + ARRAYS * i, &scene->views[i]) <
            0) {
            return -1;
        }
    }
    scene->desc.meshes = scene->views;
    return 0;
}

int csm_py_parse_scene(PyObject *args, const char *format, csm_py_scene *scene) {
    PyObject *meshes, *instance_mesh, *transforms, *origin;
    npy_intp count;
    memset(scene, 0, sizeof *scene);
    if (!PyArg_ParseTuple(args, format, &PyTuple_Type, &meshes, &instance_mesh, &transforms,
                          &origin) ||
        parse_meshes(meshes, scene) < 0 ||
        csm_py_vector(origin, "origin", 3, scene->desc.origin) < 0 ||
        csm_py_matrices(transforms, "world_from_instance", &scene->transforms, &count) < 0) {
        return -1;
    }
    scene->instance_mesh = csm_py_rows(instance_mesh, "instance_mesh", NPY_INT32, 0);
    if (!scene->instance_mesh) {
        return -1;
    }
    if (PyArray_DIM(scene->instance_mesh, 0) != count) {
        PyErr_SetString(PyExc_ValueError,
                        "instance_mesh and world_from_instance must have the same length");
        return -1;
    }
    scene->desc.instance_mesh = PyArray_DATA(scene->instance_mesh);
    scene->desc.world_from_instance = scene->transforms;
    scene->desc.instance_count = (int)count;
    return 0;
}

PyDoc_STRVAR(scene_boxes_doc,
             "scene_boxes(meshes, instance_mesh, world_from_instance, origin, /)\n--\n\n"
             "(m, 6) world boxes of a scene's chunks, one per chunk and instance: min, max [m]. "
             "Arguments as Renderer.upload takes them.");

static PyObject *scene_boxes(PyObject *module, PyObject *args) {
    csm_py_scene scene;
    csm_geometry geometry = {0};
    csm_error err = {0};
    PyObject *out = NULL;
    if (csm_py_parse_scene(args, "O!OOO:scene_boxes", &scene) == 0) {
        csm_status status;
        Py_BEGIN_ALLOW_THREADS
        status = csm_geometry_boxes(&scene.desc, &geometry, &err);
        Py_END_ALLOW_THREADS
        const npy_intp shape[2] = {(npy_intp)geometry.item_count, 6};
        out =
            status == CSM_OK ? PyArray_SimpleNew(2, shape, NPY_DOUBLE) : csm_py_raise(module, &err);
        for (size_t i = 0; out && i < geometry.item_count; i++) {
            double *row = (double *)PyArray_DATA((PyArrayObject *)out) + 6 * i;
            memcpy(row, geometry.items[i].bounds, sizeof geometry.items[i].bounds);
        }
        csm_geometry_destroy(&geometry);
    }
    csm_py_release_scene(&scene);
    return out;
}

PyMethodDef csm_py_scene_methods[] = {
    {"scene_boxes", scene_boxes, METH_VARARGS, scene_boxes_doc},
    {NULL, NULL, 0, NULL},
};
