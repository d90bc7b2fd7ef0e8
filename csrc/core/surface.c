/* surface.c: how steps in light space move points of a surface in the picture.
 *
 * In: points and normals, gradients of two coordinates of light space. Out: for each point a
 * Jacobian, pixels over steps (docs/numerics.md 13).
 */
#include "csm.h"
#include "linalg.h"

/* Where a step along the surface leads in the picture, at a point of that place from the eye. */
static void step_in_picture(const csm_camera *camera, const double from_eye[3],
                            const double step[3], double out[2]) {
    const double depth = -vec3_dot(camera->backward, from_eye);
    const double deeper = -vec3_dot(camera->backward, step);
    const double *axes[2] = {camera->right, camera->up};
    for (int k = 0; k < 2; k++) {
        out[k] = vec3_dot(axes[k], step);
        if (!camera->orthographic) { /* d(x / z) = (dx - (x / z) dz) / z */
            out[k] = (out[k] - vec3_dot(axes[k], from_eye) / depth * deeper) / depth;
        }
    }
    out[0] *= 0.5 * camera->width / camera->half_width;
    out[1] *= -0.5 * camera->height / camera->half_height;
}

void csm_surface_steps(const csm_camera *camera, const csm_surface_points *points, double *out) {
    for (size_t i = 0; i < points->count; i++) {
        const double *normal = points->normals + 3 * i, *point = points->points + 3 * i;
        const double *first = points->gradients + (points->shared ? 0 : 6 * i);
        const double *second = first + 3;
        double along[2][3]; /* dual to the gradients on the surface, times a volume */
        vec3_cross(second, normal, along[0]);
        vec3_cross(normal, first, along[1]);
        const double volume = vec3_dot(first, along[0]);
        const double from_eye[3] = {point[0] - camera->eye[0], point[1] - camera->eye[1],
                                    point[2] - camera->eye[2]};
        for (int coordinate = 0; coordinate < 2; coordinate++) {
            double step[3], moved[2];
            for (int k = 0; k < 3; k++) {
                step[k] = along[coordinate][k] / (volume != 0.0 ? volume : 1e-300);
            }
            step_in_picture(camera, from_eye, step, moved);
            out[4 * i + (size_t)coordinate] = moved[0];
            out[4 * i + 2 + (size_t)coordinate] = moved[1];
        }
    }
}
