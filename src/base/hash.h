/* Content hashes (XXH3), to find out whether something has changed. Not for security. */
#ifndef CONURB_BASE_HASH_H
#define CONURB_BASE_HASH_H
#include "conurb/base.h"
uint64_t cn_hash64(const void *data, size_t size);
CN_NODISCARD cn_status cn_hash_file(const char *path, uint64_t *hash);
/* The hash of `hash` and a printf text together. The text may have any length. */
uint64_t cn_hash_text(uint64_t hash, const char *format, ...) CN_PRINTF(2, 3);
/* 16 hex digits and a NUL. */
void cn_hash_hex(uint64_t hash, char out[17]);
#endif
