/* reuse.c: what of an earlier shadow map may be kept, and what must be drawn (docs/numerics.md 33).
 *
 * In: what a map holds, what a frame wants of it. Out: nothing to do, casters to add, a scroll, or
 * all of it. Two maps of one scene under equal settings are equal texel by texel if their matrices
 * and casters are: nothing else reaches the pass that draws them. Casters beyond those wanted do
 * not count, for culling proves that no lookup of the frame meets them (docs/numerics.md 10).
 */
#include "csm.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *csm_reuse_name(csm_reuse_action action) {
    static const char *const names[CSM_REUSE_COUNT] = {"draw", "keep", "add", "scroll"};
    return names[action];
}

void csm_map_content_make(const csm_cascades *cascades, int cascade, const csm_camera *camera,
                          const csm_settings *canonical, csm_map_content *out) {
    memset(out, 0, sizeof *out);
    out->map_size = cascades->map_size[cascade];
    out->texel_bytes = csm_depth_bytes(canonical->effects[CSM_EFFECT_DEPTH_FORMAT]);
    out->snapped = canonical->effects[CSM_EFFECT_SNAP] != CSM_SNAP_NONE;
    memcpy(out->base_from_world, cascades->light_from_world[0], sizeof out->base_from_world);
    memcpy(out->light_from_world, cascades->light_from_world[cascade],
           sizeof out->light_from_world);
    memcpy(out->clip_from_light, cascades->clip_from_light[cascade], sizeof out->clip_from_light);
    memcpy(out->clip_from_world, cascades->clip_from_world[cascade], sizeof out->clip_from_world);
    memcpy(out->texel_size, cascades->texel_size[cascade], sizeof out->texel_size);
    memcpy(out->depth_range, cascades->depth_range[cascade], sizeof out->depth_range);
    memcpy(out->lattice, cascades->lattice[cascade], sizeof out->lattice);
    if (canonical->effects[CSM_EFFECT_WARPED]) {
        out->warp = cascades->warp[cascade];
        memcpy(out->eye, camera->eye, sizeof out->eye);
    }
}

bool csm_settings_equal(const csm_settings *one, const csm_settings *other) {
    bool equal =
        !memcmp(one->effects, other->effects, sizeof one->effects) &&
        !memcmp(one->map_size, other->map_size, sizeof one->map_size) &&
        !memcmp(one->manual_splits, other->manual_splits, sizeof one->manual_splits) &&
        !memcmp(one->manual_depth_range, other->manual_depth_range, sizeof one->manual_depth_range);
    const csm_number_info *number;
    for (int i = 0; equal && (number = csm_number_describe(i)) != NULL; i++) {
        equal = !memcmp((const char *)one + number->offset, (const char *)other + number->offset,
                        sizeof(double));
    }
    return equal;
}

unsigned csm_reuse_allowed(const csm_settings *canonical, bool scroll) {
    const int *effects = canonical->effects;
    const bool depths = csm_settings_moments(canonical).kind == CSM_LOOKS_AT_DEPTHS &&
                        effects[CSM_EFFECT_SAMPLES] == 1 && !effects[CSM_EFFECT_COPIED_TILES] &&
                        !effects[CSM_EFFECT_WARPED];
    unsigned allowed = CSM_REUSE_MAY_KEEP;
    allowed |= depths ? CSM_REUSE_MAY_ADD : 0;
    allowed |=
        depths && scroll && effects[CSM_EFFECT_SNAP] != CSM_SNAP_NONE ? CSM_REUSE_MAY_SCROLL : 0;
    return allowed;
}

/* Everything that a lattice does not move. */
static bool same_but_place(const csm_map_content *one, const csm_map_content *other) {
    const double *a = one->clip_from_light, *b = other->clip_from_light;
    return !memcmp(a, b, 12 * sizeof *a) && !memcmp(a + 14, b + 14, 2 * sizeof *a) &&
           one->map_size == other->map_size && one->snapped == other->snapped &&
           !memcmp(one->base_from_world, other->base_from_world, sizeof one->base_from_world) &&
           !memcmp(one->light_from_world, other->light_from_world, sizeof one->light_from_world) &&
           !memcmp(one->texel_size, other->texel_size, sizeof one->texel_size) &&
           !memcmp(one->depth_range, other->depth_range, sizeof one->depth_range) &&
           !memcmp(&one->warp, &other->warp, sizeof one->warp) &&
           !memcmp(one->eye, other->eye, sizeof one->eye);
}

static bool same_place(const csm_map_content *one, const csm_map_content *other) {
    return !memcmp(one->clip_from_light, other->clip_from_light, sizeof one->clip_from_light) &&
           !memcmp(one->clip_from_world, other->clip_from_world, sizeof one->clip_from_world) &&
           !memcmp(one->lattice, other->lattice, sizeof one->lattice);
}

/* Texels by which the window moved; false if no part of it is left. */
static bool whole_texels(const csm_map_content *held, const csm_map_content *wanted,
                         int out_shift[2]) {
    for (int axis = 0; axis < 2; axis++) {
        const int64_t moved = wanted->lattice[axis] - held->lattice[axis];
        if (moved <= -wanted->map_size || moved >= wanted->map_size) {
            return false;
        }
        out_shift[axis] = (int)moved;
    }
    return true;
}

/* Splits wanted items into those held and those missing, each ascending. */
static void split_items(const csm_map_content *held, const csm_map_content *wanted,
                        uint32_t *out_shared, size_t *out_shared_count, uint32_t *out_missing,
                        size_t *out_missing_count) {
    size_t at = 0;
    *out_shared_count = *out_missing_count = 0;
    for (size_t i = 0; i < wanted->item_count; i++) {
        const uint32_t item = wanted->items[i];
        while (at < held->item_count && held->items[at] < item) {
            at++;
        }
        if (at < held->item_count && held->items[at] == item) {
            out_shared[(*out_shared_count)++] = item;
        } else {
            out_missing[(*out_missing_count)++] = item;
        }
    }
}

size_t csm_items_joined(const uint32_t *one, size_t one_count, const uint32_t *other,
                        size_t other_count, uint32_t *out) {
    size_t i = 0, k = 0, count = 0;
    while (i < one_count || k < other_count) {
        const bool first = k == other_count || (i < one_count && one[i] <= other[k]);
        const uint32_t item = first ? one[i] : other[k];
        i += i < one_count && one[i] == item;
        k += k < other_count && other[k] == item;
        out[count++] = item;
    }
    return count;
}

int64_t csm_items_triangles(const csm_geometry *geometry, const uint32_t *items,
                            size_t item_count) {
    int64_t triangles = 0;
    for (size_t i = 0; i < item_count; i++) {
        triangles += geometry->chunks[geometry->items[items[i]].chunk].triangle_count;
    }
    return triangles;
}

static void add_part(csm_reuse *reuse, int x, int y, int width, int height, bool cleared,
                     const uint32_t *items, size_t item_count) {
    reuse->parts[reuse->part_count++] =
        (csm_reuse_part){x, y, width, height, cleared, items, item_count};
}

static void draw_all(const csm_map_content *wanted, csm_reuse *out) {
    *out = (csm_reuse){.action = CSM_REUSE_DRAW};
    add_part(out, 0, 0, wanted->map_size, wanted->map_size, true, wanted->items,
             wanted->item_count);
}

/* Casters whose box meets a part of the map, and a texel round it: the rasteriser moves corners. */
static size_t items_in_part(const csm_geometry *geometry, const csm_cascades *cascades, int cascade,
                            const csm_reuse_part *part, const uint32_t *items, size_t count,
                            uint32_t *out) {
    csm_cull_volume volume = {.lowest_z = -INFINITY, .stretch = cascades->stretch};
    double window[4], texel;
    csm_cascade_window(cascades, cascade, window, &texel);
    memcpy(volume.light_from_world, cascades->light_from_world[cascade],
           sizeof volume.light_from_world);
    const int first[2] = {part->x, part->y}, sides[2] = {part->width, part->height};
    for (int axis = 0; axis < 2; axis++) {
        const double side = cascades->texel_size[cascade][axis];
        volume.window[axis] = window[axis] + first[axis] * side;
        volume.window[axis + 2] = window[axis] + (first[axis] + sides[axis]) * side;
    }
    volume.margin = texel;
    return csm_cull_list(geometry, &volume, items, count, out);
}

/* The exposed strips, which do not overlap: rows over the whole width, columns in the other rows.
 */
static void expose(int size, const int shift[2], csm_reuse *out) {
    const int rows = abs(shift[1]), columns = abs(shift[0]);
    if (rows) {
        add_part(out, 0, shift[1] > 0 ? size - rows : 0, size, rows, true, NULL, 0);
    }
    if (columns) {
        add_part(out, shift[0] > 0 ? size - columns : 0, shift[1] < 0 ? rows : 0, columns,
                 size - rows, true, NULL, 0);
    }
}

bool csm_scroll_pays(const csm_map_content *wanted, const csm_reuse *scroll,
                     int64_t triangles_scrolled, int64_t triangles_whole) {
    const double texels = (double)wanted->map_size * wanted->map_size;
    const double copy = CSM_SCROLL_COPY * wanted->texel_bytes / 4.0;
    double exposed = 0.0;
    for (int i = 0; i < scroll->part_count; i++) {
        const csm_reuse_part *part = &scroll->parts[i];
        exposed += part->cleared ? (double)part->width * part->height : 0.0;
    }
    const double whole = texels + CSM_SCROLL_TRIANGLE * (double)triangles_whole + CSM_SCROLL_PART;
    const double less = copy * (texels - exposed) + exposed +
                        CSM_SCROLL_TRIANGLE * (double)triangles_scrolled +
                        CSM_SCROLL_PART * scroll->part_count;
    return less < whole;
}

/* False where drawing everything costs less. */
static bool scroll(const csm_geometry *geometry, const csm_cascades *cascades, int cascade,
                   const csm_map_content *wanted, const uint32_t *shared, size_t shared_count,
                   const uint32_t *missing, size_t missing_count, uint32_t *scratch,
                   csm_reuse *out) {
    out->action = CSM_REUSE_SCROLL;
    expose(wanted->map_size, out->shift, out);
    int64_t triangles = csm_items_triangles(geometry, missing, missing_count);
    for (int i = 0; i < out->part_count; i++) {
        csm_reuse_part *part = &out->parts[i];
        part->item_count =
            items_in_part(geometry, cascades, cascade, part, shared, shared_count, scratch);
        part->items = scratch;
        scratch += wanted->item_count;
        triangles += csm_items_triangles(geometry, part->items, part->item_count);
    }
    if (missing_count) {
        add_part(out, 0, 0, wanted->map_size, wanted->map_size, false, missing, missing_count);
    }
    return csm_scroll_pays(wanted, out, triangles,
                           csm_items_triangles(geometry, wanted->items, wanted->item_count));
}

void csm_reuse_choose(const csm_geometry *geometry, const csm_cascades *cascades, int cascade,
                      const csm_map_content *held, const csm_map_content *wanted, unsigned allowed,
                      uint32_t *scratch, csm_reuse *out) {
    draw_all(wanted, out);
    if (!held || !(allowed & CSM_REUSE_MAY_KEEP) || !same_but_place(held, wanted)) {
        return;
    }
    const size_t room = wanted->item_count;
    uint32_t *shared = scratch, *missing = scratch + room;
    size_t shared_count, missing_count;
    csm_reuse chosen = {.action = CSM_REUSE_KEEP};
    split_items(held, wanted, shared, &shared_count, missing, &missing_count);
    if (same_place(held, wanted)) {
        if (missing_count && !(allowed & CSM_REUSE_MAY_ADD)) {
            return;
        }
        if (missing_count) {
            chosen.action = CSM_REUSE_ADD;
            add_part(&chosen, 0, 0, wanted->map_size, wanted->map_size, false, missing,
                     missing_count);
        }
        *out = chosen;
    } else if ((allowed & CSM_REUSE_MAY_SCROLL) && held->snapped &&
               whole_texels(held, wanted, chosen.shift) &&
               scroll(geometry, cascades, cascade, wanted, shared, shared_count, missing,
                      missing_count, scratch + 2 * room, &chosen)) {
        *out = chosen;
    }
}
