#include "stage/film.h"
#include "stage/old_frames.h"

#include "base/file.h"
#include "base/hash.h"
#include "record/record.h"
#include "conurb/video.h"
#include "city/workspace.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static cn_status encode(const cn_context *ctx, const char *folder, uint32_t n, double fps, const char *film)
{
    char **pictures = calloc(n, sizeof *pictures);
    cn_status status = pictures ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the film %s", film);
    for (uint32_t i = 0; i < n && status == CN_OK; i++) {
        pictures[i] = cn_format("%s/%05u.png", folder, i);
        if (!pictures[i]) status = cn_fail(CN_ERR_NOMEM, "out of memory for the film %s", film);
    }
    cn_video_options options = cn_video_options_default();
    options.fps = fps;
    if (status == CN_OK) status = cn_video_encode(ctx, n, (const char *const *)pictures, &options, film);
    for (uint32_t i = 0; pictures && i < n; i++)
        free(pictures[i]);
    free(pictures);
    return status;
}

/* The text of the marker file when the film was made from these frames. */
static void identity(uint64_t key, uint32_t n, double fps, char wanted[32])
{
    snprintf(wanted, 32, "%016" PRIx64 "\n", cn_hash_text(key, "%u %.17g", n, fps));
}

bool cn_film_done(const char *folder, uint32_t n, double fps, uint64_t key)
{
    char wanted[32], *have = NULL;
    size_t size;
    identity(key, n, fps, wanted);
    char *film = cn_path_join(folder, "flight.mp4"), *mark = cn_path_join(folder, "flight.mp4.json");
    const bool done = n < 2 ? !mark || !cn_is_render_mark(mark)
                            : film && mark && cn_file_exists(film) && cn_file_exists(mark) &&
                                  cn_file_read(mark, 64, &have, &size) == CN_OK && strcmp(have, wanted) == 0;
    free(have);
    free(film);
    free(mark);
    return done;
}

cn_status cn_film_make(const cn_context *ctx, const char *folder, uint32_t n, double fps, uint64_t key)
{
    if (cn_film_done(folder, n, fps, key)) return CN_OK;
    char wanted[32];
    identity(key, n, fps, wanted);
    char *film = cn_path_join(folder, "flight.mp4"), *mark = cn_path_join(folder, "flight.mp4.json");
    cn_status status = film && mark ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the film in %s", folder);
    if (status == CN_OK && cn_is_render_mark(mark)) status = cn_file_remove(film); /* it shows other frames */
    if (status == CN_OK) status = cn_file_remove(mark);
    if (status == CN_OK && n >= 2) {
        status = encode(ctx, folder, n, fps, film);
        if (status == CN_OK) status = cn_file_write(mark, wanted, strlen(wanted));
        if (status == CN_OK) cn_log(ctx, CN_LOG_INFO, "film: %s", film);
    }
    if (status == CN_ERR_TOOL || status == CN_ERR_DATA) {
        cn_log(ctx, CN_LOG_WARN, "no film of these frames: %s", cn_error_message());
        status = CN_OK;
    }
    free(film);
    free(mark);
    return status;
}
