/* Any bytes as a PLY file, whose places and triangles a surface is compared with. */
#include "fuzz.h"

#include "surface/ply.h"

#include <math.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cn_triangle_list list;
    if (cn_ply_read(&list, fuzz_file("reference.ply", data, size)) != CN_OK) return 0;
    for (uint32_t i = 0; i < list.n_places; i++)
        for (int a = 0; a < 3; a++)
            if (!isfinite(list.places[i][a])) abort();
    for (uint32_t i = 0; i < list.n_triangles; i++)
        for (int a = 0; a < 3; a++)
            if (list.corners[i][a] >= list.n_places) abort();
    cn_triangle_list_deinit(&list);
    return 0;
}
