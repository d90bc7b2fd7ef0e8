/* csm.h: the whole C API of csm, cascaded shadow maps as numbers.
 *
 * What it is. csrc/core places cascades, culls casters and plans passes: pure functions of values,
 * in doubles, with libc and libm alone. csrc/gl executes a plan with OpenGL 4.5 core and reads maps
 * and masks back. csrc/py wraps both for Python.
 *
 * What it does not do. It loads no files, opens no visible window, keeps no global state, prints
 * nothing and never falls back silently: what cannot be done is a csm_status and a sentence.
 *
 * Conventions (docs/conventions.md has the long form, tests/test_spaces.py pins them):
 *   world       right-handed, y up, metres
 *   view        right-handed, camera looks down -z; view depth = -z, positive in front [m]
 *   to_light    unit vector from a surface to the light, world space
 *   light view  right-handed, +z along to_light, in metres; light_from_world is a rotation about
 *               the world origin, or under light_basis = world a skew; light-view depth = -z of
 *               light space, small at the caster side [m]
 *   clip        x, y in [-1, 1], z in [0, 1], near = 0
 *   uvz         x, y in [0, 1] over the shadow map, (0, 0) its lower left; z as clip
 *   matrices    column-major, column vectors, named to_from: clip_from_world = clip_from_light *
 *               light_from_world
 *   corners     enum csm_corner; planes: left, right, bottom, top, near, far, normals inwards
 *
 * Errors. A fallible function returns a csm_status and takes a csm_error last. After an error the
 * outputs are unspecified and nothing is leaked. Texts say what, the value, the rule.
 */
#ifndef CSM_H
#define CSM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CSM_MAX_CASCADES 8
#define CSM_ERROR_TEXT_SIZE 1024

/* ------------------------------------------------------------------------------------------------
 * 1. Status
 */

/*      id                 value  Python exception class     default text */
#define CSM_STATUS_TABLE(STATUS)                                                                   \
    STATUS(OK, 0, NULL, "ok")                                                                      \
    STATUS(ERROR_INVALID_ARGUMENT, -1, "ValueError", "invalid argument")                           \
    STATUS(ERROR_OUT_OF_MEMORY, -2, "MemoryError", "out of memory")                                \
    STATUS(ERROR_NO_CONTEXT, -3, "ContextError", "no OpenGL context")                              \
    STATUS(ERROR_CONTEXT_LOST, -4, "ContextError", "the OpenGL context is gone")                   \
    STATUS(ERROR_SHADER, -5, "ShaderError", "a shader does not compile or link")                   \
    STATUS(ERROR_LIMIT, -6, "LimitError", "a limit of the driver is exceeded")                     \
    STATUS(ERROR_GL, -7, "GLError", "OpenGL reported an error")                                    \
    STATUS(ERROR_INTERRUPTED, -8, "KeyboardInterrupt", "interrupted")

typedef enum csm_status {
#define CSM_STATUS_ENUM(id, value, exception, text) CSM_##id = (value),
    CSM_STATUS_TABLE(CSM_STATUS_ENUM)
#undef CSM_STATUS_ENUM
} csm_status;

typedef struct csm_error {
    csm_status status;
    char text[CSM_ERROR_TEXT_SIZE];
} csm_error;

/* Name of a status, e.g. "ERROR_LIMIT"; its Python exception; its default text. */
const char *csm_status_name(csm_status status);
const char *csm_status_exception(csm_status status);
const char *csm_status_text(csm_status status);

/* Fill err (may be NULL) and return status, so that a failure is one statement. */
csm_status csm_fail(csm_error *err, csm_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Append one line to an error of status INVALID_ARGUMENT: validators collect every problem. */
void csm_fail_more(csm_error *err, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* ------------------------------------------------------------------------------------------------
 * 2. Effects: the choices that change which code, passes or textures exist
 *
 * csm_effects.def is the one table. A number that only feeds a uniform is in csm_settings instead.
 */

#define CSM_PASS_SHADOW_MAP 1u
#define CSM_PASS_VIEW 2u
#define CSM_PASS_SHADOW_MASK 4u
#define CSM_PASS_SHADOW_FORWARD 16u /* it sees what the mask pass sees too */
#define CSM_PASS_CPU 8u             /* seen by the fit or the culling, by no shader */
#define CSM_PASS_RECEIVERS 32u
#define CSM_PASS_SHADOW_MOMENTS 64u
#define CSM_PASS_SHADOW_BLUR 128u
#define CSM_PASS_SHADOW_SUM 256u
#define CSM_PASS_IDS 512u /* the passes that sum up what the view pass saw */

typedef enum csm_effect {
#define CSM_EFFECT(id, name, type, default_value, min, max, passes, choices, help) CSM_EFFECT_##id,
#include "csm_effects.def"
    CSM_EFFECT_COUNT
} csm_effect;

typedef enum csm_effect_type { CSM_TYPE_BOOL, CSM_TYPE_INT, CSM_TYPE_ENUM } csm_effect_type;

typedef struct csm_effect_info {
    const char *id;   /* macro name without CSM_ */
    const char *name; /* Python name */
    csm_effect_type type;
    int default_value, min, max;
    unsigned passes;     /* CSM_PASS_* bits */
    const char *choices; /* ENUM: names in value order, separated by blanks; else "" */
    const char *help;
} csm_effect_info;

/* The row of an effect. 0 <= effect < CSM_EFFECT_COUNT. */
const csm_effect_info *csm_effect_describe(int effect);

/* Values of the enums of the table, in the order of its choices. */
enum {
    CSM_SPLIT_PRACTICAL,
    CSM_SPLIT_UNIFORM,
    CSM_SPLIT_LOGARITHMIC,
    CSM_SPLIT_MANUAL,
    CSM_SPLIT_RESOLUTION,
    CSM_SPLIT_SDSM,
    CSM_SPLIT_PERCENTAGES,
    CSM_SPLIT_HISTOGRAM
};
enum { CSM_VIEW_RANGE_SCENE, CSM_VIEW_RANGE_CAMERA };
enum {
    CSM_FIT_SPHERE,
    CSM_FIT_BOX,
    CSM_FIT_DIAMETER,
    CSM_FIT_SCENE,
    CSM_FIT_SHIFTED,
    CSM_FIT_VISIBLE,
    CSM_FIT_CLIPPED,
    CSM_FIT_FOCUS
};
enum { CSM_LIGHT_BASIS_ORTHONORMAL, CSM_LIGHT_BASIS_WORLD, CSM_LIGHT_BASIS_TRANSPORTED };
enum { CSM_SNAP_EXACT, CSM_SNAP_NONE, CSM_SNAP_APPROXIMATE };
enum { CSM_LEVELS_LINEAR, CSM_LEVELS_GEOMETRIC };
enum { CSM_WARP_NONE, CSM_WARP_LISPSM, CSM_WARP_PSM, CSM_WARP_TSM };
enum { CSM_SELECT_MAP, CSM_SELECT_INTERVAL, CSM_SELECT_FRUSTUM };
enum { CSM_TEXCOORD_POSITION, CSM_TEXCOORD_INTERPOLATED };
enum { CSM_CULL_INCLUSIVE, CSM_CULL_NONE, CSM_CULL_EXCLUSIVE };
enum { CSM_DEPTH_RANGE_SCENE, CSM_DEPTH_RANGE_WINDOW, CSM_DEPTH_RANGE_MANUAL };
enum { CSM_DEPTH_D32F, CSM_DEPTH_D24, CSM_DEPTH_D16 };
enum { CSM_STORAGE_ARRAY, CSM_STORAGE_ATLAS, CSM_STORAGE_SEPARATE, CSM_STORAGE_CUBE };
enum { CSM_CASTER_FACES_BOTH, CSM_CASTER_FACES_FRONT, CSM_CASTER_FACES_BACK };
enum {
    CSM_FILTER_HARD,
    CSM_FILTER_NONE,
    CSM_FILTER_PCF,
    CSM_FILTER_POISSON,
    CSM_FILTER_VSM,
    CSM_FILTER_EVSM2,
    CSM_FILTER_EVSM4,
    CSM_FILTER_ESM,
    CSM_FILTER_MSM,
    CSM_FILTER_LVSM,
    CSM_FILTER_SAVSM,
    CSM_FILTER_FOURIER,
    CSM_FILTER_PCSS,
    CSM_FILTER_COUNT
};
enum { CSM_WEIGHTS_BOX, CSM_WEIGHTS_BILINEAR, CSM_WEIGHTS_TENT, CSM_WEIGHTS_GAUSSIAN };
enum { CSM_FETCH_GATHER, CSM_FETCH_TAPS };
enum { CSM_KERNEL_TEXELS, CSM_KERNEL_WORLD, CSM_KERNEL_SCREEN };
enum { CSM_DISC_POISSON, CSM_DISC_VOGEL };
enum { CSM_PCSS_DEPTH, CSM_PCSS_VARIANCE, CSM_PCSS_SUMMED };
enum { CSM_MOMENTS_FLOAT32, CSM_MOMENTS_FLOAT16, CSM_MOMENTS_UNORM16 };
enum { CSM_LOOKUP_BILINEAR, CSM_LOOKUP_TRILINEAR, CSM_LOOKUP_ANISOTROPIC };
enum { CSM_GRADIENTS_HARDWARE, CSM_GRADIENTS_QUAD, CSM_GRADIENTS_ANALYTIC };
enum { CSM_PLANE_NORMAL, CSM_PLANE_DERIVATIVES };
enum { CSM_STEPS_NONE, CSM_STEPS_ANALYTIC, CSM_STEPS_DIFFERENCES, CSM_STEPS_BOTH };
enum { CSM_BLEND_NONE, CSM_BLEND_LINEAR, CSM_BLEND_SMOOTH, CSM_BLEND_DITHER };
enum { CSM_BIAS_AUTO, CSM_BIAS_MANUAL };
enum { CSM_BIAS_RECEIVER, CSM_BIAS_CASTER };
enum { CSM_STAGE_COMPUTE, CSM_STAGE_FRAGMENT };

typedef struct csm_settings {
    int effects[CSM_EFFECT_COUNT];
    int map_size[CSM_MAX_CASCADES]; /* texels along a side, one per cascade */
#define CSM_NUMBER(name, default_value, min, max, help) double name;
#include "csm_effects.def"
    double manual_splits[CSM_MAX_CASCADES]; /* the count - 1 inner distances [m], or percents of
                                               the view range, ascending */
    double manual_depth_range[2];           /* light-view depths [m] of z = 0 and z = 1 */
} csm_settings;

typedef struct csm_number_info {
    const char *name; /* field of csm_settings and Python name */
    double default_value, min, max;
    const char *help;
    size_t offset; /* of the field */
} csm_number_info;

/* The row of a number, in the table's order; NULL beyond the last. */
const csm_number_info *csm_number_describe(int number);

/* Defaults of every field; map_size 2048. */
csm_settings csm_settings_default(void);

/* INVALID_ARGUMENT with every problem, one per line. */
csm_status csm_settings_validate(const csm_settings *settings, csm_error *err);

/* Zero (or default) what another value makes meaningless, so that equal pictures share programs:
 * settings of other filters, lam unless practical or sdsm, biases under auto, everything of the
 * maps under filter "none". Effects without a name are derived. settings must be valid. */
void csm_settings_canonical(csm_settings *settings);

/* The part of it that concerns where cascades lie and what they draw. */
void csm_settings_canonical_placement(csm_settings *settings);

/* Kernel radius in texels that a fit must keep free around a window: 0 for hard. */
int csm_settings_kernel_radius(const csm_settings *settings);

/* Width of transitions as a share: blend_width, or 0 without blending. Of canonical settings. */
double csm_settings_band(const csm_settings *settings);

/* Coarsest level of filtered maps that is looked up: a window keeps free at the rim what a lookup
 * between its texels reaches. */
#define CSM_MAX_LEVEL 4

/* How a filter works (csrc/core/filters.c has the one table). */
enum { CSM_LOOKS_AT_NOTHING, CSM_LOOKS_AT_DEPTHS, CSM_LOOKS_AT_MOMENTS, CSM_LOOKS_AT_SUMS };

/* The maps a prefiltered filter looks up, under canonical settings. */
typedef struct csm_moments {
    int kind;           /* CSM_LOOKS_AT_*: MOMENTS or SUMS where there are any */
    int channels;       /* of a layer */
    int slices;         /* layers per cascade */
    const char *format; /* as csm_plan_texture */
    int texel_bytes;
    bool blurred, mipmapped;
    double sum_steps; /* of the range of depths in summed areas: a kernel's sum must fit 32 bits */
} csm_moments;
csm_moments csm_settings_moments(const csm_settings *settings);

/* Compares or lookups of a receiver, at most. */
int csm_settings_taps(const csm_settings *settings);

/* Exponents of esm and evsm, positive and negative warp, after 0 is resolved by the format. */
void csm_settings_exponents(const csm_settings *settings, double out[2]);

/* Largest exponent that the format holds (docs/numerics.md 27); infinite under log_filter. */
double csm_exponent_limit(const csm_settings *settings);

/* What rounding leaves meaningful: the least variance (of evsm a share of the mean's square), the
 * depth by which a mean may be off, and the bias that keeps four moments realisable. */
double csm_settings_least_variance(const csm_settings *settings);
double csm_settings_mean_rounding(const csm_settings *settings);
double csm_settings_moment_bias(const csm_settings *settings);

/* Effective biases in the terms of csm_bias (section 7), after bias = auto is resolved. */
typedef struct csm_bias {
    bool receiver_plane;           /* compare against the receiver's plane at each texel's centre */
    double constant_texels;        /* times the larger texel side [m] */
    double slope_texels;           /* times (|gx| + |gy|) * texel side [m] */
    double normal_offset_texels;   /* times texel side * sin(theta) [m] */
    double caster_constant_texels; /* the first two, but casters are pushed back in the map */
    double caster_slope_texels;    /* times the steepest of |gx|, |gy| along its own side */
    double quanta;                 /* times the depth quantum of the format over the range [m] */
    double roundings;              /* times the float32 rounding of the receiver's position [m] */
} csm_bias;
csm_bias csm_settings_bias(const csm_settings *settings);

/* Texels along an axis from a receiver to the farthest centre of a texel that its filter takes. */
double csm_settings_reach(const csm_settings *settings);

/* The same biases as lengths [m] along the light, of one cascade; under a warp at its centre. Under
 * bias = auto every receiver's own float32 rounding comes on top (docs/numerics.md 11). */
typedef struct csm_bias_metres {
    bool on_casters; /* constant and slope push casters back instead of lifting receivers */
    bool receiver_plane;
    double texel;         /* larger side */
    double quantum;       /* of the stored depth */
    double constant;      /* at any slope */
    double slope;         /* times |gx| + |gy|; on casters times the larger of both */
    double normal_offset; /* of a surface parallel to the light; times sin(theta) */
    double needed_constant, needed_slope; /* the least without acne on a plane, on the receiver */
} csm_bias_metres;

/* Of canonical settings; depth_range as csm_cascades. */
csm_bias_metres csm_bias_in_metres(const csm_settings *settings, const double clip_from_light[16],
                                   int map_size, const double depth_range[2]);

/* Depth quantum of a format as a share of the depth range (docs/numerics.md 11): 1/65535 for D16,
 * 2^-24 for the others. */
double csm_depth_quantum(int depth_format);

/* ------------------------------------------------------------------------------------------------
 * 3. Cameras and frusta
 */

typedef enum csm_corner {
    CSM_LBN,
    CSM_LTN,
    CSM_RTN,
    CSM_RBN,
    CSM_LBF,
    CSM_LTF,
    CSM_RTF,
    CSM_RBF,
    CSM_CORNER_COUNT
} csm_corner; /* near corner + 4 = its far corner */

typedef enum csm_plane {
    CSM_LEFT,
    CSM_RIGHT,
    CSM_BOTTOM,
    CSM_TOP,
    CSM_NEAR,
    CSM_FAR,
    CSM_PLANE_COUNT
} csm_plane;

typedef struct csm_camera {
    double eye[3];                       /* world [m] */
    double right[3], up[3], backward[3]; /* orthonormal, right-handed; looks along -backward */
    double half_width, half_height;      /* perspective: tangents of the half fields of view;
                                            orthographic: half extents [m] */
    double centre[2];                    /* of the picture, right and up of the view axis, in the
                                            units of half_width: not 0 for off-centre frusta */
    double near_depth, far_depth;        /* view depths [m] */
    int width, height;                   /* pixels */
    bool orthographic;
} csm_camera;

/* Whether two cameras are equal to the bit. */
bool csm_camera_equal(const csm_camera *one, const csm_camera *other);

/* Finite, orthonormal to 1e-9, far > near (> 0 if perspective), positive extents and pixels. */
csm_status csm_camera_validate(const csm_camera *camera, csm_error *err);

void csm_camera_view_from_world(const csm_camera *camera, double out[16]);

/* perspective_rh_zo or ortho_rh_zo of the camera, near = 0, far = 1. */
void csm_camera_clip_from_view(const csm_camera *camera, double out[16]);

/* World corners of the slice between two view depths, in the order of csm_corner. Built from the
 * tangents, never by unprojection (docs/numerics.md 3). */
void csm_frustum_corners(const csm_camera *camera, double near_depth, double far_depth,
                         double out_corners[CSM_CORNER_COUNT][3]);

/* World planes (a, b, c, d), dot(n, p) + d >= 0 inside, unit normals. */
void csm_frustum_planes(const csm_camera *camera, double near_depth, double far_depth,
                        double out_planes[CSM_PLANE_COUNT][4]);

/* Largest view depth of the part of a box that the camera's frustum [near, far] holds, found by
 * clipping; bounds = {min x y z, max x y z}. False if they do not meet. */
bool csm_frustum_depth_of_box(const csm_camera *camera, const double bounds[6], double *out_depth);

/* ------------------------------------------------------------------------------------------------
 * 4. Splits (docs/numerics.md 1, 2 and 17)
 */

/* count + 1 ascending view depths [m]; the ends are near and far to the bit. scheme is a
 * CSM_SPLIT_* of practical, uniform, logarithmic. Fails unless 0 < near < far (near may be any
 * finite number below far for uniform, and for practical with lam 0), 1 <= count <= 8,
 * 0 <= lam <= 1. */
csm_status csm_splits_compute(double near_depth, double far_depth, int count, int scheme,
                              double lam, double *out_splits, csm_error *err);

/* near * 2^(k/4) with the smallest integer k that reaches depth; *out_step = k. When held_step is
 * not INT_MIN it is kept while it still reaches depth and is at most one step too far. */
double csm_range_round_up(double near_depth, double depth, int held_step, int *out_step);

/* ------------------------------------------------------------------------------------------------
 * 5. Light basis (docs/numerics.md 6 and 18)
 */

/* Rows X, Y, Z = to_light of an orthonormal, right-handed basis, branch-free; out is the 4x4
 * light_from_world. Fails on a zero or non-finite direction; to_light need not have unit length. */
csm_status csm_light_basis_orthonormal(const double to_light[3], double out[16], csm_error *err);

/* The nearest direction of a lattice that covers the sphere evenly, poles included: rings of
 * elevation at most step_deg apart, each cut into equal steps of azimuth. Moves a unit vector by
 * less than 4/5 of step_deg; leaves it alone where step_deg is 0. */
void csm_sun_step(double step_deg, double to_light[3]);

/* ------------------------------------------------------------------------------------------------
 * 6. Cascades (docs/numerics.md 3 to 8)
 */

typedef struct csm_window {
    double centre[2];      /* light x, y [m] before snapping */
    double half_extent[2]; /* [m] before padding */
} csm_window;

/* A sphere round a part of the view, in view space. */
typedef struct csm_ball {
    double centre[3]; /* right and up of the view axis, view depth [m] */
    double radius;
    double whole[2]; /* view depths between which it holds the view's whole cross-section [m] */
} csm_ball;

/* Smallest sphere round a slice, from the tangents and depths only (docs/numerics.md 4 and, for
 * off-centre frusta, 20). For an orthographic camera the sphere round a box. */
void csm_fit_sphere(const csm_camera *camera, double near_depth, double far_depth, csm_ball *out);

/* The same sphere, shifted along the axis of the picture as far as the slice's near corners stay
 * inside [Sylvan]: shifted at all only if k^2 > (far - near) / (far + near), for otherwise
 * the near corners lie on the smallest sphere already (docs/numerics.md 20). */
void csm_fit_shifted(const csm_camera *camera, double near_depth, double far_depth, csm_ball *out);

/* One sphere per slice of count + 1 splits, of the radius of its slice's smallest, each shifted as
 * far as it can: it keeps the whole cross-section where the one before ends to hold it, in the
 * middle of its own slice, and where the next one begins to; its end stays within the last split.
 * The last one is not shifted. Every depth between the first and the last split is held whole. */
void csm_fit_shifted_chain(const csm_camera *camera, const double *splits, int count,
                           csm_ball *out);

/* Largest distance between two corners of a slice [m] (docs/numerics.md 5). */
double csm_fit_diameter(const csm_camera *camera, double near_depth, double far_depth);

/* Approximate snapping (docs/numerics.md 19): the least level of a window that is at least ratio of
 * the base window, or the held one while it is at most hysteresis levels above; *out_level counts
 * up with the size. spacing LINEAR: level / count; GEOMETRIC: 2^(8 level / count), so that count
 * levels cover a factor of 256. Both go on beyond the base. NAN where a level is no int. */
double csm_snap_level(double ratio, int spacing, int count, int hysteresis, int held,
                      int *out_level);

/* Snapped or free lower corner and texel size of a window (docs/numerics.md 7): half extents are
 * widened to H S / (S - 1 - 2p) when snapped and H S / (S - 2p) when not; a snapped corner is
 * lattice * texel_size. The one place where positions are rounded. Fails if no texel is left or the
 * lattice leaves +-2^53. */
csm_status csm_snap_window(const csm_window *window, int map_size, int padding_texels, int snap,
                           double out_corner[2], double out_texel_size[2], int64_t out_lattice[2],
                           csm_error *err);

/* What one frame hands to the next so that its choices do not flicker. INT_MIN: nothing held. */
typedef struct csm_hold {
    int range_step;                       /* k of view_range = scene */
    int near_step, far_step;              /* of a range taken from receivers */
    int cut_step[CSM_MAX_CASCADES];       /* where split = histogram ends a cascade */
    int window_step[CSM_MAX_CASCADES][2]; /* sizes of windows that change with the view */
    int level[CSM_MAX_CASCADES][2];       /* of approximate snapping */
    int span_step[CSM_MAX_CASCADES];      /* of depth ranges of less than the scene */
    int light_basis;                      /* what light_from_world is: WORLD if it is skewed,
                                             otherwise ORTHONORMAL */
    int stretch_step;                     /* of a skewed light_from_world */
    double light_from_world[16];          /* before a window is turned */
} csm_hold;

/* Nothing held. */
csm_hold csm_hold_none(void);

#define CSM_DEPTH_BINS 256

/* Visible surfaces that face the sun: as world points, or, summed up by a pass over the pixels, as
 * depths and light-space boxes. */
typedef struct csm_receivers {
    const double *points; /* point_count x 3, world; NULL if summed up */
    size_t point_count;
    const double *depths;   /* view depths of the points [m], ascending within each run; NULL: the
                               points are in any order, and their depths not known */
    const size_t *run_ends; /* run_count, of which the last is point_count */
    int run_count;
    bool seen;                       /* summed up: there are any */
    double depth_range[2];           /* least and largest view depth [m] */
    const uint32_t *depth_histogram; /* CSM_DEPTH_BINS over the camera's range: uniform in log
                                        depth, or in depth where near is not positive; NULL:
                                        not counted */
    const float *boxes;              /* box_count x cascades x 4: min x, y, max x, y in light
                                        space relative to box_origin; empty where min > max */
    size_t box_count;
    double box_origin[3];           /* world */
    bool turned;                    /* the boxes of cascade i lie along axes turned by turns[i] */
    double turns[CSM_MAX_CASCADES]; /* [rad] about light z */
} csm_receivers;

/* A perspective warp of the light plane. Local coordinates of a point are (light xy - origin) /
 * extent along the turned axes, y from 0 to 1 over what is held. */
typedef struct csm_warp {
    double light_from_world[16]; /* the rotation given, turned about light z: y along the warp */
    double origin[2];            /* of the local coordinates, from the eye [m] */
    double extent[2];            /* [m] */
    double strength;             /* w grows from 1 to 1 + strength; the point of projection lies
                                    extent[1] / strength before the body */
    double clip_from_local[16];  /* x, y, w rows free of z; w from 1 up on the map; z is kept, so
                                    that clip z / w of a depth in [0, 1] lies in [0, 1] */
} csm_warp;

/* The warp (a CSM_WARP_*) of a map that must hold points, relative to the eye in world axes [m]:
 * the hull of a slice. Orthographic where view and light are parallel, and for an orthographic
 * camera. Fails if padding_texels leave no texel (docs/numerics.md 21). */
csm_status csm_warp_make(int kind, const csm_camera *camera, const double light_from_world[16],
                         const double (*points)[3], int count, int map_size, int padding_texels,
                         csm_warp *out, csm_error *err);

/* Light x, y [m] of a point of clip space, and the sides of one texel there along light x and y:
 * clip_from_light may be projective. */
void csm_warp_unproject(const double clip_from_light[16], const double clip[2], int map_size,
                        double out_position[2], double out_texel[2]);

typedef struct csm_cascades_desc {
    csm_camera camera;
    double to_light[3];
    const csm_settings *settings;
    const double *scene_bounds;     /* {min x y z, max x y z} of casters and receivers, or NULL */
    const double *boxes;            /* bounds of the scene's parts, as scene_bounds, or NULL */
    size_t box_count, box_stride;   /* bytes from box to box */
    const csm_receivers *receivers; /* what is seen, or NULL */
    const csm_hold *held;           /* of the frame before, or NULL */
} csm_cascades_desc;

typedef struct csm_cascades {
    int count;
    int range_step; /* k of view_range = scene, also where the camera's far is nearer; INT_MIN if
                       not rounded */
    int map_size[CSM_MAX_CASCADES];
    double splits[CSM_MAX_CASCADES + 1];
    double served_from[CSM_MAX_CASCADES]; /* view depth up to which finer maps hold all that is
                                             seen: splits[i], or less (fit shifted) */
    double light_from_world[CSM_MAX_CASCADES][16];
    double stretch; /* at most so much longer than in the world is a length along an axis of light
                       space; 1 for rotations, more for the skew of light_basis = world */
    double clip_from_light[CSM_MAX_CASCADES][16];
    double clip_from_world[CSM_MAX_CASCADES][16];
    double uvz_from_world[CSM_MAX_CASCADES][16];
    double texel_size[CSM_MAX_CASCADES][2];
    int64_t lattice[CSM_MAX_CASCADES][2];
    csm_warp warp[CSM_MAX_CASCADES]; /* set under a warp: clip_from_light is then projective */
    double depth_range[CSM_MAX_CASCADES][2]; /* light-view depths of z = 0 and z = 1 [m] */
    bool pancake; /* casters before a depth range are flattened onto its near end */
    bool bounded; /* bounds are those of the scene, as given */
    double bounds[6];
    csm_hold hold; /* for the next frame */
} csm_cascades;

/* Bounds of the map of cascade i in light x, y (min x, y, max x, y), and the largest side of a
 * texel anywhere in it [m]. */
void csm_cascade_window(const csm_cascades *cascades, int i, double out_window[4],
                        double *out_texel);

/* The first half of a fit: checks desc, fills count, splits, range_step, the hold of both, and the
 * light_from_world that windows start from. */
csm_status csm_cascades_place(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err);

/* Rows that take a world normal into light space: the inverse transpose of light_from_world, which
 * for a rotation is itself. They are also the world vectors of one metre along each light axis. */
void csm_light_normals(const csm_cascades *cascades, int cascade, double out[3][3]);

/* Angles [rad] about light z, from the axes of cascades as placed, of the rectangles of smallest
 * area round the receivers of each cascade. */
csm_status csm_receivers_turns(const csm_cascades_desc *desc, const csm_cascades *cascades,
                               double out_turns[CSM_MAX_CASCADES], csm_error *err);

/* Fits every cascade. Without scene_bounds, view_range and depth range come from the camera alone:
 * the depth range then holds the slice and as much again towards the light. */
csm_status csm_cascades_fit(const csm_cascades_desc *desc, csm_cascades *out, csm_error *err);

/* ------------------------------------------------------------------------------------------------
 * 7. Scene geometry and culling (docs/numerics.md 10 and 12)
 */

typedef struct csm_mesh_view {
    const double *positions; /* vertex_count x 3, mesh-local */
    size_t vertex_count;
    const int32_t *triangles; /* triangle_count x 3 */
    size_t triangle_count;
    /* A cut-out (docs/numerics.md 26), or NULL for both: texture coordinates, vertex_count x 2, v
     * down, repeating; and what of the image is there, one byte a texel, 0 where it is cut out. */
    const double *uv;
    const uint8_t *cutout;
    int cutout_width, cutout_height; /* 1 to CSM_MAX_CUTOUT */
} csm_mesh_view;

#define CSM_MAX_CUTOUT 16384

/* Texels that the coordinates of one mesh may span: float32 then still tells 1/16 of a texel. */
#define CSM_MAX_CUTOUT_SPAN (1 << 20)

typedef struct csm_scene_desc {
    const csm_mesh_view *meshes;
    int mesh_count;
    const int32_t *instance_mesh;      /* instance_count */
    const double *world_from_instance; /* instance_count x 16, column-major, affine */
    int instance_count;
    double origin[3]; /* world point that the float32 positions are relative to */
} csm_scene_desc;

/* A run of triangles of one mesh: what culling keeps or drops for each instance. */
typedef struct csm_chunk {
    uint32_t first_triangle, triangle_count; /* in csm_geometry.indices */
    uint32_t first_item, item_count;         /* csm_geometry.items: one per instance */
} csm_chunk;

/* Where a vertex lies in its mesh's cut-out; all zero without one. */
typedef struct csm_cutout_vertex {
    float texels[2]; /* x, y from the image's upper left corner, a whole number of images apart */
    uint32_t first;  /* word of csm_geometry.cutouts that the image's rows begin at */
    uint32_t size;   /* width - 1, height - 1 in the lower and upper 16 bits */
} csm_cutout_vertex;

typedef struct csm_item {
    double bounds[6]; /* world, {min, max} */
    uint32_t chunk;
    uint32_t instance; /* row of csm_geometry.instances */
    bool mirrored;     /* by its instance: the corners of front faces run the other way round */
} csm_item;

/* Meshes that occur once are baked to origin-relative positions under instance 0, the identity;
 * meshes that occur more often are stored once. Triangles are sorted along a space-filling curve
 * inside a mesh, so that chunks are compact. Meshes with a cut-out come after those without. */
typedef struct csm_geometry {
    float *positions; /* vertex_count x 3; vertex t is the last corner of triangle t alone */
    size_t vertex_count;
    uint32_t *indices; /* triangle_count x 3 */
    size_t triangle_count;
    float *planes; /* triangle_count x 4: unit normal and offset, dot(n, p) = offset, from doubles
                      of the rounded positions; zero-area triangles have a zero normal */
    float *instances; /* instance_count x 12: rows of origin_from_local (3 x 4); row 0 identity */
    int instance_count;
    csm_cutout_vertex *cutout_vertices; /* vertex_count; NULL if no mesh has a cut-out */
    uint32_t *cutouts; /* rows of bits, each from a word of its own, lowest bit first; 1 is there */
    size_t cutout_word_count;
    csm_chunk *chunks;
    size_t chunk_count;
    size_t cutout_chunk; /* first chunk of a mesh with a cut-out, chunk_count without */
    csm_item *items;
    size_t item_count;
    size_t drawn_triangle_count; /* with every instance counted */
    double bounds[6];            /* world */
} csm_geometry;

/* Checks indices, finiteness and transforms, then builds; csm_geometry_destroy accepts zeros. */
csm_status csm_geometry_build(const csm_scene_desc *desc, csm_geometry *out, csm_error *err);

/* Chunks, items and bounds alone, the same as csm_geometry_build gives, and nothing to draw: where
 * the parts of a scene lie, for fit focus without a renderer. */
csm_status csm_geometry_boxes(const csm_scene_desc *desc, csm_geometry *out, csm_error *err);
void csm_geometry_destroy(csm_geometry *geometry);

/* Room for the outline of frustum and scene box met: 12 planes have at most 20 vertices. */
#define CSM_HULL_MAX 24

/* Part of a finer map's window: what lies wholly inside, in light x and y, shadows nothing that a
 * coarser map is looked up for. */
typedef struct csm_cull_rectangle {
    double light_from_world[16];
    double window[4]; /* light x min, y min, x max, y max [m] */
} csm_cull_rectangle;

/* What a cascade must draw: the hull of the visible frustum between two view depths, cut to the
 * scene's bounds where known, extruded towards the light, met with the cascade's window. */
typedef struct csm_cull_volume {
    double light_from_world[16];
    double window[4];             /* light x min, y min, x max, y max [m] */
    int hull_count;               /* 0: the window alone */
    double hull[CSM_HULL_MAX][2]; /* convex polygon in light x, y, counter-clockwise */
    double margin;   /* [m] added on each side of window and hull: kernel and rounding */
    double lowest_z; /* casters wholly below this light z cannot matter; -INFINITY: unknown */
    int finer_count; /* rectangles of finer maps that are left out; 0: none */
    csm_cull_rectangle finer[CSM_MAX_CASCADES - 1];
    double stretch; /* as csm_cascades */
} csm_cull_volume;

/* Volume of cascade i: with selection by interval the frustum of its slice, else from its slice on;
 * window alone when whole_window is true (receivers outside the picture). band is the share of half
 * a map, under selection by interval of a slice, over which finer cascades blend into this one: it
 * is looked up for their receivers too; 0: they do not.
 * margin_texels: how far from its receiver a lookup may reach (kernel radius, normal offset); one
 * texel for texel centres and rounding comes on top. An empty window where nothing is seen. */
void csm_cull_volume_make(const csm_cascades *cascades, int cascade, const csm_camera *camera,
                          int select, double band, double margin_texels, bool whole_window,
                          csm_cull_volume *out);

/* Exclusive culling: leaves out what lies wholly inside the window of one finer cascade, less
 * border_texels of its own (where the finer map does not answer), less band times half its side
 * (where it does not answer alone) and less what a lookup in the coarser map may reach from there.
 * Selection must be by window, not by depth. A finer cascade whose depth range does not hold the
 * coarser one's is no reason to leave anything out. */
void csm_cull_volume_exclude(const csm_cascades *cascades, int cascade, double border_texels,
                             double band, csm_cull_volume *volume);

/* False only if no caster inside the world box can shadow a receiver of the volume, whatever the
 * finer maps answer for. */
bool csm_cull_keep_box(const csm_cull_volume *volume, const double bounds[6]);

/* True if the world box lies inside one of the volume's finer rectangles. */
bool csm_cull_in_finer(const csm_cull_volume *volume, const double bounds[6]);

/* Indices of kept items, ascending, into out (room for item_count); returns their number. A NULL
 * volume keeps all. *out_in_finer (may be NULL) counts what finer rectangles alone left out. */
size_t csm_cull_items(const csm_geometry *geometry, const csm_cull_volume *volume,
                      uint32_t *out_items, size_t *out_in_finer);

/* The same for the camera: items whose box meets the frustum [near, far]. */
size_t csm_cull_items_view(const csm_geometry *geometry, const csm_camera *camera,
                           uint32_t *out_items);

/* Of a list the items whose box meets the volume, whatever finer rectangles hold. */
size_t csm_cull_list(const csm_geometry *geometry, const csm_cull_volume *volume,
                     const uint32_t *items, size_t item_count, uint32_t *out_items);

/* -- What of an earlier map may be kept (docs/numerics.md 33) -----------------------------------
 */

/* What a map holds, of one scene under one set of canonical settings: in this window all of these
 * casters. Others of the scene may be in it too, in parts. */
typedef struct csm_map_content {
    int map_size, texel_bytes;
    bool snapped;               /* the corner is lattice * texel_size */
    double base_from_world[16]; /* light_from_world of the first cascade: shaders turn its x, y */
    double light_from_world[16];
    double clip_from_light[16];
    double clip_from_world[16];
    double texel_size[2], depth_range[2];
    int64_t lattice[2];
    csm_warp warp; /* zeros without one, as the eye that warps are relative to */
    double eye[3];
    const uint32_t *items; /* ascending */
    size_t item_count;
} csm_map_content;

/* Cascade i as fitted, with no items yet. */
void csm_map_content_make(const csm_cascades *cascades, int cascade, const csm_camera *camera,
                          const csm_settings *canonical, csm_map_content *out);

/* Whether two canonical settings are equal to the bit. */
bool csm_settings_equal(const csm_settings *one, const csm_settings *other);

/* DRAW clears and draws everything. KEEP: the same window, and every caster wanted is there. ADD:
 * the same window, casters are missing, which are drawn over what is there: the nearest depth of a
 * texel does not depend on the order. SCROLL: the window moved by whole texels; what both hold is
 * copied, casters are drawn where the window is new, and what was not there everywhere. */
typedef enum csm_reuse_action {
    CSM_REUSE_DRAW,
    CSM_REUSE_KEEP,
    CSM_REUSE_ADD,
    CSM_REUSE_SCROLL,
    CSM_REUSE_COUNT
} csm_reuse_action;

/* "draw", "keep", "add", "scroll" */
const char *csm_reuse_name(csm_reuse_action action);

#define CSM_REUSE_PARTS 3

/* A part of a map that is drawn, lower left corner and sides [texels], and what is drawn there. */
typedef struct csm_reuse_part {
    int x, y, width, height;
    bool cleared;
    const uint32_t *items;
    size_t item_count;
} csm_reuse_part;

typedef struct csm_reuse {
    csm_reuse_action action;
    int shift[2]; /* of the window, along u and v [texels] */
    int part_count;
    csm_reuse_part parts[CSM_REUSE_PARTS];
} csm_reuse;

/* What is allowed; each bit needs those before it. */
#define CSM_REUSE_MAY_KEEP 1u
#define CSM_REUSE_MAY_ADD 2u
#define CSM_REUSE_MAY_SCROLL 4u

/* What settings allow: depths alone can be added to and scrolled, neither warped nor resolved nor
 * copied from elsewhere. */
unsigned csm_reuse_allowed(const csm_settings *canonical, bool scroll);

/* What to do for the map wanted, cascade i as fitted, where another is held (NULL: none), of the
 * same scene and canonical settings. scratch (room for 4 x the items wanted) holds the items
 * of the parts. Scrolls where csm_scroll_pays. */
void csm_reuse_choose(const csm_geometry *geometry, const csm_cascades *cascades, int cascade,
                      const csm_map_content *held, const csm_map_content *wanted, unsigned allowed,
                      uint32_t *scratch, csm_reuse *out);

/* Items of both lists, ascending as they are, into out (room for the sum); returns their number. */
size_t csm_items_joined(const uint32_t *one, size_t one_count, const uint32_t *other,
                        size_t other_count, uint32_t *out);

/* Triangles of items. */
int64_t csm_items_triangles(const csm_geometry *geometry, const uint32_t *items, size_t item_count);

/* Whether copying a map's old part and drawing the rest costs less than drawing all of it, in
 * texels cleared and filled: so many more cost a texel of 4 bytes copied there and back, a
 * triangle, and a part that is drawn (medians on llvmpipe, docs/recommendation.md). */
#define CSM_SCROLL_COPY 1.0
#define CSM_SCROLL_TRIANGLE 300.0
#define CSM_SCROLL_PART 5e4
bool csm_scroll_pays(const csm_map_content *wanted, const csm_reuse *scroll,
                     int64_t triangles_scrolled, int64_t triangles_whole);

/* ------------------------------------------------------------------------------------------------
 * 8. Plan: canonical settings to passes, textures and programs; no GL
 */

/* What a frame hands out; bits of csm_plan.outputs and csm_render_desc.outputs. */
#define CSM_OUT_MASK 1u
#define CSM_OUT_VALID 2u
#define CSM_OUT_VIEW_DEPTH 4u
#define CSM_OUT_CASCADE_INDEX 8u
#define CSM_OUT_SHADOW_MAPS 16u
#define CSM_OUT_NORMAL 32u
#define CSM_OUT_POINTS 64u
#define CSM_OUT_MASK_SINGLE 128u
#define CSM_OUT_MOMENTS 256u

#define CSM_PLAN_MAX 64

typedef enum csm_pass {
    CSM_STEP_VIEW,
    CSM_STEP_RECEIVER_RANGE,
    CSM_STEP_RECEIVER_BOUNDS,
    CSM_STEP_SHADOW_MAP,
    CSM_STEP_SHADOW_MOMENTS, /* depths of one cascade to what is filtered */
    CSM_STEP_SHADOW_BLUR,    /* along x, then along y */
    CSM_STEP_SHADOW_SUM,     /* summed areas */
    CSM_STEP_SHADOW_MIPS,    /* of all cascades; by the driver, so it has no program */
    CSM_STEP_SHADOW_MASK,
    CSM_STEP_SHADOW_FORWARD, /* in its place where light coordinates are interpolated */
    CSM_STEP_SHADOW_POINTS,
    CSM_STEP_COUNT
} csm_pass;

/* "view", "receiver_range", "shadow_map", "shadow_mask", ... */
const char *csm_pass_name(csm_pass pass);

/* Name of a cascade's step in timings, "shadow_map_0"; of a frame's step, cascade -1, the pass's.
 */
const char *csm_step_name(csm_pass pass, int cascade);

typedef struct csm_plan_step {
    csm_pass pass;
    int cascade; /* -1: not of one cascade */
    uint64_t program_key;
} csm_plan_step;

enum { CSM_TEXTURE_PLAIN, CSM_TEXTURE_ARRAY, CSM_TEXTURE_CUBE };

typedef struct csm_plan_texture {
    char name[32];
    char format[16];
    int kind; /* CSM_TEXTURE_* */
    int width, height, layers;
    int samples, levels;
    uint64_t bytes;
} csm_plan_texture;

/* Where a cascade's map lies in the texture that holds it. */
typedef struct csm_place {
    int x, y, size; /* texels */
    int layer;      /* of an array, face of a cube, number of a separate texture */
} csm_place;

/* Places of the maps under canonical settings, and the size of the texture that holds them: tiles
 * of an atlas are packed without overlap, each with its border inside the atlas. */
void csm_storage_places(const csm_settings *settings, csm_place out[CSM_MAX_CASCADES],
                        int out_size[2]);

typedef struct csm_plan {
    int step_count, texture_count, program_count;
    csm_plan_step steps[CSM_PLAN_MAX];
    csm_plan_texture textures[CSM_PLAN_MAX];
    uint64_t program_keys[CSM_PLAN_MAX]; /* distinct */
    csm_pass program_passes[CSM_PLAN_MAX];
    uint64_t bytes;   /* of all textures and per-pixel buffers */
    unsigned outputs; /* CSM_OUT_* */
} csm_plan;

/* settings must be valid; they are made canonical on a copy. */
csm_status csm_plan_make(const csm_settings *settings, int width, int height, unsigned outputs,
                         csm_plan *out, csm_error *err);

/* Bytes of a texel of a depth format. */
int csm_depth_bytes(int format);

/* The texture that a map's old part goes through when it is scrolled, for a plan with maps. */
void csm_plan_add_scroll(const csm_settings *canonical, csm_plan *plan);

/* Pixels are summed up in runs of a column: their number, and the bytes of what the passes over
 * receivers hand to the fit. */
#define CSM_RECEIVER_RUN 32
size_t csm_receiver_runs(int width, int height);
uint64_t csm_receiver_range_bytes(int width, int height);
uint64_t csm_receiver_bounds_bytes(int width, int height, int cascade_count);

/* Key of a pass under canonical settings and outputs: effects the pass does not see are masked. */
uint64_t csm_program_key(csm_pass pass, const csm_settings *canonical, unsigned outputs);

/* ------------------------------------------------------------------------------------------------
 * 9. Shader text
 */

/* Reads a file of the shader folder into *out_text (malloc, zero-terminated); false if absent. */
typedef bool (*csm_read_callback)(void *user, const char *name, char **out_text);

typedef struct csm_source_line {
    const char *file; /* owned by the csm_shader_source */
    int line;
} csm_source_line;

typedef struct csm_shader_source {
    char *text; /* #version, #defines, then the files with every #include resolved once */
    csm_source_line *lines; /* one per line of text */
    size_t line_count;
    char **files;
    size_t file_count;
} csm_shader_source;

csm_status csm_shader_source_load(const char *name, const char *defines, csm_read_callback read,
                                  void *user, csm_shader_source *out, csm_error *err);
void csm_shader_source_destroy(csm_shader_source *source);

/* #define lines of a pass: every CSM_ name, 0 if off or not seen; into text, returns the length
 * that the whole needs (as snprintf). */
size_t csm_program_defines(csm_pass pass, const csm_settings *canonical, unsigned outputs,
                           char *text, size_t size);

/* ------------------------------------------------------------------------------------------------
 * 10. Renderer (csrc/gl)
 */

typedef struct csm_renderer csm_renderer;
typedef struct csm_gpu_scene csm_gpu_scene;

enum { CSM_BACKEND_EGL, CSM_BACKEND_OSMESA, CSM_BACKEND_GLFW, CSM_BACKEND_COUNT };
const char *csm_backend_name(int backend);

typedef struct csm_renderer_desc {
    int backend;
    bool debug;             /* synchronous KHR_debug output, errors fail the call */
    csm_read_callback read; /* shader files; called inside any call of the renderer */
    void *read_user;
} csm_renderer_desc;

typedef struct csm_renderer_info {
    const char *backend;
    char platform[64]; /* "device", "surfaceless", ... */
    char vendor[128], renderer[128], version[128], glsl[64];
    bool software;
    int stage;                                                    /* CSM_STAGE_* */
    int max_texture_size, max_cube_size, max_layers, max_samples; /* samples of depth textures */
    int64_t max_buffer_bytes;
    int programs_compiled; /* since the renderer was made */
    int live_objects;      /* GL objects that exist now */
} csm_renderer_info;

/* Opens a context; NO_CONTEXT says what is missing. On success the caller owns *out. */
csm_status csm_renderer_create(const csm_renderer_desc *desc, csm_renderer **out, csm_error *err);
void csm_renderer_destroy(csm_renderer *renderer);
csm_status csm_renderer_describe(csm_renderer *renderer, csm_renderer_info *out, csm_error *err);

/* Where passes over pixels and texels run from the next frame on, CSM_STAGE_*: compute at first. */
csm_status csm_renderer_set_stage(csm_renderer *renderer, int stage, csm_error *err);

/* Drops compiled programs, so that edited shader files are read again. */
csm_status csm_renderer_reload(csm_renderer *renderer, csm_error *err);

/* Uploads geometry; the scene belongs to the renderer and dies with it at the latest. */
csm_status csm_renderer_upload(csm_renderer *renderer, const csm_geometry *geometry,
                               const double origin[3], csm_gpu_scene **out, csm_error *err);
csm_status csm_renderer_drop(csm_renderer *renderer, csm_gpu_scene *scene, csm_error *err);

/* Asked between batches of work; true stops the call with INTERRUPTED. */
typedef bool (*csm_stop_callback)(void *user);

/* A message of the driver that is no error: severity "medium", "low", "notification". */
typedef void (*csm_message_callback)(void *user, unsigned id, const char *severity,
                                     const char *text);

typedef struct csm_render_desc {
    csm_gpu_scene *scene;
    csm_camera camera;
    double to_light[3];
    double angular_diameter; /* of the sun [rad]; 0: a point */
    csm_settings settings;
    const double *scene_bounds; /* as csm_cascades_desc */
    const csm_hold *held;
    unsigned outputs;
    const double *points;        /* point_count x 3 world, or NULL */
    const double *point_normals; /* point_count x 3, of unit length, or NULL: unknown */
    size_t point_count;
    int reuse;    /* CSM_REUSE_MAPS_*: what of the last render's maps may serve again */
    bool untimed; /* no pass is waited for to time it: there is the readback's time alone */
    csm_stop_callback stop;
    void *stop_user;
} csm_render_desc;

/* Never; where they are provably the same; also where they moved by whole texels. Maps are held
 * from a render that may reuse to the next, and forgotten by one that may not. */
enum { CSM_REUSE_MAPS_NEVER, CSM_REUSE_MAPS_SAME, CSM_REUSE_MAPS_SCROLLED };

typedef struct csm_map_reuse {
    csm_reuse_action action;
    int shift[2];
    int64_t texels_saved, triangles_saved; /* against drawing the map whole */
} csm_map_reuse;

#define CSM_MAX_TIMINGS 64

typedef struct csm_render_out {
    /* Caller-owned, NULL where not asked for. Images: row 0 on top. */
    float *mask;            /* height x width */
    float *mask_single;     /* height x width: of the one cascade, without blend or fade */
    uint8_t *valid;         /* height x width, 0 or 1 */
    float *view_depth;      /* height x width [m], inf where not valid */
    uint8_t *cascade_index; /* height x width, 255 = none */
    float *normal;          /* height x width x 3, towards the camera, 0 where not valid */
    float *shadow_maps[CSM_MAX_CASCADES]; /* each its size x size, row 0 at the bottom */
    float *moments[CSM_MAX_CASCADES];     /* the same, times channels x slices */
    float *point_visibility;
    uint8_t *point_cascade;
    float *point_blend_weight; /* of the next cascade, 0 to 1 */
    /* filled in */
    csm_cascades cascades;
    int timing_count;
    const char *timing_names[CSM_MAX_TIMINGS];
    double timing_ms[CSM_MAX_TIMINGS];
    const char *clock; /* "timer query" or "wall clock around glFinish" */
    int items_total;
    int items_drawn[CSM_MAX_CASCADES];
    int items_in_finer[CSM_MAX_CASCADES]; /* left out by exclusive culling alone */
    int64_t triangles_drawn[CSM_MAX_CASCADES];
    int reused_count; /* 0 where the desc does not allow it, and without maps */
    csm_map_reuse reused[CSM_MAX_CASCADES];
    int view_items_drawn;
    uint64_t bytes; /* of the plan, and of the buffers of points; scene excluded */
    uint64_t scene_bytes;
    int programs_compiled; /* by this frame */
} csm_render_out;

csm_status csm_renderer_render(csm_renderer *renderer, const csm_render_desc *desc,
                               csm_render_out *out, csm_error *err);

/* Visibility of points in the maps of the last render; maps that were culled to the picture are
 * drawn whole first, for which that render's scene must still be there. NULL outputs are not
 * wanted. */
typedef struct csm_visibility_desc {
    const double *points;  /* point_count x 3 world */
    const double *normals; /* point_count x 3, of unit length, or NULL: unknown */
    size_t point_count;
    csm_stop_callback stop;
    void *stop_user;
} csm_visibility_desc;

csm_status csm_renderer_visibility(csm_renderer *renderer, const csm_visibility_desc *desc,
                                   float *out_mask, uint8_t *out_cascade, float *out_blend_weight,
                                   csm_error *err);

/* Messages of the driver since the last drain, oldest first. */
void csm_renderer_drain_messages(csm_renderer *renderer, csm_message_callback callback, void *user);

/* ------------------------------------------------------------------------------------------------
 * 11. Coverage: what any set of cascades does to a view, ours or not (docs/numerics.md 23)
 */

typedef struct csm_coverage_desc {
    csm_camera camera;
    int count;
    const double (*clip_from_world)[16]; /* clip z in [0, 1], parallel light; may be warped */
    const int *map_size;
    const double *splits;       /* count + 1 ascending view depths [m] */
    bool first_map;             /* selection by map or frustum; otherwise by the slice */
    double border_texels;       /* of a map that must stay free */
    double tolerance_texels;    /* misses up to this are none */
    const double *scene_bounds; /* slices are cut to it, casters lie in it; or NULL */
    const double *receivers;    /* receiver_count x 3 world: they alone are judged; or NULL */
    size_t receiver_count;
} csm_coverage_desc;

#define CSM_GAP_POINTS 8

typedef struct csm_coverage_worst {
    double amount;   /* -INFINITY: nothing to judge */
    double point[3]; /* world [m] */
} csm_coverage_worst;

/* Of a cascade's slice: its part of the view frustum, cut to the bounds, or its receivers. */
typedef struct csm_coverage {
    csm_coverage_worst overflow; /* [texels] outside its own map less the border; < 0 spare */
    csm_coverage_worst before;   /* [m] before the near end of the depth range; < 0 spare */
    csm_coverage_worst behind;   /* [m] behind the far end; < 0 spare */
    csm_coverage_worst caster;   /* [m] what the bounds hold over the slice before the near end */
    double gap_texels;           /* how far what no map holds lies outside the slice's own map */
    double gap_share;            /* of the slice's volume, or of its receivers */
    int gap_point_count;
    double gap_points[CSM_GAP_POINTS][3];     /* world, of the largest pieces */
    double tolerance_texels, tolerance_depth; /* misses up to these are none; depth [m] */
    double utilisation; /* share of texels whose column meets the slice (selection by first map:
                           the view from the slice on) */
    double overlap[CSM_MAX_CASCADES]; /* share of this slice that each map holds */
    double texels_per_pixel[2];       /* lowest, highest: pixel over texel, both at the point */
    double to_light[3];               /* direction of the columns, towards smaller depth */
    bool mirrored;                    /* the map shows the world as a mirror does */
    double texel_size[2];             /* [m] along the map's x and y, at its centre */
    double depth_span;                /* [m] along the light */
    size_t receiver_count;            /* visible ones of the slice */
} csm_coverage;

/* Measures every cascade. Under first_map, what no map holds is a gap where it lies outside the
 * sides of the slice's own map, and else what before and behind speak of. Otherwise only receivers
 * beyond the last split are gaps. Fails on splits, sizes or matrices that are none. */
csm_status csm_coverage_measure(const csm_coverage_desc *desc, csm_coverage out[CSM_MAX_CASCADES],
                                csm_error *err);

/* What happened to the texel grid between two frames, seen from fixed points of the world. */
typedef struct csm_grid_move {
    double texel_size[2][2]; /* before and after, along x and y [m] */
    double texels;           /* farthest that a point moved from its place within a texel */
    double depth;            /* [m] largest change of a point's distance from the near end */
    double depth_quanta[3];  /* from whole quanta of 16, of 24 bits, of float32's upper half */
    double rounding_texels, rounding_depth; /* depth as a share of the range */
} csm_grid_move;

/* Of one cascade, from the corners of a slice of the view before the move. */
csm_status csm_coverage_move(const csm_camera *camera, double near_depth, double far_depth,
                             const double before[16], int size_before, const double after[16],
                             int size_after, csm_grid_move *out, csm_error *err);

/* ------------------------------------------------------------------------------------------------
 * 12. Coarse pictures: what a small frame and its maps show, for recommendations
 */

/* height x width of the camera, row 0 on top; a byte of valid, facing, judged and lit is 0 or 1. */
typedef struct csm_coarse_picture {
    const csm_camera *camera;
    const float *view_depth;  /* [m] */
    const float (*normal)[3]; /* world; csm_coarse_edges and _receivers alone read them */
    const uint8_t *valid;     /* whether a surface is seen; csm_coarse_plane_ends alone reads it */
    const uint8_t *facing;    /* ... that faces the sun */
    const uint8_t *judged;    /* ... and has a cascade; csm_coarse_edges alone reads both */
    const uint8_t *lit;
    const uint8_t *cascade; /* 255: none; csm_coarse_receivers alone reads it */
} csm_coarse_picture;

/* Arrays of a frame, one element per pixel. */
typedef struct csm_coarse_shown {
    size_t pixels;
    const uint8_t *valid;
    const float (*normal)[3]; /* world */
    const float *mask;
    const uint8_t *cascade;
    int cascade_count;
    double to_light[3];
    double least_cosine; /* of what faces the sun */
    double least_lit;    /* of a mask that counts as lit */
} csm_coarse_shown;

/* What they show: bytes of every pixel as in csm_coarse_picture, of the caller's, and how many. */
typedef struct csm_coarse_read {
    uint8_t *facing;
    uint8_t *judged, *lit; /* NULL: neither, nor what follows from them; mask and cascade unread */
    size_t seen_count, facing_count, shadowed_count;
    size_t of_cascade[CSM_MAX_CASCADES]; /* facing the sun */
} csm_coarse_read;

void csm_coarse_look(const csm_coarse_shown *shown, csm_coarse_read *out);

/* Judged pixels that are lit in one of two pictures alone. */
size_t csm_coarse_changed(size_t pixels, const uint8_t *judged, const uint8_t *one,
                          const uint8_t *other);

#define CSM_COARSE_RECEIVERS 2000

/* Pixels of a picture that face the sun, and how many of so many are taken as receivers: each of
 * them, or every second, third, ... */
size_t csm_coarse_facing_count(const csm_coarse_picture *picture);
size_t csm_coarse_receiver_count(size_t facing);

/* What receivers are seen by: the way to the light, two axes across it, and the least cosine that
 * counts. */
typedef struct csm_coarse_light {
    double to_light[3], axes[2][3], least_cosine;
} csm_coarse_light;

/* Arrays of the caller's, one element per receiver. */
typedef struct csm_coarse_receiver_arrays {
    double (*point)[3]; /* world */
    double *depth;      /* [m] */
    double *slope;      /* tangent of its normal's angle to the light */
    double *gradient;   /* sum of how much deeper it gets along either axis [m/m] */
    uint8_t *cascade;
    uint8_t *dark;
} csm_coarse_receiver_arrays;

/* Them, of so many pixels that face the sun. */
void csm_coarse_receivers(const csm_coarse_picture *picture, size_t facing,
                          const csm_coarse_light *light, const csm_coarse_receiver_arrays *out);

#define CSM_OUTLINE_SLICES 12
#define CSM_OUTLINE_DIRECTIONS 16
#define CSM_OUTLINE_MAX (CSM_OUTLINE_SLICES * CSM_OUTLINE_DIRECTIONS)

#define CSM_COARSE_EDGES 3000

/* Arrays of the caller's, one element per edge. */
typedef struct csm_coarse_edge_arrays {
    int64_t *row, *column; /* of the dark pixel */
    double (*point)[3];    /* world, of its surface */
    double (*normal)[3];
    double (*across)[2]; /* unit, which way it gets lighter in the picture, right and down */
    double *length;      /* [pixels of the full picture] */
} csm_coarse_edge_arrays;

/* Pairs of neighbouring judged pixels of which one is lit, along rows and along columns. */
size_t csm_coarse_edge_pairs(const csm_coarse_picture *picture);

/* How many of so many pairs are looked at: each of them, or every second, third, ... */
size_t csm_coarse_edge_count(size_t pairs);

/* These. shrink: pixels of the full picture along one of this. */
csm_status csm_coarse_edges(const csm_coarse_picture *picture, double shrink, size_t pairs,
                            const csm_coarse_edge_arrays *out, csm_error *err);

/* A plane that goes on past its last coarse pixel along a row or column, before the next one. */
typedef struct csm_plane_end {
    double point[3], depth; /* of the last pixel of the full picture that sees it */
    double last, step;   /* what is linear in the picture: at the coarse pixel, and to the next */
    int place, crossing; /* of the coarse pixel: along the way, and across it */
    int first, reach;    /* pixels of the full picture that see it, counted from the coarse one */
} csm_plane_end;

#define CSM_PLANE_WAYS 4 /* down, up, right, left */

/* Where planes end between the pixels of a coarse picture. */
typedef struct csm_plane_ends {
    csm_camera full, small;
    csm_plane_end *ends; /* way by way; malloc */
    size_t starts[CSM_PLANE_WAYS + 1];
    bool horizon;       /* whether any plane reaches its horizon against the sky */
    int horizon_box[4]; /* coarse pixels there: first row and column, and those after the last */
} csm_plane_ends;

/* They go on as far as the bounds {min, max}, in which what is seen lies, and before what is seen
 * next. A plane's inverse depth is linear in the picture (an orthographic camera's depth), so three
 * pixels in a line say whether it is one and where it goes on. An orthographic camera has no
 * horizon. Free the result with csm_plane_ends_free. */
csm_status csm_coarse_plane_ends(const csm_camera *full, const csm_coarse_picture *picture,
                                 const double bounds[6], csm_plane_ends *out, csm_error *err);
void csm_plane_ends_free(csm_plane_ends *ends);

/* Points of the world that all pixels of the full picture see there; their number, out may be
 * NULL. */
size_t csm_plane_end_points(const csm_plane_ends *ends, double (*out)[3]);

/* What windows must reach to: of each of 12 slices of view depth, in equal ratios, the outermost
 * points in 16 directions across the light. Points are those of the pictures' facing pixels and
 * those past the ends of planes of the first one (or NULL: of none); all cameras share eye and
 * direction. In the order in which they were met, each once; returns their number. */
size_t csm_coarse_outline(const csm_coarse_picture *pictures, int picture_count,
                          const csm_plane_ends *ends, const double light_axes[2][3],
                          double out[CSM_OUTLINE_MAX][3]);

/* The maps of a coarse frame: square, row 0 at the bottom, depths 0 to 1, 1 where nothing is. */
typedef struct csm_coarse_maps {
    int count;
    const float *depths[CSM_MAX_CASCADES];
    int size[CSM_MAX_CASCADES];
    const double (*uvz_from_world)[16];
    double texel[CSM_MAX_CASCADES]; /* longest side of one [m] */
    double span[CSM_MAX_CASCADES];  /* of depths, along the light [m] */
} csm_coarse_maps;

#define CSM_COARSE_MAP_MIN 5 /* texels along a side, as many as the widest look takes */

/* Share of the texels of outlines that have something farther off on both sides, within two texels
 * along u or along v; maps go on beyond their border at the opposite one. */
double csm_coarse_thin_share(const csm_coarse_maps *maps);

/* Points of the world and the cascade that each is looked up in; those of no map count for none. */
typedef struct csm_coarse_points {
    const double (*point)[3];
    const double (*normal)[3]; /* csm_coarse_blockers alone reads them */
    const uint8_t *cascade;
    const uint8_t *dark; /* csm_coarse_gaps alone reads it */
    size_t count;
} csm_coarse_points;

/* From dark points to what the map holds before them, along the light [m]; INFINITY for others. */
void csm_coarse_gaps(const csm_coarse_maps *maps, const csm_coarse_points *points, double *out);

/* From points at the dark side of edges to their occluders [m]: the middle of the nearest and the
 * farthest of 3 x 3 texels; half a texel where there are none, 0 for those of no map. */
void csm_coarse_blockers(const csm_coarse_maps *maps, const csm_coarse_points *points, double *out);

/* Share of the points with an occluder in each of 5 x 5 texels, whose depths' mean and variance
 * would let through more than a tenth of the light [Lauritzen2007]; 0 of none. */
double csm_coarse_layered_share(const csm_coarse_maps *maps, const csm_coarse_points *points);

/* Percentiles 0 to 100 of values, linear between the nearest two; NAN counts as greatest. 0 of
 * none. */
csm_status csm_percentiles(size_t count, const double *values, size_t at_count, const double *at,
                           double *out, csm_error *err);

#define CSM_COARSE_BINS 24

/* How many positive depths [m] lie in each of 24 intervals from the nearest to the farthest, in
 * equal ratios; each begins at its edge. Of none the edges are 1. */
void csm_depth_histogram(size_t count, const double *depths, double edges[CSM_COARSE_BINS + 1],
                         int64_t counts[CSM_COARSE_BINS]);

/* How a step of one along either of two coordinates, the other staying, moves points of a surface
 * in the picture: [right or down][coordinate], in pixels. gradients: of the coordinates, per metre.
 * csm/sampling.py has its own, for what judges. */
void csm_surface_steps(const csm_camera *camera, size_t count, const double (*points)[3],
                       const double (*normals)[3], const double gradients[2][3],
                       double (*out)[2][2]);

/* ------------------------------------------------------------------------------------------------
 * 13. Forecasts: what windows make of a coarse view (docs/recommendation.md)
 *
 * csm/arrangements.py, csm/forecasts.py and csm/caster_load.py say what the figures mean.
 */

/* What a camera sees, coarsely: receivers, then points on shadow edges, then others that windows
 * must hold; each of these in the order of view depth. */
enum { CSM_SEEN_RECEIVERS, CSM_SEEN_EDGES, CSM_SEEN_OTHERS, CSM_SEEN_KINDS };

typedef struct csm_coarse_view {
    const double *points;        /* world [m], x 3 */
    const double *depths;        /* view depths [m], ascending within each kind */
    size_t ends[CSM_SEEN_KINDS]; /* of each kind of points */
    const double *gradients;     /* of receivers: what a bias is made of [m/m] */
    double axes[2][3];           /* unit, across the light */
    const double *steps_across;  /* of edges, x 2: how far a metre along each axis leads across
                                    an edge [pixels] */
    const double *lengths;       /* of edges [pixels] */
} csm_coarse_view;

/* Any windows of parallel light, and which of them answers for a point. */
typedef struct csm_arrangement {
    int count;
    const double (*uvz_from_world)[16];
    const double *splits;         /* count + 1 ascending view depths [m] */
    const double *sides;          /* count: longer side of each window [m] */
    bool by_interval;             /* the slice that holds the point; otherwise the first map */
    double bias_texels, steepest; /* of a bias: texels, and the largest gradient */
    double most_moved;            /* cap of displacements that are summed up [pixels] */
} csm_arrangement;

/* By maps of one texel: sizes divide it. The arrays are the caller's. */
typedef struct csm_arranged {
    double *moved, *reach;                /* of edges: displacement, and how far across them a disc
                                             as wide as the map reaches [pixels] */
    int *edge_cascade, *receiver_cascade; /* which window answers */
    double *receiver_bias;                /* along the light [m] */
} csm_arranged;

/* INVALID_ARGUMENT if a window does not spread over both axes where an edge takes it. */
csm_status csm_arrange(const csm_coarse_view *view, const csm_arrangement *windows,
                       csm_arranged *out, csm_error *err);

/* Of each window the lengths of its edges times their displacements [pixels²], and whether points
 * lie between its splits. */
csm_status csm_sum_displaced(const csm_coarse_view *view, const csm_arrangement *windows,
                             double out_displaced[CSM_MAX_CASCADES],
                             bool out_held[CSM_MAX_CASCADES], csm_error *err);

/* Values at points under maps of several sizes. sides: size_count x columns; with one column all
 * windows have it, else point i takes column window[i], which must be one. What is said of a size
 * hangs on no other size, to the bit. */
typedef struct csm_sized {
    size_t point_count, size_count, columns;
    const int *window;
    const double *sides;
} csm_sized;

/* For each size the sum of weights[i] * min(values[i] / side, most). */
csm_status csm_sum_capped(const csm_sized *sized, const double *values, const double *weights,
                          double most, double *out, csm_error *err);

/* For each size the sum of weights[i] * max(wide[i] - values[i] / side, 0). */
csm_status csm_sum_missing(const csm_sized *sized, const double *values, const double *wide,
                           const double *weights, double *out, csm_error *err);

/* For each size how many of gaps[i] are less than values[i] / side. */
csm_status csm_count_less(const csm_sized *sized, const double *gaps, const double *values,
                          int64_t *out, csm_error *err);

/* The least q >= 0 for which the sum of weights[i] * max(wide[i] - q * values[i], 0) is at most
 * allowed >= 0; nothing is negative. Values below 1e-12 count as that. */
double csm_least_part(size_t count, const double *values, const double *wide, const double *weights,
                      double allowed);

/* Triangles across the light, each as the box that it fills in the plane of two axes [m]. */
typedef struct csm_casters {
    double axes[2][3];
    size_t count;
    const double *centre, *half; /* count x 2 */
    const double *area;          /* positive towards the light [m²] */
    const bool *cut;             /* has a cut-out */
    const double *weight;        /* triangles that it stands for */
} csm_casters;

/* What they lay on a map. Kinds: facing the light or not (2), without and with a cut-out. */
typedef struct csm_caster_load {
    double layers[4], lines[4]; /* how often the map is covered, and how often outlines cross it */
    double triangles, needed;   /* over the map, and of those not within an earlier one */
} csm_caster_load;

/* On maps without a warp. */
void csm_casters_load(const csm_casters *casters, int count, const double (*uvz_from_world)[16],
                      csm_caster_load *out);

/* The first map that the box of each one meets; count where none does. */
void csm_casters_first(const csm_casters *casters, int count, const double (*uvz_from_world)[16],
                       int *out);

/* Triangles, as they lie across the light. */
typedef struct csm_sample {
    size_t count;
    const double *along[2]; /* 3 x count each: their first corners, their second, their third [m] */
    const double *side;     /* -1 where mirrored, else 1 */
} csm_sample;

/* Boxes and areas as of csm_casters. The axes and the way to the light are a right-handed basis. */
void csm_casters_across(const csm_sample *sample, double (*centre)[2], double (*half)[2],
                        double *area);

#define CSM_KEPT_MOST 300   /* of each class of casters */
#define CSM_KEPT_LARGEST 75 /* of those, that count for none but themselves */

/* Casters that are kept; room for CSM_KEPT_MOST of every map and as many more. */
typedef struct csm_kept {
    size_t count;
    int64_t *number;
    double *weight; /* how many of its class each of them stands for */
} csm_kept;

/* Fewer of them, so that each of some maps keeps enough. Classed by the first map that they meet;
 * of each class the largest, and of the others, sorted by area, every so manieth. All of a class of
 * few, in order. No weight is read. */
csm_status csm_casters_thinned(const csm_casters *casters, int count,
                               const double (*uvz_from_world)[16], csm_kept *out, csm_error *err);

#endif
