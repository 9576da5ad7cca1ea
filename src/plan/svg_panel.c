/* The words around the map: title above, legend and warnings to the right. */
#include "plan/svg_panel.h"

#include <math.h>
#include <string.h>

#define MAX_LISTED 14u
#define MAX_WARNINGS 5u
#define LINE 17.0
#define WRAP 44u /* characters of 12 px that fit beside the map */

static void title(const cn_svg_map *map)
{
    const cn_frame *frame = map->input->frame;
    char text[256];
    uint32_t tiles = map->plan->n_tiles, photos = map->input->scene->n_views;
    snprintf(text, sizeof text, "%u tile%s over %u photo%s, %u held out", tiles, tiles == 1 ? "" : "s", photos,
             photos == 1 ? "" : "s", map->n_held_out);
    cn_svg_text(map->out, CN_SVG_MAP_LEFT, 40, "font-size=\"24\" font-weight=\"bold\"", text);
    int n = snprintf(text, sizeof text, "Layout %s, overlap %.0f %%", cn_layout_name(map->plan->layout),
                     100 * map->plan->overlap);
    if (frame->georeferenced)
        snprintf(text + n, sizeof text - (size_t)n, ". Origin %.5f, %.5f (WGS84), north is up", frame->latitude_deg,
                 frame->longitude_deg);
    else
        snprintf(text + n, sizeof text - (size_t)n, ". No GPS: local axes, units of the poses, +y is up");
    cn_svg_text(map->out, CN_SVG_MAP_LEFT, 64, "font-size=\"14\" fill=\"#555\"", text);
}

#define GREY "font-size=\"12\" fill=\"#555\""

/* The effects that are on, in as many lines as they take. */
static double list_effects(const cn_svg_map *map, const cn_plan_tile *tile, double x, double y)
{
    char line[2 * WRAP] = "";
    for (uint32_t i = 0; i < tile->n_effects; i++) {
        char name[WRAP];
        if (!tile->effects[i].on) continue;
        snprintf(name, sizeof name, "%s", tile->effects[i].name);
        for (char *c = name; *c; c++)
            if (*c == '_') *c = ' ';
        size_t n = strlen(line);
        if (n) line[n++] = ',';
        line[n] = '\0';
        if (n && n + 1 + strlen(name) >= WRAP) {
            cn_svg_text(map->out, x, y += LINE, GREY, line);
            n = 0;
        }
        snprintf(line + n, sizeof line - n, "%s%s", n ? " " : "", name);
    }
    if (*line) cn_svg_text(map->out, x, y += LINE, GREY, line);
    return y;
}

static double list_tiles(const cn_svg_map *map, double x, double y)
{
    uint32_t n = map->plan->n_tiles < MAX_LISTED ? map->plan->n_tiles : MAX_LISTED;
    char text[160];
    cn_svg_text(map->out, x, y, "font-size=\"15\" font-weight=\"bold\"", "Tiles");
    for (uint32_t i = 0; i < n; i++) {
        const cn_plan_tile *tile = &map->plan->tiles[i];
        y += 1.45 * LINE;
        fprintf(map->out,
                "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"7\" fill=\"%s\" fill-opacity=\"0.25\" stroke=\"%s\" "
                "stroke-width=\"2\"/>\n",
                x + 8, y - 4.5, cn_svg_colour(i), cn_svg_colour(i));
        cn_svg_text(map->out, x + 26, y, "font-size=\"14\" font-weight=\"bold\"", tile->id);
        y += LINE;
        snprintf(text, sizeof text, "%u photos, %u held out, radius %.3g %s", tile->n_photos, tile->n_held_out,
                 tile->radius_m, cn_frame_unit(map->input->frame));
        cn_svg_text(map->out, x + 26, y, "font-size=\"12\" fill=\"#333\"", text);
        y = list_effects(map, tile, x + 26, y);
    }
    if (n < map->plan->n_tiles) {
        y += 1.45 * LINE;
        snprintf(text, sizeof text, "and %u more, in plan.json", map->plan->n_tiles - n);
        cn_svg_text(map->out, x + 26, y, "font-size=\"12\" fill=\"#333\"", text);
    }
    return y;
}

static double list_signs(const cn_svg_map *map, double x, double y)
{
    static const struct {
        const char *text;
        bool down, held;
    } signs[] = {
        { "photo, looking the way that it opens", false, false },
        { "photo, looking down (tick: its top edge)", true, false },
        { "held out: never trained on", true, true },
    };
    cn_svg_text(map->out, x, y, "font-size=\"15\" font-weight=\"bold\"", "Signs");
    for (size_t i = 0; i < sizeof signs / sizeof *signs; i++) {
        y += 1.45 * LINE;
        cn_svg_camera(map->out, x + 9, y - (signs[i].down ? 4.5 : -1), 0, signs[i].down, "#666", signs[i].held);
        cn_svg_text(map->out, x + 26, y, "font-size=\"13\"", signs[i].text);
    }
    y += 1.4 * LINE;
    cn_svg_text(map->out, x + 26, y, "font-size=\"12\" fill=\"#555\"", "A photo has the colour of its nearest tile.");
    if (map->input->scene->n_points > 0)
        cn_svg_text(map->out, x + 26, y += LINE, "font-size=\"12\" fill=\"#555\"",
                    "Dots: sparse points, in their own colours.");
    return y;
}

/* Breaks at spaces; at most 5 lines. */
static double wrap(const cn_svg_map *map, double x, double y, const char *text)
{
    for (int lines = 0; *text && lines < 5; lines++) {
        char line[WRAP + 4];
        size_t n = strlen(text);
        if (n > WRAP) {
            for (n = WRAP; n > WRAP / 2 && text[n] != ' ';)
                n--;
        }
        snprintf(line, sizeof line, "%.*s%s", (int)n, text, lines == 4 && text[n] ? "..." : "");
        cn_svg_text(map->out, x, y += LINE, "font-size=\"12\" fill=\"#7a3b00\"", line);
        text += n + (text[n] == ' ');
    }
    return y + 0.3 * LINE;
}

double cn_svg_panel(const cn_svg_map *map)
{
    const uint32_t n_warnings = map->plan->n_warnings;
    double x = CN_SVG_MAP_LEFT + map->width + 24;
    title(map);
    double y = list_tiles(map, x, CN_SVG_MAP_TOP + 14);
    y = list_signs(map, x, y + 2.2 * LINE);
    if (n_warnings == 0) return y;
    y += 2.2 * LINE;
    cn_svg_text(map->out, x, y, "font-size=\"15\" font-weight=\"bold\" fill=\"#7a3b00\"", "Warnings");
    for (uint32_t i = 0; i < n_warnings && i < MAX_WARNINGS; i++)
        y = wrap(map, x, y, map->plan->warnings[i]);
    if (n_warnings > MAX_WARNINGS) {
        char text[64];
        snprintf(text, sizeof text, "and %u more, in plan.json", n_warnings - MAX_WARNINGS);
        cn_svg_text(map->out, x, y += LINE, GREY, text);
    }
    return y;
}
