/* arrays.c: Python objects to plain C values, checked by name; matrices in numpy's view of them. */
#include "py_common.h"

#include <math.h>
#include <string.h>

int csm_py_vector(PyObject *object, const char *name, int n, double *out) {
    PyArrayObject *array = csm_py_rows(object, name, NPY_DOUBLE, 0);
    if (!array) {
        return -1;
    }
    int status = -1;
    if (PyArray_DIM(array, 0) != n) {
        PyErr_Format(PyExc_ValueError, "%s: expected %d numbers, got %zd", name, n,
                     (Py_ssize_t)PyArray_DIM(array, 0));
    } else {
        memcpy(out, PyArray_DATA(array), (size_t)n * sizeof *out);
        status = 0;
        for (int i = 0; i < n; i++) {
            if (!isfinite(out[i])) {
                PyErr_Format(PyExc_ValueError, "%s must be finite (got %R)", name, object);
                status = -1;
                break;
            }
        }
    }
    Py_DECREF(array);
    return status;
}

/* Names of attributes as Python's own strings, made once: by those an attribute is found in a
 * third of the time, and settings have sixty. Names are literals, so that their address says which
 * it is; the table has room for several times as many as there are. */
PyObject *csm_py_name(const char *literal) {
    enum { ROOM = 1024 };
    static struct {
        const char *text;
        PyObject *name;
    } known[ROOM];
    const uintptr_t mixed = (uintptr_t)literal * 0x9E3779B1u;
    size_t at = (mixed >> 8) % ROOM;
    for (int tries = 0; tries < ROOM && known[at].text && known[at].text != literal; tries++) {
        at = (at + 1) % ROOM;
    }
    if (!known[at].text) {
        known[at].name = PyUnicode_InternFromString(literal);
        if (!known[at].name) {
            return NULL;
        }
        known[at].text = literal;
    }
    if (known[at].text != literal) {
        PyErr_Format(PyExc_SystemError, "no room for the name %s", literal);
        return NULL;
    }
    return known[at].name;
}

PyObject *csm_py_attribute(PyObject *object, const char *attribute) {
    PyObject *name = csm_py_name(attribute);
    return name ? PyObject_GetAttr(object, name) : NULL;
}

int csm_py_attribute_vector(PyObject *object, const char *attribute, int n, double *out) {
    PyObject *value = csm_py_attribute(object, attribute);
    int status = value ? csm_py_vector(value, attribute, n, out) : -1;
    Py_XDECREF(value);
    return status;
}

int csm_py_attribute_double(PyObject *object, const char *attribute, double *out) {
    PyObject *value = csm_py_attribute(object, attribute);
    if (!value) {
        return -1;
    }
    *out = PyFloat_AsDouble(value);
    Py_DECREF(value);
    return *out == -1.0 && PyErr_Occurred() ? -1 : 0;
}

int csm_py_int(PyObject *value, const char *name, int *out) {
    const long number = PyLong_AsLong(value);
    if (number == -1 && PyErr_Occurred()) {
        return -1;
    }
    if (number < INT_MIN || number > INT_MAX) {
        PyErr_Format(PyExc_ValueError, "%s must fit 32 bits (got %ld)", name, number);
        return -1;
    }
    *out = (int)number;
    return 0;
}

PyObject *csm_py_new_mat4_array(npy_intp count) {
    const npy_intp flat_shape[1] = {16 * count};
    npy_intp shape[3] = {count, 4, 4}, strides[3] = {128, 8, 32};
    PyObject *flat = PyArray_SimpleNew(1, flat_shape, NPY_DOUBLE);
    if (!flat) {
        return NULL;
    }
    PyObject *matrices =
        PyArray_New(&PyArray_Type, 3, shape, NPY_DOUBLE, strides,
                    PyArray_DATA((PyArrayObject *)flat), 0, NPY_ARRAY_WRITEABLE, NULL);
    if (!matrices) {
        Py_DECREF(flat);
        return NULL;
    }
    if (PyArray_SetBaseObject((PyArrayObject *)matrices, flat) < 0) { /* steals, also on failure */
        Py_DECREF(matrices);
        return NULL;
    }
    return matrices;
}

PyArrayObject *csm_py_rows(PyObject *object, const char *name, int type, int columns) {
    PyArray_Descr *descr = PyArray_DescrFromType(type);
    int dimensions = columns ? 2 : 1;
    PyArrayObject *array =
        (PyArrayObject *)PyArray_FromAny(object, descr, 0, 0, NPY_ARRAY_CARRAY_RO, NULL);
    if (!array) {
        return NULL;
    }
    if (!columns && PyArray_NDIM(array) != 1) { /* a (2, 3) box is as good as six numbers */
        PyArrayObject *flat = (PyArrayObject *)PyArray_Ravel(array, NPY_CORDER);
        Py_DECREF(array);
        return flat;
    }
    if (PyArray_NDIM(array) != dimensions || (columns && PyArray_DIM(array, 1) != columns)) {
        PyObject *shape = PyObject_GetAttrString((PyObject *)array, "shape");
        PyErr_Format(PyExc_ValueError, "%s: expected shape (n, %d), got %R", name, columns,
                     shape ? shape : Py_None);
        Py_XDECREF(shape);
        Py_DECREF(array);
        return NULL;
    }
    return array;
}

PyArrayObject *csm_py_shaped(PyObject *object, const char *name, int type, int dimensions,
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

PyArrayObject *csm_py_counted_rows(PyObject *object, const char *name, int type, int columns,
                                   npy_intp count) {
    return csm_py_shaped(object, name, type, columns ? 2 : 1, (npy_intp[]){count, columns});
}

int csm_py_take(PyObject *const *objects, const csm_py_rule *rules, int count, npy_intp *shape,
                PyArrayObject **arrays, const void **data) {
    for (int i = 0; i < count; i++) {
        if (objects[i]) {
            arrays[i] =
                csm_py_shaped(objects[i], rules[i].name, rules[i].type, rules[i].dimensions, shape);
            if (!arrays[i]) {
                return -1;
            }
            data[i] = PyArray_DATA(arrays[i]);
            shape[0] = PyArray_DIM(arrays[i], 0);
        }
    }
    return 0;
}

void csm_py_release_arrays(PyArrayObject **arrays, int count) {
    for (int i = 0; i < count; i++) {
        Py_CLEAR(arrays[i]);
    }
}

int csm_py_matrices(PyObject *object, const char *name, double **out, npy_intp *out_count) {
    PyArrayObject *array =
        (PyArrayObject *)PyArray_FROMANY(object, NPY_DOUBLE, 3, 3, NPY_ARRAY_CARRAY_RO);
    if (!array) {
        return -1;
    }
    if (PyArray_DIM(array, 1) != 4 || PyArray_DIM(array, 2) != 4) {
        PyErr_Format(PyExc_ValueError, "%s: expected shape (n, 4, 4)", name);
        Py_DECREF(array);
        return -1;
    }
    npy_intp count = PyArray_DIM(array, 0);
    double *matrices = PyMem_Malloc(((size_t)count + 1) * 16 * sizeof *matrices);
    if (!matrices) {
        Py_DECREF(array);
        PyErr_NoMemory();
        return -1;
    }
    const double *rows = PyArray_DATA(array);
    for (npy_intp i = 0; i < 16 * count; i++) { /* row-major in, column-major out */
        npy_intp place = i % 16;
        matrices[i - place + 4 * (place % 4) + place / 4] = rows[i];
    }
    Py_DECREF(array);
    *out = matrices;
    *out_count = count;
    return 0;
}

int csm_py_parse_camera(PyObject *camera, csm_camera *out) {
    double size[2];
    PyObject *orthographic = csm_py_attribute(camera, "orthographic");
    if (!orthographic) {
        return -1;
    }
    int truth = PyObject_IsTrue(orthographic);
    Py_DECREF(orthographic);
    memset(out, 0, sizeof *out);
    if (truth < 0 || csm_py_attribute_vector(camera, "eye", 3, out->eye) < 0 ||
        csm_py_attribute_vector(camera, "right", 3, out->right) < 0 ||
        csm_py_attribute_vector(camera, "up", 3, out->up) < 0 ||
        csm_py_attribute_vector(camera, "backward", 3, out->backward) < 0 ||
        csm_py_attribute_double(camera, "half_width", &out->half_width) < 0 ||
        csm_py_attribute_double(camera, "half_height", &out->half_height) < 0 ||
        csm_py_attribute_double(camera, "centre_x", &out->centre[0]) < 0 ||
        csm_py_attribute_double(camera, "centre_y", &out->centre[1]) < 0 ||
        csm_py_attribute_double(camera, "near", &out->near_depth) < 0 ||
        csm_py_attribute_double(camera, "far", &out->far_depth) < 0 ||
        csm_py_attribute_vector(camera, "size", 2, size) < 0) {
        return -1;
    }
    out->width = (int)size[0];
    out->height = (int)size[1];
    out->orthographic = truth;
    return 0;
}

int csm_py_checked_camera(PyObject *module, PyObject *camera, csm_camera *out) {
    csm_error err = {0};
    if (csm_py_parse_camera(camera, out) < 0) {
        return -1;
    }
    if (csm_camera_validate(out, &err) != CSM_OK) {
        csm_py_raise(module, &err);
        return -1;
    }
    return 0;
}
