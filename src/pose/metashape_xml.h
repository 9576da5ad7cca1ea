/* What cameras.xml of Metashape holds, as far as poses need it. */
#ifndef CONURB_POSE_METASHAPE_XML_H
#define CONURB_POSE_METASHAPE_XML_H
#include "conurb/base.h"

typedef enum cn_metashape_lens {
    CN_METASHAPE_FRAME,
    CN_METASHAPE_FISHEYE,
    CN_METASHAPE_SPHERICAL, /* all directions; no calibration */
    CN_METASHAPE_OTHER
} cn_metashape_lens;
typedef struct cn_metashape_sensor {
    int chunk; /* number in the file */
    long id;
    cn_metashape_lens lens;
    char type[32];
    bool adjusted; /* its calibration is what Metashape found, not what it began with */
    double width, height, f, c[2], k[4], p[2], b[2]; /* 0 where the file has none */
} cn_metashape_sensor;
typedef struct cn_metashape_shot {
    int chunk;
    long sensor, component; /* component -1: none */
    bool enabled, aligned;  /* aligned: transform is set */
    double transform[16];
    char *label;
} cn_metashape_shot;
/* The transform of a chunk (component -1) or of a component. */
typedef struct cn_metashape_part {
    int chunk;
    long component;
    double rotation[9], translation[3], scale;
} cn_metashape_part;
typedef struct cn_metashape {
    cn_metashape_sensor *sensors;
    cn_metashape_shot *shots;
    cn_metashape_part *parts;
    size_t n_sensors, n_shots, n_parts;
} cn_metashape;

/* CN_ERR_FORMAT: not valid XML, cut, not of Metashape, or a number is wrong; the message has the line. The caller frees
 * *out with cn_metashape_deinit; it is empty on failure. */
CN_NODISCARD cn_status cn_metashape_read(const char *path, cn_metashape *out);
void cn_metashape_deinit(cn_metashape *file);
#endif
