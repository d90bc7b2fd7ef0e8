/* storage.c: where the maps lie: layers, tiles of an atlas, textures of their own, faces of a cube.
 *
 * In: canonical settings. Out: a place per cascade, and the size of what holds them. Tiles are
 * packed on shelves, largest first, in the width that leaves the least area.
 */
#include "csm.h"

static int largest_size(const csm_settings *settings) {
    int largest = 0;
    for (int i = 0; i < settings->effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        largest = settings->map_size[i] > largest ? settings->map_size[i] : largest;
    }
    return largest;
}

/* Cascades by falling size, those of equal size in their order. */
static void order_by_size(const csm_settings *settings, int out[CSM_MAX_CASCADES]) {
    for (int i = 0; i < settings->effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        int at = i;
        while (at > 0 && settings->map_size[out[at - 1]] < settings->map_size[i]) {
            out[at] = out[at - 1];
            at--;
        }
        out[at] = i;
    }
}

/* Height of the shelves at a width; places may be NULL. */
static int pack(const csm_settings *settings, const int *order, int width, csm_place *places) {
    const int border = settings->effects[CSM_EFFECT_TILE_BORDER];
    int x = 0, y = 0, shelf = 0;
    for (int i = 0; i < settings->effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        const int size = settings->map_size[order[i]];
        const int tile = size + 2 * border;
        if (x + tile > width) {
            y += shelf;
            x = shelf = 0;
        }
        shelf = tile > shelf ? tile : shelf;
        if (places) {
            places[order[i]] = (csm_place){x + border, y + border, size, 0};
        }
        x += tile;
    }
    return y + shelf;
}

static void place_tiles(const csm_settings *settings, csm_place *out, int out_size[2]) {
    const int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    const int border = settings->effects[CSM_EFFECT_TILE_BORDER];
    int order[CSM_MAX_CASCADES], width = 0;
    int64_t best = INT64_MAX;
    order_by_size(settings, order);
    for (int i = 0; i < count; i++) { /* the sums of the first tiles are all widths that matter */
        width += settings->map_size[order[i]] + 2 * border;
        const int height = pack(settings, order, width, NULL);
        const int64_t longer = width > height ? width : height;
        /* the least area, and of equal ones the one nearest to a square: textures have a limit */
        const int64_t cost = (int64_t)width * height * 65536 + longer;
        if (cost < best) {
            best = cost;
            out_size[0] = width;
            out_size[1] = height;
        }
    }
    pack(settings, order, out_size[0], out);
}

void csm_storage_places(const csm_settings *settings, csm_place out[CSM_MAX_CASCADES],
                        int out_size[2]) {
    if (settings->effects[CSM_EFFECT_STORAGE] == CSM_STORAGE_ATLAS) {
        place_tiles(settings, out, out_size);
        return;
    }
    /* smaller maps lie in the lower left corner of their layer */
    out_size[0] = out_size[1] = largest_size(settings);
    for (int i = 0; i < settings->effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        out[i] = (csm_place){0, 0, settings->map_size[i], i};
    }
}
