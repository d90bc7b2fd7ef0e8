/* coarse_planes.c: where planes end between the pixels of a coarse picture.
 *
 * In: depths and which pixels face the sun. Out: pixels of the full picture past the planes' last
 * coarse ones, and the part of the picture in which planes reach their horizon.
 *
 * Between the last pixel of a plane and the centre of the next coarse one, which shows something
 * else, the full picture has pixels of its own: towards a horizon these lie many times as far off.
 * They count as far as the scene's box reaches, and before what is seen next.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coarse.h"

#define FLAT 0.02   /* of the step from pixel to pixel, that the next may differ by on a plane */
#define TOGETHER 64 /* pixels of a row */
#define BY_BEFORE 1 /* bits: whether the next pixel is where the step from the one before leads */
#define BY_AFTER 2  /* ... and the one before, where the step from the next leads */

/* One plane's last pixel. Places count along the way, from the border where it starts. */
typedef struct plane_end {
    int place, crossing;
    bool seen;         /* whether the next shows anything; past the border nothing is seen */
    double last, step; /* linear values: of it, from pixel to pixel */
    double behind;     /* depth that the next pixel shows, INFINITY if nothing */
} plane_end;

typedef struct planes {
    const csm_camera *full;
    const csm_coarse_picture *picture;
    double bounds[6], slack;
    double *linear; /* what is linear in the picture on a plane: the inverse of depth, or depth */
    uint8_t *straight[2]; /* along an axis: BY_BEFORE, BY_AFTER */
    uint8_t *marked;      /* whether a plane ends at a pixel, along one way */
    uint32_t *starts;     /* of the ends of each place, along one way, among all; one more */
    plane_end *ends;
} planes;

static void make_linear(planes *p) {
    const csm_camera *camera = p->picture->camera;
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    const float *depths = p->picture->view_depth;
    const uint8_t *valid = p->picture->valid;
    double *restrict linear = p->linear;
    const bool straight = camera->orthographic;
    for (size_t at = 0; at < pixels; at += TOGETHER) {
        const int count = pixels - at < TOGETHER ? (int)(pixels - at) : TOGETHER;
        float seen[TOGETHER];
        for (int i = 0; i < count; i++) {
            const float depth = depths[at + (size_t)i];
            seen[i] = valid[at + (size_t)i] ? depth : 1.0F;
        }
        for (int i = 0; i < count; i++) {
            linear[at + (size_t)i] = straight ? (double)seen[i] : 1.0 / (double)seen[i];
        }
    }
}

/* Whether pixels of a row lie in a line with those before and after them, by either step: bits.
 * Few say no, so they are asked without a branch; as numbers first, since compilers pack these. */
static void judge_steps(const double *before, const double *here, const double *after, int count,
                        uint8_t *restrict out) {
    double bits[TOGETHER];
    for (int i = 0; i < count; i++) {
        const double step = here[i] - before[i], next = after[i] - here[i];
        const double change = fabs(next - step);
        bits[i] = (change <= FLAT * fabs(step) ? (double)BY_BEFORE : 0.0) +
                  (change <= FLAT * fabs(next) ? (double)BY_AFTER : 0.0);
    }
    for (int i = 0; i < count; i++) {
        out[i] = (uint8_t)(int)bits[i];
    }
}

/* Along both axes, in every stretch of a row in which something faces the sun. */
static void judge_all_steps(planes *p) {
    const int width = p->picture->camera->width, height = p->picture->camera->height;
    memset(p->straight[0], 0, 2 * (size_t)width * (size_t)height);
    for (int row = 0; row < height; row++) {
        for (int column = 0; column < width; column += TOGETHER) {
            const int end = column + TOGETHER < width ? column + TOGETHER : width;
            const size_t i = (size_t)row * (size_t)width + (size_t)column;
            if (!memchr(p->picture->facing + i, 1, (size_t)(end - column))) {
                continue;
            }
            const double *here = p->linear + i;
            if (row > 0 && row + 1 < height) {
                judge_steps(here - width, here, here + width, end - column, p->straight[0] + i);
            }
            const int left = column == 0, right = end == width; /* have no neighbour */
            judge_steps(here + left - 1, here + left, here + left + 1, end - column - left - right,
                        p->straight[1] + i + left);
        }
    }
}

/* Which of count pixels in a row from i on the plane of a pixel and the two before it ends at; past
 * the border it always does. Returns how many. */
static uint32_t mark_ends(planes *p, int way, size_t i, ptrdiff_t next, int count, bool border) {
    const uint8_t *facing = p->picture->facing + i, *once = facing - next, *twice = once - next;
    const uint8_t *here = p->straight[way_axis(way)] + i, *there = here - next;
    const uint8_t *seen = p->picture->valid + (border ? (ptrdiff_t)i : (ptrdiff_t)i + next);
    /* both by the step between the two, as the way leads */
    const uint8_t by_led = way_back(way) ? BY_AFTER : BY_BEFORE, inside = !border;
    const uint8_t by_leads = BY_BEFORE + BY_AFTER - by_led;
    uint8_t *restrict marked = p->marked + i;
    uint32_t sum = 0;
    for (int k = 0; k < count; k++) {
        const uint8_t led = (there[k] & by_leads) != 0, on = (here[k] & by_led) != 0;
        marked[k] = facing[k] & once[k] & twice[k] & led & (1 ^ (inside & seen[k] & on));
    }
    for (int k = 0; k < count; k++) {
        sum += marked[k];
    }
    return sum;
}

/* From the pixel to the next one along a way. */
static ptrdiff_t way_next(const planes *p, int way) {
    return (way_axis(way) ? 1 : p->picture->camera->width) * (way_back(way) ? -1 : 1);
}

/* Marks the ends of one way and counts them by their places; returns how many. */
static size_t find_ends(planes *p, int way) {
    const int width = p->picture->camera->width, height = p->picture->camera->height;
    const int axis = way_axis(way), length = camera_side(p->picture->camera, axis);
    const ptrdiff_t next = way_next(p, way);
    const int last = way_back(way) ? 0 : length - 1;
    uint32_t *counts = p->starts + 1; /* of columns from left to right or of places down a column */
    memset(p->marked, 0, (size_t)width * (size_t)height);
    memset(p->starts, 0, ((size_t)length + 1) * sizeof *p->starts);
    for (int row = 0; length > 2 && row < height; row++) {
        const size_t first = (size_t)row * (size_t)width;
        if (axis) {
            mark_ends(p, way, first + (way_back(way) ? 1 : 2), next, width - 3, false);
            mark_ends(p, way, first + (size_t)last, next, 1, true);
            for (int column = 0; column < width; column++) {
                counts[column] += p->marked[first + (size_t)column];
            }
        } else if (way_back(way) ? row < height - 2 : row >= 2) {
            counts[row] = mark_ends(p, way, first, next, width, row == last);
        }
    }
    for (int i = 0; way_back(way) && i < length / 2; i++) {
        const uint32_t count = counts[i];
        counts[i] = counts[length - 1 - i];
        counts[length - 1 - i] = count;
    }
    for (int place = 0; place < length; place++) {
        counts[place] += counts[place - 1];
    }
    return p->starts[length];
}

static plane_end end_of(const planes *p, int way, int row, int column) {
    const int axis = way_axis(way), length = camera_side(p->picture->camera, axis);
    const size_t i = (size_t)row * (size_t)p->picture->camera->width + (size_t)column;
    const ptrdiff_t next = way_next(p, way);
    const int along = axis ? column : row, place = way_back(way) ? length - 1 - along : along;
    const double *linear = p->linear + i;
    const bool seen = place + 1 < length && p->picture->valid[(ptrdiff_t)i + next];
    const double after = seen ? linear[next] : 0.0;
    return (plane_end){
        .place = place,
        .crossing = axis ? row : column,
        .seen = seen,
        .last = linear[0],
        .step = linear[0] - *(linear - next),
        .behind = !seen                   ? INFINITY
                  : p->full->orthographic ? after
                                          : 1.0 / after,
    };
}

/* The ends of one way, place by place. */
static void gather(planes *p, int way) {
    const int width = p->picture->camera->width, height = p->picture->camera->height;
    for (int row = 0; row < height; row++) {
        const uint8_t *marked = p->marked + (size_t)row * (size_t)width;
        for (int column = 0; column < width; column++) {
            uint64_t eight = 1;
            if (column + 8 <= width) {
                memcpy(&eight, marked + column, sizeof eight);
            }
            if (!eight) {
                column += 7;
            } else if (marked[column]) {
                const plane_end end = end_of(p, way, row, column);
                p->ends[p->starts[end.place]++] = end;
            }
        }
    }
}

static bool in_bounds(const planes *p, const double point[3]) {
    bool in = true;
    for (int i = 0; i < 3; i++) {
        in &= (point[i] >= p->bounds[i] - p->slack) & (point[i] <= p->bounds[3 + i] + p->slack);
    }
    return in;
}

/* Whether the k-th pixel past a place sees a plane go on, and where. */
static bool goes_on(const planes *p, const coarse_way *way, const coarse_place *place, int k,
                    const plane_end *end, csm_plane_end *out) {
    const double ahead = coarse_ahead(way, place, k);
    if (!(ahead < 1.0)) {
        return false;
    }
    const double depth = coarse_depth_past(way, end->last, end->step, ahead);
    if (!(end->last + end->step * ahead > 0.0) || depth > end->behind ||
        depth > p->full->far_depth) {
        return false;
    }
    coarse_point_past(way, place, k, end->crossing, depth, out->point);
    return in_bounds(p, out->point);
}

/* The first pixel before what is seen next: a plane may come out from behind that. */
static int first_of(const coarse_way *way, const coarse_place *place, const plane_end *end,
                    int reach) {
    int k = 1;
    while (k < reach && coarse_depth_past(way, end->last, end->step, coarse_ahead(way, place, k)) >
                            end->behind) {
        k++;
    }
    return k;
}

/* Ends past which a pixel of the full picture sees the plane; how far that is. */
static void add_reaching(const planes *p, int number, size_t count, csm_plane_ends *out) {
    const coarse_way way = coarse_way_of(&out->full, &out->small, number);
    coarse_place place = {0.0, 0};
    size_t held = out->starts[number];
    for (size_t i = 0; i < count; i++) {
        const plane_end *end = &p->ends[i];
        if (i == 0 || end->place != p->ends[i - 1].place) {
            place = coarse_place_of(&way, end->place);
        }
        csm_plane_end *reaching = &out->ends[held];
        int k = way.most;
        while (k > 0 && !goes_on(p, &way, &place, k, end, reaching)) {
            k--;
        }
        if (k > 0) {
            reaching->depth = depth_of(p->full, reaching->point);
            reaching->last = end->last;
            reaching->step = end->step;
            reaching->place = end->place;
            reaching->crossing = end->crossing;
            reaching->reach = k;
            reaching->first = first_of(&way, &place, end, k);
            held++;
        }
    }
    out->starts[number + 1] = held;
}

static void hold(csm_plane_ends *out, int row, int column) {
    int *box = out->horizon_box;
    if (!out->horizon) {
        out->horizon = true;
        box[0] = box[2] = row;
        box[1] = box[3] = column;
    }
    box[0] = row < box[0] ? row : box[0];
    box[1] = column < box[1] ? column : box[1];
    box[2] = row + 1 > box[2] ? row + 1 : box[2];
    box[3] = column + 1 > box[3] ? column + 1 : box[3];
}

/* The last pixels of planes whose inverse depth comes to 0 before the next, and these. */
static void add_horizon(const planes *p, int way, size_t count, csm_plane_ends *out) {
    const int axis = way_axis(way), length = camera_side(p->picture->camera, axis);
    for (size_t i = 0; i < count; i++) {
        const plane_end *end = &p->ends[i];
        if (end->seen || !(end->last + end->step <= 0.0)) {
            continue;
        }
        for (int ahead = 0; ahead < 2; ahead++) {
            const int place = end->place + ahead < length ? end->place + ahead : length - 1;
            const int along = way_back(way) ? length - 1 - place : place;
            hold(out, axis ? end->crossing : along, axis ? along : end->crossing);
        }
    }
}

static csm_status find(planes *p, csm_plane_ends *out, csm_error *err) {
    make_linear(p);
    judge_all_steps(p);
    for (int way = 0; way < CSM_PLANE_WAYS; way++) {
        const size_t count = find_ends(p, way), room = out->starts[way] + count;
        void *ends = realloc(p->ends, (count + 1) * sizeof *p->ends);
        p->ends = ends ? ends : p->ends;
        void *reaching = realloc(out->ends, (room + 1) * sizeof *out->ends);
        out->ends = reaching ? reaching : out->ends;
        if (!ends || !reaching) {
            return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu ends of planes", room);
        }
        gather(p, way);
        add_reaching(p, way, count, out);
        if (!p->full->orthographic) {
            add_horizon(p, way, count, out);
        }
    }
    return CSM_OK;
}

csm_status csm_coarse_plane_ends(const csm_camera *full, const csm_coarse_picture *picture,
                                 const double bounds[6], csm_plane_ends *out, csm_error *err) {
    *out = (csm_plane_ends){.full = *full, .small = *picture->camera};
    const size_t pixels = (size_t)picture->camera->width * (size_t)picture->camera->height;
    const size_t width = (size_t)picture->camera->width, height = pixels / width;
    planes p = {.full = full,
                .picture = picture,
                .linear = malloc(pixels * sizeof *p.linear),
                .starts = malloc((width + height + 1) * sizeof *p.starts)};
    uint8_t *bytes = malloc(3 * pixels);
    for (int i = 0; i < 6; i++) {
        p.bounds[i] = bounds[i];
        p.slack = fmax(p.slack, 1e-6 * fabs(bounds[i])); /* of depths in single precision */
    }
    csm_status status;
    if (p.linear && p.starts && bytes) {
        p.straight[0] = bytes;
        p.straight[1] = bytes + pixels;
        p.marked = bytes + 2 * pixels;
        status = find(&p, out, err);
    } else {
        status = csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu pixels", pixels);
    }
    free(p.linear);
    free(p.starts);
    free(bytes);
    free(p.ends);
    if (status != CSM_OK) {
        csm_plane_ends_free(out);
    }
    return status;
}

void csm_plane_ends_free(csm_plane_ends *ends) {
    free(ends->ends);
    *ends = (csm_plane_ends){.ends = NULL};
}

size_t csm_plane_end_points(const csm_plane_ends *ends, double (*out)[3]) {
    size_t count = 0;
    for (int number = 0; number < CSM_PLANE_WAYS; number++) {
        const coarse_way way = coarse_way_of(&ends->full, &ends->small, number);
        for (size_t i = ends->starts[number]; i < ends->starts[number + 1]; i++) {
            const csm_plane_end *end = &ends->ends[i];
            const coarse_place place = coarse_place_of(&way, end->place);
            for (int k = end->first; out && k <= end->reach; k++) {
                coarse_end_point(&way, &place, end, k, out[count + (size_t)(k - end->first)]);
            }
            count += (size_t)(end->reach - end->first + 1);
        }
    }
    return count;
}
