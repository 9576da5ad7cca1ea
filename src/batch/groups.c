#include "batch/groups.h"

#include "base/file.h"
#include "base/json.h"
#include "city/workspace.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static json_t *load(const cn_city *city, uint32_t group, const char *name)
{
    char *path = group ? cn_format("%s/poses/groups/%03u/%s", city->folder, group, name)
                       : cn_format("%s/poses/groups/%s", city->folder, name);
    json_t *root = NULL;
    if (path && cn_file_exists(path) && cn_json_load(path, &root) != CN_OK) root = NULL;
    free(path);
    return root;
}

/* Files of other photos or settings do not count. */
static bool is_of(const json_t *root, const char *key)
{
    const char *theirs = json_string_value(json_object_get(root, "key"));
    return theirs && key && strcmp(theirs, key) == 0;
}

static void read_item(const cn_city *city, uint32_t group, const char *key, cn_group_item *item)
{
    json_t *done = load(city, group, "group.json"), *error = load(city, group, "error.json");
    item->done = is_of(done, key);
    item->n_posed = item->done ? (uint32_t)json_integer_value(json_object_get(done, "registered")) : 0;
    if (!item->done && is_of(error, key)) {
        const char *why = json_string_value(json_object_get(error, "message"));
        snprintf(item->why, sizeof item->why, "%.190s", why && *why ? why : "no reason is known");
        item->hopeless = json_integer_value(json_object_get(error, "status")) == CN_ERR_DATA;
    }
    json_decref(done);
    json_decref(error);
}

cn_status cn_group_rows_read(const cn_city *city, cn_group_rows *rows)
{
    json_t *root = load(city, 0, "groups.json");
    const json_t *list = json_object_get(root, "groups");
    const char *key = json_string_value(json_object_get(root, "key"));
    *rows = (cn_group_rows){ .n = (uint32_t)json_array_size(list) };
    rows->items = calloc(rows->n + (size_t)1, sizeof *rows->items);
    if (!rows->items) {
        json_decref(root);
        rows->n = 0;
        return cn_fail(CN_ERR_NOMEM, "out of memory for the groups of %s", city->folder);
    }
    for (uint32_t i = 0; i < rows->n; i++) {
        const json_t *group = json_array_get(list, i);
        rows->items[i].n_photos = (uint32_t)(json_array_size(json_object_get(group, "core")) +
                                             json_array_size(json_object_get(group, "shared")));
        read_item(city, i + 1, key, &rows->items[i]);
    }
    json_decref(root);
    return CN_OK;
}

void cn_group_rows_deinit(cn_group_rows *rows)
{
    free(rows->items);
    *rows = (cn_group_rows){ 0 };
}
