/* The cameras: positions, lenses, and the EXIF of their photos. */
#ifndef CONURB_SYNTH_RIG_H
#define CONURB_SYNTH_RIG_H
#include "synth/world.h"

enum { CN_RIG_STREET, CN_RIG_AERIAL, CN_RIG_CAMERAS };

typedef struct cn_shot {
    char name[48];                                 /* "run0-clear_street_004.jpg" */
    uint32_t run, camera;                          /* run: in whose light; camera: CN_RIG_STREET or CN_RIG_AERIAL */
    double rotation[9], translation[3], centre[3]; /* cam_from_world; local metres */
    int64_t time_s;                                /* local time since 1970 */
    double gps[3];  /* latitude, longitude (degrees), metres above sea level, with noise */
    double miss_ev; /* error of the exposure, stops */
    double iso, f_number;
    double exposure_s, gain; /* what the photo was taken with; gain: of radiance, from the exposure */
    double balance[3];       /* white balance as the camera left it */
} cn_shot;

typedef struct cn_rig {
    cn_camera cameras[CN_RIG_CAMERAS];
    cn_shot *shots; /* sorted by name */
    uint32_t n_shots;
} cn_rig;

/* Cameras and shots of a world; exposure_s and gain stay 0 until the shot is taken. */
CN_NODISCARD cn_status cn_rig_init(cn_rig *rig, const cn_world *world);
void cn_rig_deinit(cn_rig *rig);
/* The frame of the world: georeferenced, without rotation. */
void cn_rig_frame(const cn_synth_options *options, cn_frame *frame);
/* People and cars around a shot; none with `plain`. */
CN_NODISCARD cn_status cn_crowd_init(cn_crowd *crowd, const cn_world *world, const cn_shot *shot, uint32_t index);
void cn_crowd_deinit(cn_crowd *crowd);
#endif
