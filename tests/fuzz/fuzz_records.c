/* Any bytes as a JSON file of a workspace. The first byte chooses which file. */
#include "fuzz.h"

#include "conurb/geo.h"
#include "conurb/photo.h"
#include "conurb/plan.h"

static void read_plan(const uint8_t *data, size_t size)
{
    char a[] = "a.jpg", b[] = "b.jpg";
    cn_camera camera = { .width = 40, .height = 30, .params = { 30, 30, 20, 15 } };
    cn_view views[2] = { { .name = a, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } },
                         { .name = b, .photo = 1, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } } };
    const cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = 2 };
    cn_plan plan = { 0 };
    fuzz_file("plan.json", data, size);
    if (cn_plan_load(&plan, &scene, fuzz_home()) == CN_OK)
        for (uint32_t t = 0; t < plan.n_tiles; t++)
            for (uint32_t i = 0; i < plan.tiles[t].n_photos; i++)
                if (plan.tiles[t].photos[i] >= 2) abort();
    cn_plan_deinit(&plan);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 1) return 0;
    const int kind = data[0] % 3;
    data++, size--;
    if (kind == 0) {
        cn_photo_index index;
        if (cn_photo_index_load(&index, fuzz_file("photos.json", data, size)) == CN_OK) {
            for (uint32_t i = 0; i < index.n_photos; i++)
                if (cn_photo_index_find(&index, index.photos[i].name) < 0) abort();
            cn_photo_index_deinit(&index);
        }
    } else if (kind == 1) {
        cn_frame frame;
        double local[3] = { 1, 2, 3 }, geo[3];
        if (cn_frame_load(&frame, fuzz_file("frame.json", data, size)) == CN_OK && frame.georeferenced)
            (void)!cn_frame_to_geodetic(&frame, local, geo);
    } else {
        read_plan(data, size);
    }
    return 0;
}
