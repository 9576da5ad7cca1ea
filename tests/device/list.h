/* The devices that a test of devices goes over: those of the type that its one argument names. */
#ifndef CONURB_TESTS_DEVICE_LIST_H
#define CONURB_TESTS_DEVICE_LIST_H
#include "device/device.h"

#include <stdio.h>
#include <string.h>

/* By the names that a person gives. */
static const char *choice[CN_DEVICE_MAX];
static uint32_t n_choices;

/* False, and says why, where this machine has none: the test is skipped. */
static bool list_devices(int argc, char **argv)
{
    static char names[CN_DEVICE_MAX][16];
    static cn_device_info list[CN_DEVICE_MAX];
    for (uint32_t t = 0; t < cn_device_n_types; t++) {
        const cn_device_type *type = cn_device_types[t];
        uint32_t n = 0;
        if (argc != 2 || strcmp(argv[1], type->name) != 0) continue;
        if (!type->list) choice[n_choices++] = type->name;
        if (!type->list || type->list(list, &n) != CN_OK) continue;
        for (uint32_t i = 0; i < n; i++) {
            snprintf(names[i], sizeof names[i], "%s:%u", type->name, i);
            if (list[i].fit) choice[n_choices++] = names[i];
        }
    }
    if (!n_choices) printf("skipped: %s\n", cn_error_message());
    return n_choices > 0;
}
#endif
