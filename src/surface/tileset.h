/* A mesh as 3D Tiles 1.1 (OGC 22-025r4): a quadtree of GLB files with levels of detail. */
#ifndef CONURB_SURFACE_TILESET_H
#define CONURB_SURFACE_TILESET_H
#include "surface/mesh_file.h"
#include "surface/textured.h"

/* What to write: the vertices that number[] keeps, and their triangles; n: how many of each. */
typedef struct cn_tileset {
    cn_triangles *triangles;
    const uint32_t *number;
    const uint64_t *n;
    const cn_mesh_about *about;
    double cell_m; /* side of a leaf, on the map */
    /* NULL: colours of vertices. Else the textures of a leaf; its mesh and progress are set here. The texels of a level
     * above are twice as large. */
    const cn_textured *textured;
} cn_tileset;
/* Writes folder/L-X-Y.glb and, last, folder/tileset.json, each atomically. A leaf has the mesh itself. A tile above
 * four others has a quarter of their triangles (quadric error; Garland and Heckbert 1997, by meshoptimizer), or more
 * where surface or colours would move by more than a cube (2 a level higher, and so on); vertices at a tile's border
 * stay, so that neighbours of any level meet. Its geometric error is that of its children and its own, in metres.
 * With textures the surface alone counts, but the error is 8 of the tile's texels at least, so that a viewer refines
 * what would look blurred; and leaves too lose the triangles that the surface does not need within half a cube.
 * Memory: about 50 bytes for each vertex and 60 for each triangle. CN_ERR_IO, CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_tileset_write(const cn_context *ctx, const cn_tileset *tileset, const char *folder);
#endif
