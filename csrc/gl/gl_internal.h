/* gl_internal.h: the private structs of csrc/gl. Every function below runs with the renderer's lock
 * held and its context current, unless it says otherwise. */
#ifndef CSM_GL_INTERNAL_H
#define CSM_GL_INTERNAL_H

#include "csm.h"

#include <glad/gl.h>
#include <pthread.h>
#include <sys/types.h>

typedef void (*csm_gl_function)(void);

/* -- context.c: one interface over three back ends
 * ------------------------------------------------- */

typedef struct csm_context {
    int backend;
    char platform[64];
    void *display, *handle; /* EGLDisplay + EGLContext, OSMesaContext, GLFWwindow */
    void *pixels;           /* OSMesa draws its default framebuffer into memory of ours */
} csm_context;

typedef struct csm_backend {
    csm_status (*open)(csm_context *context, bool debug, csm_error *err);
    bool (*bind)(csm_context *context);   /* false: the driver refused */
    void (*unbind)(csm_context *context); /* leaves no context current */
    void (*close)(csm_context *context);
    csm_gl_function (*load)(const char *name); /* valid after open */
} csm_backend;

extern const csm_backend csm_backend_egl, csm_backend_osmesa, csm_backend_glfw;

/* Whatever context the calling thread had before ours: somebody else's stays theirs. */
typedef struct csm_saved_binding {
    void *egl_display, *egl_draw, *egl_read, *egl_context;
    void *glx_display, *glx_context;
    unsigned long glx_drawable;
    void *osmesa_context, *osmesa_pixels;
    int osmesa_width, osmesa_height;
} csm_saved_binding;

/* context_saved.c. Also releases it, so that any back end can bind. */
void csm_binding_save(csm_saved_binding *saved);
void csm_binding_restore(const csm_saved_binding *saved);

csm_status csm_context_open(csm_context *context, int backend, bool debug, csm_error *err);
bool csm_context_bind(csm_context *context);
void csm_context_unbind(csm_context *context);
void csm_context_close(csm_context *context);
csm_gl_function csm_context_load(int backend, const char *name);

/* Opens the first library of the list that loads (names end with NULL); the reason it does not goes
 * to err. The library stays open: drivers do not survive being unloaded. */
void *csm_library_open(const char *const *names, csm_error *err);

typedef struct csm_library_function {
    const char *name;
    void **slot;
} csm_library_function;

/* Fills every slot, or says which function the library lacks. */
csm_status csm_library_functions(void *library, const char *library_name,
                                 const csm_library_function *functions, size_t count,
                                 csm_error *err);

/* -- debug.c: KHR_debug into a ring ---------------------------------------------------------------
 */

#define CSM_RING_SIZE 64
#define CSM_MESSAGE_SIZE 400

typedef struct csm_message {
    GLuint id;
    GLenum severity;
    char text[CSM_MESSAGE_SIZE];
} csm_message;

typedef struct csm_message_ring {
    csm_message messages[CSM_RING_SIZE];
    int first, count;
    bool failed;                  /* an error arrived since the last check */
    char error[CSM_MESSAGE_SIZE]; /* the first one */
} csm_message_ring;

/* -- program.c ------------------------------------------------------------------------------------
 */

typedef struct csm_program {
    uint64_t key;
    GLuint name;
} csm_program;

/* -- target.c -------------------------------------------------------------------------------------
 */

enum {
    CSM_TARGET_VIEW_IDS,
    CSM_TARGET_VIEW_DEPTH,
    CSM_TARGET_SHADOW_MAPS,
    CSM_TARGET_SEPARATE, /* first of as many as there are cascades */
    CSM_TARGET_SHADOW_TILE = CSM_TARGET_SEPARATE + CSM_MAX_CASCADES,
    CSM_TARGET_SHADOW_SAMPLES,
    CSM_TARGET_SHADOW_SCROLL,
    CSM_TARGET_MOMENTS,
    CSM_TARGET_MOMENTS_BETWEEN,
    CSM_TARGET_COUNT
};

typedef struct csm_target {
    csm_plan_texture wanted;
    GLuint texture;
} csm_target;

/* Buffers the passes write, or maps are read into, and the host reads: one per kind of output. */
enum {
    CSM_BUFFER_MASK,
    CSM_BUFFER_INDEX, /* cascade index in bits 0 to 7, valid in bit 8 */
    CSM_BUFFER_DEPTH,
    CSM_BUFFER_NORMAL,
    CSM_BUFFER_POINTS,
    CSM_BUFFER_RECEIVER_BOUNDS,
    CSM_BUFFER_RECEIVER_RANGE,
    CSM_BUFFER_MASK_SINGLE,
    CSM_BUFFER_MAPS,
    CSM_BUFFER_COUNT
};

typedef struct csm_host_buffer {
    GLuint name; /* what passes write */
    GLuint host; /* what is mapped; the same buffer on software GL, and of maps */
    GLsizeiptr size;
    GLsizeiptr used; /* of this frame */
    const void *mapped;
} csm_host_buffer;

/* -- timer.c --------------------------------------------------------------------------------------
 */

typedef struct csm_timer {
    bool queries; /* timer queries on hardware, wall clock around glFinish on software */
    GLuint query;
    double start_ms;
} csm_timer;

/* -- mesh.c ---------------------------------------------------------------------------------------
 */

struct csm_gpu_scene {
    csm_geometry geometry; /* chunks and items for culling; vertex arrays are freed after upload */
    double origin[3];
    GLuint positions, indices, planes, instances, vertex_array;
    GLuint cutout_vertices, cutouts, cutout_texture; /* 0 unless a mesh has a cut-out */
    GLuint plane_texture; /* planes as a buffer texture: half the cost of a storage buffer on
                             software */
    uint64_t bytes;
    struct csm_gpu_scene *next;
};

/* What the passes of a frame draw, one behind the other: made once, and larger where it must be. */
typedef struct csm_draw_buffer {
    GLuint name;
    GLsizeiptr size, used;
} csm_draw_buffer;

/* What one pass draws: commands in a buffer; the row of each drawn instance, if the scene has any.
 */
typedef struct csm_draw_list {
    csm_draw_buffer commands, instances;
    GLintptr first_command, first_instance; /* of this pass [bytes] */
    GLsizei command_count;
    GLsizei solid_count;                    /* commands before the first of a mesh with a cut-out */
    struct csm_draw_command *host_commands; /* the same, to cut batches by */
    int item_count;
    int64_t triangle_count;
} csm_draw_list;

/* -- the uniform block of shaders/include/frame.glsl
 * ----------------------------------------------- */

typedef struct csm_frame_uniforms {
    float light_from_origin[3][4]; /* rows; w unused */
    float eye_high[4], eye_low[4]; /* the eye relative to the origin, in two floats a coordinate */
    float right[4], up[4], backward[4]; /* right w: 1 for an orthographic camera */
    float to_light[4];
    float clip_from_eye[4][4]; /* columns; reversed depth, for the view pass alone */
    float view[4];             /* half width, half height, near, far */
    int32_t image[4];          /* width, height, first row of the band, number of points */
    float bias[4]; /* slope, normal offset [texels]; border of the kernel [texels]; roundings */
    float window[CSM_MAX_CASCADES][4]; /* texels per metre in x, y; phase in x, y [texels] */
    float centre[CSM_MAX_CASCADES]
                [4]; /* of the window in lattice texels; texels of its half side, side */
    float depth[CSM_MAX_CASCADES]
               [4]; /* scale, offset of z; constant bias [depth]; larger texel [m] */
    float slope[CSM_MAX_CASCADES][4];   /* depth per texel at a gradient of 1 in x, y; far view
                                           depth; least depth per texel that a bias takes */
    float clip[CSM_MAX_CASCADES][4];    /* light x, y to clip x, y: scale, offset */
    float turn[CSM_MAX_CASCADES][4];    /* cosine, sine of its axes against those of light space */
    float normal_from_origin[3][4];     /* rows: normals to light space, where it is skewed */
    float view_centre[4];               /* x, y of the picture's centre, in the units of view.xy;
                                           view depth of the first split; most lookups along a
                                           footprint */
    int32_t place[CSM_MAX_CASCADES][4]; /* x, y of the map in what holds it [texels]; layer */
    float kernel[CSM_MAX_CASCADES][4];  /* half width in x, y [texels] */
    float width[4];   /* half of filter_size [texels]; half width [m], and a part of it per metre
                         of view depth; least half width [texels] */
    float blend[4];   /* share of half a map; depth where shadows end; 1 / width of the fade;
                         tangent of the sun's angular radius */
    float moments[4]; /* exponents of the positive and negative warp; least variance; bias */
    float bleed[4];   /* step; 1 / (1 - step); power; steps of summed areas to the range */
} csm_frame_uniforms;

_Static_assert(sizeof(csm_frame_uniforms) ==
                   16 * (3 + 2 + 3 + 1 + 4 + 3 + 3 + 1 + 4) + 8 * 16 * CSM_MAX_CASCADES,
               "std140 of frame.glsl has no padding");

/* The block of shaders/include/warp.glsl, there only under a warp. */
typedef struct csm_warp_uniforms {
    float along_x[CSM_MAX_CASCADES][4]; /* light x, y to local x: two factors, offset */
    float along_y[CSM_MAX_CASCADES][4];
    float across[CSM_MAX_CASCADES][4]; /* clip x w of local x, y, 1; bias constant in texels */
    float rows[CSM_MAX_CASCADES][4];   /* clip y w, then w, of local y and 1 */
    float metres[CSM_MAX_CASCADES][4]; /* light x, y [m] of a step in local x, then in local y */
} csm_warp_uniforms;

_Static_assert(sizeof(csm_warp_uniforms) == 5 * 16 * CSM_MAX_CASCADES,
               "std140 of warp.glsl has no padding");

/* -- renderer.c -----------------------------------------------------------------------------------
 */

/* What the last render left, for csm_renderer_visibility: its maps stay in the targets, its warps
 * in the renderer. */
typedef struct csm_last_render {
    bool done;            /* false before the first render, and after one that failed */
    bool whole;           /* maps are there, and hold what shadows any point */
    csm_gpu_scene *scene; /* NULL once it is dropped */
    double origin[3];     /* of the scene */
    csm_camera camera;
    double angular_diameter;
    csm_settings settings; /* canonical */
    unsigned outputs;
    csm_cascades cascades;
    csm_frame_uniforms uniforms;
} csm_last_render;

/* -- kept_maps.c ----------------------------------------------------------------------------------
 */

/* What the maps in the targets hold, from a render that may reuse them to the next. */
typedef struct csm_kept_maps {
    const csm_gpu_scene *scene;
    csm_settings settings; /* canonical */
    bool held[CSM_MAX_CASCADES];
    csm_map_content content[CSM_MAX_CASCADES];
    uint32_t *items[CSM_MAX_CASCADES]; /* of content */
} csm_kept_maps;

/* What the view's targets show. */
typedef struct csm_kept_view {
    const csm_gpu_scene *scene; /* NULL: nobody knows */
    csm_camera camera;
    int items_drawn;
} csm_kept_view;

/* What a frame does for one of its maps. */
typedef struct csm_map_work {
    csm_map_content wanted;
    csm_reuse reuse;
    uint32_t *lists; /* items wanted, and those of the parts */
} csm_map_work;

struct csm_renderer {
    pthread_mutex_t lock;
    pid_t owner; /* a context does not survive fork */
    bool debug;
    csm_read_callback read;
    void *read_user;
    csm_context context;
    GladGLContext gl;
    csm_renderer_info info;
    csm_message_ring ring;
    csm_program *programs;
    int program_count;
    csm_target targets[CSM_TARGET_COUNT];
    csm_host_buffer buffers[CSM_BUFFER_COUNT];
    GLuint points_in;
    GLsizeiptr points_in_size;
    GLuint frame_uniforms, warp_uniforms; /* the second from a warped frame to the next frame */
    GLuint view_framebuffer, map_framebuffer, filter_framebuffer;
    GLuint nearest_sampler, compare_sampler, moments_sampler;
    GLuint no_vertices; /* vertex array of passes that cover all pixels with one triangle */
    csm_timer timer;
    csm_draw_list draws;
    csm_gpu_scene *scenes;
    csm_last_render last;
    csm_kept_maps kept;
    csm_kept_view view;
};

/* What the passes of one frame share. */
typedef struct csm_frame {
    csm_renderer *renderer;
    const csm_render_desc *desc;
    csm_render_out *out;
    csm_settings settings; /* canonical */
    double origin[3];      /* of the scene: points on the GPU are relative to it */
    csm_plan plan;
    csm_place places[CSM_MAX_CASCADES]; /* of the maps in what holds them */
    csm_moments moments;
    csm_receivers receivers; /* what the passes over the pixels summed up; arrays are mapped */
    csm_frame_uniforms uniforms;
    csm_map_work *work; /* one per cascade, where maps may be reused and are chosen; else NULL */
} csm_frame;

/* debug.c */
void csm_debug_start(csm_renderer *renderer);
void csm_debug_label(csm_renderer *renderer, GLenum kind, GLuint name, const char *label);
void csm_debug_push(csm_renderer *renderer, const char *pass);
void csm_debug_pop(csm_renderer *renderer);
csm_status csm_debug_check(csm_renderer *renderer, const char *pass, csm_error *err);

/* program.c: *out_name is the linked program of a pass, compiled on first use. */
csm_status csm_program_get(csm_frame *frame, csm_pass pass, GLuint *out_name, csm_error *err);
/* The same for a pass that draws triangles: of meshes without a cut-out, then with. */
csm_status csm_program_get_drawing(csm_frame *frame, csm_pass pass, GLuint out_names[2],
                                   csm_error *err);
void csm_programs_drop(csm_renderer *renderer);

/* target.c */
GLenum csm_format_named(const char *name);
csm_status csm_targets_fit(csm_renderer *renderer, const csm_plan *plan, csm_error *err);
void csm_targets_drop(csm_renderer *renderer);
csm_status csm_host_buffer_fit(csm_renderer *renderer, int kind, size_t size, csm_error *err);
void csm_host_buffers_fetch(csm_renderer *renderer);
GLuint csm_buffer_make(csm_renderer *renderer, const char *label, GLsizeiptr size, const void *data,
                       GLbitfield flags);
void csm_buffer_drop(csm_renderer *renderer, GLuint *name);

/* mesh.c */
csm_status csm_gpu_scene_make(csm_renderer *renderer, const csm_geometry *geometry,
                              const double origin[3], csm_gpu_scene **out, csm_error *err);
void csm_gpu_scene_destroy(csm_renderer *renderer, csm_gpu_scene *scene);
/* After a frame: its buffers go where they may have a size and no memory. */
void csm_draw_list_distrust(csm_renderer *renderer, csm_status status);
/* Before the first list of a frame. */
void csm_draw_list_begin(csm_renderer *renderer, const csm_gpu_scene *scene);
csm_status csm_draw_list_fill(csm_renderer *renderer, const csm_gpu_scene *scene,
                              const uint32_t *items, size_t item_count, csm_error *err);
csm_status csm_draw_list_submit(csm_frame *frame, const csm_gpu_scene *scene,
                                const GLuint programs[2], csm_error *err);
void csm_draw_list_drop(csm_renderer *renderer);

/* uniforms.c */
void csm_frame_write_view(csm_frame *frame);
void csm_frame_write_light(csm_frame *frame); /* light axes and splits, of out->cascades */
void csm_frame_write_cascades(csm_frame *frame);
void csm_frame_write_warps(const csm_frame *frame, csm_warp_uniforms *out);

/* timer.c */
void csm_timer_start(const csm_frame *frame);
void csm_timer_stop(const csm_frame *frame, const char *name);
double csm_clock_ms(void);

/* What a fit reads of the frame; settings is where its choices are kept. */
csm_cascades_desc csm_frame_fit_desc(const csm_frame *frame, csm_settings *settings);
void csm_frame_upload_uniforms(csm_frame *frame);

/* pass_*.c */
csm_status csm_pass_receiver_range(csm_frame *frame, csm_error *err);
csm_status csm_pass_receiver_bounds(csm_frame *frame, csm_error *err);
void csm_bind_view_inputs(csm_frame *frame);
csm_status csm_pass_view(csm_frame *frame, csm_error *err);
csm_status csm_pass_shadow_map(csm_frame *frame, int cascade, csm_error *err);
csm_status csm_pass_shadow_mask(csm_frame *frame, csm_error *err);
csm_status csm_pass_shadow_forward(csm_frame *frame, csm_error *err);
csm_status csm_pass_shadow_points(csm_frame *frame, csm_error *err);

/* pass_shadow_filter.c */
void csm_cover_pixels(csm_renderer *renderer); /* one triangle over the whole viewport */
csm_status csm_pass_shadow_moments(csm_frame *frame, int cascade, csm_error *err);
csm_status csm_pass_shadow_blur(csm_frame *frame, int cascade, csm_error *err);
csm_status csm_pass_shadow_sum(csm_frame *frame, int cascade, csm_error *err);
csm_status csm_pass_shadow_mips(csm_frame *frame, csm_error *err);
csm_status csm_moments_read(csm_frame *frame, int cascade, float *out, csm_error *err);

/* kept_maps.c: no map is held any more, or the view is not. */
void csm_kept_forget(csm_renderer *renderer);
void csm_kept_forget_view(csm_renderer *renderer);
/* Whether the view's targets show what this frame would draw, and it may be kept. */
bool csm_kept_shows(const csm_frame *frame);
/* Chooses, once cascades are placed, what is drawn of each map. */
csm_status csm_kept_choose(csm_frame *frame, csm_error *err);
void csm_kept_finish(csm_frame *frame);
/* Whether the map of a cascade, and what is made of it, stays as it is. */
bool csm_kept_whole(const csm_frame *frame, int cascade);
/* Before a map is touched: nobody knows what is in it. After: it holds what was wanted. */
void csm_kept_begin(csm_frame *frame, int cascade);
csm_status csm_kept_note(csm_frame *frame, int cascade, csm_error *err);
/* Moves the part of a map that the last window holds too. */
void csm_kept_scroll(csm_frame *frame, int cascade);

/* pass_shadow_map.c: casters of a cascade, ascending, into out_items (room for all). */
void csm_casters_cull(csm_frame *frame, int cascade, uint32_t *out_items, size_t *out_count);

/* pass_shadow_map.c: attaches the map of a cascade to the map framebuffer; the texture and place
 * casters are drawn into. */
csm_place csm_map_attach(csm_frame *frame, int cascade);

/* pass_shadow_mask.c: the textures that shaders/include/shadow_storage.glsl declares. */
void csm_bind_maps(csm_frame *frame);
/* The same for a pass over one map; returns which of those bound it is. */
int csm_bind_map(csm_frame *frame, int cascade);
void csm_bind_looked_up(csm_frame *frame); /* maps and moments */

/* pass_view.c: the draw list of what the camera may see; returns how many items. */
csm_status csm_view_draws_fill(csm_frame *frame, int *out_items, csm_error *err);

/* pass_shadow_mask.c: what both ways of making a mask read and write. */
void csm_mask_bind_inputs(csm_frame *frame);
csm_status csm_mask_bind_outputs(csm_frame *frame, csm_error *err);
/* Draws cover the picture and write nothing but buffers. */
void csm_no_attachment(csm_frame *frame);
void csm_mask_set_image(csm_frame *frame, int first, int points);

/* renderer.c: into a call and out of it. */
csm_status csm_renderer_enter(csm_renderer *renderer, csm_saved_binding *saved, csm_error *err);
void csm_renderer_leave(csm_renderer *renderer, const csm_saved_binding *saved);

/* Settings made canonical for the scene and renderer; plan, places and moments of them. */
csm_status csm_frame_plan(csm_frame *frame, unsigned outputs, csm_error *err);
csm_status csm_frame_run_step(csm_frame *frame, const csm_plan_step *step, csm_error *err);
void csm_frame_bind_uniforms(csm_frame *frame);
void csm_points_read(const csm_frame *frame);
bool csm_frame_stopped(const csm_frame *frame);
/* The same between batches: else the driver queues everything and a stop waits for all of it. */
bool csm_frame_stopped_after_finish(const csm_frame *frame);
csm_status csm_interrupted(csm_error *err);

#endif
