/* Streets, blocks and lots of a synthetic city, and what stands where. */
#ifndef CONURB_SYNTH_TOWN_H
#define CONURB_SYNTH_TOWN_H
#include "synth/mesh.h"
#include "synth/synth.h"

#define CN_TOWN_STREETS 40 /* streets in each direction at most */
#define CN_ROAD_HALF_M 3.8f
#define CN_WALK_M 3.0f
#define CN_WALK_HEIGHT_M 0.14f

typedef struct cn_rect {
    float x0, y0, x1, y1;
} cn_rect;

typedef enum cn_wall { CN_WALL_BRICK, CN_WALL_PLASTER, CN_WALL_STONE, CN_WALL_CONCRETE, CN_WALL_KINDS } cn_wall;

/* A building. Sides: 0 south, 1 east, 2 north, 3 west. */
typedef struct cn_lot {
    cn_rect rect;
    float ground_floor_m, floor_m, gable_m; /* gable_m 0: a flat roof */
    uint32_t floors;                        /* above the ground floor */
    uint32_t seed;
    bool street[4], party[4]; /* faces a street; stands against a neighbour */
    bool near;                /* inside what is photographed */
} cn_lot;

typedef struct cn_tree {
    float x, y, ground, height, radius;
    uint32_t seed;
    bool near;
} cn_tree;
typedef struct cn_lamp {
    float x, y, dx, dy;
} cn_lamp; /* its foot; the arm goes along d */

typedef struct cn_town {
    uint32_t seed;
    float half_m;                                 /* half the side of what is photographed */
    float x[CN_TOWN_STREETS], y[CN_TOWN_STREETS]; /* axes of the streets, ascending */
    uint32_t n_x, n_y, centre_x, centre_y;        /* the streets at x = 0 and y = 0 */
    cn_rect *blocks;                              /* with their pavement; (n_x - 1) * (n_y - 1) */
    bool *parks;
    uint32_t n_blocks;
    cn_lot *lots;
    uint32_t n_lots, room_lots;
    cn_tree *trees;
    uint32_t n_trees, room_trees;
    cn_lamp *lamps;
    uint32_t n_lamps, room_lamps;
} cn_town;

CN_NODISCARD cn_status cn_town_init(cn_town *town, const cn_synth_options *options);
void cn_town_deinit(cn_town *town);
float cn_lot_height(const cn_lot *lot); /* of the walls */
cn_wall cn_lot_wall(uint32_t seed);     /* what the walls of a building with that seed are of */
/* Height of the highest roof within margin of a place, 0 in the open. */
float cn_town_roof(const cn_town *town, float x, float y, float margin);
/* Distance to the nearest tree trunk, lamp or bench row; large when there is none near. */
float cn_town_clearance(const cn_town *town, float x, float y);
bool cn_town_near(const cn_town *town, float x, float y, float margin);

/* Builds all of it. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_town_build(const cn_town *town, cn_mesh *mesh);
void cn_town_build_house(const cn_lot *lot, cn_mesh *mesh);
void cn_town_build_roof(const cn_lot *lot, cn_mesh *mesh);
void cn_town_build_tree(const cn_tree *tree, cn_mesh *mesh);
void cn_town_build_street(const cn_town *town, cn_mesh *mesh);

/* A car or a person standing on the ground at xy and looking along `turn`. */
void cn_town_build_car(cn_mesh *mesh, float x, float y, float turn, uint32_t seed);
void cn_town_build_person(cn_mesh *mesh, float x, float y, float z, float turn, uint32_t seed);

/* A number in [0, 1) from a seed. */
float cn_town_random(uint32_t seed, uint32_t what);
static inline float cn_town_between(uint32_t seed, uint32_t what, float low, float high)
{
    return low + (high - low) * cn_town_random(seed, what);
}
#endif
