/* Files of Gaussians. */
#ifndef CONURB_SPLAT_SPLAT_FILE_H
#define CONURB_SPLAT_SPLAT_FILE_H
#include "conurb/splat.h"

#include <stdio.h>

typedef enum cn_splat_format { CN_SPLAT_PLY, CN_SPLAT_SPZ } cn_splat_format;
/* By the path's ending. CN_ERR_USAGE. */
CN_NODISCARD cn_status cn_splat_format_of(const char *path, cn_splat_format *format);
/* Write one file, atomically. The Gaussians are checked already. */
CN_NODISCARD cn_status cn_splat_ply_write(const cn_splats *splats, const cn_splat_about *about, const char *path);
CN_NODISCARD cn_status cn_splat_spz_write(const cn_splats *splats, const cn_splat_about *about, const char *path);
/* What the file would hold; path is for messages. The caller checks the stream. */
CN_NODISCARD cn_status cn_splat_spz_stream(const cn_splats *splats, FILE *stream, const char *path);
#endif
