/* Reads poses that other tools made. */
#ifndef CONURB_POSE_IMPORT_H
#define CONURB_POSE_IMPORT_H
#include "pose/importer.h"

#define CN_IMPORT_NAMES                                                                                                \
    "a COLMAP model folder, a transforms.json (nerfstudio), a reconstruction.json (OpenSfM, ODM), a bundle.out "       \
    "(Bundler), an .nvm (VisualSfM), a cameras.xml (Metashape), a table of camera parameters (RealityCapture), the "   \
    "metadata of Record3D or a folder of Polycam"

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
