#include "photo/maps.h"

#include "base/file.h"
#include "bridge/oiio.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_photo_find_map(const char *folder, const char *name, char **found)
{
    static const char *const endings[] = { ".png", ".exr" };
    const char *base = strrchr(name, '/'), *dot = strrchr(base ? base : name, '.');
    const size_t whole = strlen(name), lengths[] = { whole, dot ? (size_t)(dot - name) : whole };
    *found = NULL;
    for (size_t i = 0; i < 4; i++) {
        char *path = cn_format("%s/%.*s%s", folder, (int)lengths[i / 2], name, endings[i % 2]);
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        if (cn_file_exists(path)) {
            *found = path;
            return CN_OK;
        }
        free(path);
    }
    return CN_OK;
}

static cn_status none_found(const cn_photo_index *index, const char *kind, const char *folder)
{
    return cn_fail(CN_ERR_DATA, "photos.%s: no photo has a %s map in %s; name it as the photo, such as %s.png or .exr",
                   kind, kind, folder, index->n_photos ? index->photos[0].name : "NAME");
}

cn_status cn_photo_index_find_maps(cn_photo_index *index, const cn_photo_maps *maps, uint32_t *n)
{
    uint32_t depths = 0, normals = 0;
    *n = 0;
    for (uint32_t i = 0; i < index->n_photos; i++) {
        cn_photo *p = &index->photos[i];
        free(p->depth);
        free(p->normal);
        p->depth = p->normal = NULL;
        p->normal_axes = (uint8_t)maps->normal_axes;
        if (maps->depth) CN_TRY(cn_photo_find_map(maps->depth, p->name, &p->depth));
        if (maps->normal) CN_TRY(cn_photo_find_map(maps->normal, p->name, &p->normal));
        *n += p->depth || p->normal;
        depths += p->depth != NULL;
        normals += p->normal != NULL;
    }
    if (maps->depth && !depths) return none_found(index, "depth", maps->depth);
    if (maps->normal && !normals) return none_found(index, "normal", maps->normal);
    return CN_OK;
}

bool cn_photo_same_shape(uint32_t width, uint32_t height, const cn_photo *photo)
{
    const double w = (double)height * photo->width / photo->height, h = (double)width * photo->height / photo->width;
    return fabs(w - width) <= 1 || fabs(h - height) <= 1;
}

cn_status cn_photo_check_shape(const char *path, uint32_t width, uint32_t height, const cn_photo *photo)
{
    if (cn_photo_same_shape(width, height, photo)) return CN_OK;
    return cn_fail(CN_ERR_DATA, "%s is %u x %u pixels and its photo %u x %u: give both the same aspect ratio", path,
                   width, height, photo->width, photo->height);
}

static cn_status check(const cn_photo *photo, const cn_oiio_map *map)
{
    if (map->bits == 8)
        return cn_fail(CN_ERR_DATA, "%s has 8 bits per value; give a 16-bit PNG in millimetres or an EXR in metres",
                       photo->depth);
    return cn_photo_check_shape(photo->depth, map->width, map->height, photo);
}

cn_status cn_photo_read_depth(const cn_photo *photo, uint32_t width, uint32_t height, float *depth_m)
{
    cn_oiio_map map;
    CN_TRY(cn_oiio_read_map(photo->depth, 1, &map));
    const cn_status status = check(photo, &map);
    const float unit = map.bits ? 65.535f : 1; /* metres for a value of 1 */
    for (uint32_t y = 0; y < height && status == CN_OK; y++)
        for (uint32_t x = 0; x < width; x++) {
            const size_t u = (size_t)((x + 0.5) * map.width / width), v = (size_t)((y + 0.5) * map.height / height);
            const float value = unit * map.values[v * map.width + u];
            depth_m[(size_t)y * width + x] = isfinite(value) && value > 0 ? value : 0;
        }
    free(map.values);
    return status;
}

/* One pixel of a normal map, as the store keeps it. False where there is no normal. Black in a PNG means (-1, -1, -1),
 * which is too long for a normal: networks and renderers leave black what has none. */
static bool pack(const float rgba[4], bool is_float, cn_normal_axes axes, int8_t packed[4])
{
    double n[3], squared = 0;
    memset(packed, 0, 4);
    for (int a = 0; a < 3; a++) {
        n[a] = is_float ? (double)rgba[a] : 2 * (double)rgba[a] - 1;
        squared += n[a] * n[a];
    }
    if (!isfinite(squared) || !(rgba[3] > 0)) return false;
    const double length = sqrt(squared);
    if (!(length > 1e-6) || (!is_float && !(length > 0.5 && length < 1.5))) return false;
    for (int a = 0; a < 3; a++)
        packed[a] = (int8_t)lround(127 * (axes == CN_NORMAL_OPENGL && a > 0 ? -n[a] : n[a]) / length);
    return true;
}

cn_status cn_photo_read_normal(const cn_photo *photo, uint32_t width, uint32_t height, int8_t *packed,
                               cn_normal_report *report)
{
    cn_oiio_info info;
    CN_TRY(cn_oiio_read_info(photo->normal, &info));
    if (info.channels < 3)
        return cn_fail(CN_ERR_DATA, "%s has %u channels per pixel; give the normal's x, y and z as red, green and blue",
                       photo->normal, info.channels);
    float *rgba;
    uint32_t w, h;
    CN_TRY(cn_oiio_read_rgba(photo->normal, &rgba, &w, &h));
    const cn_status status = cn_photo_check_shape(photo->normal, w, h, photo);
    size_t known = 0, away = 0;
    for (uint32_t y = 0; y < height && status == CN_OK; y++)
        for (uint32_t x = 0; x < width; x++) {
            const size_t u = (size_t)((x + 0.5) * w / width), v = (size_t)((y + 0.5) * h / height);
            int8_t *to = packed + 4 * ((size_t)y * width + x);
            if (!pack(rgba + 4 * (v * w + u), info.is_float, (cn_normal_axes)photo->normal_axes, to)) continue;
            known++;
            away += to[2] > 0;
        }
    free(rgba);
    *report = (cn_normal_report){ .none = status == CN_OK && !known, .away = 2 * away > known };
    return status;
}
