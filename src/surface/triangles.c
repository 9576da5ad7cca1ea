#include "surface/triangles.h"

#include "base/disjoint.h"
#include "base/scratch.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static cn_status open_stream(const char *path, FILE **stream)
{
    int fd;
    CN_TRY(cn_scratch_open(path, &fd));
    *stream = fdopen(fd, "w+");
    if (*stream) return CN_OK;
    close(fd);
    return cn_fail(CN_ERR_NOMEM, "out of memory for scratch files");
}

cn_status cn_triangles_open(cn_triangles *t, const char *path)
{
    *t = (cn_triangles){ .path = path };
    cn_status status = open_stream(path, &t->vertices);
    if (status == CN_OK) status = open_stream(path, &t->corners);
    if (status != CN_OK) cn_triangles_close(t);
    return status;
}

void cn_triangles_close(cn_triangles *t)
{
    if (t->vertices) fclose(t->vertices);
    if (t->corners) fclose(t->corners);
    free(t->parent);
    *t = (cn_triangles){ 0 };
}

cn_status cn_triangles_add_vertices(cn_triangles *t, const cn_surface_vertex *vertices, uint32_t n)
{
    if (!n) return CN_OK;
    const uint64_t all = (uint64_t)t->n_vertices + n;
    if (all >= UINT32_MAX)
        return cn_fail(CN_ERR_USAGE, "the mesh has more than 4 billion vertices; give a larger --gsd");
    if (all > t->room) {
        const uint32_t room = all < UINT32_MAX / 2 ? (uint32_t)all * 2 : UINT32_MAX;
        uint32_t *parent = realloc(t->parent, room * sizeof *parent);
        if (!parent) return cn_fail(CN_ERR_NOMEM, "out of memory for %u vertices; give a larger --gsd", room);
        t->parent = parent;
        t->room = room;
    }
    for (uint32_t i = 0; i < n; i++)
        t->parent[t->n_vertices + i] = t->n_vertices + i;
    t->n_vertices += n;
    return fwrite(vertices, sizeof *vertices, n, t->vertices) == n ? CN_OK
                                                                   : cn_scratch_failure(t->path, "write", errno);
}

cn_status cn_triangles_add(cn_triangles *t, const uint32_t corner[3])
{
    for (int k = 1; k < 3; k++) {
        const uint32_t a = cn_root_of(t->parent, corner[0]), b = cn_root_of(t->parent, corner[k]);
        t->parent[a > b ? a : b] = a > b ? b : a;
    }
    t->n_triangles++;
    return fwrite(corner, sizeof *corner, 3, t->corners) == 3 ? CN_OK : cn_scratch_failure(t->path, "write", errno);
}

static cn_status read_all(FILE *stream, const char *path, void *to, size_t size)
{
    if (fread(to, size, 1, stream) == 1) return CN_OK;
    return cn_scratch_failure(path, "read", ferror(stream) ? errno : EIO);
}

cn_status cn_triangles_next_vertex(cn_triangles *t, cn_surface_vertex *vertex)
{
    return read_all(t->vertices, t->path, vertex, sizeof *vertex);
}

cn_status cn_triangles_next(cn_triangles *t, uint32_t corner[3])
{
    return read_all(t->corners, t->path, corner, 3 * sizeof *corner);
}

cn_status cn_triangles_rewind(cn_triangles *t)
{
    if (fflush(t->vertices) != 0 || fflush(t->corners) != 0) return cn_scratch_failure(t->path, "write", errno);
    rewind(t->vertices);
    rewind(t->corners);
    return CN_OK;
}

static cn_status count_pieces(cn_triangles *t, uint32_t *count)
{
    uint32_t corner[3];
    CN_TRY(cn_triangles_rewind(t));
    for (uint64_t i = 0; i < t->n_triangles; i++) {
        CN_TRY(cn_triangles_next(t, corner));
        const uint32_t root = cn_root_of(t->parent, corner[0]);
        count[root] += count[root] < UINT32_MAX;
    }
    return CN_OK;
}

cn_status cn_triangles_select(cn_triangles *t, uint32_t least, uint32_t **number, uint64_t n_kept[2])
{
    uint32_t *count = calloc(t->n_vertices + (size_t)1, sizeof *count);
    if (!count) return cn_fail(CN_ERR_NOMEM, "out of memory for %u vertices; give a larger --gsd", t->n_vertices);
    const cn_status status = count_pieces(t, count);
    n_kept[0] = n_kept[1] = 0;
    if (status != CN_OK) {
        free(count);
        return status;
    }
    /* A root comes before the other vertices of its piece, so its count is needed after its own number was given. */
    for (uint32_t i = 0; i < t->n_vertices; i++) {
        const uint32_t root = cn_root_of(t->parent, i);
        if (root == i && count[i] >= least) n_kept[1] += count[i];
        t->parent[i] = root;
    }
    for (uint32_t i = 0; i < t->n_vertices; i++)
        t->parent[i] = count[t->parent[i]] >= least ? (uint32_t)n_kept[0]++ : UINT32_MAX;
    free(count);
    *number = t->parent;
    t->parent = NULL;
    t->room = 0;
    return cn_triangles_rewind(t);
}
