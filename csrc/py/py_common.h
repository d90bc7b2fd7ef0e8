/* py_common.h: what the files of csrc/py share. The only folder that sees Python and numpy. */
#ifndef CSM_PY_COMMON_H
#define CSM_PY_COMMON_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define NPY_NO_DEPRECATED_API NPY_1_23_API_VERSION
#define PY_ARRAY_UNIQUE_SYMBOL csm_ARRAY_API
#ifndef CSM_PY_IMPORTS_ARRAY
#    define NO_IMPORT_ARRAY
#endif
#include <numpy/arrayobject.h>

#include "csm.h"

enum {
    CSM_PY_CSM_ERROR,
    CSM_PY_CONTEXT_ERROR,
    CSM_PY_SHADER_ERROR,
    CSM_PY_LIMIT_ERROR,
    CSM_PY_GL_ERROR,
    CSM_PY_GL_WARNING,
    CSM_PY_EXCEPTION_COUNT
};

typedef struct csm_module_state {
    PyObject *exceptions[CSM_PY_EXCEPTION_COUNT];
    PyTypeObject *renderer_type;
} csm_module_state;

/* errors.c: the only place that maps a status to an exception. Always returns NULL. */
PyObject *csm_py_raise(PyObject *module, const csm_error *err);

/* Text of a driver or of an error as a string: bytes that are no UTF-8 (a character cut at the end
 * of a buffer) are replaced, never an error of their own. */
PyObject *csm_py_text(const char *text);
int csm_py_add_exceptions(PyObject *module);

/* arrays.c */

/* n finite doubles of any sequence or array; name appears in the error. 0, or -1 with an exception.
 */
int csm_py_vector(PyObject *object, const char *name, int n, double *out);

/* A literal as Python's own string, made once; borrowed, NULL with an exception. */
PyObject *csm_py_name(const char *literal);

/* An int; name appears in the error. 0, or -1 with an exception. */
int csm_py_int(PyObject *value, const char *name, int *out);

/* An attribute, by a literal; as a vector, as a double. */
PyObject *csm_py_attribute(PyObject *object, const char *attribute);
int csm_py_attribute_vector(PyObject *object, const char *attribute, int n, double *out);
int csm_py_attribute_double(PyObject *object, const char *attribute, double *out);

/* A new (count, 4, 4) float64 array over column-major memory: M[i, row, col], strides (128, 8, 32).
 */
PyObject *csm_py_new_mat4_array(npy_intp count);

/* An aligned, C-contiguous array of the type and of shape (?, columns), or (?,) for columns 0; a
 * new reference, or NULL with an exception that names the argument. */
PyArrayObject *csm_py_rows(PyObject *object, const char *name, int type, int columns);

/* The same of exactly this shape, in which a side of -1 may have any length. */
PyArrayObject *csm_py_shaped(PyObject *object, const char *name, int type, int dimensions,
                             const npy_intp *shape);

/* The same, of `count` rows. */
PyArrayObject *csm_py_counted_rows(PyObject *object, const char *name, int type, int columns,
                                   npy_intp count);

/* What an argument must be: its name, and csm_py_shaped's type and dimensions. */
typedef struct csm_py_rule {
    const char *name;
    int type, dimensions;
} csm_py_rule;

/* Several by their rules, into arrays and the addresses of what they hold; an object that is NULL
 * is left out. A first side of -1 becomes that of the first one, which the others must have. */
int csm_py_take(PyObject *const *objects, const csm_py_rule *rules, int count, npy_intp *shape,
                PyArrayObject **arrays, const void **data);

/* Lets go of arrays, of which some may be NULL. */
void csm_py_release_arrays(PyArrayObject **arrays, int count);

/* (?, 4, 4) float64 of any strides to column-major memory, from PyMem_Malloc; *out_count matrices.
 */
int csm_py_matrices(PyObject *object, const char *name, double **out, npy_intp *out_count);

/* csm.Camera and csm.ShadowSettings, read by attribute. */
int csm_py_parse_camera(PyObject *camera, csm_camera *out);
int csm_py_parse_settings(PyObject *settings, csm_settings *out);

/* A camera that is valid, too. */
int csm_py_checked_camera(PyObject *module, PyObject *camera, csm_camera *out);

/* core_functions.c */

/* What a fit reads; desc points into the same struct and the arrays that it holds. */
typedef struct csm_py_fit {
    csm_settings settings;
    double bounds[6];
    csm_hold held;
    csm_receivers receivers;
    PyArrayObject *points, *boxes;
    csm_cascades_desc desc;
} csm_py_fit;

/* bounds, held (the hold of an earlier csm.Cascades), receivers (m, 3), boxes (m, 6): each may be
 * None. Release what came of it, also after a failure. */
int csm_py_parse_fit(PyObject *camera, PyObject *to_light, PyObject *settings, PyObject *bounds,
                     PyObject *held, PyObject *receivers, PyObject *boxes, csm_py_fit *out);
void csm_py_release_fit(csm_py_fit *fit);
PyObject *
csm_py_new_cascades(const csm_cascades *cascades); /* dict of the arrays of csm.Cascades */
extern PyMethodDef csm_py_core_methods[];

/* coverage_functions.c */
extern PyMethodDef csm_py_coverage_methods[];

/* coarse_functions.c */
extern PyMethodDef csm_py_coarse_methods[];

/* coarse_map_functions.c */
extern PyMethodDef csm_py_coarse_map_methods[];

/* coarse_look_functions.c */
extern PyMethodDef csm_py_coarse_look_methods[];

/* coarse_number_functions.c */
extern PyMethodDef csm_py_coarse_number_methods[];

/* caster_functions.c */

/* 1 to CSM_MAX_CASCADES windows, from PyMem_Malloc; 0, or -1 with an exception. */
int csm_py_windows(PyObject *object, double **out, npy_intp *count);
extern PyMethodDef csm_py_caster_methods[];

/* arrange_functions.c */
extern PyMethodDef csm_py_arrange_methods[];

/* forecast_sum_functions.c */
extern PyMethodDef csm_py_forecast_sum_methods[];

/* scene_arguments.c */

/* A scene's arrays; desc points into what the rest holds. */
typedef struct csm_py_scene {
    csm_scene_desc desc;
    csm_mesh_view *views;
    PyArrayObject **arrays; /* four per mesh, some NULL, held while C reads them */
    PyArrayObject *instance_mesh;
    double *transforms;
} csm_py_scene;

/* format: "O!OOO:name" of (meshes, instance_mesh, world_from_instance, origin). Release what came
 * of it, also after a failure. */
int csm_py_parse_scene(PyObject *args, const char *format, csm_py_scene *scene);
void csm_py_release_scene(csm_py_scene *scene);
extern PyMethodDef csm_py_scene_methods[];

/* settings_functions.c */
extern PyMethodDef csm_py_settings_methods[];

/* renderer_type.c */
int csm_py_add_renderer_type(PyObject *module);

#endif
