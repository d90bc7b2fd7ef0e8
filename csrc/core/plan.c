/* plan.c: canonical settings to an ordered list of passes, textures and program keys; no GL.
 *
 * What a setting or an output does not call for is absent here, hence absent on the GPU: target.c
 * allocates exactly these textures, renderer.c runs exactly these steps.
 */
#include "csm.h"

#include <stdio.h>
#include <string.h>

#define MASK_OUTPUTS                                                                               \
    (CSM_OUT_MASK | CSM_OUT_MASK_SINGLE | CSM_OUT_VALID | CSM_OUT_VIEW_DEPTH |                     \
     CSM_OUT_CASCADE_INDEX | CSM_OUT_NORMAL)
/* Outputs that are looked up in maps. */
#define SHADOWS (CSM_OUT_MASK | CSM_OUT_MASK_SINGLE | CSM_OUT_POINTS)

static const struct {
    const char *name;
    unsigned effects; /* CSM_PASS_* that the pass compiles for */
    unsigned outputs; /* CSM_OUT_* that change its code */
} passes[CSM_STEP_COUNT] = {
    [CSM_STEP_VIEW] = {"view", CSM_PASS_VIEW, 0},
    [CSM_STEP_RECEIVER_RANGE] = {"receiver_range", CSM_PASS_IDS, 0},
    [CSM_STEP_RECEIVER_BOUNDS] = {"receiver_bounds", CSM_PASS_IDS | CSM_PASS_RECEIVERS, 0},
    [CSM_STEP_SHADOW_MAP] = {"shadow_map", CSM_PASS_SHADOW_MAP, 0},
    [CSM_STEP_SHADOW_MOMENTS] = {"shadow_moments", CSM_PASS_SHADOW_MOMENTS, 0},
    [CSM_STEP_SHADOW_BLUR] = {"shadow_blur", CSM_PASS_SHADOW_BLUR, 0},
    [CSM_STEP_SHADOW_SUM] = {"shadow_sum", CSM_PASS_SHADOW_SUM, 0},
    [CSM_STEP_SHADOW_MIPS] = {"shadow_mips", 0, 0},
    [CSM_STEP_SHADOW_MASK] = {"shadow_mask", CSM_PASS_SHADOW_MASK, MASK_OUTPUTS},
    [CSM_STEP_SHADOW_FORWARD] = {"shadow_forward", CSM_PASS_SHADOW_MASK | CSM_PASS_SHADOW_FORWARD,
                                 MASK_OUTPUTS},
    [CSM_STEP_SHADOW_POINTS] = {"shadow_points", CSM_PASS_SHADOW_MASK, 0},
};

static const struct {
    const char *name;
    unsigned bit;
} output_names[] = {
    {"MASK", CSM_OUT_MASK},
    {"MASK_SINGLE", CSM_OUT_MASK_SINGLE},
    {"VALID", CSM_OUT_VALID},
    {"VIEW_DEPTH", CSM_OUT_VIEW_DEPTH},
    {"CASCADE_INDEX", CSM_OUT_CASCADE_INDEX},
    {"NORMAL", CSM_OUT_NORMAL},
};

const char *csm_pass_name(csm_pass pass) {
    return passes[pass].name;
}

const char *csm_step_name(csm_pass pass, int cascade) {
#define NAMES(name)                                                                                \
    { name "_0", name "_1", name "_2", name "_3", name "_4", name "_5", name "_6", name "_7" }
    static const char *const names[][CSM_MAX_CASCADES] = {
        NAMES("shadow_map"), NAMES("shadow_moments"), NAMES("shadow_blur"), NAMES("shadow_sum")};
#undef NAMES
    return cascade < 0 ? passes[pass].name : names[pass - CSM_STEP_SHADOW_MAP][cascade];
}

/* 0 where the pass does not see the effect, so that a sweep over it compiles nothing. */
static int seen(csm_pass pass, const csm_settings *canonical, int effect) {
    bool visible = csm_effect_describe(effect)->passes & passes[pass].effects;
    return visible ? canonical->effects[effect] : 0;
}

static uint64_t hash(uint64_t key, uint64_t value) {
    for (int byte = 0; byte < 8; byte++) { /* FNV-1a */
        key = (key ^ ((value >> (8 * byte)) & 0xffu)) * 0x100000001b3u;
    }
    return key;
}

uint64_t csm_program_key(csm_pass pass, const csm_settings *canonical, unsigned outputs) {
    uint64_t key = hash(0xcbf29ce484222325u, (uint64_t)pass);
    for (int effect = 0; effect < CSM_EFFECT_COUNT; effect++) {
        key = hash(key, (uint64_t)seen(pass, canonical, effect));
    }
    return hash(key, outputs & passes[pass].outputs);
}

typedef struct text_out {
    char *text;
    size_t size, length;
} text_out;

static void define(text_out *out, const char *group, const char *name, size_t name_length,
                   int value) {
    size_t room = out->length < out->size ? out->size - out->length : 0;
    char *at = room ? out->text + out->length : NULL;
    out->length += (size_t)snprintf(at, room, "#define CSM_%s%s%.*s %d\n", group, *group ? "_" : "",
                                    (int)name_length, name, value);
}

static void define_choices(text_out *out, const csm_effect_info *row) {
    int value = 0;
    for (const char *at = row->choices; *at; value++) {
        size_t length = strcspn(at, " ");
        char upper[32] = {0};
        for (size_t i = 0; i < length && i < sizeof upper - 1; i++) {
            upper[i] = at[i] >= 'a' && at[i] <= 'z' ? (char)(at[i] - 'a' + 'A') : at[i];
        }
        define(out, row->id, upper, strlen(upper), value);
        at += length + (at[length] == ' ');
    }
}

size_t csm_program_defines(csm_pass pass, const csm_settings *canonical, unsigned outputs,
                           char *text, size_t size) {
    text_out out = {text, size, 0};
    for (int effect = 0; effect < CSM_EFFECT_COUNT; effect++) {
        const csm_effect_info *row = csm_effect_describe(effect);
        define(&out, "", row->id, strlen(row->id), seen(pass, canonical, effect));
        define_choices(&out, row);
    }
    unsigned used = outputs & passes[pass].outputs;
    for (size_t i = 0; i < sizeof output_names / sizeof *output_names; i++) {
        define(&out, "OUT", output_names[i].name, strlen(output_names[i].name),
               (used & output_names[i].bit) != 0);
    }
    return out.length;
}

static void add_program(csm_plan *plan, csm_pass pass, uint64_t key) {
    for (int i = 0; i < plan->program_count; i++) {
        if (plan->program_keys[i] == key) {
            return;
        }
    }
    plan->program_passes[plan->program_count] = pass;
    plan->program_keys[plan->program_count++] = key;
}

static void add_step(csm_plan *plan, csm_pass pass, int cascade, const csm_settings *canonical) {
    const bool programmed = pass != CSM_STEP_SHADOW_MIPS;
    uint64_t key = programmed ? csm_program_key(pass, canonical, plan->outputs) : 0;
    plan->steps[plan->step_count++] = (csm_plan_step){pass, cascade, key};
    if (!programmed) {
        return;
    }
    add_program(plan, pass, key);
    if (seen(pass, canonical, CSM_EFFECT_ALPHA_TEST)) {
        /* what has no cut-out is drawn by the program of scenes without one */
        csm_settings solid = *canonical;
        solid.effects[CSM_EFFECT_ALPHA_TEST] = 0;
        add_program(plan, pass, csm_program_key(pass, &solid, plan->outputs));
    }
}

static csm_plan_texture *add_texture(csm_plan *plan, const char *name, const char *format,
                                     int width, int height, int layers, int texel_bytes) {
    csm_plan_texture *texture = &plan->textures[plan->texture_count++];
    snprintf(texture->name, sizeof texture->name, "%s", name);
    snprintf(texture->format, sizeof texture->format, "%s", format);
    texture->width = width;
    texture->height = height;
    texture->layers = layers;
    texture->samples = texture->levels = 1;
    texture->bytes = (uint64_t)width * (uint64_t)height * (uint64_t)layers * (uint64_t)texel_bytes;
    plan->bytes += texture->bytes;
    return texture;
}

/* What the mask pass writes and the host reads, per pixel. */
static uint64_t output_bytes(unsigned outputs) {
    uint64_t bytes = outputs & CSM_OUT_MASK ? 4 : 0;
    bytes += outputs & CSM_OUT_MASK_SINGLE ? 4 : 0;
    bytes += outputs & (CSM_OUT_VALID | CSM_OUT_CASCADE_INDEX) ? 4 : 0; /* packed in one word */
    bytes += outputs & CSM_OUT_VIEW_DEPTH ? 4 : 0;
    bytes += outputs & CSM_OUT_NORMAL ? 12 : 0;
    return bytes;
}

size_t csm_receiver_runs(int width, int height) {
    return (size_t)width * (((size_t)height + CSM_RECEIVER_RUN - 1) / CSM_RECEIVER_RUN);
}

uint64_t csm_receiver_range_bytes(int width, int height) {
    return CSM_DEPTH_BINS * sizeof(uint32_t) + csm_receiver_runs(width, height) * 2 * sizeof(float);
}

uint64_t csm_receiver_bounds_bytes(int width, int height, int cascade_count) {
    return csm_receiver_runs(width, height) * (size_t)cascade_count * 4 * sizeof(float);
}

static void add_samples(csm_plan *plan, const csm_settings *canonical, const char *format, int size,
                        int texel_bytes) {
    const int samples = canonical->effects[CSM_EFFECT_SAMPLES];
    csm_plan_texture *texture =
        add_texture(plan, "shadow_samples", format, size, size, 1, texel_bytes * samples);
    texture->samples = samples;
}

typedef struct depth_format {
    const char *name;
    int bytes;
} depth_format;

static const depth_format depth_formats[] = {
    [CSM_DEPTH_D32F] = {"d32f", 4}, [CSM_DEPTH_D24] = {"d24", 4}, [CSM_DEPTH_D16] = {"d16", 2}};

static const depth_format *depth_format_of(const csm_settings *canonical) {
    return &depth_formats[canonical->effects[CSM_EFFECT_DEPTH_FORMAT]];
}

int csm_depth_bytes(int format) {
    return depth_formats[format].bytes;
}

/* Textures of the depths that casters are drawn into. */
static void add_map_textures(csm_plan *plan, const csm_settings *canonical) {
    const int *effects = canonical->effects;
    const int count = effects[CSM_EFFECT_CASCADE_COUNT];
    const char *format = depth_format_of(canonical)->name;
    const int bytes = depth_format_of(canonical)->bytes;
    const bool kept = (plan->outputs & CSM_OUT_SHADOW_MAPS) ||
                      csm_settings_moments(canonical).kind == CSM_LOOKS_AT_DEPTHS;
    csm_place places[CSM_MAX_CASCADES];
    int size[2];
    csm_storage_places(canonical, places, size);
    if (effects[CSM_EFFECT_SAMPLES] > 1) {
        add_samples(plan, canonical, format, size[0], bytes);
        if (!kept) {
            return;
        }
    }
    switch (effects[CSM_EFFECT_STORAGE]) {
    case CSM_STORAGE_ATLAS:
        add_texture(plan, "shadow_maps", format, size[0], size[1], 1, bytes);
        if (effects[CSM_EFFECT_COPIED_TILES]) {
            int largest = 0;
            for (int i = 0; i < count; i++) {
                largest = places[i].size > largest ? places[i].size : largest;
            }
            add_texture(plan, "shadow_tile", format, largest, largest, 1, bytes);
        }
        break;
    case CSM_STORAGE_SEPARATE:
        for (int i = 0; i < count; i++) {
            char name[32];
            snprintf(name, sizeof name, "shadow_maps_%d", i);
            add_texture(plan, name, format, places[i].size, places[i].size, 1, bytes);
        }
        break;
    case CSM_STORAGE_CUBE:
        add_texture(plan, "shadow_maps", format, size[0], size[1], 6, bytes)->kind =
            CSM_TEXTURE_CUBE;
        break;
    default: /* of depths that only moments are made from, one layer serves all cascades in turn */
        add_texture(plan, "shadow_maps", format, size[0], size[1], kept ? count : 1, bytes)->kind =
            CSM_TEXTURE_ARRAY;
    }
}

void csm_plan_add_scroll(const csm_settings *canonical, csm_plan *plan) {
    int size = 0;
    for (int i = 0; i < canonical->effects[CSM_EFFECT_CASCADE_COUNT]; i++) {
        size = canonical->map_size[i] > size ? canonical->map_size[i] : size;
    }
    const depth_format *format = depth_format_of(canonical);
    add_texture(plan, "shadow_scroll", format->name, size, size, 1, format->bytes);
}

static int level_count(int size) {
    int levels = 1;
    while (size >> levels && levels <= CSM_MAX_LEVEL) {
        levels++;
    }
    return levels;
}

/* What a prefiltered filter is made from and looked up in. */
static void add_moment_steps(csm_plan *plan, const csm_settings *canonical, int cascade) {
    const csm_moments moments = csm_settings_moments(canonical);
    if (moments.kind == CSM_LOOKS_AT_DEPTHS) {
        return;
    }
    add_step(plan, CSM_STEP_SHADOW_MOMENTS, cascade, canonical);
    if (moments.blurred) {
        add_step(plan, CSM_STEP_SHADOW_BLUR, cascade, canonical);
    }
    if (moments.kind == CSM_LOOKS_AT_SUMS) {
        add_step(plan, CSM_STEP_SHADOW_SUM, cascade, canonical);
    }
}

static void add_moment_textures(csm_plan *plan, const csm_settings *canonical) {
    const csm_moments moments = csm_settings_moments(canonical);
    const int count = canonical->effects[CSM_EFFECT_CASCADE_COUNT];
    int size = 0; /* of a layer: smaller maps lie in the lower left corner of theirs */
    if (moments.kind == CSM_LOOKS_AT_DEPTHS) {
        return;
    }
    for (int i = 0; i < count; i++) {
        size = canonical->map_size[i] > size ? canonical->map_size[i] : size;
    }
    csm_plan_texture *texture = add_texture(plan, "moments", moments.format, size, size,
                                            count * moments.slices, moments.texel_bytes);
    texture->kind = CSM_TEXTURE_ARRAY;
    if (moments.mipmapped) {
        texture->levels = level_count(size);
        for (int level = 1; level < texture->levels; level++) {
            const uint64_t side = (uint64_t)(size >> level);
            const uint64_t bytes = side * side * (uint64_t)(texture->layers * moments.texel_bytes);
            texture->bytes += bytes;
            plan->bytes += bytes;
        }
        add_step(plan, CSM_STEP_SHADOW_MIPS, -1, canonical);
    }
    if (moments.blurred || moments.kind == CSM_LOOKS_AT_SUMS) {
        add_texture(plan, "moments_between", moments.format, size, size, 1, moments.texel_bytes)
            ->kind = CSM_TEXTURE_ARRAY;
    }
}

csm_status csm_plan_make(const csm_settings *settings, int width, int height, unsigned outputs,
                         csm_plan *out, csm_error *err) {
    csm_settings canonical = *settings;
    csm_settings_canonical(&canonical);
    int count = canonical.effects[CSM_EFFECT_CASCADE_COUNT];
    bool shadowed = canonical.effects[CSM_EFFECT_FILTER] != CSM_FILTER_NONE;
    const bool moments = csm_settings_moments(&canonical).kind > CSM_LOOKS_AT_DEPTHS &&
                         (outputs & (SHADOWS | CSM_OUT_MOMENTS));
    const bool maps = shadowed && (moments || (outputs & (SHADOWS | CSM_OUT_SHADOW_MAPS)));

    if (!outputs) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT, "outputs must name at least one output");
    }
    if (width < 1 || height < 1) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "size must be at least 1 x 1 pixels (got %d x %d)", width, height);
    }
    memset(out, 0, sizeof *out);
    out->outputs = outputs;
    const int split = canonical.effects[CSM_EFFECT_SPLIT];
    /* cascades belong to every frame, so what they are fitted to is summed up whatever is asked */
    bool range = shadowed && (split == CSM_SPLIT_SDSM || split == CSM_SPLIT_HISTOGRAM);
    bool bounds = shadowed && canonical.effects[CSM_EFFECT_FIT] == CSM_FIT_VISIBLE;
    if ((outputs & MASK_OUTPUTS) || range || bounds) {
        add_step(out, CSM_STEP_VIEW, -1, &canonical);
        bool instances = canonical.effects[CSM_EFFECT_INSTANCES];
        add_texture(out, "view_ids", instances ? "rg32ui" : "r32ui", width, height, 1,
                    instances ? 8 : 4);
        add_texture(out, "view_depth", "d32f", width, height, 1, 4);
        out->bytes += (uint64_t)width * (uint64_t)height * output_bytes(outputs);
    }
    if (range) {
        add_step(out, CSM_STEP_RECEIVER_RANGE, -1, &canonical);
        out->bytes += csm_receiver_range_bytes(width, height);
    }
    if (bounds) {
        add_step(out, CSM_STEP_RECEIVER_BOUNDS, -1, &canonical);
        if (canonical.effects[CSM_EFFECT_TURNED]) { /* once more, along the turned axes */
            add_step(out, CSM_STEP_RECEIVER_BOUNDS, -1, &canonical);
        }
        out->bytes += csm_receiver_bounds_bytes(width, height, count);
    }
    if (maps) {
        add_map_textures(out, &canonical);
        for (int i = 0; i < count; i++) {
            add_step(out, CSM_STEP_SHADOW_MAP, i, &canonical);
            if (moments) {
                add_moment_steps(out, &canonical, i);
            }
        }
        if (moments) {
            add_moment_textures(out, &canonical);
        }
    }
    if (outputs & MASK_OUTPUTS) {
        bool forward = canonical.effects[CSM_EFFECT_TEXCOORD] == CSM_TEXCOORD_INTERPOLATED;
        add_step(out, forward ? CSM_STEP_SHADOW_FORWARD : CSM_STEP_SHADOW_MASK, -1, &canonical);
    }
    if ((outputs & CSM_OUT_POINTS) && shadowed) {
        add_step(out, CSM_STEP_SHADOW_POINTS, -1, &canonical);
    }
    return CSM_OK;
}
