/* cutouts.h: cut-outs of meshes to bits, and vertices to places in them. */
#ifndef CSM_CUTOUTS_H
#define CSM_CUTOUTS_H

#include "csm.h"

/* Of the mesh at hand. */
typedef struct csm_cutout_writer {
    double base[2]; /* whole images that are taken off its coordinates: repeating, it is the same */
    uint32_t first, size;
} csm_cutout_writer;

csm_status csm_cutout_check(const csm_mesh_view *mesh, int number, csm_error *err);

/* Packs the images into out, and makes room for vertices, if a mesh has one; nothing otherwise.
 * first_words (room for one a mesh) says where each mesh's image went. */
csm_status csm_cutouts_make(const csm_scene_desc *desc, size_t vertex_room, size_t *first_words,
                            csm_geometry *out, csm_error *err);

csm_cutout_writer csm_cutout_writer_of(const csm_mesh_view *mesh, size_t first_word);
void csm_cutout_write_vertex(const csm_cutout_writer *writer, const csm_mesh_view *mesh,
                             int32_t vertex, csm_cutout_vertex *out);

#endif
