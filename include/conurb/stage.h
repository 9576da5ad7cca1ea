/* conurb/stage.h: the stages of a city, one function for each command of the conurb program.
 *
 * A stage skips work that is done and valid: of the same settings and the same inputs. Its inputs must exist;
 * CN_ERR_DATA names the command to run first. CN_ERR_INTERRUPTED: asked to stop; a second call resumes. Use an open
 * city from one thread at a time. Several processes may work on one city: a lock protects each piece of work. */
#ifndef CONURB_STAGE_H
#define CONURB_STAGE_H
#include "conurb/base.h"
#include "conurb/city.h"
#include "conurb/compose.h"
#include "conurb/measure.h"
#include "conurb/path.h"
#include "conurb/plan.h"
#include "conurb/pose.h"
#include "conurb/render.h"
#include "conurb/surface.h"
#include "conurb/train.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Finds or imports the photos' poses, and places them on Earth. Writes CITY/photos.json and CITY/poses. Many photos are
 * posed in groups (cn_pose_is_grouped): split, each group that is due, merge. */
CN_API CN_NODISCARD cn_status cn_city_poses(const cn_context *ctx, cn_city *city);
/* The steps of a city in groups, for processes that share the work. Split: writes CITY/poses/groups; a city with too
 * few photos gets no groups. Group: maps one, 0 is the first. Merge: when every group is mapped or has failed. Group
 * and merge take the photos to be those of the split. CN_ERR_DATA: the step before is missing; the message says which.
 * CN_ERR_LOCKED: another process does the same. */
CN_API CN_NODISCARD cn_status cn_city_poses_split(const cn_context *ctx, cn_city *city);
CN_API CN_NODISCARD cn_status cn_city_poses_group(const cn_context *ctx, cn_city *city, uint32_t group);
CN_API CN_NODISCARD cn_status cn_city_poses_merge(const cn_context *ctx, cn_city *city);
/* Makes the plan of tiles. dry_run: log the plan and write nothing. forecast: at the end, log what training the tiles
 * takes on this machine with each preset but compact (cn_train_speed_predict). Measured speeds are kept in the user's
 * cache
 * ($XDG_CACHE_HOME/conurb/speed.json). */
CN_API CN_NODISCARD cn_status cn_city_plan(const cn_context *ctx, cn_city *city, bool dry_run, bool forecast);
/* Trains a tile; tile NULL: all tiles. A tile that fails does not stop the others; the message at the end names each
 * with its reason and its log. quality < 0: from city.yaml. time_budget_s: seconds per tile; 0: from city.yaml. With a
 * budget, and when neither a quality is given nor city.yaml sets one, samples_per_step, march_step or a key of field,
 * all these are chosen to suit it (cn_train_choose). CN_ERR_LOCKED: another process is training the tile. */
CN_API CN_NODISCARD cn_status cn_city_train(const cn_context *ctx, cn_city *city, const char *tile, int quality,
                                            double time_budget_s);
/* Aligns one appearance between all trained tiles (cn_appearance_align). appearance: as in cn_city_render_options.
 * Keeps the rows in CITY/match, and does nothing when they are there for the same tiles. Logs the difference of each
 * pair of neighbours. A render calls this for its own appearances. */
CN_API CN_NODISCARD cn_status cn_city_align(const cn_context *ctx, cn_city *city, const char *appearance);
typedef struct cn_city_render_options {
    const char *path;        /* a file that cn_path_load reads, "photos" for the photos in order, or NULL */
    const char *orbit;       /* an orbit as in cn_path_orbit, or NULL */
    const char *photo;       /* the view of a photo, or NULL; all three NULL: the default flight */
    double height_m;         /* metres above the ground, for streets and tracks on the ground; 0: from the file */
    const char *out;         /* folder to write to; NULL: CITY/renders/NAME */
    const char *appearance;  /* PHOTO | mean | A:B:0.3 | A:B:0.3:C:0.2 | FILE.json | fit:PHOTO; NULL: mean */
    const char *sequence;    /* instead of appearance: "A,B,C", from one to the next along the frames; a name may have
                                a comma: the longest piece that is an appearance is one */
    const char *from, *to;   /* instead of both: from one appearance to another along the frames; give both or none */
    const char *view, *look; /* NULL: from city.yaml */
    double exposure_ev;
    const char *blend;           /* a name of cn_blend_parse; NULL: from city.yaml */
    const double *crop_m;        /* as in cn_render_options; what is not drawn is black */
    uint32_t width_px, n_frames; /* 0: from city.yaml */
    unsigned aovs;               /* CN_AOV_* bits: written as layers of the EXR files, and a PNG each */
    const char *camera;       /* "equirectangular": pictures of all directions (cn_path_look_around); NULL, "pinhole" */
    uint32_t chunk, n_chunks; /* render only part `chunk` (from 1) of n_chunks parts; n_chunks 0: all frames */
} cn_city_render_options;
/* Renders frames as EXR and PNG; two or more also as a film. Frames that are done already, with the same tiles, view
 * and appearance, are kept. Frames that an earlier, longer render left in the folder are removed. CN_ERR_LOCKED:
 * another process is rendering the same frames. */
CN_API CN_NODISCARD cn_status cn_city_render(const cn_context *ctx, cn_city *city,
                                             const cn_city_render_options *options);
/* Which frames of a render are done and valid. done[n_frames] is owned by the survey. */
typedef struct cn_render_survey {
    uint32_t n_frames, n_done;
    bool *done;
} cn_render_survey;
/* Fills the survey; renders nothing. The caller frees it with the _deinit. CN_ERR_DATA: no tile is trained. */
CN_API CN_NODISCARD cn_status cn_city_render_survey(const cn_context *ctx, cn_city *city,
                                                    const cn_city_render_options *options, cn_render_survey *survey);
CN_API void cn_render_survey_deinit(cn_render_survey *survey);
/* Renders a path frame by frame, keeps no frame, and measures temporal consistency where tiles meet
 * (cn_measure_temporal) and, with ownership, seams within frames (cn_measure_seam). With the other blends seam->n is
 * 0. Of the options it uses path, orbit, photo, height_m, appearance, blend, width_px and n_frames. */
CN_API CN_NODISCARD cn_status cn_city_temporal_consistency(const cn_context *ctx, cn_city *city,
                                                           const cn_city_render_options *options,
                                                           cn_temporal_figures *figures, cn_seam_figures *seam);
/* ---- appearances; `code` is an appearance as in cn_city_render_options ---- */
/* A photo whose appearance can be used, or a light that was imported or fitted. exposure_ev: stops; NaN when EXIF lacks
 * it, and for a light. n_tiles: tiles that were trained on the photo. */
typedef struct cn_appearance_entry {
    char *name;
    double exposure_ev;
    uint32_t n_tiles;
    bool held_out, is_light;
} cn_appearance_entry;
typedef struct cn_appearance_list {
    cn_appearance_entry *entries;
    uint32_t n;
} cn_appearance_list;
/* Lists the photos of all trained tiles, then the lights with a name. The caller frees the list with the _deinit. */
CN_API CN_NODISCARD cn_status cn_city_appearance_list(const cn_context *ctx, cn_city *city, cn_appearance_list *list);
CN_API void cn_appearance_list_deinit(cn_appearance_list *list);
/* The rows of an appearance in every trained tile, as JSON. The caller frees *json with free(). */
CN_API CN_NODISCARD cn_status cn_city_appearance_show(const cn_context *ctx, cn_city *city, const char *code,
                                                      char **json);
/* Writes the same JSON to a file. */
CN_API CN_NODISCARD cn_status cn_city_appearance_export(const cn_context *ctx, cn_city *city, const char *code,
                                                        const char *file);
/* Fits an appearance to a photo of the place that is in a file, and keeps it as CITY/views/fitted/NAME.json. NAME is
 * then the name of an appearance. Nothing else of the city changes: where its poses were imported, what COLMAP finds in
 * the collection is kept in CITY/views/colmap. CN_ERR_DATA: the photo has no pose here. */
CN_API CN_NODISCARD cn_status cn_city_appearance_fit(const cn_context *ctx, cn_city *city, const char *photo,
                                                     const char *name);
/* Checks a file against the city's tiles and keeps it as CITY/appearances/NAME.json. NAME is then the name of an
 * appearance. */
CN_API CN_NODISCARD cn_status cn_city_appearance_import(const cn_context *ctx, cn_city *city, const char *file,
                                                        const char *name);
/* Writes a PNG that shows one view (of `photo`; NULL: of the first photo) with the mean appearance and with those of
 * the photos trained on, 100 at most. */
CN_API CN_NODISCARD cn_status cn_city_appearance_sheet(const cn_context *ctx, cn_city *city, const char *photo,
                                                       uint32_t width_px, const char *file);
/* Writes a PNG with three pictures side by side: a photo, what training took as present in this photo only, and the
 * alpha of that. */
CN_API CN_NODISCARD cn_status cn_city_appearance_transient(const cn_context *ctx, cn_city *city, const char *photo,
                                                           const char *file);

/* Renders each held-out photo's view and scores it. Writes CITY/eval/eval.json and CITY/eval/NAME.png (truth, render
 * and error side by side). blend: a name of cn_blend_parse; the result then goes to CITY/eval-NAME, for comparison.
 * NULL: from city.yaml. The caller frees eval with cn_eval_deinit. */
CN_API CN_NODISCARD cn_status cn_city_eval(const cn_context *ctx, cn_city *city, const char *blend, cn_eval *eval);
/* Makes a mesh of the trained tiles (CITY/eval/mesh.ply, with the mean appearance) and compares it with a reference as
 * cn_surface_compare does. Writes CITY/eval/geometry.json. reference NULL: the city's sparse points. cube_m: of the
 * mesh; 0: as fine as the photos. depths: as in cn_city_export_options. In a city without georeference lengths are
 * units of the poses (fit->unit). */
CN_API CN_NODISCARD cn_status cn_city_eval_geometry(const cn_context *ctx, cn_city *city, const char *reference,
                                                    double cube_m, const char *depths, cn_surface_fit *fit);
typedef struct cn_city_export_options {
    const char *ortho, *dsm, *points; /* files to write, or NULL. All files and folders NULL: these three in
                                         CITY/export */
    const char *dtm;       /* ground model to write (cn_export_ground), or NULL. CN_ERR_DATA without georeference */
    const char *mesh;      /* file to write (cn_surface_export), or NULL */
    const char *tileset;   /* folder for 3D Tiles (cn_surface_export_tiles), or NULL */
    const char *splats;    /* file to write (conurb/splat.h), or NULL */
    uint32_t splat_budget; /* splats at most; 0: a million */
    double splat_limit_s;  /* their fit ends after so many seconds; 0: when it is done */
    const char *tileset_content; /* "splats": Gaussians (KHR_gaussian_splatting) in place of the mesh; "spz": the same,
                                    compressed by SPZ; NULL or "mesh": the mesh */
    const char *splats_from;     /* a PLY of Gaussians (cn_splats_read) for the tileset; NULL: they are made */
    const char *qgis; /* folder to write a QGIS project and its layers to, or NULL: city.qgs, ortho.tif, dsm.tif,
                         tiles.geojson, photos.geojson. CN_ERR_DATA without georeference */
    double gsd_m; /* metres per pixel, between points, and of a mesh's cubes; 0: as fine as the photos at their working
                     width */
    double texture_px;       /* side of a mesh's textures, 64 to 16384; 0: colours of vertices */
    double texels_per_m;     /* 0: one a gsd_m */
    double triangles;        /* of a mesh, at most; 0: as cn_surface_source has it */
    const char *depths;      /* of a mesh, "stereo": moved to where the photos match; "field": as the tiles render them;
                                NULL: stereo */
    const char *appearance;  /* as in cn_city_render_options */
    const char *view, *look; /* NULL: from city.yaml */
    double exposure_ev;
} cn_city_export_options;
/* Exports an orthophoto, a surface model, points and a mesh of all trained tiles together (conurb/export.h,
 * conurb/surface.h). A file or folder that cannot be written, and an ending that is none, fail before the first tile.
 */
CN_API CN_NODISCARD cn_status cn_city_export(const cn_context *ctx, cn_city *city,
                                             const cn_city_export_options *options);
/* Writes the cameras of a flight, as a render with the same options has them, to F.chan or F.glb (cn_path_save). Of the
 * options it uses path, orbit, photo, height_m, width_px and n_frames. */
CN_API CN_NODISCARD cn_status cn_city_export_camera(const cn_context *ctx, cn_city *city,
                                                    const cn_city_render_options *options, const char *file);
/* ---- accuracy against time ---- */
typedef struct cn_tradeoff_options {
    bool effects;      /* compare effects instead of settings: each effect on or off */
    const char *tile;  /* NULL: the tile with the most photos */
    int quality;       /* < 0: from city.yaml */
    uint32_t steps;    /* 0: as in the preset */
    double budget_s;   /* seconds for all trainings together; 0: no limit */
    bool fields;       /* compare field types instead of settings: each type at two sizes */
    const char *truth; /* with fields: folder of maps of true distances along the ray, named as the held-out photos;
                          NULL: none */
} cn_tradeoff_options;
/* Trains one tile with several settings in CITY/tradeoff/ and scores each on the tile's held-out photos. Results of
 * earlier calls are kept. Writes CITY/tradeoff.{csv,svg}, CITY/tradeoff-effects.{csv,svg} or
 * CITY/tradeoff-fields.{csv,svg}. Rows with `effects`: first the plan's choice, then with-NAME or without-NAME. Rows
 * with `fields`: TYPE and TYPE-small. The caller frees tradeoff with cn_tradeoff_deinit. CN_ERR_DATA: no photo is held
 * out. */
CN_API CN_NODISCARD cn_status cn_city_tradeoff(const cn_context *ctx, cn_city *city, const cn_tradeoff_options *options,
                                               cn_tradeoff *tradeoff);

/* Runs poses, plan, train, align, eval and the render of the default flight, and skips what is done. When tiles fail,
 * the rest is made without them, and their failure is returned at the end. quality and time_budget_s: as in
 * cn_city_train. */
CN_API CN_NODISCARD cn_status cn_city_run(const cn_context *ctx, cn_city *city, int quality, double time_budget_s);

#ifdef __cplusplus
}
#endif
#endif
