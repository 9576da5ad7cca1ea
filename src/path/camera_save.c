/* Writes a path in the format of the file's ending. */
#include "base/file.h"
#include "base/number.h"
#include "path/camera.h"

#include <string.h>

cn_status cn_path_save(const cn_path *path, const char *file, const cn_path_note *note)
{
    const char *dot = strrchr(cn_path_base(file), '.');
    const bool chan = dot && strcmp(dot, ".chan") == 0;
    cn_writer writer;
    if (!chan && !(dot && strcmp(dot, ".glb") == 0))
        return cn_fail(CN_ERR_USAGE, "%s: a camera's file ends with .chan or .glb", file);
    for (uint32_t i = 0; i < path->n_frames; i++)
        if (path->frames[i].camera.lens == CN_LENS_EQUIRECTANGULAR)
            return cn_fail(CN_ERR_USAGE, "%s: frame %u shows all directions, and no camera of .chan or glTF does", file,
                           i);
    CN_TRY(cn_writer_open(&writer, file));
    const locale_t before = cn_number_begin();
    cn_status status = CN_OK;
    if (chan)
        cn_chan_write(writer.stream, path);
    else
        status = cn_gltf_write(writer.stream, path, note);
    cn_number_end(before);
    if (status == CN_OK && note->frame) status = cn_frame_save_beside(note->frame, file);
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    return status;
}
