/* The index: the photos, their EXIF, and which are damaged or duplicates. */
#include "conurb/photo.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "bridge/exiv2.h"
#include "bridge/oiio.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <time.h>

/* Files of a kind, or folders, that are not read. */
typedef struct unread {
    uint32_t n;
    char first[256];
} unread;

typedef struct names {
    char **list;
    uint32_t n, room;
    unread raw, films, cities, made;
    bool in_city; /* the root is the folder of a city */
} names;

static bool ends_with_one_of(const char *name, const char *const *endings)
{
    const char *dot = strrchr(name, '.');
    for (; dot && *endings; endings++)
        if (strcasecmp(dot, *endings) == 0) return true;
    return false;
}
static const char *const photo_endings[] = { ".jpg",  ".jpeg", ".png",  ".tif",  ".tiff", ".exr", ".heic",
                                             ".heif", ".hif",  ".avif", ".webp", ".jp2",  ".bmp", NULL };
/* Camera raw, and pictures that OpenImageIO reads badly or not at all. */
static const char *const other_endings[] = { ".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf",
                                             ".pef", ".srw", ".gpr", ".gif", ".jxl", ".psd", NULL };
static const char *const film_endings[] = { ".mp4",  ".mov", ".m4v", ".avi", ".mkv",
                                            ".webm", ".mts", ".3gp", ".360", NULL };

static cn_status add_name(names *all, char *name)
{
    if (all->n == all->room) {
        const uint32_t room = all->room ? 2 * all->room : 64;
        char **list = realloc(all->list, room * sizeof *list);
        if (!list) {
            free(name);
            return cn_fail(CN_ERR_NOMEM, "out of memory while listing photos");
        }
        all->list = list;
        all->room = room;
    }
    if (!name) return cn_fail(CN_ERR_NOMEM, "out of memory while listing photos");
    all->list[all->n++] = name;
    return CN_OK;
}

static void count_unread(unread *kind, const char *name)
{
    if (!kind->n++) snprintf(kind->first, sizeof kind->first, "%s", name);
}

/* Among the photos a city's folder would be read too, with what was rendered from them. */
static bool is_city(const char *folder)
{
    char *path = cn_path_join(folder, "city.yaml");
    const bool city = path && cn_file_exists(path);
    free(path);
    return city;
}

/* What Conurb writes into the folder of a city. */
static bool is_made(const char *folder)
{
    static const char *const made[] = { "appearances", "eval",    "export", "jobs",     "match", "plan", "poses",
                                        "probes",      "renders", "tiles",  "tradeoff", "views", NULL };
    for (int i = 0; made[i]; i++)
        if (strcmp(folder, made[i]) == 0) return true;
    return false;
}

enum { MOST_DEEP = 16 }; /* depth of nested folders at most: links can make a loop */

/* below: path of the folder relative to the root, "" at the root. */
static cn_status list_folder(const char *root, const char *below, int depth, names *all)
{
    char *path = cn_path_join(root, below);
    DIR *dir = path ? opendir(path) : NULL;
    const char *at = path ? path : root;
    cn_status status = dir ? CN_OK : cn_fail(CN_ERR_IO, "%s cannot be read; give the folder that holds the photos", at);
    for (const char *entry; status == CN_OK && (status = cn_folder_next(dir, path, &entry)) == CN_OK && entry;) {
        if (entry[0] == '.') continue;
        char *name = *below ? cn_format("%s/%s", below, entry) : cn_format("%s", entry);
        char *full = name ? cn_path_join(root, name) : NULL;
        struct stat st;
        const bool known = full && stat(full, &st) == 0, masks = depth == 0 && strcmp(entry, "masks") == 0;
        const bool folder = known && S_ISDIR(st.st_mode) && depth < MOST_DEEP && !masks;
        const bool city = folder && is_city(full), made = folder && depth == 0 && all->in_city && is_made(entry);
        if (city) count_unread(&all->cities, name);
        if (made) count_unread(&all->made, name);
        if (folder && !city && !made) status = list_folder(root, name, depth + 1, all);
        /* A photo that does not exist (a dangling link) is listed too, so that it is reported as left out. */
        const bool file = full && (!known || S_ISREG(st.st_mode));
        const bool photo = file && ends_with_one_of(entry, photo_endings);
        if (file && ends_with_one_of(entry, other_endings)) count_unread(&all->raw, name);
        if (file && ends_with_one_of(entry, film_endings)) count_unread(&all->films, name);
        if (photo && status == CN_OK)
            status = add_name(all, name);
        else
            free(name);
        if (!full) status = cn_fail(CN_ERR_NOMEM, "out of memory while listing photos");
        free(full);
    }
    free(path);
    if (dir) closedir(dir);
    return status;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* "+02:00", "-07:00" or "Z" as seconds ahead of UTC. 0 for anything else, such as the blanks of an unset clock. */
static double parse_offset(const char *text)
{
    int hours, minutes, end = 0;
    char sign;
    const bool read = sscanf(text, "%c%2d:%2d%n", &sign, &hours, &minutes, &end) == 3 && !text[end];
    if (!read || (sign != '+' && sign != '-') || hours < 0 || hours > 14 || minutes < 0 || minutes > 59) return 0;
    return (sign == '-' ? -60 : 60) * (60 * hours + minutes);
}

/* "2019:07:01 12:34:56", subseconds and the offset from UTC. NaN when it is not a date. */
static double parse_time(const char *text, const char *subsec, const char *offset)
{
    struct tm tm = { 0 };
    const int n =
        sscanf(text, "%d:%d:%d %d:%d:%d", &tm.tm_year, &tm.tm_mon, &tm.tm_mday, &tm.tm_hour, &tm.tm_min, &tm.tm_sec);
    if (n != 6 || tm.tm_year < 1826 || tm.tm_mon < 1 || tm.tm_mon > 12 || tm.tm_mday < 1 || tm.tm_mday > 31) return NAN;
    tm.tm_year -= 1900;
    tm.tm_mon -= 1;
    double fraction = 0, scale = 0.1;
    for (; *subsec >= '0' && *subsec <= '9'; subsec++, scale *= 0.1)
        fraction += (*subsec - '0') * scale;
    return (double)timegm(&tm) + fraction - parse_offset(offset);
}

/* masks/NAME.png, NAME with or without the photo's own ending. */
static char *find_mask(const char *folder, const char *name)
{
    char *with = cn_format("masks/%s.png", name);
    const char *dot = strrchr(name, '.');
    char *without = cn_format("masks/%.*s.png", (int)(dot ? dot - name : (long)strlen(name)), name);
    char *candidates[2] = { with, without }, *found = NULL;
    for (int i = 0; i < 2; i++) {
        char *full = candidates[i] && !found ? cn_path_join(folder, candidates[i]) : NULL;
        if (full && cn_file_exists(full)) found = candidates[i];
        free(full);
    }
    for (int i = 0; i < 2; i++)
        if (candidates[i] != found) free(candidates[i]);
    return found;
}

typedef struct scan {
    const char *folder;
    char **names, **reasons; /* reasons[i]: why photo i is left out, or NULL */
    cn_photo *photos;
    bool *bad_gps;
    uint32_t first; /* of the chunk being read */
    double started;
} scan;

static void take_exif(const cn_exif *exif, cn_photo *photo)
{
    photo->has_gps = exif->has_latlon;
    photo->latitude_deg = exif->has_latlon ? exif->latitude_deg : 0;
    photo->longitude_deg = exif->has_latlon ? exif->longitude_deg : 0;
    photo->has_altitude = exif->has_altitude;
    photo->altitude_m = exif->has_altitude ? exif->altitude_m : 0;
    memcpy(photo->gps_sigma_m, exif->gps_sigma_m, sizeof photo->gps_sigma_m);
    photo->time_s = parse_time(exif->datetime, exif->subsec, exif->offset);
    photo->exposure_s = exif->exposure_s;
    photo->iso = exif->iso;
    photo->f_number = exif->f_number;
    photo->focal_mm = exif->focal_mm;
    photo->focal_35mm = exif->focal_35mm;
    photo->equirectangular = strcmp(exif->projection, "equirectangular") == 0;
}

/* A pinhole camera does not describe such a photo, nor does that of all directions. */
static cn_status check_sphere(const cn_photo *photo)
{
    if (!photo->equirectangular || photo->width == 2 * photo->height) return CN_OK;
    return cn_fail(
        CN_ERR_DATA,
        "its XMP says that it is equirectangular, but %u x %u pixels are a part of the sphere; only photos of "
        "all directions, twice as wide as high, can be used",
        photo->width, photo->height);
}

static cn_status read_photo(const scan *s, const char *name, cn_photo *photo, bool *bad_gps)
{
    char *path = cn_path_join(s->folder, name);
    cn_oiio_info info;
    cn_status status = path ? cn_oiio_read_info(path, &info) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_oiio_check(path, &photo->width, &photo->height);
    /* For files that exiv2 does not read, such as EXR, use OpenImageIO's EXIF. */
    cn_exif exif = { 0 };
    if (status == CN_OK && cn_exiv2_read(path, &exif) != CN_OK) exif = info.exif;
    if (status == CN_OK) status = cn_hash_file(path, &photo->hash);
    free(path);
    CN_TRY(status);
    photo->name = strdup(name);
    photo->camera = cn_format("%s%s%s", exif.make, *exif.make && *exif.model ? " " : "", exif.model);
    photo->mask = find_mask(s->folder, name);
    if (!photo->name || !photo->camera) return cn_fail(CN_ERR_NOMEM, "out of memory");
    if (!cn_json_make_utf8(photo->name)) return cn_fail(CN_ERR_DATA, "%s: its name is not UTF-8; rename it", name);
    cn_json_make_utf8(photo->camera);
    photo->orientation = (uint8_t)info.orientation;
    photo->deep = info.is_deep;
    *bad_gps = exif.has_bad_gps;
    take_exif(&exif, photo);
    return check_sphere(photo);
}

static void scan_one(void *user, size_t i, unsigned worker)
{
    (void)worker;
    scan *s = user;
    const uint32_t at = s->first + (uint32_t)i;
    if (read_photo(s, s->names[at], &s->photos[at], &s->bad_gps[at]) != CN_OK)
        s->reasons[at] = cn_format("%s", cn_error_message());
}

static void free_photo(cn_photo *p)
{
    free(p->name);
    free(p->camera);
    free(p->mask);
    free(p->depth);
    free(p->normal);
}

static cn_status reject(cn_photo_index *index, const char *name, const char *reason)
{
    cn_photo_reject *list = realloc(index->rejects, (index->n_rejects + 1u) * sizeof *list);
    if (!list) return cn_fail(CN_ERR_NOMEM, "out of memory while listing photos");
    index->rejects = list;
    cn_photo_reject *r = &list[index->n_rejects++];
    *r = (cn_photo_reject){ strdup(name), strdup(reason) };
    if (!r->name || !r->reason) return cn_fail(CN_ERR_NOMEM, "out of memory while listing photos");
    cn_json_make_utf8(r->name);
    cn_json_make_utf8(r->reason);
    return CN_OK;
}

typedef struct hashed {
    uint64_t hash;
    uint32_t at;
} hashed;
static int by_hash(const void *a, const void *b)
{
    const hashed *x = a, *y = b;
    return x->hash != y->hash ? (x->hash < y->hash ? -1 : 1) : (x->at > y->at) - (x->at < y->at);
}

/* Marks duplicates: the first by name stays. */
static cn_status mark_duplicates(scan *s, uint32_t n)
{
    hashed *order = malloc(sizeof *order * (n + 1u));
    if (!order) return cn_fail(CN_ERR_NOMEM, "out of memory while comparing photos");
    uint32_t m = 0;
    for (uint32_t i = 0; i < n; i++)
        if (!s->reasons[i]) order[m++] = (hashed){ s->photos[i].hash, i };
    qsort(order, m, sizeof *order, by_hash);
    for (uint32_t i = 1, first = 0; i < m; i++) {
        if (order[i].hash != order[first].hash)
            first = i;
        else
            s->reasons[order[i].at] = cn_format("same bytes as %s", s->names[order[first].at]);
    }
    free(order);
    return CN_OK;
}

static void tell_gps(const cn_context *ctx, const scan *s, uint32_t n, const cn_photo_index *index)
{
    uint32_t n_bad = 0, first = 0;
    for (uint32_t i = n; i-- > 0;)
        if (s->bad_gps[i] && !s->reasons[i]) {
            n_bad++;
            first = i;
        }
    if (n_bad)
        cn_log(
            ctx, CN_LOG_WARN,
            "photos whose GPS is no place of a camera (0, 0 or not on Earth) are used without it: %u. The first is %s",
            n_bad, s->names[first]);
    if (!index->n_gps)
        cn_log(ctx, CN_LOG_WARN, "no photo has GPS: the city has no place on Earth, and its unit is not the metre");
    else if (index->n_gps < index->n_photos)
        cn_log(ctx, CN_LOG_INFO, "%u of %u photos have GPS", index->n_gps, index->n_photos);
}

static cn_status collect(const cn_context *ctx, scan *s, uint32_t n, cn_photo_index *index)
{
    index->photos = calloc(n + 1u, sizeof *index->photos);
    if (!index->photos) return cn_fail(CN_ERR_NOMEM, "out of memory while listing photos");
    for (uint32_t i = 0; i < n; i++) {
        if (s->reasons[i]) {
            cn_log(ctx, CN_LOG_WARN, "left out %s: %s", s->names[i], s->reasons[i]);
            CN_TRY(reject(index, s->names[i], s->reasons[i]));
            free_photo(&s->photos[i]);
        } else {
            index->n_gps += s->photos[i].has_gps;
            index->photos[index->n_photos++] = s->photos[i];
        }
        s->photos[i] = (cn_photo){ 0 };
    }
    if (!index->n_photos)
        return cn_fail(CN_ERR_DATA,
                       "no photos in %s: %u files tried, none is a complete JPEG, PNG, TIFF, EXR, HEIC or WebP; "
                       "give the folder that holds the photos",
                       s->folder, n);
    if (index->n_rejects) cn_log(ctx, CN_LOG_WARN, "%u of %u photos left out", index->n_rejects, n);
    tell_gps(ctx, s, n, index);
    return CN_OK;
}

static cn_status scan_all(const cn_context *ctx, scan *s, uint32_t n, cn_photo_index *index)
{
    enum { CHUNK = 16 }; /* photos between two reports */
    for (s->first = 0; s->first < n; s->first += CHUNK) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while checking photos; run the same command to resume");
        cn_pool_run(ctx ? ctx->pool : NULL, n - s->first < CHUNK ? n - s->first : CHUNK, scan_one, s);
        const double done = fmin(s->first + CHUNK, n), elapsed = cn_now_s() - s->started;
        const cn_progress_report report = { "photos", NULL, done, n, elapsed, elapsed / done * (n - done), NULL };
        cn_progress(ctx, &report);
    }
    CN_TRY(mark_duplicates(s, n));
    return collect(ctx, s, n, index);
}

static void tell_unread(const cn_context *ctx, unread *kind, const char *advice)
{
    if (!kind->n) return;
    cn_json_make_utf8(kind->first);
    cn_log(ctx, CN_LOG_WARN, "left out %s%s: %s", kind->first, kind->n > 1 ? " and others like it" : "", advice);
}

void cn_photo_own_process(void)
{
    cn_oiio_own_process();
}

cn_status cn_photo_index_scan(const cn_context *ctx, const char *folder, cn_photo_index *index)
{
    *index = (cn_photo_index){ 0 };
    if (cn_path_absolute(folder, &index->folder) != CN_OK)
        return cn_fail(CN_ERR_IO, "%s cannot be read; give the folder that holds the photos", folder);
    names all = { .in_city = is_city(index->folder) };
    scan s = { .folder = index->folder, .started = cn_now_s() };
    cn_status status = list_folder(index->folder, "", 0, &all);
    if (all.n) qsort(all.list, all.n, sizeof *all.list, by_name);
    s.names = all.list;
    s.photos = calloc(all.n + 1u, sizeof *s.photos);
    s.reasons = calloc(all.n + 1u, sizeof *s.reasons);
    s.bad_gps = calloc(all.n + 1u, sizeof *s.bad_gps);
    if (status == CN_OK && (!s.photos || !s.reasons || !s.bad_gps))
        status = cn_fail(CN_ERR_NOMEM, "out of memory while listing photos");
    tell_unread(ctx, &all.raw,
                "camera raw and such types are not read; develop them to JPEG or 16-bit TIFF, with their EXIF");
    tell_unread(ctx, &all.films, "a film; `conurb init CITY --video FILM` takes photos from one");
    tell_unread(ctx, &all.cities, "the folder of a city; what it holds is made from photos");
    if (all.made.n)
        cn_log(ctx, CN_LOG_INFO, "%s, which is the city too, is read without the folders that the city has made, as %s",
               index->folder, all.made.first);
    if (status == CN_OK) status = scan_all(ctx, &s, all.n, index);
    for (uint32_t i = 0; i < all.n; i++) {
        if (s.photos) free_photo(&s.photos[i]);
        if (s.reasons) free(s.reasons[i]);
        free(all.list[i]);
    }
    free(all.list);
    free(s.photos);
    free(s.reasons);
    free(s.bad_gps);
    if (status != CN_OK) cn_photo_index_deinit(index);
    return status;
}

void cn_photo_index_deinit(cn_photo_index *index)
{
    for (uint32_t i = 0; i < index->n_photos; i++)
        free_photo(&index->photos[i]);
    for (uint32_t i = 0; i < index->n_rejects; i++) {
        free(index->rejects[i].name);
        free(index->rejects[i].reason);
    }
    free(index->photos);
    free(index->rejects);
    free(index->folder);
    *index = (cn_photo_index){ 0 };
}

int64_t cn_photo_index_find(const cn_photo_index *index, const char *name)
{
    int64_t found = -1;
    for (uint32_t i = 0; i < index->n_photos; i++) {
        if (strcmp(index->photos[i].name, name) == 0) return i;
        if (strcmp(cn_path_base(index->photos[i].name), name) == 0) found = found == -1 ? (int64_t)i : -2;
    }
    return found < 0 ? -1 : found;
}

double cn_photo_exposure_ev(const cn_photo *photo)
{
    if (!(photo->exposure_s > 0)) return NAN;
    const double iso = photo->iso > 0 ? photo->iso : 100, f = photo->f_number > 0 ? photo->f_number : 1;
    return log2(photo->exposure_s * iso / 100 / (f * f));
}
