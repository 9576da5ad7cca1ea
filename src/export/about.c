#include "export/about.h"

#include "base/number.h"
#include "export/projection.h"

#include <stdio.h>
#include <string.h>

static void list_tiles(const cn_survey *survey, char *out, size_t size)
{
    size_t used = (size_t)snprintf(out, size, "%u", survey->n_tiles);
    for (uint32_t i = 0; i < survey->n_tiles; i++) {
        const char *id = survey->tiles[i].id;
        if (!id) return;
        if (used + strlen(id) + 8 > size) {
            snprintf(out + used, size - used, " ...");
            return;
        }
        used += (size_t)snprintf(out + used, size - used, "%s%s", i ? " " : ": ", id);
    }
}

void cn_export_about_make(cn_export_about *about, const cn_survey *survey)
{
    const cn_frame *f = survey->frame;
    *about = (cn_export_about){ 0 };
    snprintf(about->software, sizeof about->software, "Conurb %s", cn_version());
    snprintf(about->light, sizeof about->light, "%s", survey->light ? survey->light : "mean");
    for (char *c = about->light; *c; c++) /* a photo's name may hold anything */
        if ((unsigned char)*c < ' ') *c = ' ';
    list_tiles(survey, about->tiles, sizeof about->tiles);
    if (f->georeferenced)
        cn_print(about->origin, sizeof about->origin, "%.9f %.9f %.4f", f->latitude_deg, f->longitude_deg, f->height_m);
    cn_projection_heights(f, about->heights);
}
