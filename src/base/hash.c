#include "base/hash.h"
#include "base/number.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
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

uint64_t cn_hash_text(uint64_t hash, const char *format, ...)
{
    char stack[1024], *text = stack;
    const int head = snprintf(stack, sizeof stack, "%016" PRIx64 " ", hash);
    va_list args;
    va_start(args, format);
    const int n = cn_vprint(stack + head, sizeof stack - (size_t)head, format, args);
    va_end(args);
    const size_t size = (size_t)head + (n > 0 ? (size_t)n : 0);
    if (size >= sizeof stack) {
        text = malloc(size + 1);
        /* Without memory, return a hash that no text has. The work is then done again and never taken as done. */
        if (!text) return ~hash;
        memcpy(text, stack, (size_t)head);
        va_start(args, format);
        cn_vprint(text + head, size + 1 - (size_t)head, format, args);
        va_end(args);
    }
    const uint64_t result = cn_hash64(text, size);
    if (text != stack) free(text);
    return result;
}

void cn_hash_hex(uint64_t hash, char out[17])
{
    snprintf(out, 17, "%016" PRIx64, hash);
}
