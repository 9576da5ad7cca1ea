/* Finds the pose of a query photo: matches its features with those of the collection in COLMAP's database, and
 * registers it in the collection's model. The collection does not change. */
#include "base/clock.h"
#include "base/file.h"
#include "base/process.h"
#include "base/units.h"
#include "math/linalg.h"
#include "pose/colmap.h"
#include "pose/colmap_options.h"
#include "pose/grouped.h"
#include "pose/pair_matcher.h"
#include "pose/scene.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { MOST_MATCHED = 60, LEAST_COMMON = 2 };
#define FIT_WITHIN                                                                                                     \
    0.1 /* tolerance between COLMAP's poses and the collection's, as a fraction of the cameras' distances */

typedef struct search {
    const cn_context *ctx;
    const cn_photo_index *index;
    cn_photo_index *query;
    const cn_scene *posed;
    const cn_pose_options *options;
    const char *photo, *work;     /* photo: the caller's path */
    char *log, *database, *found; /* database: a copy of the features; found: the model with the photo */
    char *images;                 /* the folder in which COLMAP sees the photo */
    char name[64];                /* the photo's name there */
    cn_colmap_result colmap;      /* of the collection */
    char threads[16], last[512];
    bool linked;
    const bool *core; /* of the group whose photos `index` and `posed` have; NULL: they are the collection's */
    double started_s;
} search;

static void on_line(void *user, char *line)
{
    search *s = user;
    if (line[0]) snprintf(s->last, sizeof s->last, "%s", line + strspn(line, " "));
}

/* Step k of 3. */
static cn_status run(search *s, int k, const char *what, const char *const *argv)
{
    int exit_code;
    const cn_progress_report report = { "locate", what, k, 3, cn_now_s() - s->started_s, -1, NULL };
    cn_progress(s->ctx, &report);
    const char *words[CN_JOB_WORDS];
    CN_TRY(cn_colmap_rename(s->ctx, argv, words));
    s->last[0] = '\0';
    const cn_status status = cn_process_run(s->ctx, words, s->log, on_line, s, &exit_code);
    if (status == CN_ERR_TOOL)
        return cn_fail(
            CN_ERR_TOOL,
            "cannot run %s, which finds the pose of photo %s: install the package colmap (apt-get install colmap)",
            argv[0], s->photo);
    CN_TRY(status);
    return exit_code ? cn_fail(CN_ERR_TOOL, "COLMAP failed at the %s of photo %s: %s (exit code %d)", what, s->photo,
                               s->last, exit_code)
                     : CN_OK;
}

static cn_status copy(const char *from, const char *to)
{
    enum { CHUNK = 1 << 20 };
    char *buffer = malloc(CHUNK);
    FILE *in = fopen(from, "rb"), *out = fopen(to, "wb");
    cn_status status = !buffer ? cn_fail(CN_ERR_NOMEM, "out of memory") : CN_OK;
    if (status == CN_OK && !in) status = cn_fail(CN_ERR_IO, "cannot read %s: %s", from, strerror(errno));
    if (status == CN_OK && !out) status = cn_fail(CN_ERR_IO, "cannot write %s: %s", to, strerror(errno));
    for (size_t n; status == CN_OK && (n = fread(buffer, 1, CHUNK, in)) > 0;)
        if (fwrite(buffer, 1, n, out) != n) status = cn_fail(CN_ERR_IO, "cannot write %s: %s", to, strerror(errno));
    if (status == CN_OK && ferror(in)) status = cn_fail(CN_ERR_IO, "cannot read %s: %s", from, strerror(errno));
    if (out && fclose(out) != 0 && status == CN_OK)
        status = cn_fail(CN_ERR_IO, "cannot write %s: %s", to, strerror(errno));
    if (in) fclose(in);
    free(buffer);
    return status;
}

static cn_status extract(search *s)
{
    char size[16], features[16];
    snprintf(size, sizeof size, "%u", s->options->max_image_px);
    snprintf(features, sizeof features, "%u", s->options->max_features);
    const char *const argv[] = { s->options->colmap,
                                 "feature_extractor",
                                 "--database_path",
                                 s->database,
                                 "--image_path",
                                 s->images,
                                 "--ImageReader.camera_model",
                                 "SIMPLE_RADIAL",
                                 "--SiftExtraction.use_gpu",
                                 "0",
                                 "--SiftExtraction.num_threads",
                                 s->threads,
                                 "--SiftExtraction.max_image_size",
                                 size,
                                 "--SiftExtraction.max_num_features",
                                 features,
                                 NULL };
    return run(s, 0, "features", argv);
}

#define FARTHEST_DEG 360.0 /* as good as that are photos whose place is not known */
typedef struct candidate {
    double far;
    uint32_t photo;
} candidate;
static int by_distance(const void *a, const void *b)
{
    const candidate *x = a, *y = b;
    return x->far != y->far ? (x->far < y->far ? -1 : 1) : (x->photo > y->photo) - (x->photo < y->photo);
}

/* Whether the query photo and more than half of the posed photos have GPS. */
static bool has_places(const search *s)
{
    uint64_t n = 0;
    for (uint32_t i = 0; i < s->posed->n_views; i++)
        n += s->index->photos[s->posed->views[i].photo].has_gps;
    return s->query->photos[0].has_gps && 2 * n > s->posed->n_views;
}

/* The posed photos to match with, best first: the nearest by GPS, then those without it; where too few have GPS, all
 * evenly spaced in the order of names. */
static uint32_t choose(const search *s, candidate *out)
{
    const cn_photo *query = &s->query->photos[0];
    const uint32_t n = s->posed->n_views;
    const bool by_gps = has_places(s);
    for (uint32_t i = 0; i < n; i++) {
        const cn_photo *p = &s->index->photos[s->posed->views[i].photo];
        const double spread = (double)((uint64_t)i * MOST_MATCHED % n);
        /* The shorter way round: 179.9 degrees east and 179.9 degrees west are near. */
        const double turn_deg = remainder(p->longitude_deg - query->longitude_deg, 360);
        const double east = turn_deg * cos(cn_radians(query->latitude_deg));
        const double far_deg = hypot(east, p->latitude_deg - query->latitude_deg);
        out[i] = (candidate){ !by_gps      ? spread
                              : p->has_gps ? far_deg
                                           : FARTHEST_DEG + spread,
                              s->posed->views[i].photo };
    }
    qsort(out, n, sizeof *out, by_distance);
    return n < MOST_MATCHED ? n : MOST_MATCHED;
}

/* Matches the query photo here, so that COLMAP only verifies. */
static cn_status match_exactly(const search *s, const candidate *with, uint32_t n)
{
    const cn_context silent = { .pool = s->ctx ? s->ctx->pool : NULL, .stop = s->ctx ? s->ctx->stop : NULL };
    cn_photo *photos = calloc(n + (size_t)1, sizeof *photos);
    const cn_photo_index index = { .photos = photos, .n_photos = n + 1 };
    cn_colmap_job job = { .ctx = &silent, .index = &index, .database = s->database };
    cn_photo_pairs pairs = { 0 };
    char job_name[sizeof s->name];
    memcpy(job_name, s->name, sizeof job_name);
    bool fine = photos != NULL;
    if (fine) photos[0].name = job_name;
    for (uint32_t i = 0; i < n && fine; i++) {
        photos[i + 1].name = cn_colmap_name(s->index, s->linked, with[i].photo);
        fine = photos[i + 1].name && cn_photo_pairs_add(&pairs, 0, i + 1);
    }
    cn_job_begin(&job, "matches", n);
    const cn_status status =
        fine ? cn_pairs_match(&job, &pairs) : cn_fail(CN_ERR_NOMEM, "out of memory listing photos");
    for (uint32_t i = 0; photos && i < n; i++)
        free(photos[i + 1].name);
    free(photos);
    cn_photo_pairs_deinit(&pairs);
    return status;
}

static cn_status match(search *s)
{
    char *text = NULL, *path = cn_path_join(s->work, "pairs.txt");
    size_t size = 0;
    candidate *with = calloc(s->posed->n_views, sizeof *with);
    FILE *stream = open_memstream(&text, &size);
    bool fine = path && with && stream;
    const uint32_t n = fine ? choose(s, with) : 0;
    for (uint32_t i = 0; i < n && fine; i++) {
        char *name = cn_colmap_name(s->index, s->linked, with[i].photo);
        fine = name && fprintf(stream, "%s %s\n", s->name, name) > 0;
        free(name);
    }
    if (stream && fclose(stream) != 0) fine = false;
    cn_status status = fine ? cn_file_write(path, text, size) : cn_fail(CN_ERR_NOMEM, "out of memory listing photos");
    const char *const argv[] = { s->options->colmap,
                                 "matches_importer",
                                 "--database_path",
                                 s->database,
                                 "--match_list_path",
                                 path,
                                 "--match_type",
                                 "pairs",
                                 "--SiftMatching.use_gpu",
                                 "0",
                                 "--SiftMatching.num_threads",
                                 s->threads,
                                 NULL };
    if (status == CN_OK && s->options->match_with == CN_MATCH_WITH_CONURB) status = match_exactly(s, with, n);
    if (status == CN_OK) status = run(s, 1, "matches", argv);
    free(with);
    free(text);
    free(path);
    return status;
}

static cn_status register_photo(search *s)
{
    CN_TRY(cn_folder_make(s->found));
    const char *const argv[] = {
        s->options->colmap, "image_registrator", "--database_path", s->database, "--input_path",
        s->colmap.model,    "--output_path",     s->found,          NULL
    };
    return run(s, 2, "pose", argv);
}

/* The index of the photo alone, with orientation applied. */
static cn_status take_query(const search *s, cn_scene *out)
{
    uint32_t n_lost;
    CN_TRY(cn_scene_read_colmap(out, s->found));
    for (uint32_t i = 0; i < out->n_views; i++) {
        cn_view *view = &out->views[i];
        if (strcmp(view->name, s->name) != 0) continue;
        free(view->name);
        view->name = strdup(s->query->photos[0].name);
        if (!view->name) return cn_fail(CN_ERR_NOMEM, "out of memory for photo names");
    }
    CN_TRY(cn_scene_sort_views(out));
    CN_TRY(cn_scene_tie(out, s->query, &n_lost));
    bool *keep = calloc(out->n_views + (size_t)1, 1);
    if (!keep) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < out->n_views; i++)
        keep[i] = out->views[i].photo == 0;
    cn_status status = cn_scene_fit_photos(s->ctx, out, s->query, true, keep);
    if (status == CN_OK) status = cn_scene_keep_views(out, keep);
    free(keep);
    if (status != CN_OK || out->n_views) return status;
    return cn_fail(CN_ERR_DATA,
                   "no pose is found for photo %s: it overlaps too little with the photos of the collection", s->photo);
}

/* The collection's views in COLMAP's model, with their photos and with orientation applied. */
static cn_status take_rest(const search *s, cn_scene *rest)
{
    uint32_t n_lost;
    CN_TRY(cn_scene_read_colmap(rest, s->colmap.model));
    if (s->linked) CN_TRY(cn_colmap_restore_names(rest, s->index));
    CN_TRY(cn_scene_tie(rest, s->index, &n_lost));
    bool *keep = calloc(rest->n_views + (size_t)1, 1);
    if (!keep) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < rest->n_views; i++)
        keep[i] = rest->views[i].photo != UINT32_MAX;
    cn_status status = cn_scene_fit_photos(s->ctx, rest, s->index, true, keep);
    if (status == CN_OK) status = cn_scene_keep_views(rest, keep);
    free(keep);
    return status;
}

/* A camera as three points, which also give its rotation: its centre, and points at distance `far` ahead and below. */
static void landmarks(const cn_view *view, double far, double (*out)[3])
{
    cn_view_centre(view, out[0]);
    for (int a = 0; a < 3; a++) {
        out[1][a] = out[0][a] + far * view->rotation[6 + a];
        out[2][a] = out[0][a] + far * view->rotation[3 + a];
    }
}

/* Median distance of successive cameras in the list. */
static double typical_distance(uint32_t n, const cn_view *const *views, double *room)
{
    for (uint32_t i = 0; i + 1 < n; i++) {
        double a[3], b[3];
        cn_view_centre(views[i], a);
        cn_view_centre(views[i + 1], b);
        room[i] = cn_distance3(a, b);
    }
    return cn_select(room, n - 1, (n - 1) / 2);
}

typedef struct pairs {
    const cn_view **theirs, **ours;
    double (*source)[3], (*target)[3], *room;
    uint32_t n;
} pairs;

static cn_status fit_pairs(const search *s, pairs *p, const cn_scene *rest, cn_scene *out)
{
    cn_similarity similarity;
    for (uint32_t i = 0, j = 0; i < rest->n_views; i++) {
        while (j < s->posed->n_views && strcmp(s->posed->views[j].name, rest->views[i].name) < 0)
            j++;
        if (j == s->posed->n_views || strcmp(s->posed->views[j].name, rest->views[i].name) != 0) continue;
        p->theirs[p->n] = &rest->views[i];
        p->ours[p->n++] = &s->posed->views[j];
    }
    cn_status status = p->n >= LEAST_COMMON ? CN_OK : CN_ERR_DATA;
    if (status == CN_OK) {
        const double from = typical_distance(p->n, p->theirs, p->room), to = typical_distance(p->n, p->ours, p->room);
        for (uint32_t i = 0; i < p->n; i++) {
            landmarks(p->theirs[i], from, p->source + 3 * (size_t)i);
            landmarks(p->ours[i], to, p->target + 3 * (size_t)i);
        }
        status =
            cn_pose_fit_similarity(&(cn_similarity_task){ 3 * p->n, (const double(*)[3])p->source,
                                                          (const double(*)[3])p->target, FIT_WITHIN * to, 1, 1, NULL },
                                   &similarity, NULL);
    }
    if (status == CN_ERR_DATA)
        return cn_fail(CN_ERR_DATA, "photo %s: COLMAP's poses of the collection do not agree with those of the city",
                       s->photo);
    if (status == CN_OK) cn_scene_transform(out, similarity.scale, similarity.rotation, similarity.translation);
    return status;
}

/* The transform from COLMAP's frame to the city's. */
static cn_status move(const search *s, const cn_scene *rest, cn_scene *out)
{
    const size_t n = rest->n_views + (size_t)1;
    pairs p = { .theirs = calloc(n, sizeof *p.theirs),
                .ours = calloc(n, sizeof *p.ours),
                .source = calloc(3 * n, sizeof *p.source),
                .target = calloc(3 * n, sizeof *p.target),
                .room = calloc(n, sizeof *p.room) };
    const bool room = p.theirs && p.ours && p.source && p.target && p.room;
    const cn_status status = room ? fit_pairs(s, &p, rest, out) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(p.theirs);
    free(p.ours);
    free(p.source);
    free(p.target);
    free(p.room);
    return status;
}

static cn_status locate(search *s, cn_scene *out)
{
    cn_scene rest = { 0 };
    CN_TRY(copy(s->colmap.database, s->database));
    CN_TRY(extract(s));
    CN_TRY(match(s));
    CN_TRY(register_photo(s));
    CN_TRY(take_query(s, out));
    cn_status status = take_rest(s, &rest);
    if (status == CN_OK) status = move(s, &rest, out);
    cn_scene_deinit(&rest);
    return status;
}

/* ---- A group of the collection ---- */

/* Where photos were posed in groups, COLMAP has a database and a model of each group, not of all. */
typedef struct group {
    cn_photo_groups all;
    cn_photo_index index;
    cn_scene posed; /* views of the collection's scene; their names are borrowed */
    bool *core;
    char *dir;
} group;

static void group_deinit(group *g)
{
    cn_photo_groups_deinit(&g->all);
    free(g->index.photos);
    free(g->posed.views);
    free(g->core);
    free(g->dir);
}

static bool has_model(const char *dir, uint32_t number)
{
    char *path = cn_group_path(dir, number, "model/images.bin");
    const bool found = path && cn_file_exists(path);
    free(path);
    return found;
}

/* The group with a model that has the most of the nearest photos; UINT32_MAX: none has one of them. near: room for a
 * mark of each photo. */
static uint32_t nearest_group(const search *s, const char *dir, const cn_photo_groups *all, candidate *list, bool *near)
{
    const uint32_t n_near = choose(s, list);
    uint32_t best = UINT32_MAX, most = 0;
    for (uint32_t i = 0; i < n_near; i++)
        near[list[i].photo] = true;
    for (uint32_t g = 0; g < all->n; g++) {
        uint32_t n = 0;
        for (uint32_t i = 0; i < all->groups[g].n; i++)
            n += near[all->groups[g].photos[i]];
        if (n <= most || !has_model(dir, g)) continue;
        best = g;
        most = n;
    }
    return best;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(((const cn_photo *)a)->name, ((const cn_photo *)b)->name);
}

/* The collection's views of the group's photos. */
static cn_status pick_views(const search *s, group *g)
{
    g->posed = *s->posed;
    g->posed.n_views = 0;
    g->posed.views = malloc((s->posed->n_views + (size_t)1) * sizeof *g->posed.views);
    if (!g->posed.views) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < s->posed->n_views; i++) {
        const cn_photo *photo = bsearch(&s->index->photos[s->posed->views[i].photo], g->index.photos, g->index.n_photos,
                                        sizeof *photo, by_name);
        if (!photo) continue;
        cn_view *view = &g->posed.views[g->posed.n_views++];
        *view = s->posed->views[i];
        view->photo = (uint32_t)(photo - g->index.photos);
    }
    return CN_OK;
}

static cn_status find_group(const search *s, const char *dir, group *g, uint32_t *number)
{
    if (!has_places(s))
        return cn_fail(
            CN_ERR_DATA,
            "%s: the collection was posed in groups, and GPS, of the photo and of most of the collection, has "
            "to tell which one the photo belongs to; give a photo with GPS, or add it to the collection",
            s->photo);
    char *path = cn_group_list(dir);
    candidate *list = calloc(s->posed->n_views + (size_t)1, sizeof *list);
    bool *near = calloc(s->index->n_photos + (size_t)1, sizeof *near);
    cn_status status = path && list && near ? cn_photo_groups_load(&g->all, NULL, s->index->n_photos, path)
                                            : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        *number = nearest_group(s, dir, &g->all, list, near);
        if (*number == UINT32_MAX)
            status =
                cn_fail(CN_ERR_DATA, "%s: no group of photos near it has a model; run conurb poses again", s->photo);
    }
    free(path);
    free(list);
    free(near);
    return status;
}

/* Goes on with the photos of the nearest group alone, which *g has. */
static cn_status enter_group(search *s, const char *dir, group *g)
{
    uint32_t number;
    CN_TRY(find_group(s, dir, g, &number));
    CN_TRY(cn_group_index(s->index, &g->all.groups[number], &g->index));
    g->core = cn_group_core(s->index, &g->all.groups[number], &g->index);
    g->dir = cn_group_path(dir, number, NULL);
    if (!g->core || !g->dir) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(pick_views(s, g));
    s->index = &g->index;
    s->posed = &g->posed;
    s->core = g->core;
    s->linked = cn_colmap_needs_links(s->index);
    return CN_OK;
}

/* COLMAP's results for the collection or the group: those of the poses stage or, for imported poses, made now and kept.
 */
static cn_status prepare(search *s, const char *dir)
{
    if (s->options->import)
        cn_log(s->ctx, CN_LOG_INFO,
               "the poses were imported: to find the pose of another photo, COLMAP first processes the collection "
               "(kept in %s)",
               dir);
    CN_TRY(cn_folder_make(dir));
    const cn_colmap_task task = { .ctx = s->ctx,
                                  .index = s->index,
                                  .dir = dir,
                                  .options = s->options,
                                  .fix_focal = s->options->refine_focal == CN_OFF,
                                  .core = s->core,
                                  .colmaps_global = s->core != NULL };
    return cn_colmap_poses(&task, &s->colmap);
}

/* COLMAP has no camera for a photo of all directions, and a model with such photos is not one that it could extend. */
static cn_status refuse_spheres(const search *s)
{
    for (uint32_t i = 0; i < s->posed->n_cameras; i++)
        if (s->posed->cameras[i].lens == CN_LENS_EQUIRECTANGULAR)
            return cn_fail(CN_ERR_DATA,
                           "%s: no pose can be found among 360 degree photos; add the photo to the collection and run "
                           "`conurb poses` again",
                           s->photo);
    if (s->query->photos[0].equirectangular)
        return cn_fail(CN_ERR_DATA, "%s is a 360 degree photo; give a photo of an ordinary camera", s->photo);
    return CN_OK;
}

/* The folder with the photo alone, or one with a copy that COLMAP can read. */
static cn_status show_colmap(search *s)
{
    const bool reads = cn_colmap_reads(&s->query->photos[0]);
    snprintf(s->name, sizeof s->name, "%s", reads ? s->query->photos[0].name : "conurb-query.jpg");
    s->images = reads ? strdup(s->query->folder) : cn_path_join(s->work, "copy");
    char *copied = s->images ? cn_path_join(s->images, s->name) : NULL;
    cn_status status = copied ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !reads) status = cn_folder_make(s->images);
    if (status == CN_OK && !reads) status = cn_colmap_copy(s->query, 0, copied);
    free(copied);
    return status;
}

/* A folder with only this photo, under a name that works in COLMAP's lists and is unique. */
static cn_status show(search *s)
{
    char *folder = cn_path_join(s->work, "photo"), *target = NULL;
    const char *extension = strrchr(cn_path_base(s->photo), '.');
    char *link = cn_format("%s/photo/conurb-query%s", s->work,
                           extension && !strpbrk(extension, " \t\r\n\v\f") ? extension : ".jpg");
    cn_status status = folder && link ? cn_folder_make(folder) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_path_absolute(s->photo, &target);
    if (status == CN_OK && symlink(target, link) != 0)
        status = cn_fail(CN_ERR_IO, "%s: cannot make a link: %s", link, strerror(errno));
    if (status == CN_OK) {
        const cn_context silent = { .pool = s->ctx ? s->ctx->pool : NULL,
                                    .stop =
                                        s->ctx ? s->ctx->stop : NULL }; /* no log: its messages are about collections */
        status = cn_photo_index_scan(&silent, folder, s->query);
        if (status == CN_ERR_DATA)
            status = cn_fail(CN_ERR_DATA, "%s cannot be read as a photo; give a complete JPEG, HEIC, PNG, TIFF or EXR",
                             s->photo);
    }
    if (status == CN_OK) status = show_colmap(s);
    free(folder);
    free(link);
    free(target);
    return status;
}

cn_status cn_pose_locate(const cn_context *ctx, const cn_pose_collection *collection, const char *photo,
                         const char *work, cn_photo_index *query, cn_scene *out)
{
    const char *dir = collection->dir;
    search s = { .ctx = ctx,
                 .index = collection->index,
                 .query = query,
                 .posed = collection->scene,
                 .options = collection->options,
                 .photo = photo,
                 .work = work,
                 .linked = cn_colmap_needs_links(collection->index),
                 .started_s = cn_now_s() };
    memset(out, 0, sizeof *out);
    memset(query, 0, sizeof *query);
    snprintf(s.threads, sizeof s.threads, "%u", cn_pool_threads(ctx ? ctx->pool : NULL));
    char *colmap = collection->options->import ? cn_path_join(dir, "colmap") : strdup(dir);
    s.log = cn_path_join(work, "colmap.log");
    s.database = cn_path_join(work, "database.db");
    s.found = cn_path_join(work, "found");
    cn_status status = colmap && s.log && s.database && s.found ? show(&s) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = refuse_spheres(&s);
    group nearest = { 0 };
    if (status == CN_OK && cn_pose_is_grouped(s.index, s.options)) status = enter_group(&s, dir, &nearest);
    if (status == CN_OK) status = prepare(&s, nearest.dir ? nearest.dir : colmap);
    if (status == CN_OK) status = locate(&s, out);
    if (status != CN_OK) {
        cn_scene_deinit(out);
        cn_photo_index_deinit(query);
    }
    group_deinit(&nearest);
    free(colmap);
    free(s.log);
    free(s.database);
    cn_colmap_result_deinit(&s.colmap);
    free(s.found);
    free(s.images);
    return status;
}
