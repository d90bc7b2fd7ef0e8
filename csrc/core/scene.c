/* scene.c: meshes and instances to what is drawn: origin-relative float32 positions, triangles
 * sorted into compact chunks, the plane of every triangle, and one culling box per chunk and
 * instance.
 *
 * In: double positions and transforms. Out: csm_geometry. What is rounded to float32 here is what
 * the GPU rasterises and what the ray-traced truth must round alike (positions minus the scene's
 * origin).
 */
#include "cutouts.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Small enough that a chunk is compact against a cascade, large enough that a million triangles
 * make some thousand boxes: culling all of them stays below a tenth of a millisecond per cascade.
 */
#define CHUNK_TRIANGLES 192u
#define MORTON_BITS 10

typedef struct sort_key {
    uint32_t code, triangle;
} sort_key;

typedef struct mesh_use {
    size_t first_triangle;
    int32_t count, first_place; /* how often the mesh occurs; where its instances begin in order */
    double pivot[3];            /* what its local positions are relative to when stored once */
} mesh_use;

/* Everything a build needs beside its input and output. */
typedef struct scene_build {
    const csm_scene_desc *desc;
    mesh_use *uses;         /* one per mesh */
    int *mesh_order;        /* meshes as they are written: those with a cut-out last */
    size_t *cutout_words;   /* where each mesh's image begins */
    int32_t *order;         /* instances, grouped by mesh */
    int32_t *row;           /* row of csm_geometry.instances, one per instance */
    sort_key *keys;         /* triangles of the mesh at hand */
    uint32_t *vertex_place; /* where its vertices went, UINT32_MAX: nowhere yet */
    csm_cutout_writer cutouts;
    csm_geometry *out;
    bool boxes_alone;   /* chunks and their boxes, nothing to draw */
    size_t chunk, item; /* written so far */
} scene_build;

static void transform_point(const double m[16], const double p[3], double out[3]) {
    for (int row = 0; row < 3; row++) {
        out[row] = m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row];
    }
}

static double determinant(const double m[16]) {
    return m[0] * (m[5] * m[10] - m[9] * m[6]) - m[4] * (m[1] * m[10] - m[9] * m[2]) +
           m[8] * (m[1] * m[6] - m[5] * m[2]);
}

static bool all_finite(const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

static csm_status check_mesh(const csm_mesh_view *mesh, int number, csm_error *err) {
    if (!mesh->vertex_count || !mesh->triangle_count) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "mesh %d must have vertices and triangles (got %zu and %zu)", number,
                        mesh->vertex_count, mesh->triangle_count);
    }
    if (!all_finite(mesh->positions, 3 * mesh->vertex_count)) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "positions of mesh %d must be finite (got NaN or inf)", number);
    }
    for (size_t i = 0; i < 3 * mesh->triangle_count; i++) {
        if (mesh->triangles[i] < 0 || (size_t)mesh->triangles[i] >= mesh->vertex_count) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "triangles of mesh %d must index its %zu vertices (got %d)", number,
                            mesh->vertex_count, (int)mesh->triangles[i]);
        }
    }
    return csm_cutout_check(mesh, number, err);
}

static csm_status check_scene(const csm_scene_desc *desc, csm_error *err) {
    if (desc->mesh_count < 1 || desc->instance_count < 1) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "a scene must have at least one mesh and one instance (got %d and %d)",
                        desc->mesh_count, desc->instance_count);
    }
    for (int i = 0; i < desc->mesh_count; i++) {
        csm_status status = check_mesh(&desc->meshes[i], i, err);
        if (status != CSM_OK) {
            return status;
        }
    }
    for (int i = 0; i < desc->instance_count; i++) {
        const double *m = desc->world_from_instance + 16 * (size_t)i;
        if (desc->instance_mesh[i] < 0 || desc->instance_mesh[i] >= desc->mesh_count) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "instance %d must name one of %d meshes (got %d)", i, desc->mesh_count,
                            (int)desc->instance_mesh[i]);
        }
        if (!all_finite(m, 16) || determinant(m) == 0.0) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "the transform of instance %d must be finite and invertible", i);
        }
    }
    return CSM_OK;
}

static uint32_t spread_bits(uint32_t x) {
    uint32_t out = 0;
    for (int bit = 0; bit < MORTON_BITS; bit++) {
        out |= ((x >> bit) & 1u) << (3 * bit);
    }
    return out;
}

static int by_code(const void *a, const void *b) {
    const sort_key *ka = a, *kb = b;
    if (ka->code != kb->code) {
        return ka->code < kb->code ? -1 : 1;
    }
    return ka->triangle < kb->triangle ? -1 : ka->triangle > kb->triangle;
}

static void grow(double bounds[6], const double p[3]) {
    for (int axis = 0; axis < 3; axis++) {
        bounds[axis] = fmin(bounds[axis], p[axis]);
        bounds[3 + axis] = fmax(bounds[3 + axis], p[axis]);
    }
}

static void empty_bounds(double bounds[6]) {
    for (int axis = 0; axis < 3; axis++) {
        bounds[axis] = INFINITY;
        bounds[3 + axis] = -INFINITY;
    }
}

static void mesh_bounds(const csm_mesh_view *mesh, double bounds[6]) {
    empty_bounds(bounds);
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        grow(bounds, mesh->positions + 3 * v);
    }
}

/* Order of the mesh's triangles along a Morton curve of their centroids. */
static void sort_triangles(const csm_mesh_view *mesh, sort_key *keys) {
    double bounds[6];
    mesh_bounds(mesh, bounds);
    double extent = fmax(bounds[3] - bounds[0], fmax(bounds[4] - bounds[1], bounds[5] - bounds[2]));
    double scale = extent > 0.0 ? ((1 << MORTON_BITS) - 1) / extent : 0.0;
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        uint32_t code = 0;
        for (int axis = 0; axis < 3; axis++) {
            double sum = 0.0;
            for (int corner = 0; corner < 3; corner++) {
                sum += mesh->positions[3 * (size_t)mesh->triangles[3 * t + corner] + axis];
            }
            code |= spread_bits((uint32_t)((sum / 3.0 - bounds[axis]) * scale)) << axis;
        }
        keys[t] = (sort_key){code, (uint32_t)t};
    }
    qsort(keys, mesh->triangle_count, sizeof *keys, by_code);
}

/* Unit normal and offset of a triangle from its rounded corners: the plane that is rasterised. */
static void plane_of(const float *a, const float *b, const float *c, float out[4]) {
    double e[3], f[3], n[3];
    for (int axis = 0; axis < 3; axis++) {
        e[axis] = (double)b[axis] - a[axis];
        f[axis] = (double)c[axis] - a[axis];
    }
    n[0] = e[1] * f[2] - e[2] * f[1];
    n[1] = e[2] * f[0] - e[0] * f[2];
    n[2] = e[0] * f[1] - e[1] * f[0];
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(length > 0.0)) {
        memset(out, 0, 4 * sizeof *out);
        return;
    }
    double offset = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        n[axis] /= length;
        offset += n[axis] * a[axis];
        out[axis] = (float)n[axis];
    }
    out[3] = (float)offset;
}

/* Position relative to the scene's origin, or to the mesh's pivot if it is stored once for many. */
static void write_vertex(const scene_build *build, int mesh_number, int32_t vertex, size_t place) {
    float *out = build->out->positions + 3 * place;
    const mesh_use *use = &build->uses[mesh_number];
    const double *local = build->desc->meshes[mesh_number].positions + 3 * (size_t)vertex;
    double p[3];
    if (use->count == 1) {
        const int32_t instance = build->order[use->first_place];
        transform_point(build->desc->world_from_instance + 16 * (size_t)instance, local, p);
    } else {
        memcpy(p, local, sizeof p);
    }
    const double *base = use->count == 1 ? build->desc->origin : use->pivot;
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = (float)(p[axis] - base[axis]);
    }
    if (build->out->cutout_vertices) {
        csm_cutout_write_vertex(&build->cutouts, &build->desc->meshes[mesh_number], vertex,
                                &build->out->cutout_vertices[place]);
    }
}

/* World box of a run of triangles, widened by the rounding to float32 relative to the origin. */
static void item_bounds(const scene_build *build, const csm_mesh_view *mesh, size_t first,
                        size_t count, const double world_from_mesh[16], double bounds[6]) {
    empty_bounds(bounds);
    for (size_t t = first; t < first + count; t++) {
        for (int corner = 0; corner < 3; corner++) {
            double p[3];
            size_t v = (size_t)mesh->triangles[3 * (size_t)build->keys[t].triangle + corner];
            transform_point(world_from_mesh, mesh->positions + 3 * v, p);
            grow(bounds, p);
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        double origin = build->desc->origin[axis];
        double reach = fmax(fabs(bounds[axis] - origin), fabs(bounds[3 + axis] - origin));
        bounds[axis] -= FLT_EPSILON * reach;
        bounds[3 + axis] += FLT_EPSILON * reach;
    }
}

static void write_instances(const scene_build *build) {
    const csm_scene_desc *desc = build->desc;
    const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    memcpy(build->out->instances, identity, sizeof identity);
    int rows = 1;
    for (int i = 0; i < desc->instance_count; i++) {
        const mesh_use *use = &build->uses[desc->instance_mesh[i]];
        build->row[i] = 0;
        if (use->count < 2) {
            continue;
        }
        const double *m = desc->world_from_instance + 16 * (size_t)i;
        float *out = build->out->instances + 12 * (size_t)rows;
        double place[3];
        transform_point(m, use->pivot, place);
        for (int axis = 0; axis < 3; axis++) {
            for (int column = 0; column < 3; column++) {
                out[4 * axis + column] = (float)m[4 * column + axis];
            }
            out[4 * axis + 3] = (float)(place[axis] - desc->origin[axis]);
        }
        build->row[i] = rows++;
    }
    build->out->instance_count = rows;
}

static csm_status allocate(const scene_build *build, csm_error *err) {
    csm_geometry *out = build->out;
    size_t instances = 1, vertices = 0;
    for (int m = 0; m < build->desc->mesh_count; m++) {
        const csm_mesh_view *mesh = &build->desc->meshes[m];
        size_t chunks = (mesh->triangle_count + CHUNK_TRIANGLES - 1) / CHUNK_TRIANGLES;
        size_t count = (size_t)build->uses[m].count;
        if (!count) {
            continue;
        }
        vertices += mesh->vertex_count;
        out->triangle_count += mesh->triangle_count;
        out->chunk_count += chunks;
        out->item_count += chunks * count;
        instances += count > 1 ? count : 0;
    }
    vertices += out->triangle_count; /* at most: every vertex and a copy for every triangle */
    if (vertices > UINT32_MAX / 3 || out->item_count > UINT32_MAX) {
        return csm_fail(
            err, CSM_ERROR_LIMIT,
            "a scene may hold at most %u vertices and triangles together (got %zu and %zu)",
            UINT32_MAX / 3, vertices - out->triangle_count, out->triangle_count);
    }
    out->chunks = malloc(out->chunk_count * sizeof *out->chunks);
    out->items = malloc(out->item_count * sizeof *out->items);
    bool enough = out->chunks && out->items;
    if (!build->boxes_alone) {
        out->vertex_count = out->triangle_count;
        out->positions = malloc(vertices * 3 * sizeof *out->positions);
        out->indices = malloc(out->triangle_count * 3 * sizeof *out->indices);
        out->planes = malloc(out->triangle_count * 4 * sizeof *out->planes);
        out->instances = malloc(instances * 12 * sizeof *out->instances);
        enough = enough && out->positions && out->indices && out->planes && out->instances;
    }
    if (!enough) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for %zu triangles",
                        out->triangle_count);
    }
    return build->boxes_alone
               ? CSM_OK
               : csm_cutouts_make(build->desc, vertices, build->cutout_words, out, err);
}

/* Vertices and indices of one mesh. Vertex t is the last corner of triangle t and of no other, so
 * that a vertex shader knows the triangle it starts: gl_PrimitiveID costs software GL a fifth of
 * the pass. Vertices that end no triangle follow behind. Corners keep their order: another one
 * would change the last bits of what a rasteriser interpolates, with the order of the triangles. */
static void write_triangles(scene_build *build, int mesh_number) {
    const csm_mesh_view *mesh = &build->desc->meshes[mesh_number];
    const mesh_use *use = &build->uses[mesh_number];
    csm_geometry *out = build->out;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        build->vertex_place[v] = UINT32_MAX;
    }
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        const int32_t *corners = mesh->triangles + 3 * (size_t)build->keys[t].triangle;
        uint32_t place = (uint32_t)(use->first_triangle + t);
        if (build->vertex_place[corners[2]] == UINT32_MAX) {
            build->vertex_place[corners[2]] = place;
        }
        write_vertex(build, mesh_number, corners[2], place);
        out->indices[3 * (size_t)place] = (uint32_t)corners[0];
        out->indices[3 * (size_t)place + 1] = (uint32_t)corners[1];
        out->indices[3 * (size_t)place + 2] = place;
    }
    for (size_t t = use->first_triangle; t < use->first_triangle + mesh->triangle_count; t++) {
        uint32_t *indices = out->indices + 3 * t;
        for (int corner = 0; corner < 2; corner++) {
            uint32_t *place = &build->vertex_place[indices[corner]];
            if (*place == UINT32_MAX) {
                *place = (uint32_t)out->vertex_count++;
                write_vertex(build, mesh_number, (int32_t)indices[corner], *place);
            }
            indices[corner] = *place;
        }
        plane_of(out->positions + 3 * (size_t)indices[0], out->positions + 3 * (size_t)indices[1],
                 out->positions + 3 * (size_t)indices[2], out->planes + 4 * t);
    }
}

/* Chunks of one mesh and, for each, one item per instance. */
static void write_chunks(scene_build *build, int mesh_number) {
    const csm_mesh_view *mesh = &build->desc->meshes[mesh_number];
    const mesh_use *use = &build->uses[mesh_number];
    csm_geometry *out = build->out;
    for (size_t first = 0; first < mesh->triangle_count; first += CHUNK_TRIANGLES) {
        size_t count = mesh->triangle_count - first;
        count = count < CHUNK_TRIANGLES ? count : CHUNK_TRIANGLES;
        out->chunks[build->chunk] =
            (csm_chunk){(uint32_t)(use->first_triangle + first), (uint32_t)count,
                        (uint32_t)build->item, (uint32_t)use->count};
        for (int32_t place = use->first_place; place < use->first_place + use->count; place++) {
            int32_t instance = build->order[place];
            csm_item *item = &out->items[build->item++];
            item->chunk = (uint32_t)build->chunk;
            item->instance = build->boxes_alone ? 0 : (uint32_t)build->row[instance];
            item->mirrored =
                determinant(build->desc->world_from_instance + 16 * (size_t)instance) < 0.0;
            item_bounds(build, mesh, first, count,
                        build->desc->world_from_instance + 16 * (size_t)instance, item->bounds);
            grow(out->bounds, item->bounds);
            grow(out->bounds, item->bounds + 3);
        }
        build->chunk++;
    }
    out->drawn_triangle_count += mesh->triangle_count * (size_t)use->count;
}

static void order_meshes(const scene_build *build) {
    int place = 0;
    for (int with_cutout = 0; with_cutout < 2; with_cutout++) {
        for (int m = 0; m < build->desc->mesh_count; m++) {
            if ((build->desc->meshes[m].cutout != NULL) == with_cutout) {
                build->mesh_order[place++] = m;
            }
        }
    }
}

/* Who uses which mesh, and where each mesh's vertices, triangles and instances begin. */
static void count_uses(const scene_build *build) {
    const csm_scene_desc *desc = build->desc;
    size_t triangle = 0;
    int32_t place = 0;
    for (int i = 0; i < desc->instance_count; i++) {
        build->uses[desc->instance_mesh[i]].count++;
    }
    for (int i = 0; i < desc->mesh_count; i++) {
        const int m = build->mesh_order[i];
        mesh_use *use = &build->uses[m];
        double bounds[6];
        use->first_triangle = triangle;
        use->first_place = place;
        triangle += use->count ? desc->meshes[m].triangle_count : 0;
        place += use->count;
        use->count = 0; /* counted again below, as the instances take their places */
        mesh_bounds(&desc->meshes[m], bounds);
        for (int axis = 0; axis < 3; axis++) {
            use->pivot[axis] = 0.5 * (bounds[axis] + bounds[3 + axis]);
        }
    }
    for (int i = 0; i < desc->instance_count; i++) {
        mesh_use *use = &build->uses[desc->instance_mesh[i]];
        build->order[use->first_place + use->count++] = i;
    }
}

static csm_status build_scene(const csm_scene_desc *desc, bool boxes_alone, csm_geometry *out,
                              csm_error *err) {
    csm_status status = check_scene(desc, err);
    if (status != CSM_OK) {
        return status;
    }
    size_t largest = 0, most_vertices = 0;
    for (int m = 0; m < desc->mesh_count; m++) {
        const csm_mesh_view *mesh = &desc->meshes[m];
        largest = mesh->triangle_count > largest ? mesh->triangle_count : largest;
        most_vertices = mesh->vertex_count > most_vertices ? mesh->vertex_count : most_vertices;
    }
    memset(out, 0, sizeof *out);
    empty_bounds(out->bounds);
    scene_build build = {
        .desc = desc,
        .out = out,
        .boxes_alone = boxes_alone,
        .uses = calloc((size_t)desc->mesh_count, sizeof *build.uses),
        .mesh_order = malloc((size_t)desc->mesh_count * sizeof *build.mesh_order),
        .cutout_words = malloc((size_t)desc->mesh_count * sizeof *build.cutout_words),
        .order = malloc((size_t)desc->instance_count * sizeof *build.order),
        .row = malloc((size_t)desc->instance_count * sizeof *build.row),
        .keys = malloc(largest * sizeof *build.keys),
        .vertex_place = malloc(most_vertices * sizeof *build.vertex_place),
    };
    if (!build.uses || !build.mesh_order || !build.cutout_words || !build.order || !build.row ||
        !build.keys || !build.vertex_place) {
        status = csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory to sort %zu triangles", largest);
        goto done;
    }
    order_meshes(&build);
    count_uses(&build);
    status = allocate(&build, err);
    if (status != CSM_OK) {
        goto done;
    }
    if (!boxes_alone) {
        write_instances(&build);
    }
    for (int i = 0; i < desc->mesh_count; i++) {
        const int m = build.mesh_order[i];
        if (build.uses[m].count) {
            sort_triangles(&desc->meshes[m], build.keys);
            if (!boxes_alone) {
                build.cutouts = csm_cutout_writer_of(&desc->meshes[m], build.cutout_words[m]);
                write_triangles(&build, m);
            }
            write_chunks(&build, m);
        }
        out->cutout_chunk = desc->meshes[m].cutout ? out->cutout_chunk : build.chunk;
    }
done:
    free(build.uses);
    free(build.mesh_order);
    free(build.cutout_words);
    free(build.order);
    free(build.row);
    free(build.keys);
    free(build.vertex_place);
    if (status != CSM_OK) {
        csm_geometry_destroy(out);
    }
    return status;
}

csm_status csm_geometry_build(const csm_scene_desc *desc, csm_geometry *out, csm_error *err) {
    return build_scene(desc, false, out, err);
}

csm_status csm_geometry_boxes(const csm_scene_desc *desc, csm_geometry *out, csm_error *err) {
    return build_scene(desc, true, out, err);
}

void csm_geometry_destroy(csm_geometry *geometry) {
    free(geometry->positions);
    free(geometry->indices);
    free(geometry->planes);
    free(geometry->instances);
    free(geometry->cutout_vertices);
    free(geometry->cutouts);
    free(geometry->chunks);
    free(geometry->items);
    memset(geometry, 0, sizeof *geometry);
}
