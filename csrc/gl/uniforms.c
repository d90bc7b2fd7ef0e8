/* uniforms.c: what the shaders of a frame are told: the one conversion from doubles to floats,
 * relative to the scene's fixed origin.
 */
#include "gl_internal.h"

#include <math.h>
#include <string.h>

static void to_floats(const double *from, int count, float *out) {
    for (int i = 0; i < count; i++) {
        out[i] = (float)from[i];
    }
}

/* Rotation and projection without the eye, which the shader subtracts; depth reversed: 1 - z. */
static void write_view(const csm_camera *camera, csm_frame_uniforms *uniforms) {
    double clip_from_view[16];
    const double *rows[3] = {camera->right, camera->up, camera->backward};
    csm_camera_clip_from_view(camera, clip_from_view);
    for (int column = 0; column < 4; column++) {
        clip_from_view[4 * column + 2] =
            clip_from_view[4 * column + 3] - clip_from_view[4 * column + 2];
    }
    for (int column = 0; column < 4; column++) {
        for (int row = 0; row < 4; row++) {
            double sum = column == 3 ? clip_from_view[12 + row] : 0.0;
            for (int axis = 0; axis < 3 && column < 3; axis++) {
                sum += clip_from_view[4 * axis + row] * rows[axis][column];
            }
            uniforms->clip_from_eye[column][row] = (float)sum;
        }
    }
    to_floats(camera->right, 3, uniforms->right);
    to_floats(camera->up, 3, uniforms->up);
    to_floats(camera->backward, 3, uniforms->backward);
    uniforms->right[3] = camera->orthographic ? 1.0f : 0.0f;
    to_floats((const double[4]){camera->half_width, camera->half_height, camera->near_depth,
                                camera->far_depth},
              4, uniforms->view);
    to_floats(camera->centre, 2, uniforms->view_centre);
}

/* Lattice texels are phase + light x / texel, counted from the lattice point below the scene's
 * origin: the phase is what the origin adds beyond whole texels, so that a point keeps its lattice
 * texels to the bit while only the window moves, and the window's whole texels are exact in a
 * float. */
static void write_cascade(const csm_frame *frame, int i, const csm_bias *bias,
                          csm_frame_uniforms *uniforms) {
    const csm_cascades *cascades = &frame->out->cascades;
    const double *origin = frame->origin;
    const double *light = cascades->light_from_world[i];
    const double *clip = cascades->clip_from_light[i];
    const double *texel = cascades->texel_size[i];
    bool snapped = frame->settings.effects[CSM_EFFECT_SNAP] != CSM_SNAP_NONE;
    double span = cascades->depth_range[i][1] - cascades->depth_range[i][0];
    double half_side = 0.5 * cascades->map_size[i];
    double largest = texel[0] > texel[1] ? texel[0] : texel[1];
    bool warped = frame->settings.effects[CSM_EFFECT_WARPED];
    double quantum = csm_depth_quantum(frame->settings.effects[CSM_EFFECT_DEPTH_FORMAT]);
    double origin_ls[3];
    for (int row = 0; row < 3; row++) {
        origin_ls[row] =
            light[row] * origin[0] + light[4 + row] * origin[1] + light[8 + row] * origin[2];
    }
    for (int axis = 0; axis < 2; axis++) {
        double texels = origin_ls[axis] / texel[axis];
        double corner = (-1.0 - clip[12 + axis]) / clip[5 * axis] / texel[axis]; /* clip is -1 */
        double whole = floor(texels);
        double lower = snapped ? (double)cascades->lattice[i][axis] : corner;
        uniforms->window[i][axis] = (float)(1.0 / texel[axis]);
        /* a free window's phase takes its corner along, so that its whole texels start there */
        uniforms->window[i][2 + axis] = (float)(snapped ? texels - whole : texels - lower);
        uniforms->centre[i][axis] = (float)((snapped ? lower - whole : 0.0) + half_side);
        uniforms->slope[i][axis] = (float)(texel[axis] / span);
        uniforms->clip[i][axis] = (float)clip[5 * axis];
        uniforms->clip[i][2 + axis] = (float)(clip[5 * axis] * origin_ls[axis] + clip[12 + axis]);
    }
    const double *base = cascades->light_from_world[0];
    uniforms->turn[i][0] = (float)(light[0] * base[0] + light[4] * base[4] + light[8] * base[8]);
    uniforms->turn[i][1] = (float)(light[0] * base[1] + light[4] * base[5] + light[8] * base[9]);
    uniforms->centre[i][2] = (float)half_side;
    uniforms->centre[i][3] = (float)cascades->map_size[i];
    uniforms->depth[i][0] = (float)(-1.0 / span);
    uniforms->depth[i][1] = (float)((-origin_ls[2] - cascades->depth_range[i][0]) / span);
    uniforms->depth[i][2] =
        (float)((warped ? 0.0 : bias->constant_texels * largest / span) + bias->quanta * quantum);
    uniforms->depth[i][3] = (float)largest;
    /* by hand a bias is in texels of the larger side; the automatic one is as small as each side
     * allows */
    bool manual = frame->settings.effects[CSM_EFFECT_BIAS] == CSM_BIAS_MANUAL;
    uniforms->slope[i][3] = manual ? (float)(largest / span) : 0.0f;
}

/* Half width of kernels: in texels, and in metres where it is constant in the world or on screen.
 */
typedef struct kernel_width {
    double most, least; /* [texels] */
    double metres, metres_per_depth;
} kernel_width;

/* The filter_size texels of the first cascade, or as many pixels: in an orthographic view of one
 * width, else of the receiver's depth. A box ends at one compare, what is centred on the point at
 * the bilinear mean of four. */
static kernel_width width_of(const csm_frame *frame) {
    const csm_camera *camera = &frame->desc->camera;
    const int *effects = frame->settings.effects;
    const double half = 0.5 * effects[CSM_EFFECT_FILTER_SIZE];
    const double *first = frame->out->cascades.texel_size[0];
    const bool box = effects[CSM_EFFECT_FILTER_WEIGHTS] == CSM_WEIGHTS_BOX;
    const double on_screen = half * 2.0 * camera->half_height / camera->height;
    const bool screen = effects[CSM_EFFECT_KERNEL] == CSM_KERNEL_SCREEN;
    return (kernel_width){
        .most = half,
        .least = fmin(box ? 0.5 : 1.0, half),
        .metres = !screen                ? half * fmin(first[0], first[1])
                  : camera->orthographic ? on_screen
                                         : 0.0,
        .metres_per_depth = screen && !camera->orthographic ? on_screen : 0.0,
    };
}

/* Where the map lies, and how wide its kernel is. */
static void write_kernel(const csm_frame *frame, int i, csm_frame_uniforms *uniforms) {
    const kernel_width kernel = width_of(frame);
    const double *texel = frame->out->cascades.texel_size[i];
    const bool world = frame->settings.effects[CSM_EFFECT_KERNEL] == CSM_KERNEL_WORLD;
    for (int axis = 0; axis < 2; axis++) {
        const double half = world ? kernel.metres / texel[axis] : kernel.most;
        uniforms->kernel[i][axis] = (float)fmax(kernel.least, fmin(half, kernel.most));
    }
    uniforms->place[i][0] = frame->places[i].x;
    uniforms->place[i][1] = frame->places[i].y;
    uniforms->place[i][2] = frame->places[i].layer;
}

static void write_filter(const csm_frame *frame, csm_frame_uniforms *uniforms) {
    const csm_cascades *cascades = &frame->out->cascades;
    const csm_settings *settings = &frame->settings;
    const double last = cascades->splits[cascades->count];
    const double fade = settings->fade_width * (last - cascades->splits[0]);
    const kernel_width kernel = width_of(frame);
    double exponents[2];
    csm_settings_exponents(settings, exponents);
    to_floats((const double[4]){settings->blend_width, last, fade > 0.0 ? 1.0 / fade : 0.0,
                                tan(0.5 * frame->desc->angular_diameter)},
              4, uniforms->blend);
    to_floats((const double[4]){exponents[0], exponents[1], csm_settings_least_variance(settings),
                                csm_settings_moment_bias(settings)},
              4, uniforms->moments);
    to_floats((const double[4]){kernel.most, kernel.metres, kernel.metres_per_depth, kernel.least},
              4, uniforms->width);
    uniforms->view_centre[3] = (float)settings->effects[CSM_EFFECT_ANISOTROPY];
    to_floats((const double[4]){settings->bleed_step, 1.0 / (1.0 - settings->bleed_step),
                                settings->bleed_power, frame->moments.sum_steps},
              4, uniforms->bleed);
}

void csm_frame_write_view(csm_frame *frame) {
    const csm_render_desc *desc = frame->desc;
    csm_frame_uniforms *uniforms = &frame->uniforms;
    memset(uniforms, 0, sizeof *uniforms);
    for (int axis = 0; axis < 3; axis++) {
        double eye = desc->camera.eye[axis] - frame->origin[axis];
        /* volatile: GCC 12 at -O3 pairs x with y and leaves the rounding of both out, so that the
         * rest became 0 */
        volatile float high = (float)eye;
        uniforms->eye_high[axis] = high;
        uniforms->eye_low[axis] = (float)(eye - (double)high);
    }
    write_view(&desc->camera, uniforms);
    uniforms->image[0] = desc->camera.width;
    uniforms->image[1] = desc->camera.height;
    to_floats(desc->to_light, 3, uniforms->to_light);
}

void csm_frame_write_light(csm_frame *frame) {
    const csm_cascades *cascades = &frame->out->cascades;
    csm_frame_uniforms *uniforms = &frame->uniforms;
    double normals[3][3];
    csm_light_normals(cascades, 0, normals);
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            uniforms->light_from_origin[row][column] =
                (float)cascades->light_from_world[0][4 * column + row];
            uniforms->normal_from_origin[row][column] = (float)normals[row][column];
        }
    }
    uniforms->view_centre[2] = (float)cascades->splits[0];
    for (int i = 0; i < cascades->count; i++) {
        uniforms->slope[i][2] = (float)cascades->splits[i + 1];
    }
}

void csm_frame_write_cascades(csm_frame *frame) {
    const csm_cascades *cascades = &frame->out->cascades;
    csm_frame_uniforms *uniforms = &frame->uniforms;
    csm_bias bias = csm_settings_bias(&frame->settings);
    to_floats((const double[4]){bias.slope_texels, bias.normal_offset_texels,
                                csm_settings_kernel_radius(&frame->settings),
                                bias.roundings * cascades->stretch},
              4, uniforms->bias);
    csm_frame_write_light(frame);
    for (int i = 0; i < cascades->count; i++) {
        write_cascade(frame, i, &bias, uniforms);
        write_kernel(frame, i, uniforms);
    }
    write_filter(frame, uniforms);
}

/* Local coordinates are those of csm_warp, from the scene's origin instead of the eye. */
void csm_frame_write_warps(const csm_frame *frame, csm_warp_uniforms *out) {
    const csm_cascades *cascades = &frame->out->cascades;
    const double *base = cascades->light_from_world[0];
    const csm_bias bias = csm_settings_bias(&frame->settings);
    memset(out, 0, sizeof *out);
    for (int i = 0; i < cascades->count; i++) {
        const csm_warp *warp = &cascades->warp[i];
        const double *light = cascades->light_from_world[i], *clip = warp->clip_from_local;
        for (int row = 0; row < 2; row++) {
            float *along = row == 0 ? out->along_x[i] : out->along_y[i];
            double offset = -warp->origin[row], turned[2] = {0.0, 0.0};
            for (int axis = 0; axis < 3; axis++) {
                const double here = light[4 * axis + row];
                offset += here * (frame->origin[axis] - frame->desc->camera.eye[axis]);
                turned[0] += here * base[4 * axis];
                turned[1] += here * base[4 * axis + 1];
            }
            for (int column = 0; column < 2; column++) {
                along[column] = (float)(turned[column] / warp->extent[row]);
                out->metres[i][2 * row + column] = (float)(turned[column] * warp->extent[row]);
            }
            along[2] = (float)(offset / warp->extent[row]);
        }
        to_floats((const double[4]){clip[0], clip[4], clip[12], bias.constant_texels}, 4,
                  out->across[i]);
        to_floats((const double[4]){clip[5], clip[13], clip[7], clip[15]}, 4, out->rows[i]);
    }
}
