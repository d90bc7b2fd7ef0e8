/* light_window.c: reads a shadow map's window out of a clip matrix.
 *
 * In: any clip_from_world of parallel light, orthographic or warped (x, y and w functions of the
 * place across the light alone), clip z in [0, 1]. Out: planes, texel places, the light's
 * direction. Everything relative to a point near the view: a matrix whose last column is a million
 * texels long says so once, in the rounding that comes with the window. The elements are taken as
 * exact: a renderer that rounds them to float32 draws what the rounded ones say.
 */
#include "light_window.h"

#include "linalg.h"

static double length_of(const double v[3]) {
    return sqrt(vec3_dot(v, v));
}

/* The direction along which neither x, y nor w changes. */
static bool find_columns(light_window *window) {
    static const int pairs[3][2] = {
        {WINDOW_X, WINDOW_Y}, {WINDOW_X, WINDOW_W}, {WINDOW_Y, WINDOW_W}};
    double best = 0.0;
    for (int i = 0; i < 3; i++) {
        const double *a = window->rows[pairs[i][0]], *b = window->rows[pairs[i][1]];
        double across[3];
        vec3_cross(a, b, across);
        const double length = length_of(across);
        /* Of a sine, not of a length: rows of one matrix may differ by orders of magnitude. */
        const double sine = length > 0.0 ? length / (length_of(a) * length_of(b)) : 0.0;
        if (sine > best) {
            best = sine;
            for (int axis = 0; axis < 3; axis++) {
                window->to_light[axis] = across[axis] / length;
            }
        }
    }
    const double along = vec3_dot(window->rows[WINDOW_Z], window->to_light);
    window->depth_slope = fabs(along);
    for (int axis = 0; axis < 3 && along > 0.0; axis++) {
        window->to_light[axis] = -window->to_light[axis];
    }
    return best > 1e-9 && window->depth_slope > 1e-12 * length_of(window->rows[WINDOW_Z]);
}

csm_status light_window_make(const double clip_from_world[16], int map_size, const double origin[3],
                             double reach, light_window *out, csm_error *err) {
    memset(out, 0, sizeof *out);
    out->size = map_size;
    double rounding[4];
    for (int row = 0; row < 4; row++) {
        double offset = clip_from_world[12 + row], largest = fabs(offset);
        bool finite = isfinite(offset);
        for (int axis = 0; axis < 3; axis++) {
            const double element = clip_from_world[4 * axis + row];
            finite = finite && isfinite(element);
            out->rows[row][axis] = element;
            offset += element * origin[axis];
            largest += fabs(element) * (fabs(origin[axis]) + reach);
        }
        if (!finite) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT, "matrices must be finite (got %g)",
                            offset);
        }
        out->rows[row][3] = offset;
        /* Elements that are sums of rounded products, then four products and sums more. */
        rounding[row] = 0x1p-50 * largest;
    }
    if (!find_columns(out)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "a clip matrix must map the world to an area and a depth (its x and y, or "
                        "its depth, do not change)");
    }
    const double *w = out->rows[WINDOW_W];
    if (fabs(vec3_dot(w, out->to_light)) > 1e-5 * length_of(w)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "only parallel light: w of this clip matrix changes along the light, as "
                        "for a lamp with a place");
    }
    /* Relative to w of the window's middle, where the texels are that the figure speaks of. */
    double centre[3], clip[4];
    light_window_centre(out, centre);
    light_window_clip(out, centre, clip);
    if (!(clip[WINDOW_W] > 0.0)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "w of a clip matrix must be > 0 at the middle of the map (got %g)",
                        clip[WINDOW_W]);
    }
    const double xy = fmax(rounding[WINDOW_X], rounding[WINDOW_Y]) + rounding[WINDOW_W];
    out->rounding_texels = 0.5 * out->size * xy / clip[WINDOW_W];
    out->rounding_depth = (rounding[WINDOW_Z] + rounding[WINDOW_W]) / clip[WINDOW_W];
    return CSM_OK;
}

void light_window_planes(const light_window *window, double border, double depth_slack,
                         double out[WINDOW_PLANES][4]) {
    const double half = 1.0 - 2.0 * border / window->size;
    for (int i = 0; i < 4; i++) {
        for (int side = 0; side < 2; side++) {
            const double sign = side == 0 ? 1.0 : -1.0;
            for (int axis = 0; axis < 2; axis++) {
                out[2 * axis + side][i] =
                    sign * window->rows[axis][i] + half * window->rows[WINDOW_W][i];
            }
        }
        const double z = window->rows[WINDOW_Z][i], w = window->rows[WINDOW_W][i];
        out[WINDOW_SIDES][i] = z + depth_slack * w;
        out[WINDOW_SIDES + 1][i] = (1.0 + depth_slack) * w - z;
    }
}

void light_window_clip(const light_window *window, const double p[3], double out[4]) {
    for (int row = 0; row < 4; row++) {
        out[row] = vec3_dot(window->rows[row], p) + window->rows[row][3];
    }
}

bool light_window_texel(const light_window *window, const double p[3], double out[2]) {
    double clip[4];
    light_window_clip(window, p, clip);
    if (!(clip[WINDOW_W] > 0.0)) {
        return false;
    }
    for (int axis = 0; axis < 2; axis++) {
        out[axis] = 0.5 * window->size * (clip[axis] / clip[WINDOW_W] + 1.0);
    }
    return true;
}

double light_window_outside(const light_window *window, const double p[3], double border) {
    double texel[2];
    if (!light_window_texel(window, p, texel)) {
        return INFINITY;
    }
    const double half = 0.5 * window->size;
    return fmax(fabs(texel[0] - half), fabs(texel[1] - half)) - half + border;
}

void light_window_gradients(const light_window *window, const double p[3], double out[2][3]) {
    double clip[4];
    light_window_clip(window, p, clip);
    for (int row = 0; row < 2; row++) {
        const double place = clip[row] / clip[WINDOW_W];
        for (int axis = 0; axis < 3; axis++) {
            out[row][axis] = 0.5 * window->size *
                             (window->rows[row][axis] - place * window->rows[WINDOW_W][axis]) /
                             clip[WINDOW_W];
        }
    }
}

void light_window_centre(const light_window *window, double out[3]) {
    /* x = y = 0, and no way along the column: three planes meet. */
    const double *planes[3] = {window->rows[WINDOW_X], window->rows[WINDOW_Y], window->to_light};
    const double offsets[3] = {-planes[0][3], -planes[1][3], 0.0};
    double across[3][3];
    for (int i = 0; i < 3; i++) {
        vec3_cross(planes[(i + 1) % 3], planes[(i + 2) % 3], across[i]);
    }
    const double volume = vec3_dot(planes[0], across[0]);
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = 0.0;
        for (int i = 0; i < 3; i++) {
            out[axis] += offsets[i] * across[i][axis] / volume;
        }
    }
}
