#include "pose/control.h"

#include "base/file.h"
#include "geo/crs.h"
#include "pose/control_file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void cn_control_deinit(cn_control *control)
{
    for (uint32_t i = 0; i < control->n_points && control->points; i++)
        free(control->points[i].name);
    free(control->points);
    free(control->marks);
    *control = (cn_control){ 0 };
}

static int by_point(const void *a, const void *b)
{
    const cn_control_mark *x = a, *y = b;
    if (x->point != y->point) return x->point < y->point ? -1 : 1;
    return (x->photo > y->photo) - (x->photo < y->photo);
}

/* Marks the names of the list as check points. CN_ERR_CONFIG: the file has no such point. */
static cn_status choose_checks(const cn_control_source *source, cn_control *control)
{
    char *list = source->check ? strdup(source->check) : NULL, *rest = NULL;
    cn_status status = CN_OK;
    if (source->check && !list) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (char *name = list ? strtok_r(list, ",", &rest) : NULL; name && status == CN_OK;
         name = strtok_r(NULL, ",", &rest)) {
        bool found = false;
        name += strspn(name, " \t");
        for (char *end = name + strlen(name); end > name && strchr(" \t", end[-1]);)
            *--end = '\0';
        for (uint32_t i = 0; i < control->n_points; i++)
            if (strcmp(control->points[i].name, name) == 0) found = control->points[i].check = true;
        if (!found && *name)
            status = cn_fail(CN_ERR_CONFIG, "poses.check: %s has no point %s; give names of its points, with commas",
                             source->path, name);
    }
    free(list);
    return status;
}

static cn_status to_wgs84(cn_control_file *file)
{
    cn_control *to = file->to;
    double(*places)[3] = calloc(to->n_points + (size_t)1, sizeof *places);
    if (!places) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < to->n_points; i++)
        memcpy(places[i], to->points[i].place, sizeof places[i]);
    cn_status status = cn_crs_to_wgs84(file->crs, file->source->sea_level ? CN_HEIGHTS_SEA_LEVEL : CN_HEIGHTS_ELLIPSOID,
                                       to->n_points, places, &to->by_egm96);
    for (uint32_t i = 0; i < to->n_points && status == CN_OK; i++)
        memcpy(to->points[i].place, places[i], sizeof places[i]);
    free(places);
    if (status != CN_ERR_DATA) return status;
    char *why = strdup(cn_error_message());
    status = cn_fail(CN_ERR_DATA, "%s: %s", file->source->path, why ? why : "PROJ cannot convert its places");
    free(why);
    return status;
}

static cn_status complete(cn_control_file *file)
{
    cn_control *to = file->to;
    const char *path = file->source->path;
    for (uint32_t i = 0; i < to->n_points; i++) {
        const double *place = to->points[i].place;
        if (!isfinite(place[0]) || !isfinite(place[1]) || isinf(place[2]))
            return cn_fail(CN_ERR_FORMAT, "%s: point %s is marked, but its place is not stated", path,
                           to->points[i].name);
    }
    if (file->n_missing)
        cn_log(file->ctx, CN_LOG_WARN, "%s: %u marks are in photos that are not in the collection", path,
               file->n_missing);
    if (!to->n_marks)
        return cn_fail(CN_ERR_DATA, "%s: none of its marks is in a photo of %s; give the file that belongs to them",
                       path, file->source->index->folder);
    qsort(to->marks, to->n_marks, sizeof *to->marks, by_point);
    CN_TRY(choose_checks(file->source, to));
    return to_wgs84(file);
}

/* JSON begins with a brace. The second line of a table names its columns; that of a list is numbers. */
static cn_status read_kind(cn_control_file *file)
{
    char *text = NULL;
    size_t size;
    CN_TRY(cn_file_read(file->source->path, 0, &text, &size));
    const char *at = text + (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0 ? 3 : 0);
    at += strspn(at, " \t\r\n");
    const bool json = *at == '{';
    while (*at && (*at == '#' || strchr("\r\n", *at)))
        at += strcspn(at, "\n") + (at[strcspn(at, "\n")] == '\n');
    const char *second = strchr(at, '\n');
    while (second && (second[1] == '#' || second[1] == '\n' || second[1] == '\r'))
        second = strchr(second + 1, '\n');
    const bool list = second && strchr("+-.0123456789", second[1 + strspn(second + 1, " \t")]);
    free(text);
    return json ? cn_control_read_json(file) : list ? cn_control_read_list(file) : cn_control_read_table(file);
}

cn_status cn_control_read(const cn_context *ctx, const cn_control_source *source, cn_control *out)
{
    cn_control_file file = { .ctx = ctx, .source = source, .to = out };
    *out = (cn_control){ 0 };
    CN_TRY(cn_photo_finder_init(&file.finder, source->index));
    cn_status status = read_kind(&file);
    if (status == CN_OK) status = complete(&file);
    cn_photo_finder_deinit(&file.finder);
    if (status != CN_OK) cn_control_deinit(out);
    return status;
}
