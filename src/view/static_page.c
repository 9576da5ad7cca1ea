/* A static page that needs no server: `conurb export --page`. */
#include "base/file.h"
#include "base/json.h"
#include "conurb/stage.h"
#include "conurb/view.h"
#include "renderer/renderer.h"
#include "view/live_page.h"
#include "view/pages.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { STILLS = 6, STILL_WIDTH = 640, SHEET_WIDTH = 160, MAX_FILM = 1 << 30 };

typedef struct static_page {
    const cn_context *ctx;
    cn_city *city;
    const char *dir;
    bool live;
    cn_writer out; /* index.html */
} static_page;

/* Text as HTML. */
static void put(const static_page *p, const char *text)
{
    for (const char *c = text; *c; c++) {
        const char *entity = *c == '<'   ? "&lt;"
                             : *c == '>' ? "&gt;"
                             : *c == '&' ? "&amp;"
                             : *c == '"' ? "&quot;"
                                         : NULL;
        if (entity)
            fputs(entity, p->out.stream);
        else
            fputc(*c, p->out.stream);
    }
}

static cn_status write_file(const static_page *p, const char *name, const void *bytes, size_t size)
{
    char *path = cn_path_join(p->dir, name);
    const cn_status status = path ? cn_file_write(path, bytes, size) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

/* *there: whether the city has the file. */
static cn_status copy_file(const static_page *p, const char *from, const char *to, bool *there)
{
    char *path = cn_city_path(p->city, from), *bytes = NULL;
    size_t size;
    *there = path && cn_file_exists(path);
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (*there) status = cn_file_read(path, MAX_FILM, &bytes, &size);
    if (*there && status == CN_OK) status = write_file(p, to, bytes, size);
    free(path);
    free(bytes);
    return status;
}

/* ---- stills: views of photos, evenly over the collection ---- */

static cn_status put_still(const static_page *p, cn_renderer *renderer, uint32_t number, const cn_view *view)
{
    const cn_camera *own = &renderer->dataset->scene.cameras[view->camera];
    cn_render_request q = { .view = *view, .passes = CN_PASS_FULL, .encoding = CN_ENCODING_JPEG };
    const uint32_t height = (uint32_t)fmax(1, round((double)own->height * STILL_WIDTH / own->width));
    cn_camera_resize(own, STILL_WIDTH, height, &q.camera);
    cn_render_job *job;
    cn_render_result result;
    char name[32];
    snprintf(name, sizeof name, "still-%u.jpg", (unsigned)number);
    CN_TRY(cn_renderer_submit(renderer, &q, &job));
    cn_status status = cn_renderer_wait(job, p->ctx, &result);
    if (status == CN_OK) status = write_file(p, name, result.encoded, result.encoded_size);
    cn_renderer_release(&job);
    if (status != CN_OK) return status;
    fprintf(p->out.stream, "<figure><img src=\"%s\" alt=\"Render of the view of ", name);
    put(p, view->name);
    fputs("\"><figcaption>", p->out.stream);
    put(p, view->name);
    fputs("</figcaption></figure>\n", p->out.stream);
    return CN_OK;
}

static cn_status put_stills(const static_page *p)
{
    cn_renderer *renderer;
    CN_TRY(cn_renderer_create(&renderer, p->ctx, p->city, true));
    const cn_scene *scene = &renderer->dataset->scene;
    const uint32_t n = scene->n_views < STILLS ? scene->n_views : STILLS;
    cn_status status = CN_OK;
    fputs("<h2>Views</h2>\n<div class=\"stills\">\n", p->out.stream);
    for (uint32_t i = 0; i < n && status == CN_OK; i++) {
        status = put_still(p, renderer, i + 1, &scene->views[(uint64_t)i * scene->n_views / n]);
        cn_progress(p->ctx, &(cn_progress_report){ .stage = "page", .done = i + 1, .total = n, .left_s = -1 });
    }
    fputs("</div>\n", p->out.stream);
    cn_renderer_destroy(&renderer);
    return status;
}

/* ---- what the city has already ---- */

static cn_status put_films(const static_page *p)
{
    char *folder = cn_city_path(p->city, "renders");
    DIR *dir = folder ? opendir(folder) : NULL;
    const char *name = NULL;
    cn_status status = CN_OK;
    while (dir && status == CN_OK && (status = cn_folder_next(dir, folder, &name)) == CN_OK && name) {
        char *from = cn_format("renders/%s/flight.mp4", name), *to = cn_format("%s.mp4", name);
        bool there = false;
        status = from && to ? copy_file(p, from, to, &there) : cn_fail(CN_ERR_NOMEM, "out of memory");
        if (there && status == CN_OK) {
            fputs("<h2>Film: ", p->out.stream);
            put(p, name);
            fputs("</h2>\n<video controls loop muted playsinline src=\"", p->out.stream);
            put(p, to);
            fputs("\"></video>\n", p->out.stream);
        }
        free(from);
        free(to);
    }
    if (dir) closedir(dir);
    free(folder);
    return status;
}

static void put_score(const static_page *p, const json_t *photo)
{
    const json_t *name = json_object_get(photo, "name"), *psnr = json_object_get(photo, "psnr");
    const json_t *ssim = json_object_get(photo, "ssim");
    fputs("<tr><td>", p->out.stream);
    put(p, json_is_string(name) ? json_string_value(name) : "all");
    fprintf(p->out.stream, "</td><td>%.2f</td><td>%.3f</td></tr>\n", json_number_value(psnr), json_number_value(ssim));
}

static cn_status put_scores(const static_page *p)
{
    char *path = cn_city_path(p->city, "eval/eval.json");
    json_t *root = NULL;
    size_t i;
    json_t *photo;
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status status = cn_file_exists(path) ? cn_json_load(path, &root) : CN_OK;
    free(path);
    if (status != CN_OK || !root) return status;
    fputs("<h2>Scores on photos that training never saw</h2>\n<table><tr><th>Photo</th><th>PSNR, dB</th><th>SSIM</th>"
          "</tr>\n",
          p->out.stream);
    put_score(p, root);
    json_array_foreach(json_object_get(root, "photos"), i, photo) put_score(p, photo);
    fputs("</table>\n", p->out.stream);
    json_decref(root);
    return CN_OK;
}

static cn_status put_plan(const static_page *p)
{
    bool there;
    CN_TRY(copy_file(p, "plan/plan.svg", "plan.svg", &there));
    if (there) fputs("<h2>Plan</h2>\n<img class=\"plan\" src=\"plan.svg\" alt=\"Plan of the tiles\">\n", p->out.stream);
    return CN_OK;
}

static cn_status put_lights(const static_page *p)
{
    char *path = cn_path_join(p->dir, "lights.png");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status status = cn_city_appearance_sheet(p->ctx, p->city, NULL, SHEET_WIDTH, path);
    free(path);
    if (status == CN_OK)
        fputs("<h2>Lights</h2>\n<img src=\"lights.png\" alt=\"One view under the light of each photo\">\n",
              p->out.stream);
    return status;
}

static cn_status put_all(const static_page *p)
{
    char *absolute = NULL;
    CN_TRY(cn_path_absolute(p->city->folder, &absolute));
    const char *name = cn_path_base(absolute);
    fputs("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
          "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
          "<meta name=\"color-scheme\" content=\"light dark\">\n<title>",
          p->out.stream);
    put(p, name);
    fputs("</title>\n<link rel=\"stylesheet\" href=\"still.css\"></head><body>\n<h1>", p->out.stream);
    put(p, name);
    fputs("</h1>\n", p->out.stream);
    free(absolute);
    if (p->live)
        fputs("<h2>In 3D</h2>\n<iframe src=\"live.html\" title=\"The city in 3D\" allowfullscreen></iframe>\n"
              "<p><a href=\"live.html\">In the whole window</a></p>\n",
              p->out.stream);
    if (!p->live) CN_TRY(put_stills(p));
    CN_TRY(put_films(p));
    CN_TRY(put_plan(p));
    if (!p->live) CN_TRY(put_lights(p));
    CN_TRY(put_scores(p));
    fprintf(p->out.stream, "<p>Made by Conurb %s.</p>\n</body></html>\n", cn_version());
    return CN_OK;
}

cn_status cn_viewer_export(const cn_context *ctx, cn_city *city, const cn_viewer_page *page)
{
    static_page p = { .ctx = ctx, .city = city, .dir = page->dir, .live = page->live };
    const cn_page *style = cn_page_find("/still.css");
    if (page->live) CN_TRY(cn_live_page_write(ctx, city, page));
    CN_TRY(cn_folder_make(p.dir));
    CN_TRY(write_file(&p, "still.css", style->text, strlen(style->text)));
    char *path = cn_path_join(p.dir, "index.html");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = cn_writer_open(&p.out, path);
    if (status == CN_OK) {
        status = put_all(&p);
        if (status == CN_OK) status = cn_writer_commit(&p.out);
        cn_writer_abort(&p.out);
    }
    if (status == CN_OK) cn_log(ctx, CN_LOG_INFO, "page: %s", path);
    free(path);
    return status;
}
