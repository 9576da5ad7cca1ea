/* Reads the bundle.out of Bundler (Snavely et al. 2006, "Photo tourism"), which VisualSfM, OpenMVG and COLMAP write
 * too, with the list of its photos beside it. Cameras look along -z with y up; lengths in pictures are pixels from the
 * centre. Poses are for the stored pixels. */
#include "base/file.h"
#include "pose/import_lines.h"
#include "pose/importer.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

enum { LINES_A_PHOTO = 5, LINES_A_POINT = 3 };

typedef struct source {
    cn_importer *to;
    cn_import_lines text, list;
} source;

/* x.bundle.out has x.list.txt, as COLMAP names them; else list.txt in the same folder, or in the one around it.
 * *list: the caller frees it. */
static cn_status find_list(const char *path, const char *folder, char **list)
{
    static const char ENDING[] = "bundle.out";
    const size_t n = strlen(path), m = sizeof ENDING - 1;
    const int stem = n > m && strcmp(path + n - m, ENDING) == 0 ? (int)(n - m) : 0;
    for (int k = 0; k < 3; k++) {
        *list = k == 0   ? cn_format("%.*slist.txt", stem, path)
                : k == 1 ? cn_path_join(folder, "list.txt")
                         : cn_path_join(folder, "../list.txt");
        if (!*list) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
        if ((k || stem) && cn_file_exists(*list)) return CN_OK;
        free(*list);
        *list = NULL;
    }
    return cn_fail(CN_ERR_FORMAT, "%s: the list of its photos is missing; put list.txt beside it", path);
}

cn_status cn_import_bundler_list(const char *path, char **list)
{
    char *folder;
    *list = NULL;
    CN_TRY(cn_path_absolute(path, &folder));
    *strrchr(folder, '/') = '\0';
    const cn_status status = find_list(path, folder, list);
    free(folder);
    return status;
}

/* Bundler's lists have up to two numbers after a name: 0, and a focal length. Cuts them off. */
static void cut_numbers(char *line)
{
    for (int k = 0; k < 2; k++) {
        char *blank = strrchr(line, ' ');
        if (!blank || blank == line || blank[1 + strspn(blank + 1, "0123456789.e+-")]) return;
        while (blank > line && isspace((unsigned char)blank[-1]))
            blank--;
        *blank = '\0';
    }
}

static cn_status read_pose(const source *from, size_t i, cn_view *view)
{
    const cn_import_numbers place = { .what = "three numbers of a translation", .out = view->translation, .n = 3 };
    for (size_t row = 0; row < 3; row++) {
        const cn_import_numbers turn = { .what = "three numbers of a rotation",
                                         .out = view->rotation + 3 * row,
                                         .n = 3 };
        CN_TRY(cn_import_lines_numbers(&from->text, i + row, &turn));
    }
    CN_TRY(cn_import_lines_numbers(&from->text, i + 3, &place));
    for (int k = 3; k < 9; k++)
        view->rotation[k] = -view->rotation[k];
    view->translation[1] = -view->translation[1];
    view->translation[2] = -view->translation[2];
    return cn_import_rotation(view->rotation) ? CN_OK : cn_import_lines_fault(&from->text, i, "a rotation");
}

static cn_status read_photo(source *from, size_t k)
{
    const size_t i = 1 + LINES_A_PHOTO * k;
    double lens_numbers[3];
    char who[512];
    int64_t photo;
    cn_view view = { 0 };
    const cn_import_numbers numbers = { .what = "a focal length and two radial terms", .out = lens_numbers, .n = 3 };
    CN_TRY(cn_import_lines_numbers(&from->text, i, &numbers));
    if (lens_numbers[0] == 0.0) return CN_OK; /* a photo without a pose */
    CN_TRY(read_pose(from, i + 1, &view));
    cut_numbers(from->list.lines[k]);
    cn_importer_find(from->to, from->list.lines[k], &photo);
    if (photo < 0) return CN_OK;
    const cn_photo *of = &from->to->index->photos[photo];
    const bool turned = of->orientation >= 5;
    cn_camera camera = { .width = turned ? of->height : of->width, .height = turned ? of->width : of->height };
    const cn_import_lens lens = { .fx = lens_numbers[0],
                                  .fy = lens_numbers[0],
                                  .cx = 0.5 * camera.width,
                                  .cy = 0.5 * camera.height,
                                  .k = { lens_numbers[1], lens_numbers[2] } };
    cn_importer_who(of, who, sizeof who);
    CN_TRY(cn_importer_lens(from->to, &lens, who, &camera));
    return cn_importer_add(from->to, photo, &camera, &view);
}

static cn_status read_photos(source *from)
{
    double counts[2];
    const cn_import_numbers numbers = { .what = "the numbers of photos and points", .out = counts, .n = 2 };
    CN_TRY(cn_import_lines_numbers(&from->text, 0, &numbers));
    if (!(counts[0] >= 1.0 && counts[1] >= 0.0)) return cn_import_lines_fault(&from->text, 0, numbers.what);
    if (LINES_A_PHOTO * counts[0] + LINES_A_POINT * counts[1] > (double)(from->text.n - 1))
        return cn_fail(CN_ERR_FORMAT, "%s: too short for %.0f photos and %.0f points; the file is cut, export it again",
                       from->text.path, counts[0], counts[1]);
    if ((double)from->list.n != counts[0])
        return cn_fail(CN_ERR_FORMAT, "%s: it has %.0f photos, but %s names %zu; give the list that belongs to it",
                       from->text.path, counts[0], from->list.path, from->list.n);
    CN_TRY(cn_importer_room(from->to, (size_t)counts[0]));
    for (size_t k = 0; k < (size_t)counts[0]; k++)
        CN_TRY(read_photo(from, k));
    return CN_OK;
}

cn_status cn_import_bundler(cn_importer *to)
{
    source from = { .to = to };
    char *list = NULL;
    CN_TRY(find_list(to->path, to->folder, &list));
    cn_status status = cn_import_lines_read(to->path, &from.text);
    if (status == CN_OK) status = cn_import_lines_read(list, &from.list);
    if (status == CN_OK) status = read_photos(&from);
    cn_import_lines_deinit(&from.text);
    cn_import_lines_deinit(&from.list);
    free(list);
    return status;
}
