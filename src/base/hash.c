#include "base/hash.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#define CN_HASH_BLOCK ((size_t)1 << 18)

uint64_t cn_hash64(const void *data, size_t size)
{
    return XXH3_64bits(data, size);
}

static int hash_descriptor(int fd, XXH3_state_t *state, void *block)
{
    for (;;) {
        ssize_t got = read(fd, block, CN_HASH_BLOCK);
        if (got == 0) return 0;
        if (got > 0)
            XXH3_64bits_update(state, block, (size_t)got);
        else if (errno != EINTR)
            return errno;
    }
}

cn_status cn_hash_file(const char *path, uint64_t *hash)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return cn_fail(CN_ERR_IO, "cannot read %s: %s", path, strerror(errno));
    XXH3_state_t *state = XXH3_createState();
    void *block = malloc(CN_HASH_BLOCK);
    int error = ENOMEM;
    if (state && block) {
        XXH3_64bits_reset(state);
        error = hash_descriptor(fd, state, block);
        *hash = XXH3_64bits_digest(state);
    }
    XXH3_freeState(state);
    free(block);
    close(fd);
    if (error) return cn_fail(error == ENOMEM ? CN_ERR_NOMEM : CN_ERR_IO, "cannot read %s: %s", path, strerror(error));
    return CN_OK;
}

void cn_hash_hex(uint64_t hash, char out[17])
{
    snprintf(out, 17, "%016" PRIx64, hash);
}
