/* spheres.c: the smallest sphere round a slice of the view, and that sphere shifted along the view.
 *
 * In: tangents and depths of slices. Out: centre and radius in view space, and the view depths
 * between which a sphere holds the whole cross-section of the view. No transformed corner takes
 * part: a radius whose last bit jitters would move the texel grid by a fraction of a texel far from
 * the world origin. The formulas: docs/numerics.md 4 and 20.
 */
#include "csm.h"

#include <math.h>
#include <string.h>

/* What the cross-sections of a perspective view have in common. At depth z they are rectangles of
 * half diagonal k z round (a z, b z, z). */
typedef struct section {
    double k, axis2, lean; /* k; 1 + a^2 + b^2; |a| half_width + |b| half_height */
} section;

static section sections_of(const csm_camera *camera) {
    const double a = fabs(camera->centre[0]), b = fabs(camera->centre[1]);
    return (section){
        .k = hypot(camera->half_width, camera->half_height),
        .axis2 = 1.0 + a * a + b * b,
        .lean = a * camera->half_width + b * camera->half_height,
    };
}

static void put_on_axis(const csm_camera *camera, double depth, csm_ball *ball) {
    ball->centre[0] = camera->centre[0] * depth;
    ball->centre[1] = camera->centre[1] * depth;
    ball->centre[2] = depth;
}

/* Between which depths a ball on the axis at depth s holds the whole cross-section; it holds one.
 * The corner farthest from the centre changes at s, so each side has its own quadratic. */
static void find_whole(const section *view, csm_ball *ball) {
    const double s = ball->centre[2], k2 = view->k * view->k;
    const double rest = view->axis2 * s * s - ball->radius * ball->radius;
    const double before = view->axis2 - 2.0 * view->lean + k2;
    const double slope = s * (view->axis2 - view->lean);
    const double root = sqrt(fmax(slope * slope - before * rest, 0.0));
    ball->whole[0] = rest > 0.0 ? rest / (slope + root) : 0.0; /* 0: it holds the eye */
    if (view->k * s > ball->radius) {
        ball->whole[1] = (slope + root) / before;
        return;
    }
    const double behind = view->axis2 + 2.0 * view->lean + k2;
    const double rise = s * (view->axis2 + view->lean);
    ball->whole[1] = (rise + sqrt(fmax(rise * rise - behind * rest, 0.0))) / behind;
}

/* Off-centre, seen from the quadrant where a and b are not negative: the centre lies between the
 * axis points of both ends, so of each end one corner matters, the outer far and the inner near
 * one. Centres that weigh their squared distances by 1 - share and share lie a share of the line
 * back from the outer corner, but no nearer to it in x and y than the far end's axis point. The
 * difference of the two distances falls along share, linearly from cut to cut
 * (docs/numerics.md 20). */
static void fit_off_centre(const csm_camera *camera, double n, double f, csm_ball *out) {
    const double halves[2] = {camera->half_width * f, camera->half_height * f};
    double line[3] = {0.0, 0.0, f - n}, until[2];
    for (int axis = 0; axis < 2; axis++) {
        const double half = axis == 0 ? camera->half_width : camera->half_height;
        line[axis] = fabs(camera->centre[axis]) * (f - n) + halves[axis] + half * n;
        until[axis] = halves[axis] / line[axis];
    }
    const int order[2] = {until[0] > until[1], until[0] <= until[1]};
    double share = 0.0;
    for (int freed = 0; freed < 3; freed++) {
        double constant = line[2] * line[2], slope = 2.0 * line[2] * line[2];
        for (int k = 0; k < 2; k++) {
            const double along = line[order[k]];
            constant += along * (k < freed ? along : along - 2.0 * halves[order[k]]);
            slope += k < freed ? 2.0 * along * along : 0.0;
        }
        share = fmax(constant / slope, 0.0);
        if (freed == 2 || share <= until[order[freed]]) {
            break;
        }
    }
    double radius2 = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double back = fmax(share * line[axis], axis < 2 ? halves[axis] : 0.0);
        radius2 += back * back;
        if (axis < 2) {
            const double middle = camera->centre[axis];
            out->centre[axis] = middle * f + copysign(1.0, middle) * (halves[axis] - back);
        } else {
            out->centre[axis] = f - back;
        }
    }
    out->radius = sqrt(radius2);
}

static bool on_far_end(const csm_camera *camera, double n, double f) {
    const double k = hypot(camera->half_width, camera->half_height);
    if (camera->centre[0] == 0.0 && camera->centre[1] == 0.0) {
        return k * k * (f + n) >= f - n;
    }
    double near2 = (f - n) * (f - n);
    const double halves[2] = {camera->half_width, camera->half_height};
    for (int axis = 0; axis < 2; axis++) {
        const double side = fabs(camera->centre[axis]) * (f - n) + halves[axis] * n;
        near2 += side * side;
    }
    return near2 <= k * k * f * f;
}

void csm_fit_sphere(const csm_camera *camera, double near_depth, double far_depth, csm_ball *out) {
    const double n = near_depth, f = far_depth;
    const double k = hypot(camera->half_width, camera->half_height);
    out->whole[0] = n;
    out->whole[1] = f;
    if (camera->orthographic) {
        memcpy(out->centre, camera->centre, sizeof camera->centre);
        out->centre[2] = n + 0.5 * (f - n);
        out->radius = hypot(k, 0.5 * (f - n));
        return;
    }
    if (on_far_end(camera, n, f)) {
        /* So wide that the far corners alone decide: centred on the far plane. */
        const section view = sections_of(camera);
        put_on_axis(camera, f, out);
        out->radius = k * f;
        find_whole(&view, out);
        out->whole[0] = fmin(out->whole[0], n);
        out->whole[1] = f;
        return;
    }
    if (camera->centre[0] != 0.0 || camera->centre[1] != 0.0) {
        fit_off_centre(camera, n, f, out);
        return;
    }
    out->centre[0] = out->centre[1] = 0.0;
    out->centre[2] = 0.5 * (n + f) * (1.0 + k * k);
    out->radius = hypot(f - out->centre[2], k * f);
}

/* The farthest centre on the axis for which a ball holds the whole cross-section at a depth. */
static double farthest_centre(const section *view, double radius, double depth) {
    const double spare = (radius - view->k * depth) * (radius + view->k * depth);
    const double lean = view->lean * depth;
    return depth + (sqrt(lean * lean + view->axis2 * fmax(spare, 0.0)) - lean) / view->axis2;
}

/* Shifts the ball of a slice that has room, keeping the cross-sections at both depths, and its
 * centre before limit. */
static void shift(const csm_camera *camera, double keep_near, double keep_far, double limit,
                  csm_ball *ball) {
    const section view = sections_of(camera);
    const double reach = fmin(farthest_centre(&view, ball->radius, keep_near),
                              farthest_centre(&view, ball->radius, keep_far));
    const double depth = fmin(reach, limit);
    if (!(depth > ball->centre[2])) {
        return;
    }
    put_on_axis(camera, depth, ball);
    find_whole(&view, ball);
    ball->whole[0] = fmin(ball->whole[0], keep_near);
    ball->whole[1] = fmax(ball->whole[1], keep_far);
}

void csm_fit_shifted(const csm_camera *camera, double near_depth, double far_depth, csm_ball *out) {
    csm_fit_sphere(camera, near_depth, far_depth, out);
    if (!camera->orthographic && on_far_end(camera, near_depth, far_depth)) {
        shift(camera, near_depth, near_depth, INFINITY, out);
    }
}

void csm_fit_shifted_chain(const csm_camera *camera, const double *splits, int count,
                           csm_ball *out) {
    for (int i = 0; i < count; i++) {
        csm_fit_sphere(camera, splits[i], splits[i + 1], &out[i]);
    }
    double whole_until = splits[0];
    for (int i = 0; i + 1 < count; i++) {
        if (!camera->orthographic && on_far_end(camera, splits[i], splits[i + 1])) {
            const double middle = 0.5 * (splits[i] + splits[i + 1]);
            shift(camera, whole_until, fmax(middle, out[i + 1].whole[0]),
                  splits[count] - out[i].radius, &out[i]);
        }
        whole_until = out[i].whole[1];
    }
}
