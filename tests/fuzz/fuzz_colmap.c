/* Any bytes as the three files of a COLMAP model. The first byte says whether they are binary. A model that is read can
 * be written and read again. */
#include "fuzz.h"

#include "pose/scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char *const names[2][3] = { { "cameras.bin", "images.bin", "points3D.bin" },
                                             { "cameras.txt", "images.txt", "points3D.txt" } };
    if (size < 1) return 0;
    const int text = data[0] & 1;
    for (int i = 0; i < 3; i++) {
        size_t n;
        const uint8_t *part = fuzz_part(data + 1, size - 1, i, &n);
        char other[192];
        fuzz_file(names[text][i], part, n);
        snprintf(other, sizeof other, "%s/%s", fuzz_home(), names[!text][i]);
        unlink(other);
    }
    cn_scene scene = { 0 }, again = { 0 };
    if (cn_scene_read_colmap(&scene, fuzz_home()) != CN_OK) return 0;
    char out[96];
    snprintf(out, sizeof out, "%s/out", fuzz_home());
    (void)cn_scene_measure_errors(&scene);
    if (cn_scene_write_colmap(&scene, out) != CN_OK) abort();
    if (cn_scene_read_colmap(&again, out) != CN_OK || again.n_views != scene.n_views ||
        again.n_points != scene.n_points) {
        fprintf(stderr, "written and not read again: %s\n", cn_error_message());
        abort();
    }
    cn_scene_deinit(&again);
    cn_scene_deinit(&scene);
    return 0;
}
