#include "surface/textured.h"

#include "base/file.h"
#include "base/number.h"
#include "base/scratch.h"
#include "bridge/oiio.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <unistd.h>

enum { STRIDE = 32, QUALITY = 90 }; /* bytes of a vertex: place, normal, texture; of a JPEG */

/* What belongs to a page: an image, and a range of vertices and triangles. */
typedef struct sheet {
    uint64_t image, image_size; /* bytes of the scratch file */
    uint32_t vertex, n_vertices, triangle, n_triangles;
} sheet;

typedef struct textured_job {
    const cn_textured *in;
    const char *path;
    cn_charts charts;
    cn_atlas atlas;
    sheet *sheets; /* of each page */
    FILE *images;
    uint32_t *source; /* of each vertex that is written, the mesh's */
    float (*uv)[2];
    uint32_t *corners; /* from the first vertex of the sheet */
    uint32_t n_vertices, n_triangles, room;
    uint32_t *local; /* of a mesh's vertex that in the chart; UINT32_MAX: none */
    uint64_t texels, done;
} textured_job;

/* ---- vertices: one for each chart that a vertex is in ---- */

static cn_status add_vertex(textured_job *j, uint32_t vertex, const double uv[2])
{
    if (j->n_vertices == j->room) {
        const uint32_t room = j->room ? 2 * j->room : 4096;
        uint32_t *source = realloc(j->source, room * sizeof *source);
        if (source) j->source = source;
        float(*more)[2] = realloc(j->uv, room * sizeof *more);
        if (more) j->uv = more;
        if (!source || !more) return cn_fail(CN_ERR_NOMEM, "out of memory for %u vertices; give a larger --gsd", room);
        j->room = room;
    }
    j->source[j->n_vertices] = vertex;
    j->uv[j->n_vertices][0] = (float)uv[0];
    j->uv[j->n_vertices][1] = (float)uv[1];
    j->local[vertex] = j->n_vertices++;
    return CN_OK;
}

static cn_status add_chart(textured_job *j, const cn_chart *chart, uint32_t first, uint32_t side)
{
    const cn_mesh *m = j->in->mesh;
    const uint32_t *list = j->charts.triangles + chart->first;
    for (uint32_t i = 0; i < 3 * chart->n; i++) {
        const uint32_t vertex = m->corners[3 * (size_t)list[i / 3] + i % 3];
        if (j->local[vertex] == UINT32_MAX) {
            double px[2];
            cn_chart_project(chart, m->vertices[vertex].xyz, px);
            for (int k = 0; k < 2; k++)
                px[k] = (px[k] + chart->at_px[k]) / side;
            CN_TRY(add_vertex(j, vertex, px));
        }
        j->corners[3 * (size_t)j->n_triangles + i] = j->local[vertex] - first;
    }
    for (uint32_t i = 0; i < 3 * chart->n; i++)
        j->local[m->corners[3 * (size_t)list[i / 3] + i % 3]] = UINT32_MAX;
    j->n_triangles += chart->n;
    return CN_OK;
}

static cn_status add_sheet(textured_job *j, uint32_t page)
{
    const cn_atlas_page *p = &j->atlas.pages[page];
    sheet *s = &j->sheets[page];
    s->vertex = j->n_vertices;
    s->triangle = j->n_triangles;
    for (uint32_t i = 0; i < p->n; i++)
        CN_TRY(add_chart(j, &j->charts.charts[p->first + i], s->vertex, p->side_px));
    s->n_vertices = j->n_vertices - s->vertex;
    s->n_triangles = j->n_triangles - s->triangle;
    return CN_OK;
}

/* ---- images ---- */

static void report_texels(void *user, size_t texels)
{
    textured_job *j = user;
    j->done += texels;
    if (j->in->progress) j->in->progress(j->in->user, fmin((double)j->done / (double)(j->texels + 1), 1));
}

static cn_status write_all(textured_job *j, const uint8_t *bytes, size_t size)
{
    return fwrite(bytes, 1, size, j->images) == size && fflush(j->images) == 0
               ? CN_OK
               : cn_scratch_failure(j->path, "write", errno);
}

static cn_status bake_sheet(textured_job *j, uint32_t page)
{
    const cn_bake bake = { .ctx = j->in->ctx,
                           .source = j->in->source,
                           .mesh = j->in->mesh,
                           .charts = &j->charts,
                           .reach_m = j->in->reach_m,
                           .progress = report_texels,
                           .user = j };
    const uint32_t side = j->atlas.pages[page].side_px;
    sheet *s = &j->sheets[page];
    uint8_t *rgb = NULL, *bytes = NULL;
    size_t size = 0;
    s->image = page ? j->sheets[page - 1].image + j->sheets[page - 1].image_size : 0;
    cn_status status = cn_bake_page(&bake, &j->atlas.pages[page], &rgb);
    if (status == CN_OK)
        status = cn_oiio_encode_bytes((cn_oiio_encoding){ true, QUALITY, true }, rgb, side, side, &bytes, &size);
    if (status == CN_OK) status = write_all(j, bytes, size);
    s->image_size = size;
    free(rgb);
    free(bytes);
    return status;
}

static cn_status copy_image(textured_job *j, const sheet *s, FILE *to)
{
    char buffer[65536];
    if (fseeko(j->images, (off_t)s->image, SEEK_SET) != 0) return cn_scratch_failure(j->path, "read", errno);
    for (uint64_t left = s->image_size; left;) {
        const size_t want = left < sizeof buffer ? (size_t)left : sizeof buffer;
        if (fread(buffer, 1, want, j->images) != want) return cn_scratch_failure(j->path, "read", errno ? errno : EIO);
        fwrite(buffer, 1, want, to);
        left -= want;
    }
    return CN_OK;
}

/* ---- glTF ---- */

static json_t *place_json(const textured_job *j, const sheet *s)
{
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    for (uint32_t i = 0; i < s->n_vertices; i++) {
        float xyz[3];
        cn_gltf_turn(j->in->mesh->vertices[j->source[s->vertex + i]].xyz, xyz);
        for (int k = 0; k < 3; k++) {
            low[k] = fmin(low[k], (double)xyz[k]);
            high[k] = fmax(high[k], (double)xyz[k]);
        }
    }
    return json_pack("{s:i, s:I, s:i, s:I, s:s, s:o, s:o}", "bufferView", 0, "byteOffset",
                     (json_int_t)s->vertex * STRIDE, "componentType", 5126, "count", (json_int_t)s->n_vertices, "type",
                     "VEC3", "min", cn_json_reals(low, 3), "max", cn_json_reals(high, 3));
}

static json_t *accessors_json(const textured_job *j)
{
    json_t *list = json_array();
    for (uint32_t p = 0; p < j->atlas.n; p++) {
        const sheet *s = &j->sheets[p];
        const json_int_t first = (json_int_t)s->vertex * STRIDE, n = (json_int_t)s->n_vertices;
        json_array_append_new(list, place_json(j, s));
        json_array_append_new(list, json_pack("{s:i, s:I, s:i, s:I, s:s}", "bufferView", 0, "byteOffset", first + 12,
                                              "componentType", 5126, "count", n, "type", "VEC3"));
        json_array_append_new(list, json_pack("{s:i, s:I, s:i, s:I, s:s}", "bufferView", 0, "byteOffset", first + 24,
                                              "componentType", 5126, "count", n, "type", "VEC2"));
        json_array_append_new(list, json_pack("{s:i, s:I, s:i, s:I, s:s}", "bufferView", 1, "byteOffset",
                                              (json_int_t)s->triangle * 12, "componentType", 5125, "count",
                                              (json_int_t)s->n_triangles * 3, "type", "SCALAR"));
    }
    return list;
}

static uint64_t geometry_size(const textured_job *j)
{
    return (uint64_t)j->n_vertices * STRIDE + (uint64_t)j->n_triangles * 12;
}

static json_t *views_json(const textured_job *j)
{
    const json_int_t vertices = (json_int_t)j->n_vertices * STRIDE, corners = (json_int_t)j->n_triangles * 12;
    json_t *list =
        json_pack("[{s:i, s:I, s:i, s:i}, {s:i, s:I, s:I, s:i}]", "buffer", 0, "byteLength", vertices, "byteStride",
                  STRIDE, "target", 34962, "buffer", 0, "byteOffset", vertices, "byteLength", corners, "target", 34963);
    for (uint32_t p = 0; p < j->atlas.n; p++)
        json_array_append_new(list, json_pack("{s:i, s:I, s:I}", "buffer", 0, "byteOffset",
                                              (json_int_t)(geometry_size(j) + j->sheets[p].image), "byteLength",
                                              (json_int_t)j->sheets[p].image_size));
    return list;
}

static json_t *root_json(const textured_job *j, uint64_t size)
{
    char generator[32];
    json_t *primitives = json_array(), *materials = json_array(), *textures = json_array(), *images = json_array();
    for (int p = 0; p < (int)j->atlas.n; p++) {
        json_array_append_new(primitives,
                              json_pack("{s:{s:i, s:i, s:i}, s:i, s:i}", "attributes", "POSITION", 4 * p, "NORMAL",
                                        4 * p + 1, "TEXCOORD_0", 4 * p + 2, "indices", 4 * p + 3, "material", p));
        json_array_append_new(materials,
                              json_pack("{s:{s:{}}, s:{s:{s:i}, s:f, s:f}, s:b}", "extensions", "KHR_materials_unlit",
                                        "pbrMetallicRoughness", "baseColorTexture", "index", p, "metallicFactor", 0.0,
                                        "roughnessFactor", 1.0, "doubleSided", 1));
        json_array_append_new(textures, json_pack("{s:i, s:i}", "sampler", 0, "source", p));
        json_array_append_new(images, json_pack("{s:i, s:s}", "bufferView", 2 + p, "mimeType", "image/jpeg"));
    }
    snprintf(generator, sizeof generator, "Conurb %s", cn_version());
    return json_pack("{s:{s:s, s:s, s:o}, s:[s], s:i, s:[{s:[i]}], s:[{s:i, s:s}], s:[{s:o}], s:o, s:o, s:o,"
                     " s:[{s:i, s:i, s:i, s:i}], s:o, s:o, s:[{s:I}]}",
                     "asset", "version", "2.0", "generator", generator, "extras", cn_mesh_about_json(j->in->about),
                     "extensionsUsed", "KHR_materials_unlit", "scene", 0, "scenes", "nodes", 0, "nodes", "mesh", 0,
                     "name", "city", "meshes", "primitives", primitives, "materials", materials, "textures", textures,
                     "images", images, "samplers", "magFilter", 9729, "minFilter", 9987, "wrapS", 33071, "wrapT", 33071,
                     "accessors", accessors_json(j), "bufferViews", views_json(j), "buffers", "byteLength",
                     (json_int_t)size);
}

static void write_vertex(const textured_job *j, uint32_t i, FILE *to)
{
    const cn_surface_vertex *v = &j->in->mesh->vertices[j->source[i]];
    float turned[2][3];
    uint8_t row[STRIDE], *at = row;
    cn_gltf_turn(v->xyz, turned[0]);
    cn_gltf_turn(v->normal, turned[1]);
    for (int k = 0; k < 6; k++)
        at = cn_put_float(at, turned[k / 3][k % 3]);
    for (int k = 0; k < 2; k++)
        at = cn_put_float(at, j->uv[i][k]);
    fwrite(row, sizeof row, 1, to);
}

static cn_status write_glb(textured_job *j)
{
    const sheet *last = &j->sheets[j->atlas.n - 1];
    const uint64_t used = geometry_size(j) + last->image + last->image_size, size = (used + 3) / 4 * 4;
    if (size > UINT32_MAX - (1 << 24))
        return cn_fail(CN_ERR_USAGE,
                       "%s: a textured mesh of %.1f GB does not fit into a .glb; give a larger --gsd, "
                       "fewer --texels, or --3dtiles",
                       j->path, (double)size / 1e9);
    cn_writer writer;
    CN_TRY(cn_writer_open(&writer, j->path));
    cn_status status = cn_gltf_head(writer.stream, root_json(j, size), (uint32_t)size);
    for (uint32_t i = 0; i < j->n_vertices && status == CN_OK; i++)
        write_vertex(j, i, writer.stream);
    for (size_t i = 0; i < 3 * (size_t)j->n_triangles && status == CN_OK; i++) {
        uint8_t index[4];
        cn_put_32(index, j->corners[i]);
        fwrite(index, sizeof index, 1, writer.stream);
    }
    for (uint32_t p = 0; p < j->atlas.n && status == CN_OK; p++)
        status = copy_image(j, &j->sheets[p], writer.stream);
    for (uint64_t i = used; i < size; i++)
        fputc(0, writer.stream);
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    return status;
}

/* ---- OBJ: all its files are written before the first is renamed ---- */

typedef struct obj_files {
    textured_job *job;
    cn_writer *writers; /* images, then MTL, then OBJ */
    char *stem;         /* path without its ending */
    char *beside;       /* the same for MTL and images: a name in these files ends at white space, so it has none */
} obj_files;

static void write_obj(const obj_files *o, FILE *to)
{
    const textured_job *j = o->job;
    const cn_mesh *m = j->in->mesh;
    cn_mesh_comments(to, j->in->about, "#");
    fprintf(to, "mtllib %s.mtl\n", cn_path_base(o->beside));
    for (uint32_t i = 0; i < m->n_vertices; i++) {
        const cn_surface_vertex *v = &m->vertices[i];
        fprintf(to, "v %.9g %.9g %.9g\nvn %.4f %.4f %.4f\n", (double)v->xyz[0], (double)v->xyz[1], (double)v->xyz[2],
                (double)v->normal[0], (double)v->normal[1], (double)v->normal[2]);
    }
    for (uint32_t i = 0; i < j->n_vertices; i++)
        fprintf(to, "vt %.7f %.7f\n", (double)j->uv[i][0], 1 - (double)j->uv[i][1]);
    for (uint32_t p = 0; p < j->atlas.n; p++) {
        const sheet *s = &j->sheets[p];
        fprintf(to, "usemtl page%u\n", p + 1);
        for (size_t i = 3 * (size_t)s->triangle; i < 3 * ((size_t)s->triangle + s->n_triangles); i++) {
            const uint32_t vertex = s->vertex + j->corners[i], place = j->source[vertex] + 1;
            fprintf(to, "%s%u/%u/%u%s", i % 3 ? " " : "f ", place, vertex + 1, place, i % 3 == 2 ? "\n" : "");
        }
    }
}

static void write_mtl(const obj_files *o, FILE *to)
{
    cn_mesh_comments(to, o->job->in->about, "#");
    for (uint32_t p = 0; p < o->job->atlas.n; p++)
        fprintf(to, "newmtl page%u\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Kd %s-%u.jpg\n", p + 1,
                cn_path_base(o->beside), p + 1);
}

static cn_status write_files(obj_files *o)
{
    const uint32_t n = o->job->atlas.n;
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < n + 2 && status == CN_OK; i++) {
        char *name = i < n    ? cn_format("%s-%u.jpg", o->beside, i + 1)
                     : i == n ? cn_format("%s.mtl", o->beside)
                              : cn_format("%s.obj", o->stem);
        status = name ? cn_writer_open(&o->writers[i], name) : cn_fail(CN_ERR_NOMEM, "out of memory");
        if (status == CN_OK && i < n) status = copy_image(o->job, &o->job->sheets[i], o->writers[i].stream);
        if (status == CN_OK && i == n) write_mtl(o, o->writers[i].stream);
        if (status == CN_OK && i > n) write_obj(o, o->writers[i].stream);
        if (status == CN_OK && (fflush(o->writers[i].stream) != 0 || ferror(o->writers[i].stream)))
            status = cn_fail(CN_ERR_IO, "cannot write %s: %s", name, strerror(errno));
        free(name);
    }
    for (uint32_t i = 0; i < n + 2 && status == CN_OK; i++)
        status = cn_writer_commit(&o->writers[i]);
    for (uint32_t i = 0; i < n + 2; i++)
        cn_writer_abort(&o->writers[i]);
    return status;
}

static cn_status write_objs(textured_job *j)
{
    const int length = (int)strlen(j->path) - 4;
    obj_files o = { j, calloc(j->atlas.n + (size_t)2, sizeof *o.writers), cn_format("%.*s", length, j->path),
                    cn_format("%.*s", length, j->path) };
    for (char *c = o.beside ? o.beside + (cn_path_base(o.beside) - o.beside) : NULL; c && *c; c++)
        if (isspace((unsigned char)*c)) *c = '_';
    cn_status status =
        o.writers && o.stem && o.beside ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %u files", j->atlas.n);
    const locale_t before = cn_number_begin();
    if (status == CN_OK) status = write_files(&o);
    cn_number_end(before);
    free(o.writers);
    free(o.stem);
    free(o.beside);
    return status;
}

/* ---- all of it ---- */

static cn_status open_images(textured_job *j)
{
    int fd;
    CN_TRY(cn_scratch_open(j->path, &fd));
    j->images = fdopen(fd, "w+");
    if (j->images) return CN_OK;
    close(fd);
    return cn_fail(CN_ERR_NOMEM, "out of memory for textures");
}

static cn_status lay_out(textured_job *j)
{
    const cn_mesh *m = j->in->mesh;
    const uint32_t side = j->in->source->page_px;
    /* A chart fits onto a page, whichever way it turns. */
    const double largest = j->in->texel_m * fmin(side / 2.0 - 2 * CN_ATLAS_GUTTER, 512);
    const cn_chart_limits limits = { j->in->texel_m, largest, side - 2 * CN_ATLAS_GUTTER - 2 };
    CN_TRY(cn_charts_grow(j->in->ctx, m, &limits, &j->charts));
    CN_TRY(cn_atlas_pack(&j->charts, side, &j->atlas));
    for (uint32_t i = 0; i < j->charts.n; i++)
        j->texels += (uint64_t)j->charts.charts[i].size_px[0] * j->charts.charts[i].size_px[1];
    j->sheets = calloc(j->atlas.n + (size_t)1, sizeof *j->sheets);
    j->corners = malloc((3 * (size_t)m->n_triangles + 1) * sizeof *j->corners);
    j->local = malloc((m->n_vertices + (size_t)1) * sizeof *j->local);
    if (!j->sheets || !j->corners || !j->local)
        return cn_fail(CN_ERR_NOMEM, "out of memory for %u triangles; give a larger --gsd", m->n_triangles);
    memset(j->local, 0xff, (m->n_vertices + (size_t)1) * sizeof *j->local);
    for (uint32_t p = 0; p < j->atlas.n; p++)
        CN_TRY(add_sheet(j, p));
    return CN_OK;
}

static cn_status make(textured_job *j)
{
    CN_TRY(lay_out(j));
    CN_TRY(open_images(j));
    for (uint32_t p = 0; p < j->atlas.n; p++)
        CN_TRY(bake_sheet(j, p));
    const size_t length = strlen(j->path);
    return length > 4 && strcmp(j->path + length - 4, ".obj") == 0 ? write_objs(j) : write_glb(j);
}

cn_status cn_textured_write(const cn_textured *in, const char *path, cn_textured_report *report)
{
    textured_job j = { .in = in, .path = path };
    if (!in->mesh->n_triangles) return cn_fail(CN_ERR_DATA, "%s: there is no triangle to texture", path);
    const cn_status status = make(&j);
    if (report && status == CN_OK) {
        *report = (cn_textured_report){ j.charts.n, j.atlas.n, 0, 0 };
        for (uint32_t p = 0; p < j.atlas.n; p++)
            report->n_texels += (uint64_t)j.atlas.pages[p].side_px * j.atlas.pages[p].side_px;
        report->used = (double)j.done / (double)report->n_texels;
    }
    if (j.images) fclose(j.images);
    cn_charts_deinit(&j.charts);
    cn_atlas_deinit(&j.atlas);
    free(j.sheets);
    free(j.source);
    free(j.uv);
    free(j.corners);
    free(j.local);
    return status;
}
