/* The material at a place of the city: colours from noise, never repeated, and filtered to the pixel's size. */
#ifndef CONURB_SYNTH_TEXTURE_H
#define CONURB_SYNTH_TEXTURE_H
#include "synth/town.h"

typedef struct cn_surface_place {
    const cn_patch *patch;
    const cn_chart *chart;
    float position[3];
    float a, b;        /* on the patch, in [0, 1] */
    float s, t;        /* on the chart, metres */
    float footprint_m; /* size of a pixel there */
} cn_surface_place;

typedef struct cn_surface {
    float albedo[3];
    float mirror;  /* reflectance at normal incidence; 0: no mirror */
    float glow[3]; /* emitted light when lamps are lit */
    float wrap;    /* how far light goes round: leaves */
} cn_surface;

void cn_texture(const cn_town *town, const cn_surface_place *place, cn_surface *out);

/* By kind; albedo is filled. */
void cn_texture_wall(const cn_surface_place *place, float albedo[3]);
void cn_texture_window(const cn_surface_place *place, cn_surface *out);
void cn_texture_shop(const cn_surface_place *place, cn_surface *out);
void cn_texture_sign(const cn_surface_place *place, float albedo[3]);
void cn_texture_ground(const cn_town *town, const cn_surface_place *place, float albedo[3]);
void cn_texture_roof(const cn_surface_place *place, float albedo[3]);

/* A bright colour from a hash. */
void cn_texture_colour(uint64_t hash, float rgb[3]);
#endif
