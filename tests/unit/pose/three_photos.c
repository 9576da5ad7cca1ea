#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "three_photos.h"

#include "math/linalg.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

char folder[64], logged[LOGGED], path[160], said[ROOM];
const cn_context CONTEXT = { .log = log_append, .user = logged };
cn_photo photos[N];
cn_photo_index photo_index;
cn_view views[N];

int photos_make(const char *const names[N], uint32_t width, uint32_t height)
{
    static const double TURNS[N][4] = { { 1, 0, 0, 0 }, { 0.5, -0.5, 0.3, 0.1 }, { 0.1, 0.7, -0.2, 0.6 } };
    static char own[N][16], images[80];
    strcpy(folder, "/tmp/conurb-import-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(images, sizeof images, "%s/images", folder);
    for (int i = 0; i < N; i++) {
        snprintf(own[i], sizeof own[i], "%s", names[i]);
        photos[i] = (cn_photo){ .name = own[i], .width = width, .height = height, .orientation = 1 };
        views[i] = (cn_view){ .name = own[i], .photo = (uint32_t)i, .translation = { 1 + i, 2 * i - 1, 3 } };
        cn_quat_to_mat3(TURNS[i], views[i].rotation);
    }
    photo_index = (cn_photo_index){ .folder = images, .photos = photos, .n_photos = N };
    logged[0] = said[0] = '\0';
    return 0;
}

int photos_remove(void **state)
{
    (void)state;
    return folder_remove(folder);
}

void world_from_cam(int view, double sign, double m[16])
{
    double centre[3];
    cn_view_centre(&views[view], centre);
    memset(m, 0, 16 * sizeof *m);
    m[15] = 1;
    for (int row = 0; row < 3; row++) {
        for (int c = 0; c < 3; c++)
            m[4 * row + c] = (c ? sign : 1) * views[view].rotation[3 * c + row];
        m[4 * row + 3] = centre[row];
    }
}

void begin(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", folder, name);
    said[0] = '\0';
}

void say(const char *format, ...)
{
    const size_t n = strlen(said);
    va_list arguments;
    va_start(arguments, format);
    assert_true(vsnprintf(said + n, ROOM - n, format, arguments) < (int)(ROOM - n));
    va_end(arguments);
}

const char *changed(const char *old, const char *fresh)
{
    static char out[ROOM];
    const char *at = strstr(said, old);
    assert_non_null(at);
    snprintf(out, sizeof out, "%.*s%s%s", (int)(at - said), said, fresh, at + strlen(old));
    return out;
}
