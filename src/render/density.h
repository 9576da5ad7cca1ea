/* Density of a tile at places of one's own choice: for normals and ambient occlusion. One thread uses a probe, or a
 * density field, at a time. */
#ifndef CONURB_RENDER_DENSITY_H
#define CONURB_RENDER_DENSITY_H
#include "tile/model.h"

enum { CN_DENSITY_PANELS = 8, CN_DENSITY_PLACES = CN_DENSITY_PANELS * CN_PANEL };
typedef struct cn_density_probe {
    const cn_tile *tile;
    const cn_kernel *kernel;
    cn_arena memory;
    cn_field_acts acts;
    float *pos, *logit, inv_extent;
} cn_density_probe;
/* The tile is borrowed. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_density_probe_init(cn_density_probe *probe, const cn_context *ctx, const cn_tile *tile);
void cn_density_probe_deinit(cn_density_probe *probe); /* fine when zeroed */
/* sigma[n] in 1/m at n places (local metres). 0 where the tile is empty. */
void cn_density_probe_at(cn_density_probe *probe, size_t n, const double (*xyz)[3], float *sigma);
/* Signed distances in metres, positive in free space, of a tile whose field has them (cn_field_type.distance). */
void cn_density_probe_distance(cn_density_probe *probe, size_t n, const double (*xyz)[3], float *distance_m);

/* Density at many places at once, on the context's device. */
typedef struct cn_density_field {
    const cn_context *ctx;
    const cn_tile *tile;
    cn_density_probe *probes; /* [threads] */
    size_t most;
    float (*place)[4], *logit; /* [most]: of the places that are not empty */
    uint32_t *which;           /* [most]: their numbers */
} cn_density_field;
/* ctx and tile are borrowed. most: places of one call. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_density_field_init(cn_density_field *field, const cn_context *ctx, const cn_tile *tile,
                                             size_t most);
void cn_density_field_deinit(cn_density_field *field); /* fine when zeroed */
/* As cn_density_probe_at; xyz and sigma are the caller's. CN_ERR_INTERRUPTED: asked to stop. */
CN_NODISCARD cn_status cn_density_field_at(cn_density_field *field, size_t n, const double (*xyz)[3], float *sigma);
#endif
