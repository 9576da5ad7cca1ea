#include "geo/tile_box.h"

#include <math.h>

static json_t *box_of(const json_t *tile)
{
    return json_object_get(json_object_get(tile, "boundingVolume"), "box");
}

void cn_tile_box_widen(json_t *tile)
{
    json_t *box = box_of(tile), *child;
    size_t i;
    json_array_foreach(json_object_get(tile, "children"), i, child)
    {
        cn_tile_box_widen(child);
        const json_t *other = box_of(child);
        for (size_t k = 0; k < 3; k++) {
            const double a = json_number_value(json_array_get(box, k)),
                         h = json_number_value(json_array_get(box, 3 + 4 * k));
            const double b = json_number_value(json_array_get(other, k));
            const double g = json_number_value(json_array_get(other, 3 + 4 * k));
            const double low = fmin(a - h, b - g), high = fmax(a + h, b + g);
            json_array_set_new(box, k, cn_json_real((low + high) / 2));
            json_array_set_new(box, 3 + 4 * k, cn_json_real((high - low) / 2));
        }
    }
}

double cn_tile_box_across(const json_t *tile)
{
    const json_t *box = box_of(tile);
    double sum = 0;
    for (size_t k = 0; k < 3; k++)
        sum += pow(json_number_value(json_array_get(box, 3 + 4 * k)), 2);
    return 2 * sqrt(sum);
}
