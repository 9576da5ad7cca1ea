/* Reads the pictures of a film, one after another, through libav. */
#ifndef CONURB_VIDEO_INPUT_H
#define CONURB_VIDEO_INPUT_H
#include "video/gps_track.h"

#include <libavutil/frame.h>

typedef struct cn_film cn_film; /* one thread at a time */
typedef struct cn_film_facts {
    uint32_t width, height;   /* as stored, before the rotation */
    int quarter_turns;        /* clockwise, 0 to 3, that make the picture upright */
    double duration_s;        /* 0: unknown */
    double created_s;         /* seconds since 1970 (UTC); NaN: unknown */
    char make[64], model[64]; /* of the camera; "" unknown */
    bool is_hdr;              /* HLG or PQ */
} cn_film_facts;

/* Opens the film with its first video stream. threads: of the decoder. telemetry: gets the places that the film itself
 * holds (GPMF) while its pictures are read; NULL: not wanted. Both stay the caller's. CN_ERR_IO: there is no such file.
 * CN_ERR_FORMAT: it is no film that this libav can read. */
CN_NODISCARD cn_status cn_film_open(cn_film **film, const char *path, unsigned threads, cn_gps_track *telemetry);
void cn_film_close(cn_film **film);
const cn_film_facts *cn_film_facts_of(const cn_film *film);
/* *picture: the next picture, valid until the next call; NULL: the film has ended. *time_s: from the first picture on.
 * Damaged pictures are skipped. */
CN_NODISCARD cn_status cn_film_next(cn_film *film, const AVFrame **picture, double *time_s);
#endif
