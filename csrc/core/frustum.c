/* frustum.c: corners and planes of a slice of the camera's view, and what a box holds of it.
 *
 * In: a camera, two view depths [m]. Out: world corners, world planes, matrices, all from the
 * camera's axes and tangents: unprojecting clip space would lose eps * far / near
 * (docs/numerics.md 3).
 */
#include "frustum.h"

#include <stddef.h>
#include <string.h>

#include "linalg.h"

static void check_axes(const csm_camera *camera, csm_error *err, int *problems) {
    const double *axes[3] = {camera->right, camera->up, camera->backward};
    double worst = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            const double miss = fabs(vec3_dot(axes[i], axes[j]) - (i == j ? 1.0 : 0.0));
            worst = fmax(worst, isnan(miss) ? INFINITY : miss);
        }
    }
    double backward[3];
    vec3_cross(camera->right, camera->up, backward);
    if (!(worst <= 1e-9) || vec3_dot(backward, camera->backward) < 0.0) {
        csm_fail_more(err,
                      "right, up and backward must be orthonormal to 1e-9 and right-handed (worst "
                      "dot product is off by %g)",
                      worst);
        ++*problems;
    }
}

bool csm_camera_equal(const csm_camera *one, const csm_camera *other) {
    /* doubles without padding up to the size */
    return !memcmp(one, other, offsetof(csm_camera, width)) && one->width == other->width &&
           one->height == other->height && one->orthographic == other->orthographic;
}

csm_status csm_camera_validate(const csm_camera *camera, csm_error *err) {
    int problems = 0;
    if (!vec3_finite(camera->eye)) {
        csm_fail_more(err, "eye must be finite (got %g, %g, %g)", camera->eye[0], camera->eye[1],
                      camera->eye[2]);
        problems++;
    }
    check_axes(camera, err, &problems);
    if (!isfinite(camera->centre[0]) || !isfinite(camera->centre[1])) {
        csm_fail_more(err, "centre_x and centre_y must be finite (got %g, %g)", camera->centre[0],
                      camera->centre[1]);
        problems++;
    }
    const char *kind = camera->orthographic ? "half extent" : "tangent of the half field of view";
    const double halves[2] = {camera->half_width, camera->half_height};
    for (int axis = 0; axis < 2; axis++) {
        if (!(halves[axis] > 0.0) || !isfinite(halves[axis])) {
            csm_fail_more(err, "%s (the %s) must be finite and > 0 (got %g)",
                          axis == 0 ? "half_width" : "half_height", kind, halves[axis]);
            problems++;
        }
    }
    if (!isfinite(camera->near_depth) || !isfinite(camera->far_depth) ||
        !(camera->far_depth > camera->near_depth)) {
        csm_fail_more(err, "far must be > near, both finite (got near %g, far %g)",
                      camera->near_depth, camera->far_depth);
        problems++;
    }
    if (!camera->orthographic && !(camera->near_depth > 0.0)) {
        csm_fail_more(err, "near must be > 0 for a perspective camera (got %g)",
                      camera->near_depth);
        problems++;
    }
    if (camera->width < 1 || camera->height < 1) {
        csm_fail_more(err, "size must be at least 1 x 1 pixels (got %d x %d)", camera->width,
                      camera->height);
        problems++;
    }
    return problems > 0 ? CSM_ERROR_INVALID_ARGUMENT : CSM_OK;
}

void csm_camera_view_from_world(const csm_camera *camera, double out[16]) {
    mat4_from_rows(camera->right, camera->up, camera->backward, out);
    double eye_vs[3];
    mat4_rotate(out, camera->eye, eye_vs);
    for (int axis = 0; axis < 3; axis++) {
        out[12 + axis] = -eye_vs[axis];
    }
}

void csm_camera_clip_from_view(const csm_camera *camera, double out[16]) {
    if (!camera->orthographic) {
        perspective_rh_zo(camera->half_width, camera->half_height, camera->centre,
                          camera->near_depth, camera->far_depth, out);
        return;
    }
    const double corner[2] = {camera->centre[0] - camera->half_width,
                              camera->centre[1] - camera->half_height};
    const double sides[2] = {2.0 * camera->half_width, 2.0 * camera->half_height};
    ortho_rh_zo(corner, sides, camera->near_depth, camera->far_depth - camera->near_depth, out);
}

static void corners_from_eye(const csm_camera *camera, double near_depth, double far_depth,
                             double out_corners[CSM_CORNER_COUNT][3]) {
    static const double signs[4][2] = {{-1, -1}, {-1, 1}, {1, 1}, {1, -1}}; /* LB LT RT RB */
    for (int i = 0; i < CSM_CORNER_COUNT; i++) {
        const double depth = i < CSM_LBF ? near_depth : far_depth;
        const double spread = camera->orthographic ? 1.0 : depth;
        const double x = (camera->centre[0] + signs[i % 4][0] * camera->half_width) * spread;
        const double y = (camera->centre[1] + signs[i % 4][1] * camera->half_height) * spread;
        for (int axis = 0; axis < 3; axis++) {
            out_corners[i][axis] =
                camera->right[axis] * x + camera->up[axis] * y - camera->backward[axis] * depth;
        }
    }
}

void csm_frustum_corners(const csm_camera *camera, double near_depth, double far_depth,
                         double out_corners[CSM_CORNER_COUNT][3]) {
    corners_from_eye(camera, near_depth, far_depth, out_corners);
    for (int i = 0; i < CSM_CORNER_COUNT; i++) {
        for (int axis = 0; axis < 3; axis++) {
            out_corners[i][axis] += camera->eye[axis];
        }
    }
}

/* Planes relative to the eye. A side plane of a perspective camera holds the eye and leans by a
 * tangent: x + (half_width - centre) * depth >= 0; of an orthographic one it stands off:
 * x + half_width - centre >= 0. */
static void planes_from_eye(const csm_camera *camera, double near_depth, double far_depth,
                            double out_planes[CSM_PLANE_COUNT][4]) {
    const double *axes[4] = {camera->right, camera->right, camera->up, camera->up};
    const double *centre = camera->centre;
    const double sides[4] = {camera->half_width - centre[0], camera->half_width + centre[0],
                             camera->half_height - centre[1], camera->half_height + centre[1]};
    for (int i = CSM_LEFT; i <= CSM_TOP; i++) {
        const double sign = i % 2 == 0 ? 1.0 : -1.0;
        const double lean = camera->orthographic ? 0.0 : sides[i];
        const double length = hypot(1.0, lean);
        for (int axis = 0; axis < 3; axis++) {
            out_planes[i][axis] = (sign * axes[i][axis] - lean * camera->backward[axis]) / length;
        }
        out_planes[i][3] = camera->orthographic ? sides[i] : 0.0;
    }
    for (int axis = 0; axis < 3; axis++) {
        out_planes[CSM_NEAR][axis] = -camera->backward[axis];
        out_planes[CSM_FAR][axis] = camera->backward[axis];
    }
    out_planes[CSM_NEAR][3] = -near_depth;
    out_planes[CSM_FAR][3] = far_depth;
}

void csm_frustum_planes(const csm_camera *camera, double near_depth, double far_depth,
                        double out_planes[CSM_PLANE_COUNT][4]) {
    planes_from_eye(camera, near_depth, far_depth, out_planes);
    for (int i = 0; i < CSM_PLANE_COUNT; i++) {
        out_planes[i][3] -= vec3_dot(out_planes[i], camera->eye);
    }
}

/* A box relative to the eye, its corners in the order of csm_corner with near at z max. */
static void box_from_eye(const csm_camera *camera, const double bounds[6],
                         double out_corners[CSM_CORNER_COUNT][3],
                         double out_planes[CSM_PLANE_COUNT][4]) {
    const double *low = bounds, *high = bounds + 3;
    for (int i = 0; i < CSM_CORNER_COUNT; i++) {
        const bool right = i % 4 >= 2, top = i % 4 == 1 || i % 4 == 2, near = i < 4;
        out_corners[i][0] = (right ? high : low)[0] - camera->eye[0];
        out_corners[i][1] = (top ? high : low)[1] - camera->eye[1];
        out_corners[i][2] = (near ? high : low)[2] - camera->eye[2];
    }
    memset(out_planes, 0, CSM_PLANE_COUNT * sizeof *out_planes);
    for (int axis = 0; axis < 3; axis++) {
        out_planes[2 * axis][axis] = 1.0;
        out_planes[2 * axis][3] = camera->eye[axis] - low[axis];
        out_planes[2 * axis + 1][axis] = -1.0;
        out_planes[2 * axis + 1][3] = high[axis] - camera->eye[axis];
    }
}

/* One step of Sutherland and Hodgman: the part of a polygon where dot(plane, p) >= 0. */
static int clip_polygon(const double (*polygon)[3], int count, const double plane[4],
                        double (*out)[3]) {
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const double *a = polygon[i], *b = polygon[(i + 1) % count];
        const double inside_a = vec3_dot(plane, a) + plane[3];
        const double inside_b = vec3_dot(plane, b) + plane[3];
        if (inside_a >= 0.0) {
            memcpy(out[kept++], a, sizeof out[0]);
        }
        if ((inside_a >= 0.0) != (inside_b >= 0.0)) {
            const double share = inside_a / (inside_a - inside_b);
            for (int axis = 0; axis < 3; axis++) {
                out[kept][axis] = a[axis] + (b[axis] - a[axis]) * share;
            }
            kept++;
        }
    }
    return kept;
}

/* The faces of one body inside the planes of the other. */
static int clip_faces(const double corners[CSM_CORNER_COUNT][3],
                      const double planes[CSM_PLANE_COUNT][4], double (*out_points)[3]) {
    static const int faces[6][4] = {
        {CSM_LBN, CSM_LTN, CSM_LTF, CSM_LBF}, {CSM_RBN, CSM_RTN, CSM_RTF, CSM_RBF},
        {CSM_LBN, CSM_RBN, CSM_RBF, CSM_LBF}, {CSM_LTN, CSM_RTN, CSM_RTF, CSM_LTF},
        {CSM_LBN, CSM_LTN, CSM_RTN, CSM_RBN}, {CSM_LBF, CSM_LTF, CSM_RTF, CSM_RBF}};
    int point_count = 0;
    for (int face = 0; face < 6; face++) {
        double polygons[2][CSM_CLIP_POLYGON_MAX][3];
        int count = 4;
        for (int i = 0; i < count; i++) {
            memcpy(polygons[0][i], corners[faces[face][i]], sizeof polygons[0][i]);
        }
        for (int i = 0; i < CSM_PLANE_COUNT && count > 0; i++) {
            count = clip_polygon((const double(*)[3])polygons[i % 2], count, planes[i],
                                 polygons[(i + 1) % 2]);
        }
        memcpy(out_points[point_count], polygons[CSM_PLANE_COUNT % 2],
               (size_t)count * sizeof out_points[0]);
        point_count += count;
    }
    return point_count;
}

int csm_frustum_clip_box(const csm_camera *camera, double near_depth, double far_depth,
                         const double bounds[6], double out_points[CSM_CLIP_MAX][3]) {
    double corners[CSM_CORNER_COUNT][3], planes[CSM_PLANE_COUNT][4];
    double box_corners[CSM_CORNER_COUNT][3], box_planes[CSM_PLANE_COUNT][4];
    corners_from_eye(camera, near_depth, far_depth, corners);
    planes_from_eye(camera, near_depth, far_depth, planes);
    box_from_eye(camera, bounds, box_corners, box_planes);
    /* A vertex of the common part lies on a face of either body, and on one of both. */
    int count = clip_faces((const double(*)[3])corners, (const double(*)[4])box_planes, out_points);
    count +=
        clip_faces((const double(*)[3])box_corners, (const double(*)[4])planes, out_points + count);
    return count;
}

bool csm_planes_meet_box(const double planes[CSM_PLANE_COUNT][4], const double eye[3],
                         const double bounds[6], double margin) {
    for (int p = 0; p < CSM_PLANE_COUNT; p++) {
        double highest = planes[p][3] + margin;
        for (int axis = 0; axis < 3; axis++) {
            const double end = planes[p][axis] > 0.0 ? bounds[axis + 3] : bounds[axis];
            highest += planes[p][axis] * (end - eye[axis]);
        }
        if (!(highest >= 0.0)) {
            return false;
        }
    }
    return true;
}

bool csm_frustum_depth_of_box(const csm_camera *camera, const double bounds[6], double *out_depth) {
    double points[CSM_CLIP_MAX][3];
    const int count =
        csm_frustum_clip_box(camera, camera->near_depth, camera->far_depth, bounds, points);
    double depth = camera->near_depth;
    for (int i = 0; i < count; i++) {
        depth = fmax(depth, -vec3_dot(camera->backward, points[i]));
    }
    *out_depth = fmin(depth, camera->far_depth);
    return count > 0;
}
