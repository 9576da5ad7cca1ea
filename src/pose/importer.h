/* What the readers of other tools' poses share. */
#ifndef CONURB_POSE_IMPORTER_H
#define CONURB_POSE_IMPORTER_H
#include "conurb/pose.h"
#include "pose/finder.h"

/* Where the file says that its local east-north-up axes have their origin. */
typedef struct cn_import_origin {
    bool arbitrary_axes;   /* the tool gives its axes no meaning: z may be anywhere */
    bool known, sea_level; /* sea_level: height_m is above the sea, not above the ellipsoid */
    double latitude_deg, longitude_deg, height_m;
} cn_import_origin;

/* A scene that is being read from a file. Readers add the photos of the collection one by one. */
typedef struct cn_importer {
    const cn_context *ctx;
    const char *path; /* of the file, for messages */
    const cn_photo_index *index;
    cn_scene *scene;
    char *folder; /* absolute, of the file */
    cn_photo_finder finder;
    uint32_t room, n_frames, n_missing; /* room: most views; n_frames: that the file has */
    uint32_t n_models;                  /* separate reconstructions in the file */
    double worst_fit_px;                /* largest error of a lens that was approximated */
    cn_import_origin origin;
} cn_importer;

/* Makes room for n photos. Once per file. */
CN_NODISCARD cn_status cn_importer_room(cn_importer *to, size_t n);
/* *photo: index of the photo that the file names, relative to the file or to the photo folder, with or without
 * extension. -1 when it is not in the collection: it is counted, and the log names the first ones. */
void cn_importer_find(cn_importer *to, const char *file, int64_t *photo);
/* Adds the pose of a photo. view: rotation and translation are set. Checks camera and pose. */
CN_NODISCARD cn_status cn_importer_add(cn_importer *to, int64_t photo, const cn_camera *camera, const cn_view *view);

/* A lens as other tools describe it. Pixels: x = cx + fx x', y = cy + fy y'; x', y' are distorted. */
typedef struct cn_import_lens {
    bool fisheye;
    bool undistorts; /* k takes distorted radii to undistorted ones, not the other way; not for fisheye */
    double fx, fy, cx, cy, k[4], p[2];
} cn_import_lens;
/* The camera of this lens. A perspective lens with k3 or k4, or one that undistorts, is approximated by k1, k2 and a
 * change of the focal length;
 * worst_fit_px keeps the error. CN_ERR_FORMAT: no camera is near enough. who: "photo a.jpg". */
CN_NODISCARD cn_status cn_importer_lens(cn_importer *to, const cn_import_lens *lens, const char *who,
                                        cn_camera *camera);
/* Makes a camera with a size one of all directions. CN_ERR_FORMAT: it is not twice as wide as high. who: "photo a.jpg".
 */
CN_NODISCARD cn_status cn_importer_sphere(cn_importer *to, const char *who, cn_camera *camera);
/* "photo NAME", cut where it is too long. */
void cn_importer_who(const cn_photo *photo, char *who, size_t size);
/* The nearest rotation of r. False when it is far from being one: scaled, sheared or mirrored. */
bool cn_import_rotation(double r[9]);

/* The readers. The importer's scene is filled with what the file says; nothing is finished yet. */
CN_NODISCARD cn_status cn_import_transforms(cn_importer *to);
CN_NODISCARD cn_status cn_import_opensfm(cn_importer *to);
CN_NODISCARD cn_status cn_import_bundler(cn_importer *to);
/* The list of photos that belongs to a bundle.out; the caller frees *list. CN_ERR_FORMAT: there is none. */
CN_NODISCARD cn_status cn_import_bundler_list(const char *path, char **list);
CN_NODISCARD cn_status cn_import_nvm(cn_importer *to);
CN_NODISCARD cn_status cn_import_metashape(cn_importer *to);
CN_NODISCARD cn_status cn_import_reality_capture(cn_importer *to);
CN_NODISCARD cn_status cn_import_record3d(cn_importer *to);
CN_NODISCARD cn_status cn_import_polycam(cn_importer *to); /* its path is a folder of JSON files */
#endif
