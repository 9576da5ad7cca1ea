/* Options of COLMAP that have another name in newer ones (3.13 and 4). Conurb's own lists have the names of COLMAP 3.8;
 * the help of each program says which of them an installed COLMAP knows. */
#ifndef CONURB_POSE_COLMAP_OPTIONS_H
#define CONURB_POSE_COLMAP_OPTIONS_H
#include "conurb/base.h"

/* Copies a command line, COLMAP with the name of one of its programs, with the names that this COLMAP knows. out: as
 * long as argv. The words are borrowed from argv or constants. Reads the help of a program once per process. Several
 * threads may call it. CN_ERR_INTERRUPTED: asked to stop; CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_colmap_rename(const cn_context *ctx, const char *const *argv, const char **out);
/* CN_ERR_TOOL: this COLMAP knows neither name of an option, which the message names. Where no help can be read, nothing
 * is said of it. Other errors as above. */
CN_NODISCARD cn_status cn_colmap_check_options(const cn_context *ctx, const char *colmap);
#endif
