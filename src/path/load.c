/* Detects the format of a file; each format has its own reader. */
#include "path/camera.h"

#include "base/json.h"

#include <ctype.h>
#include <stdio.h>

typedef enum kind { JSON, XML, GLTF, CHAN } kind;

/* By the first byte that is no space: XML begins with '<', a glTF binary with "glTF", and .chan with a number, which
 * JSON's objects never do. */
static cn_status kind_of(const char *file, kind *is)
{
    FILE *stream = fopen(file, "rb");
    if (!stream) return cn_fail(CN_ERR_IO, "cannot read the camera path %s; name a file that is there", file);
    int c = fgetc(stream);
    while (c != EOF && (isspace(c) || c == 0xEF || c == 0xBB || c == 0xBF))
        c = fgetc(stream);
    *is = c == '<' ? XML : c == 'g' ? GLTF : isdigit(c) || c == '-' || c == '+' || c == '.' || c == '#' ? CHAN : JSON;
    fclose(stream);
    return CN_OK;
}

static cn_status load_json(cn_path *path, const char *file, const cn_path_options *options)
{
    json_t *root;
    CN_TRY(cn_json_load(file, &root));
    cn_status status = json_object_get(root, "asset")
                           ? cn_fail(CN_ERR_FORMAT, "%s: glTF with its data in other files; export it as .glb", file)
                       : json_object_get(root, "type") ? cn_path_from_geojson(path, file, root, options)
                                                       : cn_path_from_keyframes(path, file, root, options);
    json_decref(root);
    return status;
}

cn_status cn_path_load(cn_path *path, const char *file, const cn_path_options *options)
{
    kind is = JSON;
    *path = (cn_path){ 0 };
    if (options->width == 0 || options->height == 0)
        return cn_fail(CN_ERR_USAGE, "a camera path needs a picture size above 0 x 0");
    CN_TRY(kind_of(file, &is));
    cn_status status = is == XML    ? cn_path_from_kml(path, file, options)
                       : is == GLTF ? cn_path_from_gltf(path, file, options)
                       : is == CHAN ? cn_path_from_chan(path, file, options)
                                    : load_json(path, file, options);
    if (status != CN_OK) cn_path_deinit(path);
    return status;
}
