#include "view/out.h"

#include <stdlib.h>
#include <string.h>

cn_out *cn_out_create(const void *bytes, size_t size, bool binary, int slot)
{
    cn_out *out = calloc(1, sizeof *out);
    if (!out) return NULL;
    *out = (cn_out){ .slot = slot, .binary = binary, .size = size, .bytes = malloc(CN_OUT_ROOM + size) };
    if (!out->bytes) {
        free(out);
        return NULL;
    }
    if (bytes) memcpy(out->bytes + CN_OUT_ROOM, bytes, size);
    return out;
}

void cn_out_destroy(cn_out *out)
{
    if (!out) return;
    free(out->bytes);
    free(out);
}
