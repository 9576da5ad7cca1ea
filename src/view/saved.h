/* What viewers save: camera paths, as `conurb render --path` takes them, and lights. One file each, below CITY/views.
 */
#ifndef CONURB_VIEW_SAVED_H
#define CONURB_VIEW_SAVED_H
#include "city/workspace.h"

#include <jansson.h>

/* The file of a name that cn_ask_name_is_safe; caller frees; NULL when out of memory. */
char *cn_saved_path(const cn_city *city, bool is_appearance, const char *name);
/* A path is first read as a render would read it: one that could not be rendered is not saved. Whole, or not at all,
 * whenever the process ends. */
CN_NODISCARD cn_status cn_saved_write(const cn_city *city, const cn_frame *frame, bool is_appearance, const char *name,
                                      const json_t *data);
CN_NODISCARD cn_status cn_saved_load(const cn_city *city, bool is_appearance, const char *name, json_t **data);
/* A sorted list of names; caller owns. NULL when out of memory. */
json_t *cn_saved_list(const cn_city *city, bool is_appearance);
#endif
