/* scene_arguments.c: the arrays of a csm.Scene as core takes them, and where its parts lie.
 *
 * In: (meshes, instance_mesh, world_from_instance, origin), as Renderer.upload is called. Out: a
 * csm_scene_desc that points into arrays which are held until it is released.
 */
#include "py_common.h"

#include <string.h>

void csm_py_release_scene(csm_py_scene *scene) {
    for (int i = 0; scene->arrays && i < 2 * scene->desc.mesh_count; i++) {
        Py_XDECREF(scene->arrays[i]);
    }
    Py_XDECREF(scene->instance_mesh);
    PyMem_Free(scene->arrays);
    PyMem_Free(scene->views);
    PyMem_Free(scene->transforms);
}

static int parse_meshes(PyObject *meshes, csm_py_scene *scene) {
    Py_ssize_t count = PyTuple_GET_SIZE(meshes);
    scene->views = PyMem_Calloc((size_t)count + 1, sizeof *scene->views);
    scene->arrays = PyMem_Calloc(2 * (size_t)count + 1, sizeof(PyArrayObject *));
    if (!scene->views || !scene->arrays) {
        PyErr_NoMemory();
        return -1;
    }
    scene->desc.mesh_count = (int)count;
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *positions, *triangles;
        if (!PyArg_ParseTuple(PyTuple_GET_ITEM(meshes, i), "OO", &positions, &triangles)) {
            return -1;
        }
        scene->arrays[2 * i] = csm_py_rows(positions, "positions", NPY_DOUBLE, 3);
        scene->arrays[2 * i + 1] = csm_py_rows(triangles, "triangles", NPY_INT32, 3);
        if (!scene->arrays[2 * i] || !scene->arrays[2 * i + 1]) {
            return -1;
        }
        scene->views[i] = (csm_mesh_view){PyArray_DATA(scene->arrays[2 * i]),
                                          (size_t)PyArray_DIM(scene->arrays[2 * i], 0),
                                          PyArray_DATA(scene->arrays[2 * i + 1]),
                                          (size_t)PyArray_DIM(scene->arrays[2 * i + 1], 0)};
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
