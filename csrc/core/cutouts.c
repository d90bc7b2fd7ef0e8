/* cutouts.c: what of a mesh's triangles is there, by an image laid over them (docs/numerics.md 26).
 *
 * In: one byte a texel and coordinates in doubles. Out: one bit a texel, every image of the scene
 * behind the other, and for each vertex its place in texels.
 */
#include "cutouts.h"

#include <math.h>
#include <stdlib.h>

static double used_extreme(const csm_mesh_view *mesh, int axis, double sign) {
    double most = -INFINITY;
    for (size_t i = 0; i < 3 * mesh->triangle_count; i++) {
        most = fmax(most, sign * mesh->uv[2 * (size_t)mesh->triangles[i] + axis]);
    }
    return sign * most;
}

csm_status csm_cutout_check(const csm_mesh_view *mesh, int number, csm_error *err) {
    if (!mesh->cutout != !mesh->uv) {
        return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                        "mesh %d must have both a cut-out and texture coordinates, or neither",
                        number);
    }
    if (!mesh->cutout) {
        return CSM_OK;
    }
    const int sides[2] = {mesh->cutout_width, mesh->cutout_height};
    for (int axis = 0; axis < 2; axis++) {
        if (sides[axis] < 1 || sides[axis] > CSM_MAX_CUTOUT) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "the cut-out of mesh %d must be 1 to %d texels wide and high (got %d)",
                            number, CSM_MAX_CUTOUT, sides[axis]);
        }
        for (size_t v = 0; v < mesh->vertex_count; v++) {
            if (!isfinite(mesh->uv[2 * v + axis])) {
                return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                                "texture coordinates of mesh %d must be finite (got NaN or inf)",
                                number);
            }
        }
        double span = used_extreme(mesh, axis, 1.0) - floor(used_extreme(mesh, axis, -1.0));
        if (!(span * sides[axis] <= CSM_MAX_CUTOUT_SPAN)) {
            return csm_fail(err, CSM_ERROR_INVALID_ARGUMENT,
                            "texture coordinates of mesh %d must span at most %d texels (got %.9g)",
                            number, CSM_MAX_CUTOUT_SPAN, span * sides[axis]);
        }
    }
    return CSM_OK;
}

static size_t image_words(const csm_mesh_view *mesh) {
    return ((size_t)mesh->cutout_width + 31) / 32 * (size_t)mesh->cutout_height;
}

/* The first mesh with the same image: it is stored once. */
static int owner_of(const csm_scene_desc *desc, int mesh_number) {
    const csm_mesh_view *mesh = &desc->meshes[mesh_number];
    int owner = 0;
    while (desc->meshes[owner].cutout != mesh->cutout ||
           desc->meshes[owner].cutout_width != mesh->cutout_width ||
           desc->meshes[owner].cutout_height != mesh->cutout_height) {
        owner++;
    }
    return owner;
}

static void pack(const csm_mesh_view *mesh, uint32_t *words) {
    size_t row_words = ((size_t)mesh->cutout_width + 31) / 32;
    for (int y = 0; y < mesh->cutout_height; y++) {
        const uint8_t *texels = mesh->cutout + (size_t)y * (size_t)mesh->cutout_width;
        for (int x = 0; x < mesh->cutout_width; x++) {
            words[(size_t)y * row_words + (size_t)x / 32] |= (uint32_t)(texels[x] != 0) << x % 32;
        }
    }
}

/* First word of each mesh's image; returns how many there are in all. */
static size_t lay_out(const csm_scene_desc *desc, size_t *first_words) {
    size_t words = 0;
    for (int m = 0; m < desc->mesh_count; m++) {
        first_words[m] = 0;
        if (desc->meshes[m].cutout) {
            int owner = owner_of(desc, m);
            first_words[m] = owner < m ? first_words[owner] : words;
            words += owner < m ? 0 : image_words(&desc->meshes[m]);
        }
    }
    return words;
}

csm_status csm_cutouts_make(const csm_scene_desc *desc, size_t vertex_room, size_t *first_words,
                            csm_geometry *out, csm_error *err) {
    out->cutout_word_count = lay_out(desc, first_words);
    if (!out->cutout_word_count) {
        return CSM_OK;
    }
    if (out->cutout_word_count > INT32_MAX) {
        return csm_fail(err, CSM_ERROR_LIMIT, "the cut-outs of a scene may hold 2^36 texels");
    }
    out->cutouts = calloc(out->cutout_word_count, sizeof *out->cutouts);
    out->cutout_vertices = calloc(vertex_room, sizeof *out->cutout_vertices);
    if (!out->cutouts || !out->cutout_vertices) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "no memory for cut-outs of %zu words",
                        out->cutout_word_count);
    }
    for (int m = 0; m < desc->mesh_count; m++) {
        if (desc->meshes[m].cutout && owner_of(desc, m) == m) {
            pack(&desc->meshes[m], out->cutouts + first_words[m]);
        }
    }
    return CSM_OK;
}

csm_cutout_writer csm_cutout_writer_of(const csm_mesh_view *mesh, size_t first_word) {
    csm_cutout_writer writer = {{0.0, 0.0}, 0, 0};
    if (mesh->cutout) {
        for (int axis = 0; axis < 2; axis++) {
            writer.base[axis] = floor(used_extreme(mesh, axis, -1.0));
        }
        writer.first = (uint32_t)first_word;
        writer.size = (uint32_t)(mesh->cutout_width - 1) | (uint32_t)(mesh->cutout_height - 1)
                                                               << 16;
    }
    return writer;
}

void csm_cutout_write_vertex(const csm_cutout_writer *writer, const csm_mesh_view *mesh,
                             int32_t vertex, csm_cutout_vertex *out) {
    if (!mesh->cutout) {
        return; /* zero as it is */
    }
    const double sides[2] = {mesh->cutout_width, mesh->cutout_height};
    for (int axis = 0; axis < 2; axis++) {
        double images = mesh->uv[2 * (size_t)vertex + axis] - writer->base[axis];
        out->texels[axis] = (float)(images * sides[axis]);
    }
    out->first = writer->first;
    out->size = writer->size;
}
