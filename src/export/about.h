/* What an export says of itself: program, light, tiles, place. */
#ifndef CONURB_EXPORT_ABOUT_H
#define CONURB_EXPORT_ABOUT_H
#include "conurb/export.h"

typedef struct cn_export_about {
    char software[32]; /* "Conurb 0.1.0" */
    char light[640];   /* one line */
    char tiles[1024];  /* "3: ID ID ID"; of very many the first ones */
    char origin[96];   /* latitude, longitude, height of the frame's origin; "" without georeference */
    char heights[160]; /* what heights are measured from */
} cn_export_about;
void cn_export_about_make(cn_export_about *about, const cn_survey *survey);
#endif
