/* Gaussians as 3D Tiles 1.1 (OGC 22-025r4): an octree of GLB files with KHR_gaussian_splatting. */
#ifndef CONURB_SPLAT_SPLAT_TILES_H
#define CONURB_SPLAT_SPLAT_TILES_H
#include "conurb/splat.h"

/* Writes one GLB: POINTS with the attributes of KHR_gaussian_splatting (Khronos 2025), y up: x east, y up, z south,
 * local metres, with COLOR_0 for readers that know points only. compressed: all of it in SPZ
 * (KHR_gaussian_splatting_compression_spz_2), in the file's axes. Degree 0 or 1. Atomic.
 * CN_ERR_IO, CN_ERR_NOMEM; CN_ERR_DATA: too far from the origin for SPZ. */
CN_NODISCARD cn_status cn_splat_glb_write(const cn_splats *splats, const cn_splat_about *about, bool compressed,
                                          const char *path);

typedef struct cn_splat_tiles_options {
    const char *folder; /* is made */
    cn_splat_about about;
    bool compressed;
} cn_splat_tiles_options;
/* Writes folder/rootDIGITS.glb, a digit for each level, folder/farN.glb, and, last, folder/tileset.json, each
 * atomically. A leaf has 20000 Gaussians at most. A tile above others has 20000 at most in place of all of theirs
 * (cn_splats_merge), and replaces them from afar. Above the octree's root are far1 and far2 with 2500 and 312 at most.
 * A tile's geometric error is the diagonal of the cubes in which its Gaussians were merged, and more than those of its
 * children. With georeference the root's transform is cn_frame_ecef's. Degree 2 is left out.
 * CN_ERR_DATA: there is none. CN_ERR_IO, CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_splat_tiles_write(const cn_context *ctx, const cn_splats *splats,
                                            const cn_splat_tiles_options *options);
#endif
