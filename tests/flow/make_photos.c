/* make_photos DIR N [some|all]: N small photos of a synthetic scene in DIR, and DIR/transforms.json with their poses.
 * "all" or "some" (every second one) get EXIF GPS of their true places near Zurich. */
#include "synthetic.h"

#include "base/file.h"
#include "base/json.h"
#include "bridge/oiio.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void write_photo(const synthetic_scene *synthetic, uint32_t i, const char *dir, bool gps)
{
    char *from = cn_path_join(synthetic->folder, synthetic->scene.views[i].name),
         *to = cn_format("%s/%03u.jpg", dir, i);
    float *rgba, rgb[48 * 36 * 3];
    uint32_t w, h;
    double centre[3], geo[3];
    cn_frame frame;
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.latitude_deg = 47.37, frame.longitude_deg = 8.54, frame.height_m = 450;
    cn_view_centre(&synthetic->scene.views[i], centre);
    if (cn_oiio_read_rgba(from, &rgba, &w, &h) != CN_OK || cn_frame_to_geodetic(&frame, centre, geo) != CN_OK) abort();
    for (uint32_t p = 0; p < w * h; p++)
        memcpy(rgb + 3 * p, rgba + 4 * p, 3 * sizeof *rgb);
    double lat[3], lon[3], shutter = 0.01 * exp2((double)(i % 3) - 1), altitude = geo[2];
    for (int a = 0; a < 2; a++) {
        double *dms = a ? lon : lat, rest = geo[a];
        for (int k = 0; k < 3; k++)
            dms[k] = k < 2 ? floor(rest) : rest, rest = (rest - dms[k]) * 60;
    }
    const cn_oiio_attribute attributes[] = {
        { "ExposureTime", NULL, &shutter, 1 },
        { gps ? "GPS:Latitude" : NULL, NULL, lat, 3 },
        { "GPS:LatitudeRef", "N", NULL, 0 },
        { "GPS:Longitude", NULL, lon, 3 },
        { "GPS:LongitudeRef", "E", NULL, 0 },
        { "GPS:Altitude", NULL, &altitude, 1 },
        { NULL, NULL, NULL, 0 },
    };
    if (cn_oiio_write_jpeg(to, rgb, w, h, attributes) != CN_OK) {
        fprintf(stderr, "%s\n", cn_error_message());
        abort();
    }
    free(rgba);
    free(from);
    free(to);
}

static json_t *frame_of(const cn_view *view, uint32_t i)
{
    double r[9], c[3];
    cn_mat3_transpose(view->rotation, r);
    cn_view_centre(view, c);
    json_t *rows = json_array();
    for (int a = 0; a < 3; a++) {
        const double row[4] = { r[3 * a], -r[3 * a + 1], -r[3 * a + 2], c[a] }; /* OpenGL camera axes */
        json_array_append_new(rows, cn_json_reals(row, 4));
    }
    const double last[4] = { 0, 0, 0, 1 };
    json_array_append_new(rows, cn_json_reals(last, 4));
    char name[32];
    snprintf(name, sizeof name, "%03u.jpg", i);
    return json_pack("{s:s,s:o}", "file_path", name, "transform_matrix", rows);
}

int main(int argc, char **argv)
{
    if (argc < 3) return 2;
    const uint32_t n = (uint32_t)atoi(argv[2]);
    const char *gps = argc > 3 ? argv[3] : "none";
    synthetic_scene synthetic;
    synthetic_scene_init(&synthetic, n);
    json_t *frames = json_array();
    for (uint32_t i = 0; i < n; i++) {
        write_photo(&synthetic, i, argv[1], strcmp(gps, "all") == 0 || (strcmp(gps, "some") == 0 && i % 2 == 0));
        json_array_append_new(frames, frame_of(&synthetic.scene.views[i], i));
    }
    json_t *root = json_pack("{s:f,s:f,s:f,s:f,s:i,s:i,s:o}", "fl_x", 45.0, "fl_y", 45.0, "cx", 24.0, "cy", 18.0, "w",
                             48, "h", 36, "frames", frames);
    char *path = cn_path_join(argv[1], "transforms.json");
    if (cn_json_save(root, path) != CN_OK) return 1;
    json_decref(root);
    free(path);
    synthetic_scene_deinit(&synthetic);
    return 0;
}
