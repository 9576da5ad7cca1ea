#include "renderer/renderer.h"

#include <stdlib.h>
#include <string.h>

cn_status cn_renderer_display(const cn_colour *colour, const cn_display_transform *display, cn_unseen unseen,
                              const cn_picture *picture, float **rgb)
{
    const size_t n = (size_t)picture->width * picture->height;
    cn_picture shown = *picture;
    shown.rgba = malloc(n * 4 * sizeof *shown.rgba);
    *rgb = NULL;
    if (!shown.rgba)
        return cn_fail(CN_ERR_NOMEM, "out of memory for a picture of %u x %u pixels", picture->width, picture->height);
    memcpy(shown.rgba, picture->rgba, n * 4 * sizeof *shown.rgba);
    cn_status status = cn_compose_unseen(&shown, unseen);
    if (status == CN_OK) status = cn_colour_to_display(colour, display, shown.rgba, n, 4);
    if (status != CN_OK) {
        free(shown.rgba);
        return status;
    }
    for (size_t i = 0; i < n; i++)
        memmove(shown.rgba + 3 * i, shown.rgba + 4 * i, 3 * sizeof *shown.rgba);
    *rgb = shown.rgba;
    return CN_OK;
}
