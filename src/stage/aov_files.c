#include "stage/aov_files.h"

#include "base/file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const char *const layer_names[CN_AOV_COUNT][3] = {
    { "depth.Z" }, { "normal.X", "normal.Y", "normal.Z" }, { "opacity.A" }, { "ambient_occlusion.Y" }, { "coverage.Y" }
};
enum { WHITE = 16 /* photos */ };

void cn_aov_layers(const cn_aovs *a, cn_oiio_channel layers[CN_AOV_LAYERS])
{
    int n = 0;
    for (unsigned i = 0; i < CN_AOV_COUNT; i++)
        for (unsigned c = 0; a->values[i] && c < cn_aov_channels(i); c++)
            layers[n++] = (cn_oiio_channel){ layer_names[i][c], a->values[i] + c, cn_aov_channels(i) };
    layers[n] = (cn_oiio_channel){ 0 };
}

char *cn_aov_png_path(const char *png, unsigned aov)
{
    const char *dot = strrchr(png, '.');
    return cn_format("%.*s.%s.png", (int)(dot ? dot - png : (ptrdiff_t)strlen(png)), png, cn_aov_name(aov));
}

bool cn_aov_pngs_exist(const char *png, unsigned which)
{
    bool there = true;
    for (unsigned i = 0; i < CN_AOV_COUNT && there; i++) {
        if (!(which >> i & 1)) continue;
        char *path = cn_aov_png_path(png, i);
        there = path && cn_file_exists(path);
        free(path);
    }
    return there;
}

cn_status cn_aov_pngs_remove(const char *png)
{
    cn_status status = CN_OK;
    for (unsigned i = 0; i < CN_AOV_COUNT && status == CN_OK; i++) {
        char *path = cn_aov_png_path(png, i);
        status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
        free(path);
    }
    return status;
}

static float shown(unsigned aov, float value, double near_m)
{
    switch (1u << aov) {
    case CN_AOV_DEPTH: return value > 0 ? (float)(near_m / (near_m + (double)value)) : 0;
    case CN_AOV_NORMAL: return 0.5f * value + 0.5f;
    case CN_AOV_COVERAGE: return value / WHITE;
    default: return value;
    }
}

static cn_status write_png(const cn_aovs *a, unsigned aov, const char *path, double near_m,
                           const cn_oiio_attribute *attributes)
{
    const size_t n = (size_t)a->width * a->height, channels = cn_aov_channels(aov);
    float *rgb = malloc(n * 3 * sizeof *rgb);
    if (!path || !rgb) {
        free(rgb);
        return cn_fail(CN_ERR_NOMEM, "out of memory while writing the %s of a frame", cn_aov_name(aov));
    }
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = shown(aov, a->values[aov][channels * i + (channels == 3 ? c : 0)], near_m);
    const cn_status status = cn_oiio_write_png(path, rgb, a->width, a->height, 3, attributes);
    free(rgb);
    return status;
}

cn_status cn_aov_write_pngs(const cn_aovs *a, const char *png, double near_m, const cn_oiio_attribute *attributes)
{
    cn_status status = CN_OK;
    for (unsigned i = 0; i < CN_AOV_COUNT && status == CN_OK; i++) {
        if (!a->values[i]) continue;
        char *path = cn_aov_png_path(png, i);
        status = write_png(a, i, path, near_m, attributes);
        free(path);
    }
    return status;
}
