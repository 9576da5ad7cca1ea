/* The film of a flight's frames. */
#ifndef CONURB_STAGE_FILM_H
#define CONURB_STAGE_FILM_H
#include "conurb/base.h"

/* Makes FOLDER/flight.mp4 from the n pictures 00000.png and so on, unless it exists and was made from frames of the
 * same key. There is no film for a single picture, for pictures that are too small, and without an encoder; the log
 * says so. A film of other frames is removed then, if its marker is there. */
CN_NODISCARD cn_status cn_film_make(const cn_context *ctx, const char *folder, uint32_t n, double fps, uint64_t key);
/* Whether there is nothing to do: the film exists and has these frames, or these frames give no film. */
bool cn_film_done(const char *folder, uint32_t n, double fps, uint64_t key);
#endif
