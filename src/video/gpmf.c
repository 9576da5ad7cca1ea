/* GoPro's telemetry, GPMF: keys of four letters, a type, a size and a count, big endian, padded to four bytes. */
#include "video/gps_track.h"

#include <math.h>
#include <string.h>

enum { MOST_DEPTH = 8, FIELDS = 9, GPS9_BYTES = 32 };

typedef struct stream {
    double scale[FIELDS];
    bool no_fix;
} stream;
typedef struct span {
    cn_gps_track *track;
    double begin_s, end_s;
} span;

static uint32_t be16(const uint8_t *p)
{
    return (uint32_t)p[0] << 8 | p[1];
}
static uint32_t be32(const uint8_t *p)
{
    return be16(p) << 16 | be16(p + 2);
}

static void read_scale(stream *s, char type, const uint8_t *data, uint32_t size, uint32_t n)
{
    for (uint32_t k = 0; k < FIELDS; k++) {
        const uint32_t i = n == 1 ? 0 : k;
        if (i >= n) break;
        if (type == 'l' && size == 4) s->scale[k] = (int32_t)be32(data + 4 * i);
        if (type == 's' && size == 2) s->scale[k] = (int16_t)be16(data + 2 * i);
    }
}

/* Both kinds begin with latitude, longitude and altitude. Their points are spread over the packet's time. */
static cn_status add_points(const span *at, const stream *s, const uint8_t *data, uint32_t size, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++) {
        const uint8_t *p = data + (size_t)size * i;
        double v[3];
        for (int k = 0; k < 3; k++)
            v[k] = (int32_t)be32(p + 4 * k) / (s->scale[k] != 0 ? s->scale[k] : 1);
        if (s->no_fix || (size == GPS9_BYTES && be16(p + 30) == 0) || fabs(v[0]) > 90 || fabs(v[1]) > 360) continue;
        const cn_gps_point point = { at->begin_s + (at->end_s - at->begin_s) * i / n, v[0], v[1], v[2] };
        CN_TRY(cn_gps_track_add(at->track, &point));
    }
    return CN_OK;
}

static cn_status walk(const span *at, stream *s, const uint8_t *data, size_t size, int depth)
{
    while (size >= 8 && depth < MOST_DEPTH) {
        const char type = (char)data[4];
        const uint32_t one = data[5], n = be16(data + 6);
        const size_t bytes = (size_t)one * n, padded = (bytes + 3) & ~(size_t)3;
        if (padded > size - 8) break;
        const uint8_t *value = data + 8;
        if (type == 0) {
            stream inner = { .scale = { 1, 1, 1, 1, 1, 1, 1, 1, 1 } };
            CN_TRY(walk(at, &inner, value, bytes, depth + 1));
        } else if (memcmp(data, "SCAL", 4) == 0) {
            read_scale(s, type, value, one, n);
        } else if (memcmp(data, "GPSF", 4) == 0 && bytes >= 4) {
            s->no_fix = be32(value) == 0;
        } else if ((memcmp(data, "GPS5", 4) == 0 && one == 20) || (memcmp(data, "GPS9", 4) == 0 && one == GPS9_BYTES)) {
            CN_TRY(add_points(at, s, value, one, n));
        }
        data += 8 + padded;
        size -= 8 + padded;
    }
    return CN_OK;
}

cn_status cn_gps_track_add_gpmf(cn_gps_track *track, const uint8_t *data, size_t size, double begin_s, double end_s)
{
    const span at = { track, begin_s, end_s };
    stream outer = { .scale = { 1, 1, 1, 1, 1, 1, 1, 1, 1 } };
    track->from_start = true;
    return walk(&at, &outer, data, size, 0);
}
