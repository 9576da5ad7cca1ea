/* The town as surfaces: everything that stands in it is built here. */
#include "synth/town.h"

cn_status cn_town_build(const cn_town *town, cn_mesh *mesh)
{
    cn_town_build_street(town, mesh);
    for (uint32_t i = 0; i < town->n_lots; i++)
        cn_town_build_house(&town->lots[i], mesh);
    for (uint32_t i = 0; i < town->n_trees; i++)
        cn_town_build_tree(&town->trees[i], mesh);
    return mesh->full ? cn_fail(CN_ERR_NOMEM, "out of memory while building the city; give a smaller --size") : CN_OK;
}
