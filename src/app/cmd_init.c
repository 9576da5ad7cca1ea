#include "app.h"

typedef struct options {
    const char *photos, *import, *video, *track;
    double width, every, track_offset;
} options;

static const cn_app_option table[] = {
    { "photos", "DIR", "folder of the photos (JPEG, HEIC, PNG, TIFF, EXR, WebP). Masks go in DIR/masks/NAME.png",
      CN_APP_TEXT, offsetof(options, photos), NULL },
    { "import", "PATH",
      "take the poses from another tool, a file or a folder (the README lists the kinds), and do not run COLMAP",
      CN_APP_TEXT, offsetof(options, import), NULL },
    { "width", "PX", "width in pixels to which the photos are scaled down; by default 800", CN_APP_NUMBER,
      offsetof(options, width), NULL },
    { "video", "FILE", "a film: sharp pictures of it, evenly along the camera's motion, become CITY/photos",
      CN_APP_TEXT, offsetof(options, video), NULL },
    { "every", "T", "one photo of the film for about so much time in which the camera moves; by default 0.5s",
      CN_APP_TIME, offsetof(options, every), NULL },
    { "track", "FILE",
      "where the camera was while it filmed: a GPX, a KML with a gx:Track, or the SRT of a DJI drone. By default the "
      "film's own telemetry (GoPro), or an SRT or GPX of the film's name beside it",
      CN_APP_TEXT, offsetof(options, track), NULL },
    { "track-offset", "T", "how far the track's clock is ahead of the film's, in seconds", CN_APP_NUMBER,
      offsetof(options, track_offset), NULL },
    { 0 }
};

static cn_status run_init(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    if (o->width < 0 || o->width > 65535) return cn_fail(CN_ERR_USAGE, "--width: give 16 to 65535 pixels");
    if (!o->video && (o->every != 0 || o->track || o->track_offset != 0))
        return cn_fail(CN_ERR_USAGE, "--every, --track and --track-offset belong to a film; name it by --video");
    cn_init_options init = { .photos = o->photos,
                             .import = o->import,
                             .width_px = (uint32_t)o->width,
                             .video = o->video,
                             .film = cn_film_options_default() };
    if (o->every != 0) init.film.every_s = o->every;
    init.film.track = o->track;
    init.film.offset_s = o->track_offset;
    return cn_city_init(ctx, call->operands[0], &init);
}

const cn_app_command cn_app_init = {
    .name = "init",
    .summary = "make a city: a folder with a commented city.yaml",
    .forms = "CITY",
    .about = "Writes CITY/city.yaml. Each key in it has a comment that says what it does. The photos stay where they "
             "are.\n\n"
             "Of a film (--video), about two photos a second are taken while the camera moves.",
    .example = "conurb init beach --photos photos --width 1000",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_init,
};
