/* Colours, text and signs that the map and the words around it share. */
#include "plan/svg_marks.h"

const char *cn_svg_colour(uint32_t tile)
{
    /* Okabe and Ito's palette, told apart by colour-blind readers too. */
    static const char *const colours[] = { "#0072b2", "#d98200", "#009e73", "#a34f8f",
                                           "#3a9bd9", "#8a7a00", "#5b5bd6", "#007a7a" };
    return colours[tile % (sizeof colours / sizeof *colours)];
}

void cn_svg_text(FILE *out, double x, double y, const char *attributes, const char *text)
{
    fprintf(out, "<text x=\"%.1f\" y=\"%.1f\" %s>", x, y, attributes);
    for (const char *c = text; *c; c++) {
        if (*c == '<')
            fputs("&lt;", out);
        else if (*c == '&')
            fputs("&amp;", out);
        else if ((unsigned char)*c >= 0x20)
            fputc(*c, out);
    }
    fputs("</text>\n", out);
}

void cn_svg_camera(FILE *out, double x, double y, double turn_deg, bool down, const char *colour, bool held)
{
    /* A frustum opens upwards from its apex, which is where the camera stands; the photo from above has a tick on its
     * top edge. */
    const char *shape =
        down ? "M-7 -4.7h14v9.4h-14zM0 -4.7v-4" : "M0 0L-6 -12H6zM0 0m-1.8 0a1.8 1.8 0 1 0 3.6 0a1.8 1.8 0 1 0 -3.6 0";
    fprintf(
        out,
        "<path transform=\"translate(%.1f %.1f) rotate(%.1f)\" d=\"%s\" fill=\"%s\" fill-opacity=\"%s\" stroke=\"%s\" "
        "stroke-width=\"1.6\" stroke-linejoin=\"round\"/>\n",
        x, y, turn_deg, shape, held ? "#fff" : colour, held ? "0.9" : "0.55", held ? CN_SVG_HELD_OUT : colour);
}
