/* A mesh as PLY, OBJ or glTF (GLB). */
#ifndef CONURB_SURFACE_MESH_FILE_H
#define CONURB_SURFACE_MESH_FILE_H
#include "surface/gltf.h"
#include "surface/mesh.h"
#include "surface/triangles.h"

typedef enum cn_mesh_format { CN_MESH_PLY, CN_MESH_OBJ, CN_MESH_GLB } cn_mesh_format;
/* By the path's ending. CN_ERR_USAGE. */
CN_NODISCARD cn_status cn_mesh_format_of(const char *path, cn_mesh_format *format);
/* Whether a mesh can have this name. CN_ERR_USAGE: another ending, or one without room for textures. */
CN_NODISCARD cn_status cn_mesh_check_path(const char *path, bool textured);

/* Writes the vertices that number[] keeps, and their triangles. n: how many of each. Reads `triangles` from the
 * beginning. Atomic. CN_ERR_USAGE: too large for the format. */
CN_NODISCARD cn_status cn_mesh_file_write(cn_triangles *triangles, const uint32_t *number, const uint64_t n[2],
                                          const cn_mesh_about *about, const char *path);
/* The same of a mesh in memory; scratch files are made in path's folder. */
CN_NODISCARD cn_status cn_mesh_file_write_mesh(const cn_mesh *mesh, const cn_mesh_about *about, const char *path);
#endif
