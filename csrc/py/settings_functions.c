/* settings_functions.c: settings, effects and plans, for Python. */
#include "py_common.h"

#include <string.h>

/* Number of a choice in a row's list, -1 with an exception if it is none of them. */
static int choice_number(const csm_effect_info *row, PyObject *value) {
    Py_ssize_t wanted = 0;
    const char *choice = PyUnicode_Check(value) ? PyUnicode_AsUTF8AndSize(value, &wanted) : NULL;
    int number = 0;
    for (const char *at = row->choices; choice && *at; number++) {
        Py_ssize_t length = 0;
        bool same = true;
        for (; at[length] && at[length] != ' '; length++) {
            same = same && length < wanted && at[length] == choice[length];
        }
        if (same && length == wanted) {
            return number;
        }
        at += length + (at[length] == ' ');
    }
    if (!PyErr_Occurred()) {
        PyErr_Format(PyExc_ValueError, "%s must be one of: %s (got %R)", row->name, row->choices,
                     value);
    }
    return -1;
}

/* A field of settings by a literal. Theirs lie in the dict of the instance, whose lookup is the
 * better part of an attribute's; `own` is NULL for what has none. */
static PyObject *field(PyObject *settings, PyObject *own, const char *name) {
    PyObject *key = own ? csm_py_name(name) : NULL;
    PyObject *value = key ? PyDict_GetItemWithError(own, key) : NULL;
    if (value) {
        return Py_NewRef(value);
    }
    return PyErr_Occurred() ? NULL : csm_py_attribute(settings, name);
}

static int parse_effect(PyObject *settings, PyObject *own, const csm_effect_info *row, int *out) {
    PyObject *value = field(settings, own, row->name);
    if (!value) {
        return -1;
    }
    int status;
    if (row->type == CSM_TYPE_INT) {
        status = csm_py_int(value, row->name, out);
    } else {
        *out = row->type == CSM_TYPE_ENUM ? choice_number(row, value) : PyObject_IsTrue(value);
        status = *out < 0 ? -1 : 0;
    }
    Py_DECREF(value);
    return status;
}

/* map_size is one number for all cascades or a sequence of one per cascade. */
static int parse_map_size(PyObject *settings, PyObject *own, int count, int *out) {
    PyObject *value = field(settings, own, "map_size");
    if (!value) {
        return -1;
    }
    int status = 0;
    if (PyLong_Check(value)) {
        status = csm_py_int(value, "map_size", &out[0]);
        for (int i = 1; i < CSM_MAX_CASCADES; i++) {
            out[i] = out[0];
        }
    } else {
        double sizes[CSM_MAX_CASCADES];
        count = count < 1 ? 1 : count > CSM_MAX_CASCADES ? CSM_MAX_CASCADES : count;
        status = csm_py_vector(value, "map_size", count, sizes);
        for (int i = 0; i < count && status == 0; i++) {
            out[i] = (int)sizes[i];
        }
    }
    Py_DECREF(value);
    return status;
}

static int parse_manual_splits(PyObject *settings, int count, double *out) {
    PyObject *value = csm_py_attribute(settings, "manual_splits");
    if (!value) {
        return -1;
    }
    int status = 0;
    Py_ssize_t given = PySequence_Size(value);
    if (given < 0) {
        status = -1;
    } else if (given != count - 1) {
        PyErr_Format(PyExc_ValueError,
                     "manual_splits must be the %d inner distances of %d cascades (got %zd)",
                     count - 1, count, given);
        status = -1;
    } else if (given > 0) {
        status = csm_py_vector(value, "manual_splits", count - 1, out);
    }
    Py_DECREF(value);
    return status;
}

static int parse_number(PyObject *settings, PyObject *own, const char *name, double *out) {
    PyObject *value = field(settings, own, name);
    if (!value) {
        return -1;
    }
    *out = PyFloat_AsDouble(value);
    Py_DECREF(value);
    return *out == -1.0 && PyErr_Occurred() ? -1 : 0;
}

static int parse_fields(PyObject *settings, PyObject *own, csm_settings *out) {
    for (int i = 0; i < CSM_EFFECT_COUNT; i++) {
        const csm_effect_info *row = csm_effect_describe(i);
        if (row->name[0] && parse_effect(settings, own, row, &out->effects[i]) < 0) {
            return -1;
        }
    }
    const int count = out->effects[CSM_EFFECT_CASCADE_COUNT];
    if (parse_map_size(settings, own, count, out->map_size) < 0) {
        return -1;
    }
    const csm_number_info *number;
    for (int i = 0; (number = csm_number_describe(i)); i++) {
        double *value = (double *)((char *)out + number->offset);
        if (parse_number(settings, own, number->name, value) < 0) {
            return -1;
        }
    }
    if (out->effects[CSM_EFFECT_DEPTH_RANGE] == CSM_DEPTH_RANGE_MANUAL &&
        csm_py_attribute_vector(settings, "manual_depth_range", 2, out->manual_depth_range) < 0) {
        return -1;
    }
    const int split = out->effects[CSM_EFFECT_SPLIT];
    bool manual = split == CSM_SPLIT_MANUAL || split == CSM_SPLIT_PERCENTAGES;
    if (manual && count >= 1 && count <= CSM_MAX_CASCADES) {
        return parse_manual_splits(settings, count, out->manual_splits);
    }
    return 0;
}

int csm_py_parse_settings(PyObject *settings, csm_settings *out) {
    memset(out, 0, sizeof *out);
    PyObject *own = PyObject_GenericGetDict(settings, NULL);
    if (!own) {
        PyErr_Clear(); /* then its attributes are asked for */
    }
    const int status = parse_fields(settings, own, out);
    Py_XDECREF(own);
    return status;
}

static int parse_valid(PyObject *module, PyObject *object, csm_settings *out) {
    csm_error err = {0};
    if (csm_py_parse_settings(object, out) < 0) {
        return -1;
    }
    if (csm_settings_validate(out, &err) != CSM_OK) {
        csm_py_raise(module, &err);
        return -1;
    }
    return 0;
}

PyDoc_STRVAR(validate_settings_doc, "validate_settings(settings)\n--\n\n"
                                    "ValueError with every problem, one per line.");

static PyObject *validate_settings(PyObject *module, PyObject *object) {
    csm_settings settings;
    if (parse_valid(module, object, &settings) < 0) {
        return NULL;
    }
    Py_RETURN_NONE;
}

static PyObject *choice_text(const csm_effect_info *row, int value) {
    const char *at = row->choices;
    for (; value > 0; value--) {
        at += strcspn(at, " ") + 1;
    }
    return PyUnicode_FromStringAndSize(at, (Py_ssize_t)strcspn(at, " "));
}

static PyObject *effect_value(const csm_effect_info *row, int value) {
    switch (row->type) {
    case CSM_TYPE_ENUM:
        return choice_text(row, value);
    case CSM_TYPE_BOOL:
        return PyBool_FromLong(value);
    default:
        return PyLong_FromLong(value);
    }
}

static PyObject *floats(const double *values, int count) {
    PyObject *tuple = PyTuple_New(count);
    for (int i = 0; i < count && tuple; i++) {
        PyObject *value = PyFloat_FromDouble(values[i]);
        if (!value) {
            Py_CLEAR(tuple);
        } else {
            PyTuple_SET_ITEM(tuple, i, value);
        }
    }
    return tuple;
}

static int set_item(PyObject *dict, const char *name, PyObject *value) {
    PyObject *key = csm_py_name(name);
    int status = key && value ? PyDict_SetItem(dict, key, value) : -1;
    Py_XDECREF(value);
    return status;
}

PyDoc_STRVAR(canonical_settings_doc,
             "canonical_settings(settings)\n--\n\n"
             "dict of the settings that matter, meaningless ones at their defaults.");

static PyObject *canonical_settings(PyObject *module, PyObject *object) {
    csm_settings settings;
    PyObject *dict = NULL;
    if (parse_valid(module, object, &settings) < 0 || !(dict = PyDict_New())) {
        return NULL;
    }
    csm_settings_canonical(&settings);
    int count = settings.effects[CSM_EFFECT_CASCADE_COUNT];
    const int split = settings.effects[CSM_EFFECT_SPLIT];
    bool manual = split == CSM_SPLIT_MANUAL || split == CSM_SPLIT_PERCENTAGES;
    bool ranged = settings.effects[CSM_EFFECT_DEPTH_RANGE] == CSM_DEPTH_RANGE_MANUAL;
    double sizes[CSM_MAX_CASCADES];
    for (int i = 0; i < CSM_EFFECT_COUNT; i++) {
        const csm_effect_info *row = csm_effect_describe(i);
        if (row->name[0] && set_item(dict, row->name, effect_value(row, settings.effects[i])) < 0) {
            goto fail;
        }
    }
    for (int i = 0; i < count; i++) {
        sizes[i] = settings.map_size[i];
    }
    if (set_item(dict, "map_size", floats(sizes, count)) < 0 ||
        set_item(dict, "manual_splits", floats(settings.manual_splits, manual ? count - 1 : 0)) <
            0 ||
        set_item(dict, "manual_depth_range", floats(settings.manual_depth_range, ranged ? 2 : 0)) <
            0) {
        goto fail;
    }
    const csm_number_info *number;
    for (int i = 0; (number = csm_number_describe(i)); i++) {
        const double value = *(const double *)((const char *)&settings + number->offset);
        if (set_item(dict, number->name, PyFloat_FromDouble(value)) < 0) {
            goto fail;
        }
    }
    return dict;
fail:
    Py_DECREF(dict);
    return NULL;
}

PyDoc_STRVAR(settings_draw_alike_doc,
             "settings_draw_alike(one, other)\n--\n\n"
             "Whether settings are equal, meaningless ones at their defaults.");

static PyObject *settings_draw_alike(PyObject *module, PyObject *args) {
    PyObject *objects[2];
    csm_settings settings[2];
    if (!PyArg_ParseTuple(args, "OO:settings_draw_alike", &objects[0], &objects[1])) {
        return NULL;
    }
    for (int i = 0; i < 2; i++) {
        if (parse_valid(module, objects[i], &settings[i]) < 0) {
            return NULL;
        }
        csm_settings_canonical(&settings[i]);
    }
    return PyBool_FromLong(csm_settings_equal(&settings[0], &settings[1]));
}

PyDoc_STRVAR(effect_table_doc, "effect_table()\n--\n\n"
                               "Rows of the effect table as dicts, in order.");

static PyObject *effect_table(PyObject *module, PyObject *unused) {
    (void)module;
    (void)unused;
    static const char *const types[] = {"bool", "int", "enum"};
    PyObject *list = PyList_New(0);
    for (int i = 0; i < CSM_EFFECT_COUNT && list; i++) {
        const csm_effect_info *row = csm_effect_describe(i);
        PyObject *item = Py_BuildValue(
            "{s:s,s:s,s:s,s:N,s:i,s:i,s:I,s:s,s:s}", "id", row->id, "name", row->name, "type",
            types[row->type], "default", effect_value(row, row->default_value), "min", row->min,
            "max", row->max, "passes", row->passes, "choices", row->choices, "help", row->help);
        if (!item || PyList_Append(list, item) < 0) {
            Py_CLEAR(list);
        }
        Py_XDECREF(item);
    }
    return list;
}

PyDoc_STRVAR(number_table_doc, "number_table()\n--\n\n"
                               "Rows of the table of numbers as dicts, in order.");

static PyObject *number_table(PyObject *module, PyObject *unused) {
    (void)module;
    (void)unused;
    PyObject *list = PyList_New(0);
    const csm_number_info *row;
    for (int i = 0; list && (row = csm_number_describe(i)); i++) {
        PyObject *item =
            Py_BuildValue("{s:s,s:d,s:d,s:d,s:s}", "name", row->name, "default", row->default_value,
                          "min", row->min, "max", row->max, "help", row->help);
        if (!item || PyList_Append(list, item) < 0) {
            Py_CLEAR(list);
        }
        Py_XDECREF(item);
    }
    return list;
}

PyDoc_STRVAR(moment_numbers_doc, "moment_numbers(settings)\n--\n\n"
                                 "Numbers of a texel that a prefiltered filter looks up; 0: none.");

static PyObject *moment_numbers(PyObject *module, PyObject *object) {
    csm_settings settings;
    if (parse_valid(module, object, &settings) < 0) {
        return NULL;
    }
    csm_settings_canonical(&settings);
    const csm_moments moments = csm_settings_moments(&settings);
    return PyLong_FromLong(moments.channels * moments.slices);
}

PyDoc_STRVAR(bias_terms_doc, "bias_terms(settings)\n--\n\n"
                             "Effective bias (receiver_plane, constant_texels, slope_texels, "
                             "normal_offset_texels, depth share, roundings).");

static PyObject *bias_terms(PyObject *module, PyObject *object) {
    csm_settings settings;
    if (parse_valid(module, object, &settings) < 0) {
        return NULL;
    }
    csm_settings_canonical(&settings);
    csm_bias bias = csm_settings_bias(&settings);
    double quantum = csm_depth_quantum(settings.effects[CSM_EFFECT_DEPTH_FORMAT]);
    return Py_BuildValue("Nddddd", PyBool_FromLong(bias.receiver_plane), bias.constant_texels,
                         bias.slope_texels, bias.normal_offset_texels, bias.quanta * quantum,
                         bias.roundings);
}

static PyObject *new_bias(const csm_bias_metres *bias) {
    return Py_BuildValue("{s:s,s:N,s:d,s:d,s:d,s:d,s:d,s:d,s:d}", "side",
                         bias->on_casters ? "caster" : "receiver", "receiver_plane",
                         PyBool_FromLong(bias->receiver_plane), "texel_m", bias->texel, "quantum_m",
                         bias->quantum, "constant_m", bias->constant, "slope_m", bias->slope,
                         "normal_offset_m", bias->normal_offset, "needed_constant_m",
                         bias->needed_constant, "needed_slope_m", bias->needed_slope);
}

PyDoc_STRVAR(bias_metres_doc, "bias_metres(settings, clip_from_light, map_size, depth_range)\n"
                              "--\n\n"
                              "A dict of lengths for each cascade.");

static PyObject *bias_metres(PyObject *module, PyObject *args) {
    PyObject *object, *matrices, *sizes, *ranges, *list = NULL;
    csm_settings settings;
    double *clip_from_light;
    npy_intp count;
    if (!PyArg_ParseTuple(args, "OOOO:bias_metres", &object, &matrices, &sizes, &ranges) ||
        parse_valid(module, object, &settings) < 0 ||
        csm_py_matrices(matrices, "clip_from_light", &clip_from_light, &count) < 0) {
        return NULL;
    }
    csm_settings_canonical(&settings);
    PyArrayObject *range_rows = csm_py_rows(ranges, "depth_range", NPY_DOUBLE, 2);
    PyArrayObject *size_rows = csm_py_rows(sizes, "map_size", NPY_INT, 0);
    if (range_rows && size_rows) {
        if (PyArray_DIM(range_rows, 0) == count && PyArray_DIM(size_rows, 0) == count) {
            list = PyList_New(0);
        } else {
            PyErr_SetString(PyExc_ValueError, "map_size and depth_range must be as many as maps");
        }
    }
    for (npy_intp i = 0; i < count && list; i++) {
        const csm_bias_metres bias = csm_bias_in_metres(
            &settings, clip_from_light + 16 * i, ((const int *)PyArray_DATA(size_rows))[i],
            (const double *)PyArray_DATA(range_rows) + 2 * i);
        PyObject *item = new_bias(&bias);
        if (!item || PyList_Append(list, item) < 0) {
            Py_CLEAR(list);
        }
        Py_XDECREF(item);
    }
    Py_XDECREF(range_rows);
    Py_XDECREF(size_rows);
    PyMem_Free(clip_from_light);
    return list;
}

static PyObject *plan_lists(const csm_plan *plan) {
    PyObject *steps = PyList_New(0), *textures = PyList_New(0), *programs = PyList_New(0);
    bool complete = steps && textures && programs;
    for (int i = 0; i < plan->step_count && complete; i++) {
        const csm_plan_step *step = &plan->steps[i];
        PyObject *item = Py_BuildValue("(siK)", csm_pass_name(step->pass), step->cascade,
                                       (unsigned long long)step->program_key);
        complete = item && PyList_Append(steps, item) == 0;
        Py_XDECREF(item);
    }
    for (int i = 0; i < plan->texture_count && complete; i++) {
        const csm_plan_texture *texture = &plan->textures[i];
        PyObject *item = Py_BuildValue("(ssiiiiiK)", texture->name, texture->format, texture->width,
                                       texture->height, texture->layers, texture->samples,
                                       texture->levels, (unsigned long long)texture->bytes);
        complete = item && PyList_Append(textures, item) == 0;
        Py_XDECREF(item);
    }
    for (int i = 0; i < plan->program_count && complete; i++) {
        PyObject *item = Py_BuildValue("(sK)", csm_pass_name(plan->program_passes[i]),
                                       (unsigned long long)plan->program_keys[i]);
        complete = item && PyList_Append(programs, item) == 0;
        Py_XDECREF(item);
    }
    if (!complete) {
        Py_XDECREF(steps);
        Py_XDECREF(textures);
        Py_XDECREF(programs);
        return NULL;
    }
    return Py_BuildValue("(NNNK)", steps, textures, programs, (unsigned long long)plan->bytes);
}

PyDoc_STRVAR(plan_doc, "plan(settings, width, height, outputs, instanced=False, "
                       "alpha_tested=False)\n--\n\n"
                       "(steps, textures, programs, bytes) of a frame; outputs is a bit set.");

static PyObject *plan(PyObject *module, PyObject *args) {
    PyObject *object;
    int width, height, instanced = 0, alpha_tested = 0;
    unsigned outputs;
    csm_settings settings;
    csm_plan made;
    csm_error err = {0};
    if (!PyArg_ParseTuple(args, "OiiI|pp:plan", &object, &width, &height, &outputs, &instanced,
                          &alpha_tested) ||
        parse_valid(module, object, &settings) < 0) {
        return NULL;
    }
    settings.effects[CSM_EFFECT_INSTANCES] = instanced;
    settings.effects[CSM_EFFECT_ALPHA_TEST] = alpha_tested;
    if (csm_plan_make(&settings, width, height, outputs, &made, &err) != CSM_OK) {
        return csm_py_raise(module, &err);
    }
    return plan_lists(&made);
}

PyDoc_STRVAR(storage_places_doc,
             "storage_places(settings)\n--\n\n"
             "(places, size): (x, y, size, layer) of each map in a texture of (width, height).");

static PyObject *storage_places(PyObject *module, PyObject *object) {
    csm_settings settings;
    csm_place places[CSM_MAX_CASCADES];
    int size[2];
    if (parse_valid(module, object, &settings) < 0) {
        return NULL;
    }
    csm_settings_canonical(&settings);
    csm_storage_places(&settings, places, size);
    const int count = settings.effects[CSM_EFFECT_CASCADE_COUNT];
    PyObject *list = PyList_New(0);
    for (int i = 0; i < count && list; i++) {
        const csm_place *at = &places[i];
        PyObject *item = Py_BuildValue("(iiii)", at->x, at->y, at->size, at->layer);
        if (!item || PyList_Append(list, item) < 0) {
            Py_CLEAR(list);
        }
        Py_XDECREF(item);
    }
    return list ? Py_BuildValue("N(ii)", list, size[0], size[1]) : NULL;
}

PyDoc_STRVAR(program_defines_doc, "program_defines(pass_name, settings, outputs, instanced=False, "
                                  "alpha_tested=False)\n"
                                  "--\n\n"
                                  "The #define lines a pass is compiled with.");

static PyObject *program_defines(PyObject *module, PyObject *args) {
    const char *pass_name;
    PyObject *object;
    unsigned outputs;
    int instanced = 0, alpha_tested = 0;
    csm_settings settings;
    char text[16384];
    if (!PyArg_ParseTuple(args, "sOI|pp:program_defines", &pass_name, &object, &outputs, &instanced,
                          &alpha_tested) ||
        parse_valid(module, object, &settings) < 0) {
        return NULL;
    }
    settings.effects[CSM_EFFECT_INSTANCES] = instanced;
    settings.effects[CSM_EFFECT_ALPHA_TEST] = alpha_tested;
    csm_settings_canonical(&settings);
    for (int pass = 0; pass < CSM_STEP_COUNT; pass++) {
        if (!strcmp(csm_pass_name((csm_pass)pass), pass_name)) {
            csm_program_defines((csm_pass)pass, &settings, outputs, text, sizeof text);
            return PyUnicode_FromString(text);
        }
    }
    return PyErr_Format(PyExc_ValueError, "pass_name: there is no pass %s", pass_name);
}

PyMethodDef csm_py_settings_methods[] = {
    {"validate_settings", validate_settings, METH_O, validate_settings_doc},
    {"canonical_settings", canonical_settings, METH_O, canonical_settings_doc},
    {"settings_draw_alike", settings_draw_alike, METH_VARARGS, settings_draw_alike_doc},
    {"effect_table", effect_table, METH_NOARGS, effect_table_doc},
    {"number_table", number_table, METH_NOARGS, number_table_doc},
    {"moment_numbers", moment_numbers, METH_O, moment_numbers_doc},
    {"bias_terms", bias_terms, METH_O, bias_terms_doc},
    {"bias_metres", bias_metres, METH_VARARGS, bias_metres_doc},
    {"plan", plan, METH_VARARGS, plan_doc},
    {"storage_places", storage_places, METH_O, storage_places_doc},
    {"program_defines", program_defines, METH_VARARGS, program_defines_doc},
    {NULL, NULL, 0, NULL},
};
