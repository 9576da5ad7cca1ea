/* A light from a photo that somebody drops on the page: the file goes to a temporary folder, and what is found to
 * CITY/views/fitted. */
#include "view/desk.h"

#include "base/file.h"
#include "bridge/oiio.h"
#include "conurb/stage.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* A name must mean one light. */
static cn_status check_name(const cn_desk *k, const char *name)
{
    char *relative = cn_format("appearances/%s.json", name), *path = relative ? cn_city_path(k->city, relative) : NULL;
    const bool taken = path && cn_file_exists(path);
    free(path);
    free(relative);
    if (!taken && strcmp(name, "mean") != 0 && cn_photo_index_find(&k->dataset->photos, name) < 0) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "'%s' is the name of a photo or a light of this city; give another name", name);
}

/* A small file may hold a very large picture. */
static cn_status check_size(const char *path)
{
    cn_oiio_info info;
    CN_TRY(cn_oiio_read_info(path, &info));
    if ((uint64_t)info.width * info.height <= CN_ASK_MAX_PHOTO_PIXELS) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "the photo has %u x %u pixels, more than %d million; make it smaller", info.width,
                   info.height, CN_ASK_MAX_PHOTO_PIXELS >> 20);
}

static cn_status fit_file(const cn_desk *k, const cn_context *ctx, const char *path)
{
    const cn_ask *ask = &k->film.ask;
    cn_city *city = NULL;
    CN_TRY(cn_file_write(path, ask->bytes, ask->n_bytes));
    CN_TRY(check_size(path));
    CN_TRY(cn_city_open(&city, k->city->folder));
    const cn_status status = cn_city_appearance_fit(ctx, city, path, ask->name);
    cn_city_close(&city);
    return status;
}

cn_status cn_desk_fit(const cn_desk *k, const cn_context *ctx)
{
    const char *temporary = getenv("TMPDIR");
    const bool png = k->film.ask.bytes[0] == 0x89;
    CN_TRY(check_name(k, k->film.ask.name));
    char *folder = cn_format("%s/conurb-photo-XXXXXX", temporary && *temporary ? temporary : "/tmp"), *path = NULL;
    if (!folder) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = CN_OK;
    if (!mkdtemp(folder)) {
        status = cn_fail(CN_ERR_IO, "cannot make %s: %s; set TMPDIR to a folder that can be written", folder,
                         strerror(errno));
    } else {
        path = cn_format("%s/photo.%s", folder, png ? "png" : "jpg");
        status = path ? fit_file(k, ctx, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
        if (path) unlink(path);
        rmdir(folder);
    }
    free(path);
    free(folder);
    return status;
}
