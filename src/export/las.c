#include "base/number.h"
#include "export/point_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HEADER = 375, RECORD_HEADER = 54, POINT = 36, TEXT = 2560 };
#define FORMAT 7   /* a point with colour and no waveform */
#define WKT_BIT 16 /* of the global encoding: the coordinate system is WKT */
#define UNCLASSIFIED 1
#define FINEST_M 0.001

/* ---- bytes, little-endian on every machine ---- */

static uint8_t *put(uint8_t *to, uint64_t value, int bytes)
{
    for (int b = 0; b < bytes; b++)
        *to++ = (uint8_t)(value >> (8 * b));
    return to;
}

static uint8_t *put_real(uint8_t *to, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return put(to, bits, 8);
}

/* A text field of fixed length, zeros behind it. */
static uint8_t *put_text(uint8_t *to, const char *text, size_t room)
{
    memset(to, 0, room);
    memcpy(to, text, strnlen(text, room));
    return to + room;
}

/* ---- variable length records ---- */

/* A record: its header, then the text with its closing zero. */
typedef struct record {
    const char *user, *about, *text;
    uint16_t id;
} record;

static void describe(const cn_point_file *f, char text[TEXT])
{
    cn_export_about about;
    cn_export_about_make(&about, f->survey);
    snprintf(text, TEXT, "%s\nlight: %s\ntiles: %s\nheights: %s\n%s%s%s", about.software, about.light, about.tiles,
             about.heights, *about.origin ? "frame origin, latitude longitude height: " : "", about.origin,
             *about.origin ? "\n" : "");
}

/* Of the projection's WKT (id 2112), where there is one, and of the text area (id 3). */
static int make_records(const cn_point_file *f, const char *text, record out[2])
{
    int n = 0;
    if (f->wkt) out[n++] = (record){ "LASF_Projection", "WKT", f->wkt, 2112 };
    out[n++] = (record){ "LASF_Spec", "Text area description", text, 3 };
    return n;
}

static void write_record(FILE *stream, const record *r)
{
    uint8_t head[RECORD_HEADER], *to = put(head, 0, 2);
    const size_t length = strlen(r->text) + 1;
    to = put_text(to, r->user, 16);
    to = put(to, r->id, 2);
    to = put(to, length, 2);
    put_text(to, r->about, 32);
    fwrite(head, sizeof head, 1, stream);
    fwrite(r->text, length, 1, stream);
}

/* ---- the header ---- */

static uint8_t *put_box(const cn_point_file *f, uint8_t *to)
{
    for (int k = 0; k < 3; k++)
        to = put_real(to, f->scale);
    for (int k = 0; k < 3; k++)
        to = put_real(to, f->offset[k]);
    for (int k = 0; k < 3; k++) {
        to = put_real(to, f->n ? f->offset[k] + f->scale * f->high[k] : 0);
        to = put_real(to, f->n ? f->offset[k] + f->scale * f->low[k] : 0);
    }
    return to;
}

void cn_las_write_header(cn_point_file *f)
{
    uint8_t head[HEADER] = { 0 }, *to;
    char text[TEXT], software[32];
    record records[2];
    describe(f, text);
    const int n = make_records(f, text, records);
    size_t start = HEADER;
    for (int i = 0; i < n; i++)
        start += RECORD_HEADER + strlen(records[i].text) + 1;
    snprintf(software, sizeof software, "Conurb %s", cn_version());
    to = put_text(head, "LASF", 4);
    to = put(to, 0, 2);
    to = put(to, WKT_BIT, 2);
    to = put(to + 16, 1 | 4 << 8, 2); /* behind an empty project id: version 1.4 */
    to = put_text(to, "EXTRACTION", 32);
    to = put_text(to, software, 32);
    to = put(to, 0, 4); /* no date: the same city gives the same bytes */
    to = put(to, HEADER, 2);
    to = put(to, start, 4);
    to = put(to, (uint64_t)n, 4);
    to = put(to, FORMAT, 1);
    to = put(to, POINT, 2);
    to = put_box(f, to + 24);          /* behind the counts of older versions, which are 0 with this format */
    to = put(to + 8 + 8 + 4, f->n, 8); /* behind waveforms and extended records, of which there are none */
    put(to, f->n, 8);                  /* first returns */
    fwrite(head, sizeof head, 1, f->writer.stream);
    for (int i = 0; i < n; i++)
        write_record(f->writer.stream, &records[i]);
}

cn_status cn_las_begin(cn_point_file *f, double spacing_m)
{
    static const double origin[3] = { 0 };
    CN_TRY(cn_projection_init(&f->projection, f->survey->frame));
    if (f->projection.epsg) CN_TRY(cn_epsg_wkt(f->projection.epsg, &f->wkt));
    if (f->wkt && strlen(f->wkt) >= UINT16_MAX)
        return cn_fail(CN_ERR_DATA, "%s: the coordinate system's WKT is too long for LAS", f->writer.path);
    CN_TRY(cn_projection_forward(&f->projection, origin, f->offset));
    for (int k = 0; k < 3; k++)
        f->offset[k] = round(f->offset[k]);
    /* A power of ten, a hundredth of the spacing or finer, at most a millimetre. */
    f->scale = fmin(FINEST_M, pow(10, floor(log10(spacing_m) + 1e-9) - 2));
    cn_las_write_header(f);
    return CN_OK;
}

cn_status cn_las_write_point(cn_point_file *f, const double xyz[3], const uint8_t rgb[3])
{
    double at[3];
    uint8_t row[POINT] = { 0 }, *to = row;
    CN_TRY(cn_projection_forward(&f->projection, xyz, at));
    for (int k = 0; k < 3; k++) {
        const double steps = round((at[k] - f->offset[k]) / f->scale);
        if (!(fabs(steps) <= INT32_MAX))
            return cn_fail(CN_ERR_DATA, "%s: a point lies %.0f away, too far for LAS with steps of %g; write a .ply",
                           f->writer.path, at[k] - f->offset[k], f->scale);
        const int32_t step = (int32_t)steps;
        f->low[k] = f->n && f->low[k] < step ? f->low[k] : step;
        f->high[k] = f->n && f->high[k] > step ? f->high[k] : step;
        to = put(to, (uint32_t)step, 4);
    }
    to = put(to, 0, 2);    /* intensity */
    to = put(to, 0x11, 1); /* return 1 of 1 */
    to = put(to, 0, 1);
    to = put(to, UNCLASSIFIED, 1);
    to += 1 + 2 + 2 + 8; /* user data, scan angle, source, time */
    for (int k = 0; k < 3; k++)
        to = put(to, rgb[k] * 257u, 2);
    fwrite(row, sizeof row, 1, f->writer.stream);
    return CN_OK;
}
