/* conurb/surface.h: a city's surface as triangles, and how well it fits a reference.
 *
 * The surface comes from depths that are rendered in the photos' views, moved to where the photos match, and fused into
 * a signed distance (Curless and Levoy 1996, "A volumetric method for building complex models from range images"). The
 * triangles are surface nets
 * (Gibson 1998, "Constrained elastic surface nets") on one lattice for the whole city: no crack between regions or
 * tiles. Threads: one call at a time on a pool. */
#ifndef CONURB_SURFACE_H
#define CONURB_SURFACE_H
#include "conurb/base.h"
#include "conurb/colour.h"
#include "conurb/geo.h"
#include "conurb/photo.h"
#include "conurb/pose.h"
#include "conurb/render.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Renders a view of the scene into the picture, which has the camera's size. */
typedef cn_status (*cn_surface_draw)(void *user, const cn_context *ctx, const cn_camera *camera, const cn_view *view,
                                     cn_picture *picture);
/* The colours that parts of rays show, range_m[n][2] along them, each in the light and by the tile that owns the middle
 * of its range: rgba[n][4], linear ACEScg, premultiplied. */
typedef cn_status (*cn_surface_shade)(void *user, const cn_context *ctx, const cn_ray_list *rays,
                                      const double (*range_m)[2], float *rgba);
/* Signed distances in metres at n places, positive in free space, NaN where they are not known; on the threads of the
 * context's pool, worker counts them. */
typedef void (*cn_surface_distance)(void *user, unsigned worker, size_t n, const double (*xyz)[3], float *distance_m);
/* A place where the surface is wanted: an upright cylinder. */
typedef struct cn_surface_disc {
    double centre[2], radius_m;
} cn_surface_disc;

/* What to make a surface of. Everything is borrowed. */
typedef struct cn_surface_source {
    const cn_scene *scene; /* its views are rendered */
    const cn_frame *frame;
    cn_surface_draw draw;
    /* The photos of the views, or NULL. With them a rendered depth is where a search begins, by PatchMatch stereo
     * (Schoenberger et al. 2016, "Pixelwise view selection for unstructured multi-view stereo"), for the plane on which
     * the nearest photos match best; where none matches, the rendered depth stays. */
    const cn_pixel_store *pixels;
    /* NULL, or the distance of fields that have one: near what the depth maps show, the surface is where the mean of it
     * and of the fused distance is 0. It does not count where depths were moved. */
    cn_surface_distance distance;
    void *user;
    const cn_surface_disc *discs;
    uint32_t n_discs;
    uint32_t width_px; /* of the depth maps */
    double cube_m;     /* side of a lattice cube, about the length of an edge */
    const cn_colour *colour;
    cn_display_transform display;
    const char *appearance; /* what the file says of its light */
    const char *tiles;      /* NULL, or what it says of the tiles that it shows */
    uint64_t key; /* hash of all that depths and colours in the views depend on, to resume; 0: a run begins anew */
    /* Triangles to keep; 0: all, or with textures as few as move the surface by half a cube at most. */
    uint64_t n_triangles;
    uint32_t page_px;       /* side of a square texture; 0: colours of vertices instead of textures */
    double texel_m;         /* side of a texel on the surface; 0: cube_m */
    cn_surface_shade shade; /* for textures */
} cn_surface_source;
typedef struct cn_surface_report {
    uint64_t n_vertices, n_triangles;
    uint64_t n_dropped;            /* triangles of pieces that were too small to keep */
    uint32_t n_textures, n_charts; /* of a file; 0 without textures */
    uint64_t n_texels;             /* of all textures */
    double used;                   /* part of them that charts cover */
} cn_surface_report;

/* Writes the surface to path, atomically: F.ply (binary little-endian: float x y z nx ny nz, uchar red green blue),
 * F.obj (vertices with colours and normals) or F.glb (glTF 2.0, y up, colours without lighting). Places are local
 * metres, x east, y north, z up; in glTF x east, y up, z south. F.frame.json beside it places them on Earth.
 *
 * A lattice point counts when it lies within 4 cubes of what a depth map shows; a triangle is kept when two photos (or
 * the only one) show its place, and when its piece of the surface has 200 triangles or more. Scratch files are made in
 * path's folder: 8 bytes for each depth pixel (16 with photos), 40 for each vertex, 12 for each triangle. Memory: one
 * region of 128 x 128 cubes on the map with all above it, and about 16 bytes for each vertex; with photos, before that,
 * 16 bytes for each pixel of 128 depth maps.
 *
 * With n_triangles or page_px the mesh is simplified (quadric error; Garland and Heckbert 1997), the vertices at its
 * border stay, and no crack opens. With page_px, F.glb and F.obj have textures (JPEG; in the GLB, or F.mtl and F-1.jpg,
 * F-2.jpg, ... beside the OBJ, with _ for white space in their names). Connected triangles that face about the same way
 * are a chart, flattened onto a plane; charts lie on square textures, 4 texels apart; a triangle that is wider than a
 * texture has larger texels. A texel's colour is what the field shows there, from where the photos see it. Memory: 110
 * bytes for each triangle before, 70 after the simplification, and a texture (4 bytes a texel).
 *
 * With a key the depth maps lie in path + ".depths" while the export runs. When it is interrupted or killed, or fails
 * with another error than CN_ERR_DATA, the file stays, and the next export with the same key and path does not render
 * them again.
 *
 * report may be NULL. CN_ERR_USAGE: an unknown ending, or a cube out of range. CN_ERR_DATA: there is no surface.
 * CN_ERR_IO, CN_ERR_NOMEM, CN_ERR_INTERRUPTED: an old file stays. */
CN_API CN_NODISCARD cn_status cn_surface_export(const cn_context *ctx, const cn_surface_source *source,
                                                const char *path, cn_surface_report *report);

/* Writes the same surface as 3D Tiles 1.1 (OGC 22-025r4) to a folder, which is made: GLB files LEVEL-X-Y.glb and, last,
 * tileset.json. A quadtree on the map with leaves of 128 cubes; the leaves are the surface itself, a tile above has a
 * quarter of the triangles of those below it (quadrics; Garland and Heckbert 1997), or more where the surface or its
 * colours would move by over one cube (2 a level higher, and so on). Vertices at a tile's border stay,
 * so tiles of any level meet without cracks. geometricError is in metres. With georeference the root's transform takes
 * local metres to Earth-centred, Earth-fixed WGS84 (EPSG:4978). The tileset.json of an
 * earlier export is removed before its tiles are replaced; its files with other names stay. With page_px tiles have
 * textures as above; leaves are half a texture wide (32 to 512 cubes) and lose what they do not need within half a
 * cube, and texels double at each level up; geometricError is 8 texels at least, but 0 of a leaf. Memory beside that of
 * cn_surface_export: 50 bytes for each vertex, 60 for each triangle. Errors as there. */
CN_API CN_NODISCARD cn_status cn_surface_export_tiles(const cn_context *ctx, const cn_surface_source *source,
                                                      const char *folder, cn_surface_report *report);

/* ---- a mesh against a reference ---- */
/* Distances from some places to the nearest place of the other side. NaN without places. */
enum { CN_SURFACE_THRESHOLDS = 4 };
CN_API extern const double cn_surface_thresholds_m[CN_SURFACE_THRESHOLDS]; /* 0.05, 0.1, 0.2, 0.5 */
typedef struct cn_surface_distances {
    uint64_t n;
    double median_m, mean_m;
    double within[CN_SURFACE_THRESHOLDS]; /* share of the places whose distance is not larger */
} cn_surface_distances;
/* As Knapitsch et al. 2017 (Tanks and Temples) name them: accuracy from the mesh, completeness from the reference. */
typedef struct cn_surface_fit {
    bool sparse;                         /* the reference is sparse points: from_reference is all that is known */
    cn_surface_distances from_mesh;      /* vertices of the mesh to the reference */
    cn_surface_distances from_reference; /* places of the reference to the mesh's triangles */
    double chamfer_m;                    /* the mean of the two means; NaN when sparse */
    double f_score[CN_SURFACE_THRESHOLDS];
    const char *unit; /* of all lengths: cn_frame_unit of the city; NULL by cn_surface_compare, which knows none */
} cn_surface_fit;
/* Compares a mesh (PLY) with a reference: a PLY of points or triangles in the same local metres, or, reference NULL,
 * the scene's sparse points that three photos or more see. Vertices of the mesh outside the reference's box, widened by
 * the largest threshold, do not count. CN_ERR_FORMAT, CN_ERR_IO: the message names the file. CN_ERR_DATA: there is no
 * such sparse point. CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_API CN_NODISCARD cn_status cn_surface_compare(const cn_context *ctx, const char *mesh, const char *reference,
                                                 const cn_scene *scene, cn_surface_fit *fit);

#ifdef __cplusplus
}
#endif
#endif
