/* Tiles made by a test: flat ground at z = 0 of one colour, as far as the tile's box goes. */
#ifndef CONURB_TEST_BLOCK_H
#define CONURB_TEST_BLOCK_H
#include "conurb/pose.h"
#include "conurb/tile.h"
#include "tile/seen.h"

#define BLOCK_CELL 0.25 /* of the occupancy grid: what heights are good for */
enum {
    BLOCK_EXTENT = 8,
    BLOCK_PHOTOS = 2
}; /* metres from centre to side; photos "dim.jpg" at -1 stop, "bright.jpg" at +1 */

typedef struct block {
    const char *id;
    double x, y;                        /* of its centre */
    float rgb[3];                       /* linear, at 0 stops */
    bool exposure;                      /* with a row a photo */
    const cn_seen *seen;                /* with a sky, light grey, if not NULL */
    uint32_t levels, log2_table, width; /* 0: small */
} block;
cn_status block_write(const block *b, const char *path);
/* A camera at x, y, z that looks straight down; north is up. */
void block_look_down(double x, double y, double z, cn_view *view);
#endif
