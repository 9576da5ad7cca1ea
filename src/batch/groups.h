/* The groups of a city's photos, as their files say. */
#ifndef CONURB_BATCH_GROUPS_H
#define CONURB_BATCH_GROUPS_H
#include "conurb/batch.h"

typedef struct cn_group_item {
    uint32_t n_photos, n_posed;
    bool done;     /* it has a model */
    bool hopeless; /* it has no poses, and another try would find none */
    char why[200]; /* why it failed; "": it did not */
} cn_group_item;
typedef struct cn_group_rows {
    cn_group_item *items; /* group 1 first */
    uint32_t n;
} cn_group_rows;
/* No groups when the city has no groups.json. The caller frees the rows. Fails only when out of memory. */
CN_NODISCARD cn_status cn_group_rows_read(const cn_city *city, cn_group_rows *rows);
void cn_group_rows_deinit(cn_group_rows *rows);
#endif
