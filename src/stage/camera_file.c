/* The cameras of a flight as a file for compositing programs. */
#include "stage/camera_path.h"

#include "base/file.h"

cn_status cn_city_export_camera(const cn_context *ctx, cn_city *city, const cn_city_render_options *options,
                                const char *file)
{
    cn_dataset m;
    cn_path path = { 0 };
    CN_TRY(cn_dataset_load(ctx, city, true, &m));
    const char *flight = options->path ? cn_path_base(options->path) : options->orbit ? options->orbit : "default";
    const cn_path_note note = { &m.frame, flight };
    cn_status status = cn_route_choose(ctx, city, &m, options, &path);
    if (status == CN_OK) status = cn_path_save(&path, file, &note);
    if (status == CN_OK) cn_log(ctx, CN_LOG_INFO, "camera of %u frames: %s", path.n_frames, file);
    cn_path_deinit(&path);
    cn_dataset_deinit(&m);
    return status;
}
