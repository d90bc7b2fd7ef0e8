/* storage.c: where the maps lie: layers, tiles of an atlas, textures of their own, faces of a cube.
 *
 * In: canonical settings. Out: a place per cascade, and the size of what holds them. Tiles are
 * packed on shelves, largest first, in the width that leaves the least area.
 */
#include "csm.h"

#include <stdbool.h>

#define EVERY_DRIVER_HAS 16384 /* GL_MAX_TEXTURE_SIZE of OpenGL 4.5 is no less */

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

/* What every driver holds before what only some do, then the least area, then the nearest to a
 * square. */
static bool better(const int size[2], const int than[2]) {
    const int longer[2] = {size[0] > size[1] ? size[0] : size[1],
                           than[0] > than[1] ? than[0] : than[1]};
    const int64_t area[2] = {(int64_t)size[0] * size[1], (int64_t)than[0] * than[1]};
    if ((longer[0] > EVERY_DRIVER_HAS) != (longer[1] > EVERY_DRIVER_HAS)) {
        return longer[0] <= EVERY_DRIVER_HAS;
    }
    return area[0] != area[1] ? area[0] < area[1] : longer[0] < longer[1];
}

static void place_tiles(const csm_settings *settings, csm_place *out, int out_size[2]) {
    const int count = settings->effects[CSM_EFFECT_CASCADE_COUNT];
    const int border = settings->effects[CSM_EFFECT_TILE_BORDER];
    int order[CSM_MAX_CASCADES], width = 0;
    order_by_size(settings, order);
    for (int i = 0; i < count; i++) { /* the sums of the first tiles are all widths that matter */
        width += settings->map_size[order[i]] + 2 * border;
        const int size[2] = {width, pack(settings, order, width, NULL)};
        if (i == 0 || better(size, out_size)) {
            out_size[0] = size[0];
            out_size[1] = size[1];
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
