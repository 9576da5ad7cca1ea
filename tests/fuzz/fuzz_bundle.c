/* Any bytes as a safetensors file. The reader refuses them or reads them. Every tensor that it gives can be read to its
 * end. */
#include "conurb/tile.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

static unsigned touch(const cn_bundle *bundle)
{
    unsigned sum = 0;
    for (uint32_t i = 0; i < cn_bundle_count(bundle); i++) {
        const cn_tensor *t = cn_bundle_at(bundle, i);
        uint64_t bytes = cn_dtype_size(t->dtype);
        for (uint32_t d = 0; d < t->n_dims; d++)
            bytes *= t->dims[d];
        for (uint64_t b = 0; b < bytes; b++)
            sum += ((const unsigned char *)t->data)[b];
    }
    return sum;
}

/* The header's length has 8 bytes. Most of them must be 0, which a fuzzer seldom finds. So the length is made from the
 * first two bytes of the input. After ff ff the input is taken as it is. */
static bool put(int fd, const uint8_t *data, size_t size)
{
    if (size < 2) return true;
    const uint64_t length = data[0] | (uint64_t)data[1] << 8;
    if (length != 0xffff && write(fd, &length, sizeof length) != (ssize_t)sizeof length) return false;
    return size == 2 || write(fd, data + 2, size - 2) == (ssize_t)(size - 2);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static volatile unsigned kept; /* so that the reads are not optimised away */
    const int fd = memfd_create("bundle", MFD_CLOEXEC);
    if (fd < 0 || !put(fd, data, size)) abort();
    char path[64];
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    cn_bundle *bundle = NULL;
    if (cn_bundle_open(&bundle, path, false) == CN_OK) kept = kept + touch(bundle);
    cn_bundle_destroy(&bundle);
    cn_tile *tile = NULL;
    if (cn_tile_open(&tile, path) == CN_OK) cn_tile_close(&tile);
    close(fd);
    return 0;
}
