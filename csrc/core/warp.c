/* warp.c: maps whose texels follow the perspective of the view.
 *
 * In: the camera, a light basis, the points of what a cascade must hold. Out: the basis turned so
 * that y runs along the warp's axis, and a projective map of the light plane. Light space
 * perspective shadow maps: Wimmer, Scherzer, Purgathofer 2004; perspective shadow maps: Stamminger,
 * Drettakis 2002; trapezoidal shadow maps: Martin, Tan 2004.
 *
 * A warp must keep light rays parallel to the depth axis of the map, so where a point falls may not
 * depend on its light z: every warp is a homography of the light plane, and up to an affine map of
 * the texture such a one is a direction and a strength. With b from 0 to 1 along that direction,
 * w = 1 + strength * b. strength = d/n for a point of projection n before a body of length d: the
 * published form with that point as origin, but in units that stay finite for n = inf, which is the
 * orthographic map (docs/numerics.md 21).
 */
#include "csm.h"

#include "linalg.h"

/* Below this angle between light and view [sine of 1 degree] strengths fade linearly to 0: the axis
 * turns with the azimuth of what is left of the view direction and jumps where nothing is. */
#define FADE_SINE 0.017452406437283512

#define BISECTIONS 64

/* Share of the map that a trapezoid's focus takes [Martin, Tan 2004]. */
#define FOCUS_SHARE 0.8

/* What is to be held, relative to the eye. */
typedef struct body {
    const double (*points)[3];
    int count;
    const csm_camera *camera;
    double nearest, farthest; /* view depths */
    double light[3][3];       /* axes of light space: dot products with points give x, y, z */
} body;

/* A direction in the light plane as a world vector, and the body's reach along it. */
typedef struct warp_axis {
    double light[2]; /* light x, y, of unit length */
    double world[3];
    double start, length;
} warp_axis;

static double depth_of(const body *held, const double point[3]) {
    return -vec3_dot(held->camera->backward, point);
}

static body describe(const csm_camera *camera, const double light_from_world[16],
                     const double (*points)[3], int count) {
    body out = {.points = points,
                .count = count,
                .camera = camera,
                .nearest = INFINITY,
                .farthest = -INFINITY};
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            out.light[row][column] = light_from_world[4 * column + row];
        }
    }
    for (int i = 0; i < count; i++) {
        const double depth = depth_of(&out, points[i]);
        out.nearest = fmin(out.nearest, depth);
        out.farthest = fmax(out.farthest, depth);
    }
    return out;
}

/* The axis along (x, y) of the light plane, which need not have unit length. */
static warp_axis axis_along(const body *held, double x, double y) {
    const double length = hypot(x, y);
    warp_axis out = {.light = {x / length, y / length}, .start = INFINITY};
    for (int i = 0; i < 3; i++) {
        out.world[i] = out.light[0] * held->light[0][i] + out.light[1] * held->light[1][i];
    }
    double end = -INFINITY;
    for (int i = 0; i < held->count; i++) {
        const double here = vec3_dot(out.world, held->points[i]);
        out.start = fmin(out.start, here);
        end = fmax(end, here);
    }
    /* a body that is flat along the axis is given a length that floats can divide by */
    out.length = fmax(end - out.start, 0x1p-40 * (fabs(end) + fabs(out.start) + held->farthest));
    return out;
}

/* Largest length of a texel along the axis over the view depth there, as a share of length/texels:
 * its size on the screen. The error of Wimmer et al., over the whole body instead of its axis. It
 * is convex in each piece between points, so a corner has the largest. *out_rising: whether a
 * greater strength makes it worse. */
static double worst_texel(const body *held, const warp_axis *along, double strength,
                          bool *out_rising) {
    double worst = 0.0;
    for (int i = 0; i < held->count; i++) {
        const double b = (vec3_dot(along->world, held->points[i]) - along->start) / along->length;
        const double w = 1.0 + strength * b;
        const double error = w * w / ((1.0 + strength) * depth_of(held, held->points[i]));
        if (error > worst) {
            worst = error;
            *out_rising = 2.0 * b * (1.0 + strength) > w;
        }
    }
    return worst;
}

/* The strength whose worst texel is the smallest. Each point's error falls, then rises, with the
 * strength, so the worst does too. Where light and view are at right angles the ends of the body
 * decide, and this is n = near + sqrt(near far). */
static double best_strength(const body *held, const warp_axis *along) {
    double low = 0.0, high = log(held->farthest / held->nearest);
    for (int i = 0; i < BISECTIONS; i++) {
        const double middle = 0.5 * (low + high);
        bool rising = true;
        worst_texel(held, along, expm1(middle), &rising);
        *(rising ? &high : &low) = middle;
    }
    return expm1(low);
}

/* The greatest strength whose worst texel is no worse than without a warp. */
static double strength_limit(const body *held, const warp_axis *along) {
    bool rising;
    const double unwarped = worst_texel(held, along, 0.0, &rising);
    double low = log1p(best_strength(held, along)), high = log(held->farthest / held->nearest);
    for (int i = 0; i < BISECTIONS; i++) {
        const double middle = 0.5 * (low + high);
        const bool worse = worst_texel(held, along, expm1(middle), &rising) > unwarped;
        *(worse ? &high : &low) = middle;
    }
    return expm1(low);
}

/* The trapezoid of Martin and Tan: what lies nearer than the focus, measured on the centre line,
 * takes 80 % of the map. They leave the focus to the user; here it is the depth below which a
 * logarithmic, ideal map has 80 % of its texels. */
static double trapezoid_strength(const body *held, const warp_axis *along, const double centre[3]) {
    const double focus = held->nearest * exp(FOCUS_SHARE * log(held->farthest / held->nearest));
    const double share = (focus * vec3_dot(along->world, centre) - along->start) / along->length;
    const double limit = strength_limit(held, along);
    if (!(share > 0.0)) {
        return limit;
    }
    return fmin(limit, fmax(0.0, (FOCUS_SHARE - share) / ((1.0 - FOCUS_SHARE) * share)));
}

/* Perspective shadow maps project the camera's post-perspective space from the image Q of the
 * light. With homogeneous c of a point, q of the light, m the centre of clip space and r = c.xyz -
 * m c.w, the divisor along the line from m to Q is c.w - q.w (q' . r) / |q'|^2, q' = q.xyz - m q.w:
 * finite for a light at right angles (q.w = 0, Q at infinity), and the same for one behind. It does
 * not change along the light, so it is linear in light x, y. The camera is moved back by slide
 * along its centre line, as the authors do where Q lies in view. False if the divisor is not
 * positive over the body, or a texel is larger on screen than without a warp. */
static bool perspective_axis(const body *held, const double centre[3], double slide,
                             warp_axis *out_along, double *out_strength) {
    const csm_camera *camera = held->camera;
    const double n = held->nearest + slide, f = held->farthest + slide;
    const double ratio = f / (f - n);
    /* the frustum from the moved eye that holds the far end, and so all */
    const double spread = f / held->farthest;
    const double scale[2] = {spread / camera->half_width, spread / camera->half_height};
    const double *sides[2] = {camera->right, camera->up};

    /* r.x, r.y, r.z and c.w as world vectors */
    double r[3][3], divisor[3];
    for (int i = 0; i < 3; i++) {
        const double forward = -camera->backward[i];
        for (int row = 0; row < 2; row++) {
            /* relative to the centre line, which r.xy vanish on: x - depth * (x of centre) */
            const double lean = vec3_dot(sides[row], centre);
            r[row][i] = (sides[row][i] - lean * forward) * scale[row];
        }
        r[2][i] = (ratio - 0.5) * forward;
    }
    double q[3], squared = 0.0;
    for (int row = 0; row < 3; row++) {
        q[row] = vec3_dot(r[row], held->light[2]);
        squared += q[row] * q[row];
    }
    const double light_w = -vec3_dot(camera->backward, held->light[2]);
    for (int i = 0; i < 3; i++) {
        divisor[i] = -camera->backward[i];
        for (int row = 0; row < 3; row++) {
            divisor[i] -= light_w * q[row] / squared * r[row][i];
        }
    }
    const double base = slide - light_w * q[2] / squared * ((ratio - 0.5) * slide - ratio * n);
    const double x = vec3_dot(divisor, held->light[0]), y = vec3_dot(divisor, held->light[1]);
    if (!(hypot(x, y) > 0.0)) {
        *out_strength = 0.0;
        return true; /* no axis: out_along stays as it was */
    }
    const warp_axis along = axis_along(held, x, y);
    const double low = base + hypot(x, y) * along.start;
    const double strength = hypot(x, y) * along.length / low;
    bool rising;
    /* at right angles the worst texels are equal, but for rounding */
    if (!(low > 0.0) || worst_texel(held, &along, strength, &rising) >
                            (1.0 + 1e-9) * worst_texel(held, &along, 0.0, &rising)) {
        return false;
    }
    *out_along = along;
    *out_strength = strength;
    return true;
}

/* The least slide that will do, found by doubling and bisection; none if it takes an eye so far off
 * that its perspective is none. */
static void perspective_strength(const body *held, const double centre[3], warp_axis *out_along,
                                 double *out_strength) {
    *out_strength = 0.0;
    if (perspective_axis(held, centre, 0.0, out_along, out_strength)) {
        return;
    }
    double bad = 0.0, good = 0x1p-10 * held->nearest;
    while (!perspective_axis(held, centre, good, out_along, out_strength)) {
        bad = good;
        good *= 2.0;
        if (good > 0x1p20 * held->farthest) {
            return;
        }
    }
    for (int i = 0; i < BISECTIONS; i++) {
        const double middle = 0.5 * (bad + good);
        *(perspective_axis(held, centre, middle, out_along, out_strength) ? &good : &bad) = middle;
    }
}

/* Fills the turned basis, the local coordinates and the homography. */
static void write_warp(const body *held, const warp_axis *along, double strength, int map_size,
                       int padding_texels, const double light_from_world[16], csm_warp *out) {
    const double across[2] = {along->light[1], -along->light[0]};
    double low = INFINITY, high = -INFINITY, half = 0.0;
    memcpy(out->light_from_world, light_from_world, sizeof out->light_from_world);
    for (int column = 0; column < 3; column++) {
        const double *from = light_from_world + 4 * column;
        out->light_from_world[4 * column] = across[0] * from[0] + across[1] * from[1];
        out->light_from_world[4 * column + 1] =
            along->light[0] * from[0] + along->light[1] * from[1];
    }
    for (int i = 0; i < held->count; i++) {
        double point_ls[3];
        mat4_rotate(out->light_from_world, held->points[i], point_ls);
        const double w = 1.0 + strength * (point_ls[1] - along->start) / along->length;
        half = fmax(half, fabs(point_ls[0]));
        low = fmin(low, point_ls[0] / w);
        high = fmax(high, point_ls[0] / w);
    }
    half = fmax(half, 0x1p-40 * (along->length + held->farthest));
    if (high - low < 0x1p-40 * half) {
        low -= 0x1p-40 * half;
        high += 0x1p-40 * half;
    }
    out->strength = strength;
    out->origin[0] = 0.0;
    out->origin[1] = along->start;
    out->extent[0] = half;
    out->extent[1] = along->length;

    const double share = (double)(map_size - 2 * padding_texels) / map_size;
    const double gain = 2.0 * half / (high - low), shift = (high + low) / (high - low);
    /* 1 / w is linear over the map and largest where the padding before b = 0 ends: there w is 1 */
    const double beyond = 0.5 * (1.0 / share - 1.0);
    const double unit = 1.0 + beyond * strength / (1.0 + strength);
    double *m = out->clip_from_local;
    memset(m, 0, sizeof out->clip_from_local);
    m[0] = unit * share * gain;
    m[4] = -unit * share * shift * strength;
    m[12] = -unit * share * shift;
    m[5] = unit * share * (2.0 + strength);
    m[13] = -unit * share;
    m[10] = 1.0;
    m[7] = unit * strength;
    m[15] = unit;
}

csm_status csm_warp_make(int kind, const csm_camera *camera, const double light_from_world[16],
                         const double (*points)[3], int count, int map_size, int padding_texels,
                         csm_warp *out, csm_error *err) {
    if (padding_texels < 0 || map_size - 2 * padding_texels < 1) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "map_size must be > %d for a kernel radius of %d texels under a warp "
                        "(got %d)",
                        2 * padding_texels, padding_texels, map_size);
    }
    const body held = describe(camera, light_from_world, points, count);
    double centre[3], beside[3];
    for (int i = 0; i < 3; i++) {
        centre[i] = -camera->backward[i];
        if (!camera->orthographic) {
            centre[i] += camera->centre[0] * camera->right[i] + camera->centre[1] * camera->up[i];
        }
    }
    vec3_cross(centre, held.light[2], beside);
    const double sine = sqrt(vec3_dot(beside, beside) / vec3_dot(centre, centre));
    const double x = vec3_dot(held.light[0], centre), y = vec3_dot(held.light[1], centre);
    const bool aside = hypot(x, y) > 0.0;
    warp_axis along = axis_along(&held, aside ? x : 0.0, aside ? y : 1.0);
    double strength = 0.0;
    /* an orthographic view has no perspective to follow, nor has one along the light */
    if (aside && !camera->orthographic && held.nearest > 0.0 && held.farthest > held.nearest) {
        if (kind == CSM_WARP_LISPSM) {
            strength = best_strength(&held, &along);
        } else if (kind == CSM_WARP_TSM) {
            strength = trapezoid_strength(&held, &along, centre);
        } else if (kind == CSM_WARP_PSM) {
            perspective_strength(&held, centre, &along, &strength);
        }
    }
    strength *= fmin(1.0, sine / FADE_SINE);
    /* the padding behind b = 1 may take no more than half of what is left to the horizon */
    strength = fmin(strength, 0.5 * (map_size - 2 * padding_texels) / fmax(padding_texels, 1.0));
    write_warp(&held, &along, strength, map_size, padding_texels, light_from_world, out);
    return CSM_OK;
}

void csm_warp_unproject(const double clip_from_light[16], const double clip[2], int map_size,
                        double out_position[2], double out_texel[2]) {
    /* rows of x and y less clip times the row of w: two lines in the light plane that meet there */
    const double *m = clip_from_light;
    double lines[2][3], slopes[2][2];
    for (int row = 0; row < 2; row++) {
        for (int i = 0; i < 3; i++) {
            const int column = i < 2 ? i : 3;
            lines[row][i] = m[4 * column + row] - clip[row] * m[4 * column + 3];
        }
    }
    const double area = lines[0][0] * lines[1][1] - lines[0][1] * lines[1][0];
    out_position[0] = (lines[0][1] * lines[1][2] - lines[1][1] * lines[0][2]) / area;
    out_position[1] = (lines[1][0] * lines[0][2] - lines[0][0] * lines[1][2]) / area;
    /* a step in clip x or y moves along the other line, scaled by w */
    const double w = m[3] * out_position[0] + m[7] * out_position[1] + m[15];
    slopes[0][0] = lines[1][1];
    slopes[0][1] = -lines[1][0];
    slopes[1][0] = -lines[0][1];
    slopes[1][1] = lines[0][0];
    for (int row = 0; row < 2; row++) {
        out_texel[row] = fabs(2.0 * w / (area * map_size)) * hypot(slopes[row][0], slopes[row][1]);
    }
}

void csm_cascade_window(const csm_cascades *cascades, int i, double out_window[4],
                        double *out_texel) {
    const double *clip_from_light = cascades->clip_from_light[i];
    const double *texel_size = cascades->texel_size[i];
    if (clip_from_light[3] == 0.0 && clip_from_light[7] == 0.0) {
        for (int row = 0; row < 2; row++) {
            const double half_sides = 1.0 / clip_from_light[5 * row];
            const double centre = -clip_from_light[12 + row] * half_sides;
            out_window[row] = centre - half_sides;
            out_window[row + 2] = centre + half_sides;
        }
        *out_texel = fmax(texel_size[0], texel_size[1]);
        return;
    }
    *out_texel = 0.0;
    for (int corner = 0; corner < 4; corner++) {
        const double clip[2] = {corner % 2 ? 1.0 : -1.0, corner / 2 ? 1.0 : -1.0};
        double position[2], texel[2];
        csm_warp_unproject(clip_from_light, clip, cascades->map_size[i], position, texel);
        *out_texel = fmax(*out_texel, fmax(texel[0], texel[1]));
        for (int row = 0; row < 2; row++) {
            out_window[row] = corner ? fmin(out_window[row], position[row]) : position[row];
            out_window[row + 2] = corner ? fmax(out_window[row + 2], position[row]) : position[row];
        }
    }
}
