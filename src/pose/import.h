/* Reads poses that other tools made. */
#ifndef CONURB_POSE_IMPORT_H
#define CONURB_POSE_IMPORT_H
#include "pose/import_files.h"
#include "pose/importer.h"

#define CN_IMPORT_NAMES                                                                                                \
    "a COLMAP model folder, a transforms.json (nerfstudio), a reconstruction.json (OpenSfM, ODM), a bundle.out "       \
    "(Bundler), an .nvm (VisualSfM), a cameras.xml (Metashape), a table of camera parameters (RealityCapture), the "   \
    "metadata of Record3D or a folder of Polycam"

/* Where the poses at the path of an import are: a COLMAP model folder, a file or a folder of Polycam's JSON files; all
 * NULL: nowhere. n_models: separate COLMAP models. */
typedef struct cn_import_source {
    char *model, *file, *keyframes;
    uint32_t n_models;
} cn_import_source;
/* CN_ERR_IO: there is nothing at the path. The caller calls cn_import_source_deinit. */
CN_NODISCARD cn_status cn_import_find(const char *path, cn_import_source *source);
void cn_import_source_deinit(cn_import_source *source);

/* The files that the import at this path is read from, whether they can be read or not. Errors as of cn_import_find. */
CN_NODISCARD cn_status cn_import_list(const char *path, cn_import_files *files);
/* Whether a file of poses needs a list of photos beside it. False also where the file cannot be read. */
bool cn_import_has_list(const char *path);

/* Reads the file or folder, whatever tool wrote it, and fits cameras to the photos. *n_models: separate parts in it.
 * Errors as cn_scene_read_transforms; on failure the scene is empty. CN_ERR_FORMAT also: no known tool wrote it. */
CN_NODISCARD cn_status cn_import_file(const cn_context *ctx, const char *path, const cn_photo_index *index,
                                      cn_scene *scene, uint32_t *n_models, cn_import_origin *origin);
/* As cn_import_file, of a folder with Polycam's JSON files. */
CN_NODISCARD cn_status cn_import_folder(const cn_context *ctx, const char *path, const cn_photo_index *index,
                                        cn_scene *scene);
/* Gives the scene the frame that its file states, when the photos' GPS does not contradict it; else aligns it to GPS
 * as cn_align does. */
CN_NODISCARD cn_status cn_import_place(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index,
                                       double max_error_m, const cn_import_origin *origin, cn_frame *frame);
#endif
