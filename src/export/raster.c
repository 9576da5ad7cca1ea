/* Orthophoto and surface model: every tile adds its samples below the pixels in its reach to sums in a scratch file;
 * then rows of blocks become pixels. */
#include "base/clock.h"
#include "base/file.h"
#include "export/about.h"
#include "export/blocks.h"
#include "export/geotiff.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct raster {
    const cn_survey *survey;
    const cn_raster_options *options;
    cn_height_sampler sampler;
    cn_height_samples samples;
    cn_ground_grid grid;
    cn_blocks blocks;
    cn_pixel_sum *sums;      /* of a block */
    cn_pixel_sum *row;       /* of a row of blocks: rows of pixels */
    uint32_t x0, y0, x1, y1; /* covered pixels */
    uint64_t covered;
    cn_geotiff ortho, dsm;
} raster;

static cn_status stopped(void)
{
    return cn_fail(CN_ERR_INTERRUPTED, "stopped while exporting; run the same command again, it starts over");
}

/* ---- gathering ---- */

static bool add_samples(const cn_height_samples *q, cn_pixel_sum *sums)
{
    bool any = false;
    for (size_t i = 0; i < q->n; i++) {
        const float w = q->weight[i];
        if (!(w > 0)) continue;
        for (int c = 0; c < 3; c++)
            sums[i].rgb[c] += w * q->rgba[i][c];
        sums[i].alpha += w * q->rgba[i][3];
        sums[i].below += w * q->below_m[i];
        sums[i].weight += w;
        any = true;
    }
    return any;
}

static cn_status survey_block(raster *r, uint32_t x, uint32_t y)
{
    CN_TRY(cn_ground_grid_block(&r->grid, x, y, &r->samples));
    CN_TRY(cn_height_sampler_down(&r->sampler, &r->samples));
    CN_TRY(cn_blocks_read(&r->blocks, x, y, r->sums));
    return add_samples(&r->samples, r->sums) ? cn_blocks_write(&r->blocks, x, y, r->sums) : CN_OK;
}

static cn_status survey_tile(raster *r, uint32_t tile, double started)
{
    const cn_survey_tile *place = &r->survey->tiles[tile];
    cn_block_range range;
    CN_TRY(cn_ground_grid_range(&r->grid, place, r->survey->reach, &range));
    CN_TRY(cn_height_sampler_open(&r->sampler, tile));
    for (uint32_t y = range.y0; y < range.y1; y++) {
        for (uint32_t x = range.x0; x < range.x1; x++) {
            if (cn_stopping(&r->sampler.ctx)) return stopped();
            CN_TRY(survey_block(r, x, y));
        }
        const double total = r->survey->n_tiles, done = tile + (double)(y + 1 - range.y0) / (range.y1 - range.y0);
        const double elapsed = cn_now_s() - started;
        const cn_progress_report report = { "export", "ground", 100 * done / total,
                                            100,      elapsed,  elapsed / done * (total - done),
                                            NULL };
        cn_progress(&r->sampler.ctx, &report);
    }
    return CN_OK;
}

/* ---- what is covered ---- */

static void note_covered(raster *r, uint32_t x, uint32_t y)
{
    for (uint32_t i = 0; i < CN_BLOCK * CN_BLOCK; i++) {
        if (!(r->sums[i].weight > 0)) continue;
        const uint32_t px = x * CN_BLOCK + i % CN_BLOCK, py = y * CN_BLOCK + i / CN_BLOCK;
        r->x0 = px < r->x0 ? px : r->x0;
        r->y0 = py < r->y0 ? py : r->y0;
        r->x1 = px >= r->x1 ? px + 1 : r->x1;
        r->y1 = py >= r->y1 ? py + 1 : r->y1;
        r->covered++;
    }
}

static cn_status find_covered(raster *r)
{
    r->x0 = r->y0 = UINT32_MAX;
    for (uint32_t y = 0; y < r->grid.down; y++)
        for (uint32_t x = 0; x < r->grid.across; x++) {
            CN_TRY(cn_blocks_read(&r->blocks, x, y, r->sums));
            note_covered(r, x, y);
        }
    return r->covered ? CN_OK
                      : cn_fail(CN_ERR_DATA,
                                "the tiles show no ground that two photos see; train longer, or look at the renders");
}

/* ---- writing ---- */

static cn_status open_files(raster *r)
{
    cn_geotiff_header header = { .rgba = true, .width = r->x1 - r->x0, .height = r->y1 - r->y0 };
    header.place = (cn_geotiff_place){ r->grid.projection.epsg, r->grid.left_m + r->grid.gsd_m * r->x0,
                                       r->grid.north_m - r->grid.gsd_m * r->y0, r->grid.gsd_m };
    cn_export_about about;
    cn_export_about_make(&about, r->survey);
    const char *metadata[] = { "TIFFTAG_SOFTWARE",
                               about.software,
                               "HEIGHTS",
                               about.heights,
                               "LIGHT",
                               about.light,
                               "TILES",
                               about.tiles,
                               *about.origin ? "ORIGIN_LATITUDE_LONGITUDE_HEIGHT" : NULL,
                               about.origin,
                               NULL };
    header.metadata = metadata;
    if (r->options->ortho) CN_TRY(cn_geotiff_open(&r->ortho, &r->sampler.ctx, r->options->ortho, &header));
    header.rgba = false;
    if (r->options->dsm) CN_TRY(cn_geotiff_open(&r->dsm, &r->sampler.ctx, r->options->dsm, &header));
    return CN_OK;
}

/* The covered columns of a row of blocks, as rows of pixels. */
static cn_status read_row(raster *r, uint32_t y)
{
    const uint32_t width = r->x1 - r->x0;
    for (uint32_t x = r->x0 / CN_BLOCK; x * CN_BLOCK < r->x1; x++) {
        CN_TRY(cn_blocks_read(&r->blocks, x, y, r->sums));
        for (uint32_t i = 0; i < CN_BLOCK * CN_BLOCK; i++) {
            const uint32_t px = x * CN_BLOCK + i % CN_BLOCK;
            if (px >= r->x0 && px < r->x1) r->row[(size_t)(i / CN_BLOCK) * width + (px - r->x0)] = r->sums[i];
        }
    }
    return CN_OK;
}

static cn_status write_ortho(raster *r, uint32_t first, uint32_t row, uint32_t rows)
{
    const size_t n = (size_t)rows * (r->x1 - r->x0);
    const cn_pixel_sum *sums = r->row + (size_t)first * (r->x1 - r->x0);
    float *colour = malloc(n * 3 * sizeof *colour);
    uint8_t *pixels = malloc(n * 4);
    cn_status status = colour && pixels ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", r->options->ortho);
    for (size_t i = 0; i < n && status == CN_OK; i++)
        for (int c = 0; c < 3; c++)
            colour[3 * i + (size_t)c] = sums[i].alpha > 0 ? sums[i].rgb[c] / sums[i].alpha : 0;
    if (status == CN_OK)
        status = cn_colour_to_display(r->survey->colour,
                                      &(cn_display_transform){ .view = r->survey->view,
                                                               .look = r->survey->look,
                                                               .exposure_ev = r->survey->exposure_ev },
                                      colour, n, 3);
    for (size_t i = 0; i < n && status == CN_OK; i++) {
        const bool there = sums[i].weight > 0;
        for (int c = 0; c < 3; c++)
            pixels[4 * i + (size_t)c] =
                there ? (uint8_t)lrintf(fminf(fmaxf(colour[3 * i + (size_t)c], 0), 1) * 255) : 0;
        pixels[4 * i + 3] = there ? 255 : 0;
    }
    if (status == CN_OK) status = cn_geotiff_write(&r->ortho, row, rows, pixels);
    free(colour);
    free(pixels);
    return status;
}

static cn_status write_dsm(raster *r, uint32_t first, uint32_t row, uint32_t rows)
{
    const size_t n = (size_t)rows * (r->x1 - r->x0);
    const cn_pixel_sum *sums = r->row + (size_t)first * (r->x1 - r->x0);
    float *heights = malloc(n * sizeof *heights);
    if (!heights) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", r->options->dsm);
    for (size_t i = 0; i < n; i++)
        heights[i] = sums[i].weight > 0 ? (float)cn_ground_grid_height(&r->grid, (double)sums[i].below / sums[i].weight)
                                        : CN_GEOTIFF_NODATA;
    const cn_status status = cn_geotiff_write(&r->dsm, row, rows, heights);
    free(heights);
    return status;
}

static cn_status write_files(raster *r)
{
    CN_TRY(open_files(r));
    r->row = calloc((size_t)CN_BLOCK * (r->x1 - r->x0), sizeof *r->row);
    if (!r->row) return cn_fail(CN_ERR_NOMEM, "out of memory for a row of the raster");
    for (uint32_t y = r->y0 / CN_BLOCK; y * CN_BLOCK < r->y1; y++) {
        if (cn_stopping(&r->sampler.ctx)) return stopped();
        const uint32_t from = y * CN_BLOCK > r->y0 ? y * CN_BLOCK : r->y0;
        const uint32_t to = (y + 1) * CN_BLOCK < r->y1 ? (y + 1) * CN_BLOCK : r->y1;
        CN_TRY(read_row(r, y));
        if (r->options->ortho) CN_TRY(write_ortho(r, from - y * CN_BLOCK, from - r->y0, to - from));
        if (r->options->dsm) CN_TRY(write_dsm(r, from - y * CN_BLOCK, from - r->y0, to - from));
    }
    if (r->options->ortho) CN_TRY(cn_geotiff_finish(&r->ortho));
    return r->options->dsm ? cn_geotiff_finish(&r->dsm) : CN_OK;
}

static cn_status make(raster *r, double gsd_m)
{
    const char *beside = r->options->ortho ? r->options->ortho : r->options->dsm;
    CN_TRY(cn_ground_grid_init(&r->grid, &r->sampler, gsd_m));
    CN_TRY(cn_height_samples_init(&r->samples, CN_BLOCK * CN_BLOCK));
    CN_TRY(cn_blocks_open(&r->blocks, beside, r->grid.across, r->grid.down));
    r->sums = malloc(sizeof(cn_block_sums));
    if (!r->sums) return cn_fail(CN_ERR_NOMEM, "out of memory for a block of the raster");
    const double started = cn_now_s();
    for (uint32_t t = 0; t < r->survey->n_tiles; t++)
        CN_TRY(survey_tile(r, t, started));
    CN_TRY(find_covered(r));
    return write_files(r);
}

cn_status cn_export_rasters(const cn_context *ctx, const cn_survey *survey, const cn_raster_options *options,
                            cn_raster_report *report)
{
    raster r = { .survey = survey, .options = options, .blocks.fd = -1 };
    if (!options->ortho && !options->dsm)
        return cn_fail(CN_ERR_USAGE, "neither an orthophoto nor a surface model was asked for");
    if (options->ortho) CN_TRY(cn_file_check(options->ortho));
    if (options->dsm) CN_TRY(cn_file_check(options->dsm));
    CN_TRY(cn_height_sampler_init(&r.sampler, ctx, survey));
    const double gsd_m = options->gsd_m > 0 ? options->gsd_m : cn_export_gsd(survey);
    const cn_status status = make(&r, gsd_m);
    if (status == CN_OK && report)
        *report = (cn_raster_report){ r.x1 - r.x0,
                                      r.y1 - r.y0,
                                      gsd_m,
                                      r.grid.left_m + gsd_m * r.x0,
                                      r.grid.north_m - gsd_m * r.y0,
                                      r.grid.projection.epsg,
                                      r.covered };
    cn_geotiff_abort(&r.ortho);
    cn_geotiff_abort(&r.dsm);
    cn_blocks_close(&r.blocks);
    cn_height_samples_deinit(&r.samples);
    cn_ground_grid_deinit(&r.grid);
    cn_height_sampler_deinit(&r.sampler);
    free(r.sums);
    free(r.row);
    return status;
}
