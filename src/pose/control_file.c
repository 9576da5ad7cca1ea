#include "pose/control_file.h"

#include "base/file.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NAMED_AT_MOST 5
#define SAME_PLACE 1e-9 /* of the coordinate: printed twice by the same program */

/* Room for one more item. */
static cn_status grow(void **items, uint32_t n, uint32_t *room, size_t size)
{
    if (n < *room) return CN_OK;
    const uint32_t wanted = *room ? 2 * *room : 64;
    void *more = realloc(*items, wanted * size);
    if (!more) return cn_fail(CN_ERR_NOMEM, "out of memory reading control points");
    *items = more;
    *room = wanted;
    return CN_OK;
}

static bool is_same(double a, double b)
{
    return (isnan(a) && isnan(b)) || fabs(a - b) <= SAME_PLACE * fmax(1.0, fabs(a));
}

static cn_status set_place(const cn_control_file *file, cn_control_point *point, const double place[3])
{
    if (!place) return CN_OK;
    const bool known = !isnan(point->place[0]);
    for (int k = 0; k < 3 && known; k++)
        if (!is_same(point->place[k], place[k]))
            return cn_fail(CN_ERR_FORMAT, "%s: point %s has two places: %.3f %.3f %.3f and %.3f %.3f %.3f; give one",
                           file->source->path, point->name, point->place[0], point->place[1], point->place[2], place[0],
                           place[1], place[2]);
    memcpy(point->place, place, sizeof point->place);
    return CN_OK;
}

cn_status cn_control_file_point(cn_control_file *file, const char *name, const double place[3], uint32_t *point)
{
    cn_control *to = file->to;
    for (*point = 0; *point < to->n_points; ++*point)
        if (strcmp(to->points[*point].name, name) == 0) return set_place(file, &to->points[*point], place);
    CN_TRY(grow((void **)&to->points, to->n_points, &file->room_points, sizeof *to->points));
    cn_control_point fresh = { .name = strdup(name), .place = { NAN, NAN, NAN } };
    if (!fresh.name) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", file->source->path);
    to->points[to->n_points++] = fresh;
    return set_place(file, &to->points[*point], place);
}

cn_status cn_control_file_mark(cn_control_file *file, const cn_control_seen *seen)
{
    cn_control *to = file->to;
    const char *path = file->source->path, *name = to->points[seen->point].name;
    const int64_t photo = cn_photo_finder_match(&file->finder, seen->photo);
    if (photo < 0) {
        if (file->n_missing++ < NAMED_AT_MOST)
            cn_log(file->ctx, CN_LOG_WARN, "%s: photo %s is not in the collection; its marks are left out", path,
                   seen->photo);
        return CN_OK;
    }
    const cn_photo *of = &file->source->index->photos[photo];
    const bool turned = of->orientation >= 5;
    const double width = turned ? of->height : of->width, height = turned ? of->width : of->height;
    const double unit = fmax(width, height);
    double xy[2] = { seen->fractions ? seen->x * unit + 0.5 * width : seen->x + 0.5,
                     seen->fractions ? seen->y * unit + 0.5 * height : seen->y + 0.5 };
    if (!(xy[0] >= 0.0 && xy[0] <= width && xy[1] >= 0.0 && xy[1] <= height))
        return cn_fail(CN_ERR_FORMAT, "%s: point %s is marked at %g, %g, outside of photo %s of %.0f x %.0f pixels",
                       path, name, seen->x, seen->y, of->name, width, height);
    cn_photo_upright(of, xy);
    for (uint32_t i = 0; i < to->n_marks; i++)
        if (to->marks[i].point == seen->point && to->marks[i].photo == photo)
            return cn_fail(CN_ERR_FORMAT, "%s: point %s is marked twice in photo %s; remove one", path, name, of->name);
    CN_TRY(grow((void **)&to->marks, to->n_marks, &file->room_marks, sizeof *to->marks));
    to->marks[to->n_marks++] = (cn_control_mark){ seen->point, (uint32_t)photo, xy[0], xy[1] };
    to->points[seen->point].n_marks++;
    return CN_OK;
}
