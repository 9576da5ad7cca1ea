#include "surface/mesh_file.h"

#include "base/file.h"
#include "base/json.h"
#include "base/number.h"
#include "base/srgb.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct mesh_output {
    cn_triangles *triangles;
    const uint32_t *number;
    const uint64_t *n; /* vertices, triangles */
    const cn_mesh_about *about;
    FILE *stream;
} mesh_output;

cn_status cn_mesh_format_of(const char *path, cn_mesh_format *format)
{
    static const char *const endings[] = { ".ply", ".obj", ".glb" };
    const char *dot = strrchr(cn_path_base(path), '.');
    for (int i = 0; i < 3 && dot; i++) {
        if (strcmp(dot, endings[i]) != 0) continue;
        *format = (cn_mesh_format)i;
        return CN_OK;
    }
    return cn_fail(CN_ERR_USAGE, "%s: a mesh ends with .ply, .obj or .glb", path);
}

cn_status cn_mesh_check_path(const char *path, bool textured)
{
    cn_mesh_format format;
    CN_TRY(cn_mesh_format_of(path, &format));
    return textured && format == CN_MESH_PLY
               ? cn_fail(CN_ERR_USAGE, "%s: a PLY has no textures; give a .glb or an .obj", path)
               : CN_OK;
}

/* ---- PLY and OBJ ---- */

static cn_status next_kept(const mesh_output *o, uint32_t *i, cn_surface_vertex *v)
{
    do
        CN_TRY(cn_triangles_next_vertex(o->triangles, v));
    while (o->number[(*i)++] == UINT32_MAX);
    return CN_OK;
}

/* The next triangle that is kept, with new numbers. */
static cn_status next_triangle(const mesh_output *o, uint32_t corner[3])
{
    do
        CN_TRY(cn_triangles_next(o->triangles, corner));
    while (o->number[corner[0]] == UINT32_MAX);
    for (int k = 0; k < 3; k++)
        corner[k] = o->number[corner[k]];
    return CN_OK;
}

static cn_status write_ply(const mesh_output *o)
{
    fprintf(o->stream, "ply\nformat binary_little_endian 1.0\n");
    cn_mesh_comments(o->stream, o->about, "comment");
    fprintf(o->stream, "element vertex %llu\n", (unsigned long long)o->n[0]);
    static const char *const names[] = { "x", "y", "z", "nx", "ny", "nz" };
    for (int k = 0; k < 6; k++)
        fprintf(o->stream, "property float %s\n", names[k]);
    fprintf(o->stream,
            "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face %llu\n"
            "property list uchar int vertex_indices\nend_header\n",
            (unsigned long long)o->n[1]);
    uint32_t at = 0;
    for (uint64_t i = 0; i < o->n[0]; i++) {
        cn_surface_vertex v;
        uint8_t row[27], *to = row;
        CN_TRY(next_kept(o, &at, &v));
        for (int k = 0; k < 6; k++)
            to = cn_put_float(to, k < 3 ? v.xyz[k] : v.normal[k - 3]);
        memcpy(to, v.rgb, 3);
        fwrite(row, sizeof row, 1, o->stream);
    }
    for (uint64_t i = 0; i < o->n[1]; i++) {
        uint32_t corner[3];
        uint8_t row[13] = { 3 };
        CN_TRY(next_triangle(o, corner));
        for (int k = 0; k < 3; k++)
            cn_put_32(row + 1 + 4 * k, corner[k]);
        fwrite(row, sizeof row, 1, o->stream);
    }
    return CN_OK;
}

static cn_status write_obj(const mesh_output *o)
{
    cn_mesh_comments(o->stream, o->about, "#");
    uint32_t at = 0;
    for (uint64_t i = 0; i < o->n[0]; i++) {
        cn_surface_vertex v;
        CN_TRY(next_kept(o, &at, &v));
        fprintf(o->stream, "v %.9g %.9g %.9g %.4f %.4f %.4f\nvn %.4f %.4f %.4f\n", (double)v.xyz[0], (double)v.xyz[1],
                (double)v.xyz[2], v.rgb[0] / 255.0, v.rgb[1] / 255.0, v.rgb[2] / 255.0, (double)v.normal[0],
                (double)v.normal[1], (double)v.normal[2]);
    }
    for (uint64_t i = 0; i < o->n[1]; i++) {
        uint32_t c[3];
        CN_TRY(next_triangle(o, c));
        for (int k = 0; k < 3; k++)
            fprintf(o->stream, "%s%u//%u", k ? " " : "f ", c[k] + 1, c[k] + 1);
        fputc('\n', o->stream);
    }
    return CN_OK;
}

/* ---- glTF ---- */

enum { STRIDE = 32 }; /* of a vertex: place, normal, four 16-bit colours */

static cn_status find_bounds(const mesh_output *o, double low[3], double high[3])
{
    uint32_t at = 0;
    for (uint64_t i = 0; i < o->n[0]; i++) {
        cn_surface_vertex v;
        float xyz[3];
        CN_TRY(next_kept(o, &at, &v));
        cn_gltf_turn(v.xyz, xyz);
        for (int k = 0; k < 3; k++) {
            low[k] = i ? fmin(low[k], (double)xyz[k]) : (double)xyz[k];
            high[k] = i ? fmax(high[k], (double)xyz[k]) : (double)xyz[k];
        }
    }
    return cn_triangles_rewind(o->triangles);
}

static json_t *gltf_json(const mesh_output *o, const double low[3], const double high[3])
{
    const json_int_t vertices = (json_int_t)o->n[0], indices = (json_int_t)(3 * o->n[1]);
    char generator[32];
    snprintf(generator, sizeof generator, "Conurb %s", cn_version());
    json_t *about = cn_mesh_about_json(o->about);
    return json_pack("{s:{s:s, s:s}, s:[s], s:i, s:[{s:[i]}], s:[{s:i, s:s}], s:[{s:[{s:{s:i, s:i, s:i}, s:i, s:i}]}],"
                     " s:[{s:{s:{}}, s:{s:f, s:f}, s:b}],"
                     " s:[{s:i, s:i, s:I, s:s, s:o, s:o}, {s:i, s:i, s:i, s:I, s:s}, {s:i, s:i, s:i, s:b, s:I, s:s},"
                     " {s:i, s:i, s:I, s:s}],"
                     " s:[{s:i, s:I, s:i, s:i}, {s:i, s:I, s:I, s:i}], s:[{s:I}], s:o}",
                     "asset", "version", "2.0", "generator", generator, "extensionsUsed", "KHR_materials_unlit",
                     "scene", 0, "scenes", "nodes", 0, "nodes", "mesh", 0, "name", "city", "meshes", "primitives",
                     "attributes", "POSITION", 0, "NORMAL", 1, "COLOR_0", 2, "indices", 3, "material", 0, "materials",
                     "extensions", "KHR_materials_unlit", "pbrMetallicRoughness", "metallicFactor", 0.0,
                     "roughnessFactor", 1.0, "doubleSided", 1, "accessors", "bufferView", 0, "componentType", 5126,
                     "count", vertices, "type", "VEC3", "min", cn_json_reals(low, 3), "max", cn_json_reals(high, 3),
                     "bufferView", 0, "byteOffset", 12, "componentType", 5126, "count", vertices, "type", "VEC3",
                     "bufferView", 0, "byteOffset", 24, "componentType", 5123, "normalized", 1, "count", vertices,
                     "type", "VEC4", "bufferView", 1, "componentType", 5125, "count", indices, "type", "SCALAR",
                     "bufferViews", "buffer", 0, "byteLength", vertices * STRIDE, "byteStride", STRIDE, "target", 34962,
                     "buffer", 0, "byteOffset", vertices * STRIDE, "byteLength", indices * 4, "target", 34963,
                     "buffers", "byteLength", vertices * STRIDE + indices * 4, "extras", about);
}

static cn_status write_glb_head(const mesh_output *o, uint32_t size)
{
    double low[3], high[3];
    CN_TRY(find_bounds(o, low, high));
    return cn_gltf_head(o->stream, gltf_json(o, low, high), size);
}

static cn_status write_glb(const mesh_output *o)
{
    const uint64_t size = o->n[0] * STRIDE + o->n[1] * 12;
    if (size > UINT32_MAX - 65536)
        return cn_fail(CN_ERR_USAGE, "a mesh of %llu vertices does not fit into a .glb; give a larger --gsd, or a .ply",
                       (unsigned long long)o->n[0]);
    CN_TRY(write_glb_head(o, (uint32_t)size));
    uint32_t at = 0;
    for (uint64_t i = 0; i < o->n[0]; i++) {
        cn_surface_vertex v;
        float xyz[3], normal[3];
        uint8_t row[STRIDE], *to = row;
        CN_TRY(next_kept(o, &at, &v));
        cn_gltf_turn(v.xyz, xyz);
        cn_gltf_turn(v.normal, normal);
        for (int k = 0; k < 6; k++)
            to = cn_put_float(to, k < 3 ? xyz[k] : normal[k - 3]);
        for (int k = 0; k < 4; k++) { /* glTF's colours are linear */
            const long value = k < 3 ? lround(65535 * cn_srgb_decode(v.rgb[k] / 255.0)) : 65535;
            *to++ = (uint8_t)value;
            *to++ = (uint8_t)(value >> 8);
        }
        fwrite(row, sizeof row, 1, o->stream);
    }
    for (uint64_t i = 0; i < o->n[1]; i++) {
        uint32_t corner[3];
        uint8_t row[12];
        CN_TRY(next_triangle(o, corner));
        for (int k = 0; k < 3; k++)
            cn_put_32(row + 4 * k, corner[k]);
        fwrite(row, sizeof row, 1, o->stream);
    }
    return CN_OK;
}

cn_status cn_mesh_file_write(cn_triangles *triangles, const uint32_t *number, const uint64_t n[2],
                             const cn_mesh_about *about, const char *path)
{
    static cn_status (*const write[])(const mesh_output *o) = { write_ply, write_obj, write_glb };
    cn_mesh_format format = CN_MESH_PLY;
    cn_writer writer;
    CN_TRY(cn_mesh_format_of(path, &format));
    CN_TRY(cn_writer_open(&writer, path));
    const mesh_output o = { triangles, number, n, about, writer.stream };
    const locale_t before = cn_number_begin();
    cn_status status = write[format](&o);
    cn_number_end(before);
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    return status;
}

cn_status cn_mesh_file_write_mesh(const cn_mesh *mesh, const cn_mesh_about *about, const char *path)
{
    cn_triangles file;
    uint32_t *number = malloc((mesh->n_vertices + (size_t)1) * sizeof *number);
    const uint64_t counts[2] = { mesh->n_vertices, mesh->n_triangles };
    cn_status status = number ? cn_triangles_open(&file, path) : cn_fail(CN_ERR_NOMEM, "out of memory for a mesh");
    if (status != CN_OK) {
        free(number);
        return status;
    }
    status = cn_triangles_add_vertices(&file, mesh->vertices, mesh->n_vertices);
    for (uint32_t i = 0; i < mesh->n_vertices; i++)
        number[i] = i;
    for (uint32_t i = 0; i < mesh->n_triangles && status == CN_OK; i++)
        status = cn_triangles_add(&file, mesh->corners + 3 * (size_t)i);
    if (status == CN_OK) status = cn_triangles_rewind(&file);
    if (status == CN_OK) status = cn_mesh_file_write(&file, number, counts, about, path);
    cn_triangles_close(&file);
    free(number);
    return status;
}
