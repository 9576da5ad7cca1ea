/* COLMAP's features and matches, and the names and folders that it sees. */
#ifndef CONURB_POSE_COLMAP_H
#define CONURB_POSE_COLMAP_H
#include "bridge/sqlite.h"
#include "pose/colmap_job.h"

/* The first two stages, each done once: features of the photos, and matches of pairs. A run that was killed goes on. */
CN_NODISCARD cn_status cn_colmap_features(cn_colmap_job *j);
CN_NODISCARD cn_status cn_colmap_matches(cn_colmap_job *j);
/* Whether COLMAP can read the photo: it fails on EXR and HEIC, and on samples of more than 8 bits. */
bool cn_colmap_reads(const cn_photo *photo);
/* A JPEG at `path` that COLMAP reads in place of the photo, in the orientation of the file. */
CN_NODISCARD cn_status cn_colmap_copy(const cn_photo_index *index, uint32_t photo, const char *path);
/* COLMAP splits its lists at spaces. If a photo has a space in its name, or COLMAP cannot read it, then COLMAP sees a
 * folder of links and copies, named by number. This fills the folder, and restores the real names. */
bool cn_colmap_needs_links(const cn_photo_index *index);
CN_NODISCARD cn_status cn_colmap_show_photos(const cn_colmap_job *j);
CN_NODISCARD cn_status cn_colmap_restore_names(cn_scene *scene, const cn_photo_index *index);
/* The name under which COLMAP sees photo i; caller frees; NULL when out of memory. */
char *cn_colmap_name(const cn_photo_index *index, bool linked, uint32_t i);
/* *number: of photo i in the database; 0 when it has no such photo. Errors as of cn_colmap_database_photo. */
CN_NODISCARD cn_status cn_colmap_number(cn_colmap_database *database, const cn_photo_index *index, bool linked,
                                        uint32_t i, uint32_t *number);
/* Writes the names of n photos to a file, one a line, for COLMAP. */
CN_NODISCARD cn_status cn_colmap_write_list(const cn_photo_index *index, bool linked, const char *path,
                                            const uint32_t *photos, uint32_t n);

/* The largest model among DIR, DIR/0, DIR/1, ..., or else DIR/sparse, DIR/sparse/0, ...; *model NULL and *n_models 0
 * when there is none. Caller frees *model. */
CN_NODISCARD cn_status cn_colmap_find_model(const char *dir, char **model, uint32_t *n_models);

/* Photos that may share a camera, and those that may not. order: photos, group after group. */
typedef struct cn_lens_group {
    uint32_t first, n;
    bool shared;
    double focal_px; /* known exactly; 0: not */
} cn_lens_group;
typedef struct cn_lens_groups {
    uint32_t *order;
    cn_lens_group *groups;
    uint32_t n_groups;
} cn_lens_groups;
CN_NODISCARD cn_status cn_colmap_group(const cn_photo_index *index, bool share, cn_lens_groups *out);
void cn_lens_groups_deinit(cn_lens_groups *groups);
/* cameras: the camera of each group in the database at `path`; 0 where the group shares no camera or has no photo
 * there. COLMAP needs this number when it goes on with a group; else it makes another camera for the rest of the
 * photos. CN_ERR_FORMAT when the database is damaged. */
CN_NODISCARD cn_status cn_colmap_find_cameras(const cn_photo_index *index, bool linked, const cn_lens_groups *groups,
                                              const char *path, uint32_t *cameras);
#endif
