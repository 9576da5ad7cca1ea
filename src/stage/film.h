/* The film beside a flight's frames. */
#ifndef CONURB_STAGE_FILM_H
#define CONURB_STAGE_FILM_H
#include "conurb/base.h"

/* Makes FOLDER/flight.mp4 from 00000.png to the n-th, unless it is there and was made from frames of the same key. A
 * single picture makes no film, nor do pictures too small for one, nor a system without an encoder: the log says so. */
CN_NODISCARD cn_status cn_film_make(const cn_context *ctx, const char *folder, uint32_t n, double fps, uint64_t key);
/* Whether there is nothing to make: it is there and of these frames, or these make no film. */
bool cn_film_done(const char *folder, uint32_t n, double fps, uint64_t key);
#endif
