/* Any bytes as a camera path: keyframes, GeoJSON or KML, with a georeference and without. */
#include "fuzz.h"

#include "conurb/geo.h"
#include "conurb/path.h"

#include <math.h>

static cn_status flat(void *user, size_t n, const double (*xy_m)[2], double *ground_m)
{
    (void)user;
    for (size_t i = 0; i < n; i++)
        ground_m[i] = xy_m[i][0] > 1e5 ? NAN : 3;
    return CN_OK;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 1) return 0;
    cn_frame frame;
    cn_frame_init(&frame);
    frame.georeferenced = data[0] & 1;
    frame.latitude_deg = 47, frame.longitude_deg = 8, frame.height_m = 450;
    cn_path_options options = cn_path_options_default();
    options.frame = &frame;
    options.width = 64, options.height = 48;
    options.n_frames = data[0] & 2 ? 0 : 20;
    options.sound = flat;
    if (data[0] & 4) options.height_m = 2;
    cn_path path = { 0 };
    if (cn_path_load(&path, fuzz_file("path", data + 1, size - 1), &options) == CN_OK) {
        if (!path.n_frames) abort();
        for (uint32_t i = 0; i < path.n_frames; i++)
            for (int k = 0; k < 9; k++)
                if (!isfinite(path.frames[i].view.rotation[k])) abort();
    }
    cn_path_deinit(&path);
    return 0;
}
