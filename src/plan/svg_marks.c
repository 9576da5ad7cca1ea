/* Signs that the map and the words around it share. */
#include "plan/svg_marks.h"

void cn_svg_camera(const cn_chart *chart, const cn_camera_sign *sign)
{
    /* A frustum opens upwards from its apex, which is where the camera stands; the photo from above has a tick on its
     * top edge. */
    const char *shape = sign->down ? "M-7 -4.7h14v9.4h-14zM0 -4.7v-4"
                                   : "M0 0L-6 -12H6zM0 0m-1.8 0a1.8 1.8 0 1 0 3.6 0a1.8 1.8 0 1 0 -3.6 0";
    cn_chart_path(chart, shape, &sign->pose,
                  &(cn_paint){ .fill = sign->held ? "#fff" : sign->colour,
                               .opacity = sign->held ? 0.9 : 0.55,
                               .stroke = sign->held ? CN_CHART_RED : sign->colour,
                               .width = 1.6 });
}

cn_paint cn_svg_tile_paint(uint32_t tile, double opacity)
{
    return (cn_paint){ .fill = cn_chart_colour(tile), .opacity = opacity, .stroke = cn_chart_colour(tile), .width = 2 };
}
