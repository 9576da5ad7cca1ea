/* Any bytes as a track of GPS: GPX, KML, SRT, or a packet of GPMF. */
#include "fuzz.h"

#include "video/gps_track.h"

#include <math.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 1) return 0;
    cn_gps_track track = { 0 };
    const cn_status status = data[0] & 1 ? cn_gps_track_add_gpmf(&track, data + 1, size - 1, 1, 2)
                                         : cn_gps_track_read(&track, fuzz_file("track", data + 1, size - 1));
    if (status == CN_OK) {
        cn_gps_track_sort(&track);
        for (size_t i = 0; i < track.n; i++) {
            cn_gps_point at;
            if (!(fabs(track.points[i].latitude_deg) <= 90)) abort();
            if (!cn_gps_track_at(&track, track.points[i].time_s, &at)) abort();
        }
    }
    cn_gps_track_deinit(&track);
    return 0;
}
