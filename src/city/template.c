#include "city/config.h"

#include "base/file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A YAML text in double quotes: a folder may have quotes and backslashes in its name. */
static char *quote(const char *text)
{
    char *out = malloc(4 * strlen(text) + 3), *p = out;
    if (!out) return NULL;
    *p++ = '"';
    for (; *text; text++) {
        if (*text == '"' || *text == '\\') *p++ = '\\';
        if ((unsigned char)*text >= ' ' && *text != 0x7f)
            *p++ = *text;
        else
            p += sprintf(p, "\\x%02x", (unsigned char)*text);
    }
    memcpy(p, "\"", 2);
    return out;
}

static char *fill(const char *photos, const char *import, uint32_t width_px)
{
    return cn_format(
        "# A city of Conurb. Commented keys show their defaults. Relative paths start at this folder.\n"
        "version: 1\n"
        "\n"
        "photos:\n"
        "  folder: %s\n"
        "  width_px: %u             # working width: photos are resampled to it once; smaller is faster\n"
        "\n"
        "poses:\n"
        "%s%s%s"
        "  # colmap: colmap           # program to run\n"
        "  # matcher: auto            # auto | gps (neighbours by position) | exhaustive | sequential\n"
        "  # neighbours: 20           # photos to match each photo with, by GPS\n"
        "  # max_image_px: 1600       # features are found on photos of at most this size\n"
        "  # refine_focal: auto       # auto | on | off; auto is off for near-nadir sets with an EXIF focal length\n"
        "  # max_error_m: 5           # metres from its GPS at which a photo no longer counts for the alignment\n"
        "\n"
        "plan:\n"
        "  # layout: auto             # auto | grid | centres\n"
        "  # centres: crossings.geojson  # GeoJSON points, for layout: centres\n"
        "  # spacing_m: 0             # metres between neighbouring tiles; 0 chooses\n"
        "  # overlap: 0.5             # part of a tile's diameter that the next one shares: 1 - spacing / (2 radius)\n"
        "  # min_photos: 4            # a tile with fewer joins a neighbour or is dropped\n"
        "  # max_tile_photos: 0       # a tile trains on at most so many, spread evenly; 0: on all\n"
        "  # max_tile_gb: 8           # and on as many as training has room for in so much memory; 0: no limit\n"
        "  # hold_out_every: 8        # every 8th photo by name is kept for eval; 0 keeps none\n"
        "\n"
        "effects:                     # auto: on when the photos show the need; or on, off\n"
        "  # view_dependence: auto    # colours change with the direction of view\n"
        "  # exposure: auto           # brightness follows shutter, ISO and f-number\n"
        "  # appearance: auto         # the light differs between photos\n"
        "  # transient: auto          # people, cars: what is in some photos only\n"
        "  # pose_refinement: auto    # poses are off by more than a pixel\n"
        "  # sky: auto                # rays that end nowhere\n"
        "\n"
        "train:\n"
        "  # quality: standard        # preview | standard | high | reference\n"
        "  # seed: 1                  # same seed, same tile\n"
        "  # time_budget_s: 0         # a tile; 0: as long as the quality takes. With no quality or size named, these "
        "are chosen for it\n"
        "  # stop_gain_db: 0          # end early when another minute is expected to buy less on held-out photos, in "
        "dB; 0: never\n"
        "  # steps: 6000              # by default those of the quality, as are the six below\n"
        "  # samples_per_step: 32768  # memory and time of a step grow with it\n"
        "  # log2_table: 19           # entries of a hash level, as a power of two\n"
        "  # levels: 16               # of the hash grid\n"
        "  # finest_resolution: 2048  # cells across the tile at the finest level\n"
        "  # march_step: 0.0078125    # length of a sample over its distance, at the end; depth is about as exact\n"
        "  # precision: fastest       # fastest | float: of the networks' products, where the processor has bfloat16\n"
        "  # learning_rate: 0.01      # at the start; it decays\n"
        "  # checkpoint_every_s: 60   # what a crash can cost\n"
        "\n"
        "compose:\n"
        "  # scheme: distance_2d      # nearest | distance_2d | distance_3d | visibility | ownership\n"
        "  # exponent: 4              # tiles blend by distance^-exponent\n"
        "  # reach: 2                 # how far from its centre a tile is seen, in radii\n"
        "  # max_tiles: 4             # nearest first; one more are held in memory\n"
        "  # min_visibility: 0.05     # a tile that sees less of a view, of what the best one sees, is left out\n"
        "  # match: on                # on | off; the tiles' light is matched to a root tile's\n"
        "\n"
        "render:\n"
        "  # width_px: 640            # of a picture; its height follows the photos\n"
        "  # frames: 48               # of the default flight\n"
        "  # fps: 24                  # of a path without its own\n"
        "  # view: sRGB               # of the OpenColorIO config: sRGB | ACES\n"
        "  # look: \"\"                 # of the OpenColorIO config\n"
        "  # exposure_ev: 0           # stops, added to every picture\n",
        photos, width_px,
        import ? "  import: " : "  # import: MODEL          # a COLMAP model folder or a transforms.json",
        import ? import : "", "\n");
}

char *cn_config_template(const char *photos, const char *import, uint32_t width_px)
{
    char *folder = quote(photos), *model = import ? quote(import) : NULL;
    char *text = folder && (model || !import) ? fill(folder, model, width_px) : NULL;
    free(folder);
    free(model);
    return text;
}
