/* Photos of all directions, for COLMAP, which has no such camera: each is cut into views of a rig of pinhole cameras,
 * and the poses that COLMAP finds for the views become one pose again. */
#ifndef CONURB_POSE_PANORAMA_H
#define CONURB_POSE_PANORAMA_H
#include "conurb/pose.h"

/* Views look along the horizon, 60 degrees apart, and are 90 degrees wide, so that each shares a third with the next.
 */
enum { CN_PANORAMA_VIEWS = 6, CN_PANORAMA_WHOLE = UINT8_MAX };

/* The photos that COLMAP sees: views of the photos of all directions, and the others as they are. */
typedef struct cn_panorama_cut {
    cn_photo_index index;
    uint32_t *photo;      /* of each: the photo of the collection */
    uint8_t *view;        /* of each: the number of the view, or CN_PANORAMA_WHOLE */
    uint32_t n_panoramas; /* of the collection */
} cn_panorama_cut;

bool cn_panoramas_exist(const cn_photo_index *index);
/* Writes the views to the folder dir/rig-views; those of an earlier run are kept. Takes memory for one photo a thread.
 * The caller calls cn_panorama_cut_deinit, also on failure. CN_ERR_INTERRUPTED: asked to stop. */
CN_NODISCARD cn_status cn_panorama_cut_make(const cn_context *ctx, const cn_photo_index *index, const char *dir,
                                            cn_panorama_cut *cut);
void cn_panorama_cut_deinit(cn_panorama_cut *cut);
/* The camera of the views of a photo of this width, and how view k is turned: x_view = rotation * x_photo. */
cn_camera cn_panorama_view_camera(uint32_t width);
void cn_panorama_view_rotation(unsigned k, double rotation[9]);

/* One pose for each photo of which a view has one: that on which most of its views agree, then adjusted together with
 * the points, so that a photo's views have one centre. pieces: COLMAP's scene of the cut; it stays. index: the
 * collection. keep_focal: the other photos' focal lengths stay. The caller frees out; it is empty on failure. */
CN_NODISCARD cn_status cn_panorama_join(const cn_context *ctx, const cn_panorama_cut *cut, const cn_photo_index *index,
                                        const cn_scene *pieces, bool keep_focal, cn_scene *out);
#endif
