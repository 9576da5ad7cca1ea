/* The words around the map: title above, legend and warnings to the right. */
#include "plan/svg_panel.h"

#include <stdio.h>

#define MAX_LISTED 14u
#define MAX_WARNINGS 5u
#define LINE 17.0
#define TEXT_WIDTH (CN_SVG_PANEL_WIDTH - 24 - 20)
#define INDENT 26.0
#define BROWN "#7a3b00"

static const cn_letters heading = { .size = 15, .bold = true };
static const cn_letters small = { .size = 12, .colour = CN_CHART_GREY };

static void title(const cn_svg_map *map)
{
    const cn_frame *frame = map->input->frame;
    char text[256];
    uint32_t tiles = map->plan->n_tiles, photos = map->input->scene->n_views;
    snprintf(text, sizeof text, "%u tile%s over %u photo%s, %u held out", tiles, tiles == 1 ? "" : "s", photos,
             photos == 1 ? "" : "s", map->n_held_out);
    cn_chart_text(&map->chart, CN_SVG_MAP_LEFT, 40, &(cn_letters){ .size = 24, .bold = true }, text);
    int n = snprintf(text, sizeof text, "Layout %s, overlap %.0f %%", cn_layout_name(map->plan->layout),
                     100 * map->plan->overlap);
    if (frame->georeferenced)
        snprintf(text + n, sizeof text - (size_t)n, ". Origin %.5f, %.5f (WGS84), north is up", frame->latitude_deg,
                 frame->longitude_deg);
    else
        snprintf(text + n, sizeof text - (size_t)n, ". No GPS: local axes, units of the poses, +y is up");
    cn_chart_text(&map->chart, CN_SVG_MAP_LEFT, 64, &(cn_letters){ .size = 14, .colour = CN_CHART_GREY }, text);
}

/* The effects that are on, in as many lines as they take; returns the lowest. */
static double list_effects(const cn_svg_map *map, const cn_plan_tile *tile, double x, double y)
{
    char names[1024] = "";
    size_t n = 0;
    for (uint32_t i = 0; i < tile->n_effects && n < sizeof names; i++)
        if (tile->effects[i].on)
            n += (size_t)snprintf(names + n, sizeof names - n, "%s%s", n ? ", " : "", tile->effects[i].name);
    for (char *c = names; *c; c++)
        if (*c == '_') *c = ' ';
    const cn_text_block block = {
        .x = x, .y = y, .width = TEXT_WIDTH - INDENT, .line = LINE, .after = ',', .most_lines = UINT32_MAX
    };
    return cn_chart_wrap(&map->chart, &block, &small, names);
}

static double list_tiles(const cn_svg_map *map, double x, double y)
{
    uint32_t n = map->plan->n_tiles < MAX_LISTED ? map->plan->n_tiles : MAX_LISTED;
    char text[160];
    cn_chart_text(&map->chart, x, y, &heading, "Tiles");
    for (uint32_t i = 0; i < n; i++) {
        const cn_plan_tile *tile = &map->plan->tiles[i];
        y += 1.45 * LINE;
        const cn_paint disc = cn_svg_tile_paint(i, 0.25);
        cn_chart_circle(&map->chart, x + 8, y - 4.5, 7, &disc);
        cn_chart_text(&map->chart, x + INDENT, y, &(cn_letters){ .size = 14, .bold = true }, tile->id);
        y += LINE;
        snprintf(text, sizeof text, "%u photos, %u held out, radius %.3g %s", tile->n_photos, tile->n_held_out,
                 tile->radius_m, cn_frame_unit(map->input->frame));
        cn_chart_text(&map->chart, x + INDENT, y, &small, text);
        y = list_effects(map, tile, x + INDENT, y);
    }
    if (n < map->plan->n_tiles) {
        y += 1.45 * LINE;
        snprintf(text, sizeof text, "and %u more, in plan.json", map->plan->n_tiles - n);
        cn_chart_text(&map->chart, x + INDENT, y, &small, text);
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
    cn_chart_text(&map->chart, x, y, &heading, "Signs");
    for (size_t i = 0; i < sizeof signs / sizeof *signs; i++) {
        y += 1.45 * LINE;
        cn_svg_camera(&map->chart, &(cn_camera_sign){ .pose = { x + 9, y - (signs[i].down ? 4.5 : -1), 0 },
                                                      .down = signs[i].down,
                                                      .held = signs[i].held,
                                                      .colour = CN_CHART_GREY });
        cn_chart_text(&map->chart, x + INDENT, y, &(cn_letters){ .size = 13 }, signs[i].text);
    }
    y += 1.4 * LINE;
    cn_chart_text(&map->chart, x + INDENT, y, &small, "A photo has the colour of its nearest tile.");
    if (map->input->scene->n_points > 0)
        cn_chart_text(&map->chart, x + INDENT, y += LINE, &small, "Dots: sparse points, in their own colours.");
    return y;
}

double cn_svg_panel(const cn_svg_map *map)
{
    const uint32_t n_warnings = map->plan->n_warnings;
    double x = map->box.x1 + 24;
    title(map);
    double y = list_tiles(map, x, CN_SVG_MAP_TOP + 14);
    y = list_signs(map, x, y + 2.2 * LINE);
    if (n_warnings == 0) return y;
    y += 2.2 * LINE;
    cn_chart_text(&map->chart, x, y, &(cn_letters){ .size = 15, .bold = true, .colour = BROWN }, "Warnings");
    for (uint32_t i = 0; i < n_warnings && i < MAX_WARNINGS; i++)
        y = 0.3 * LINE +
            cn_chart_wrap(
                &map->chart,
                &(cn_text_block){ .x = x, .y = y, .width = TEXT_WIDTH, .line = LINE, .after = ' ', .most_lines = 5 },
                &(cn_letters){ .size = 12, .colour = BROWN }, map->plan->warnings[i]);
    if (n_warnings > MAX_WARNINGS) {
        char text[64];
        snprintf(text, sizeof text, "and %u more, in plan.json", n_warnings - MAX_WARNINGS);
        cn_chart_text(&map->chart, x, y += LINE, &small, text);
    }
    return y;
}
