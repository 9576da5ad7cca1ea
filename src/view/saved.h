/* What viewers save: camera paths in the format of `conurb render --path`, and appearances. Each is one file below
 * CITY/views. */
#ifndef CONURB_VIEW_SAVED_H
#define CONURB_VIEW_SAVED_H
#include "city/workspace.h"

#include <jansson.h>

/* The file path of a name, which must pass cn_ask_name_is_safe; the caller frees it; NULL when out of memory. */
char *cn_saved_path(const cn_city *city, bool is_appearance, const char *name);
/* CN_ERR_USAGE: the name is in use. A path's film lies in renders/NAME, so the name of another film's folder is in use
 * too, such as that of the default flight. */
CN_NODISCARD cn_status cn_saved_check_fresh(const cn_city *city, bool is_appearance, const char *name);
/* Saves atomically. A camera path is checked first: one that cannot be rendered is not saved. */
CN_NODISCARD cn_status cn_saved_write(const cn_city *city, const cn_frame *frame, bool is_appearance, const char *name,
                                      const json_t *data);
CN_NODISCARD cn_status cn_saved_load(const cn_city *city, bool is_appearance, const char *name, json_t **data);
/* A sorted list of names; caller owns. NULL when out of memory. */
json_t *cn_saved_list(const cn_city *city, bool is_appearance);
#endif
