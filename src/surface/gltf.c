#include "surface/gltf.h"

#include "geo/heights.h"

#include <stdlib.h>

json_t *cn_mesh_about_json(const cn_mesh_about *a)
{
    const cn_frame *f = a->frame;
    json_t *about = json_pack("{s:s, s:o, s:s, s:b}", "light", a->appearance, "cube_m", cn_json_real(a->cube_m), "axes",
                              "x east, y up, z south; metres from the origin", "georeferenced", (int)f->georeferenced);
    if (about && a->tiles) json_object_set_new(about, "tiles", json_string(a->tiles));
    if (about && f->georeferenced)
        json_object_set_new(about, "origin_wgs84",
                            json_pack("{s:o, s:o, s:o, s:s}", "latitude_deg", cn_json_real(f->latitude_deg),
                                      "longitude_deg", cn_json_real(f->longitude_deg), "height_m",
                                      cn_json_real(f->height_m), "heights", cn_frame_heights(f)));
    return about;
}

/* One line, whatever a name has in it. */
static void write_text(FILE *stream, const char *text)
{
    for (const char *c = text; *c; c++)
        fputc((unsigned char)*c < ' ' ? ' ' : *c, stream);
    fputc('\n', stream);
}

void cn_mesh_comments(FILE *stream, const cn_mesh_about *about, const char *mark)
{
    const cn_frame *f = about->frame;
    fprintf(stream, "%s Conurb %s: %s\n%s light: ", mark, cn_version(),
            f->georeferenced ? "local metres, x east, y north, z up" : "axes and units of the poses", mark);
    write_text(stream, about->appearance);
    if (about->tiles) {
        fprintf(stream, "%s tiles ", mark);
        write_text(stream, about->tiles);
    }
    if (f->georeferenced)
        fprintf(stream, "%s origin: latitude %.9f, longitude %.9f, height %.4f m %s\n", mark, f->latitude_deg,
                f->longitude_deg, f->height_m, cn_frame_heights(f));
}

cn_status cn_gltf_head(FILE *stream, json_t *root, uint32_t size)
{
    char *text = root ? json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(17)) : NULL;
    json_decref(root);
    if (!text) return cn_fail(CN_ERR_NOMEM, "out of memory for the head of a mesh");
    const uint32_t length = (uint32_t)strlen(text), padded = (length + 3) / 4 * 4;
    uint8_t head[20], chunk[8];
    cn_put_32(cn_put_32(cn_put_32(cn_put_32(cn_put_32(head, 0x46546c67), 2), 12 + 8 + padded + 8 + size), padded),
              0x4e4f534a);
    cn_put_32(cn_put_32(chunk, size), 0x004e4942);
    fwrite(head, sizeof head, 1, stream);
    fprintf(stream, "%s%*s", text, (int)(padded - length), "");
    fwrite(chunk, sizeof chunk, 1, stream);
    free(text);
    return CN_OK;
}
