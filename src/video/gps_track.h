/* Where a camera was while it filmed: GPX, KML with a gx:Track, the SRT that drones of DJI write, and GoPro's GPMF. */
#ifndef CONURB_VIDEO_GPS_TRACK_H
#define CONURB_VIDEO_GPS_TRACK_H
#include "conurb/base.h"

typedef struct cn_gps_point {
    double time_s, latitude_deg, longitude_deg;
    double altitude_m; /* above sea level; NaN if unknown */
} cn_gps_point;
typedef struct cn_gps_track {
    cn_gps_point *points;
    size_t n, room;
    bool from_start; /* times count from the video's first picture; else from 1970 (UTC) */
} cn_gps_track;

void cn_gps_track_deinit(cn_gps_track *track);
/* Adds a point; points at latitude 0, longitude 0 are receivers without a fix, and are left out. */
CN_NODISCARD cn_status cn_gps_track_add(cn_gps_track *track, const cn_gps_point *point);
/* Sorts the points by time. Of points at one time only one stays. */
void cn_gps_track_sort(cn_gps_track *track);
/* The place at a time, between two points no more than 10 s apart, or within 1 s of the nearest point. false: the
 * track does not say. */
bool cn_gps_track_at(const cn_gps_track *track, double time_s, cn_gps_point *at);

/* Reads and sorts a file, whose kind follows from its text. The caller frees the track; on failure it is empty.
 * CN_ERR_FORMAT: the file is none of these, is damaged, or has no point. */
CN_NODISCARD cn_status cn_gps_track_read(cn_gps_track *track, const char *path);
/* Adds the points of one packet of GPMF, which lasts from begin_s to end_s (github.com/gopro/gpmf-parser: GPS5 and
 * GPS9, scaled by SCAL; GPSF 0 means no fix). Bytes that are no GPMF are ignored. */
CN_NODISCARD cn_status cn_gps_track_add_gpmf(cn_gps_track *track, const uint8_t *data, size_t size, double begin_s,
                                             double end_s);
#endif
