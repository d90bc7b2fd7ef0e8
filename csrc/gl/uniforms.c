/* uniforms.c: what the shaders of a frame are told: the one conversion from doubles to floats, relative to
 * the scene's fixed origin.
 */
#include "gl_internal.h"

#include <math.h>
#include <string.h>

static void to_floats(const double *from, int count, float *out)
{
    for (int i = 0; i < count; i++) {
        out[i] = (float)from[i];
    }
}

/* Rotation and projection without the eye, which the shader subtracts; depth reversed: 1 - z. */
static void write_view(const csm_camera *camera, csm_frame_uniforms *uniforms)
{
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
}

/* Texel coordinates are phase + light x / texel - lattice. The phase is what the origin adds beyond whole
 * texels, which go to the integers: so it stays the same while only the window moves. */
static void write_cascade(const csm_frame *frame, int i, csm_frame_uniforms *uniforms)
{
    const csm_cascades *cascades = frame->desc->cascades;
    const double *origin = frame->desc->scene->origin;
    bool snapped = frame->settings.effects[CSM_EFFECT_SNAP] == CSM_SNAP_EXACT;
    const double *light = cascades->light_from_world[i];
    const double *clip = cascades->clip_from_light[i];
    double span = cascades->depth_range[i][1] - cascades->depth_range[i][0];
    double origin_ls[3];
    for (int row = 0; row < 3; row++) {
        origin_ls[row] = light[row] * origin[0] + light[4 + row] * origin[1] + light[8 + row] * origin[2];
    }
    for (int axis = 0; axis < 2; axis++) {
        double texel = cascades->texel_size[i][axis];
        double texels = origin_ls[axis] / texel;
        double whole = floor(texels);
        uniforms->window[i][axis] = (float)(1.0 / texel);
        if (snapped) {
            uniforms->window[i][2 + axis] = (float)(texels - whole);
            uniforms->lattice[i][axis] = (int32_t)(cascades->lattice[i][axis] - (int64_t)whole);
        } else {
            double corner = (-1.0 - clip[12 + axis]) / clip[5 * axis]; /* where clip is -1 */
            uniforms->window[i][2 + axis] = (float)((origin_ls[axis] - corner) / texel);
            uniforms->lattice[i][axis] = 0;
        }
        /* casters need no integers: their rounding is that of the rasteriser's own sub-texel grid */
        double clip_scale = clip[5 * axis];
        uniforms->clip[i][axis] = (float)clip_scale;
        uniforms->clip[i][2 + axis] = (float)(clip_scale * origin_ls[axis] + clip[12 + axis]);
        uniforms->depth[i][2 + axis] = (float)texel;
    }
    uniforms->lattice[i][2] = cascades->map_size[i];
    uniforms->lattice[i][3] = csm_settings_kernel_radius(&frame->settings);
    uniforms->depth[i][0] = (float)(-1.0 / span);
    uniforms->depth[i][1] = (float)((-origin_ls[2] - cascades->depth_range[i][0]) / span);
    uniforms->split[i][0] = (float)cascades->splits[i + 1];
}

void csm_frame_write_uniforms(csm_frame *frame)
{
    const csm_render_desc *desc = frame->desc;
    const csm_cascades *cascades = desc->cascades;
    csm_frame_uniforms *uniforms = &frame->uniforms;
    memset(uniforms, 0, sizeof *uniforms);
    for (int axis = 0; axis < 3; axis++) {
        double eye = desc->camera.eye[axis] - desc->scene->origin[axis];
        uniforms->eye_high[axis] = (float)eye;
        uniforms->eye_low[axis] = (float)(eye - (double)uniforms->eye_high[axis]);
    }
    write_view(&desc->camera, uniforms);
    to_floats(desc->to_light, 3, uniforms->to_light);
    if (frame->settings.effects[CSM_EFFECT_FILTER] == CSM_FILTER_NONE) {
        return;
    }
    csm_bias bias = csm_settings_bias(&frame->settings);
    double quantum = csm_depth_quantum(frame->settings.effects[CSM_EFFECT_DEPTH_FORMAT]);
    to_floats((const double[4]){bias.constant_texels, bias.slope_texels, bias.normal_offset_texels,
                                bias.quanta * quantum},
              4, uniforms->bias);
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            uniforms->light_from_origin[row][column] =
                (float)cascades->light_from_world[0][4 * column + row];
        }
    }
    for (int i = 0; i < cascades->count; i++) {
        write_cascade(frame, i, uniforms);
    }
}
