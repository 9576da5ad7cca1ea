/* Internals of planning: views and what they see, the layout of tiles, and the views of each tile. */
#ifndef CONURB_PLAN_PLAN_H
#define CONURB_PLAN_PLAN_H
#include "conurb/plan.h"
#include "base/json.h"

#define CN_PLAN_VERSION                                                                                                \
    2 /* version 2 has photo lists as runs of indices; a plan with names is written as version 1                       \
       */

/* What one view sees. Its anchor is the middle of what it sees: centre + distance_m * forward; forward is 0 for a photo
 * of all directions. Tiles are laid out by anchors, not by cameras: cameras around one object share an anchor; those of
 * a survey have one each. */
typedef struct cn_plan_view {
    double centre[3], forward[3], anchor[3];
    double distance_m;    /* median distance to the points that it sees, or to the scene's focus */
    uint64_t first_point; /* into cn_plan_views.seen */
    uint32_t n_points;
} cn_plan_view;

typedef struct cn_plan_views {
    cn_plan_view *views;
    uint32_t n;
    uint32_t *seen;    /* point indices, view by view */
    double distance_m; /* median of the views' */
    double guess_m;    /* distance_m; where neither points nor axes tell it, how far views see at least, by a guess */
    double span_m;     /* distance_m; then the cameras' spread */
    double focus[3];   /* the place nearest to all optical axes, or the middle of the anchors */
    bool no_parallax;  /* all photos at one place */
    bool has_points;
} cn_plan_views;

/* O(observations): the points of each view from the tracks. spacing_m: of the options. Where neither points nor optical
 * axes tell the viewing distance, it is spacing_m if that is above 0, but not more than the cameras' spread, or else
 * this spread. */
CN_NODISCARD cn_status cn_plan_views_make(cn_plan_views *views, const cn_scene *scene, double spacing_m);
void cn_plan_views_deinit(cn_plan_views *views);

/* Circles of one radius in the plane, with an index for lookup by place. */
typedef struct cn_plan_circles {
    double (*centre)[2];
    uint32_t n; /* room for capacity */
    uint32_t capacity;
    double radius_m;
    uint64_t *cells;
    uint32_t *order; /* the index: cells of radius_m, sorted; made by cn_plan_circles_index */
} cn_plan_circles;

CN_NODISCARD cn_status cn_plan_circles_index(cn_plan_circles *circles);
void cn_plan_circles_deinit(cn_plan_circles *circles);
/* Indices of the circles that contain the place, at most max, in any order. */
uint32_t cn_plan_circles_at(const cn_plan_circles *circles, const double place[2], uint32_t *found, uint32_t max);

/* The circle with the nearest centre, among those that are not gone[]; at least one must remain. */
uint32_t cn_plan_circles_nearest(const cn_plan_circles *circles, const double place[2], const bool *gone);

/* Centres and radius by options->layout; *spacing_m the distance between neighbouring centres (0: a single tile). */
CN_NODISCARD cn_status cn_plan_layout(cn_plan_circles *circles, const cn_plan_views *views, const cn_frame *frame,
                                      const cn_plan_options *options, double *spacing_m);
/* The points of a GeoJSON file, in local metres. *places: [n][2], caller frees. */
CN_NODISCARD cn_status cn_plan_read_centres(const char *path, const cn_frame *frame, double (**places)[2], uint32_t *n);

/* Lists of views in files, see runs.c. The text is NULL when out of memory; caller frees it, and the views. Reading:
 * CN_ERR_FORMAT where the text holds anything but ascending indices below limit. */
void cn_plan_views_hash(const cn_scene *scene, char hex[17]);
char *cn_plan_runs_write(const uint32_t *views, uint32_t n);
CN_NODISCARD cn_status cn_plan_runs_read(const char *text, uint32_t limit, const char *where, uint32_t **views,
                                         uint32_t *n);

/* A growing list of view indices. */
typedef struct cn_plan_list {
    uint32_t *items;
    uint32_t n, capacity;
} cn_plan_list;
CN_NODISCARD cn_status cn_plan_list_add(cn_plan_list *list, uint32_t item);

/* A plan in progress: the photos, the circles, and the views of each circle. */
typedef struct cn_plan_draft {
    const cn_plan_input *input;
    const cn_plan_options *options;
    cn_plan_views views;
    cn_plan_circles circles;
    cn_plan_list *lists; /* the views of each circle, ascending */
    double *radius_m;    /* of each circle; 0: that of all circles */
    bool *held;          /* of each view: never trained on */
    uint32_t n_left;     /* views in no circle, which were given to the nearest */
    uint32_t one_left;   /* one of them */
    uint32_t n_joined;   /* circles that were left out for having the photos of another */
} cn_plan_draft;
/* Fills the lists and radii, which the caller zeroed: by place or by the points seen. Circles with too few training
 * photos are dropped from all arrays (circles.n falls). So are those with the same photos as another, unless the
 * options say where tiles are or how far apart: they would train the same tile twice. The one that is left goes to the
 * middle of them, with a radius that holds their cameras. */
CN_NODISCARD cn_status cn_plan_members(cn_plan_draft *draft);

/* centre[2], bounds, near and far of a tile whose photos and held-out photos are known. */
CN_NODISCARD cn_status cn_plan_extent(cn_plan_tile *tile, const cn_plan_views *views, const cn_scene *scene);
/* Ids for all tiles, unique; then sorts the tiles by id. */
CN_NODISCARD cn_status cn_plan_ids(cn_plan *plan, const cn_frame *frame);
/* A tile's photos ordered by position, then direction, then name, so that neighbours see nearly the same. The caller
 * frees *order, which has n entries. */
typedef struct cn_plan_rank {
    uint32_t key, view;
} cn_plan_rank;
CN_NODISCARD cn_status cn_plan_rank_views(const cn_plan_tile *tile, const cn_plan_views *views, const uint32_t *list,
                                          uint32_t n, cn_plan_rank **order);

/* Thins a tile's photos to options->max_tile_photos. */
CN_NODISCARD cn_status cn_plan_budget_photos(cn_plan_tile *tile, const cn_plan_views *views,
                                             const cn_plan_options *options);
/* Estimates the cost of a tile whose effects are known, and thins its photos until it fits options->max_tile_bytes.
 * *too_big: not even min_photos fit; then nothing is thinned. */
CN_NODISCARD cn_status cn_plan_budget_bytes(cn_plan_tile *tile, const cn_plan_views *views,
                                            const cn_plan_options *options, bool *too_big);

/* Scratch: the part of the scene that a tile's photos see. Reused for the next tile. */
typedef struct cn_plan_part {
    cn_scene scene;             /* cameras and names are borrowed */
    uint32_t *row;              /* of each of the city's views in scene.views; UINT32_MAX */
    bool *known;                /* of each of the city's points */
    uint32_t *photos, *points;  /* 0, 1, 2 ...; the city's points that scene.points are */
    uint32_t *chosen, n_chosen; /* the city's views that scene.views are, ascending */
    uint64_t room_points, room_scene, room_observations;
} cn_plan_part;
CN_NODISCARD cn_status cn_plan_part_init(cn_plan_part *part, const cn_scene *scene);
void cn_plan_part_deinit(cn_plan_part *part);
/* cn_plan_effects on at most 512 of the tile's photos and what they see: O(that), not O(city). One part a thread. */
CN_NODISCARD cn_status cn_plan_part_effects(cn_plan_part *part, cn_plan_tile *tile, const cn_plan_views *views,
                                            const cn_plan_input *input, const cn_plan_options *options);
CN_NODISCARD cn_status cn_plan_effects(cn_plan_tile *tile, const cn_plan_input *input, const cn_plan_options *options);

CN_NODISCARD cn_status cn_plan_warn(const cn_context *ctx, cn_plan *plan, const char *format, ...) CN_PRINTF(3, 4);
const char *cn_layout_name(cn_layout layout);

CN_NODISCARD cn_status cn_plan_write_geojson(const cn_plan *plan, const cn_plan_input *input, const char *path);
CN_NODISCARD cn_status cn_plan_write_svg(const cn_plan *plan, const cn_plan_input *input, const char *path);
#endif
