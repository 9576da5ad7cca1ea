/* Any bytes as poses of another tool, a transforms.json, a reconstruction.json, an .nvm, a bundle.out, a
 * cameras.xml, a table of RealityCapture or Record3D's metadata, for a collection of four photos. */
#include "fuzz.h"

#include "conurb/photo.h"
#include "pose/import.h"
#include "pose/scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char folder[] = "/photos", a[] = "a.jpg", b[] = "sub/b.png", c[] = "c", first[] = "0.jpg", camera[] = "";
    cn_photo photos[4] = { { .name = first, .width = 40, .height = 30, .orientation = 1, .camera = camera },
                           { .name = a, .width = 40, .height = 30, .orientation = 1, .camera = camera },
                           { .name = c, .width = 30, .height = 40, .orientation = 6, .camera = camera },
                           { .name = b, .width = 40, .height = 30, .orientation = 1, .camera = camera } };
    const cn_photo_index index = { .folder = folder, .photos = photos, .n_photos = 4 };
    static const char names[] = "a.jpg\nsub/b.png\nc\n"; /* the list that belongs to a bundle.out */
    static bool listed;
    if (!listed) fuzz_file("list.txt", names, sizeof names - 1);
    listed = true;
    cn_scene scene = { 0 };
    uint32_t n_models;
    cn_import_origin origin;
    if (cn_import_file(NULL, fuzz_file("transforms.json", data, size), &index, &scene, &n_models, &origin) == CN_OK) {
        bool keep[64];
        memset(keep, 1, sizeof keep);
        if (scene.n_views <= 64) (void)!cn_scene_fit_photos(NULL, &scene, &index, false, keep);
    }
    cn_scene_deinit(&scene);
    return 0;
}
