/* The channels of a frame as files: layers of its EXR, and a PNG each. */
#ifndef CONURB_STAGE_AOV_FILES_H
#define CONURB_STAGE_AOV_FILES_H
#include "bridge/oiio.h"
#include "conurb/render.h"

/* As Nuke and Cycles name them: depth.Z, normal.X, normal.Y, normal.Z, opacity.A, ambient_occlusion.Y, coverage.Y.
 * Ends with a NULL name. */
enum { CN_AOV_LAYERS = CN_AOV_COUNT + 3 };
void cn_aov_layers(const cn_aovs *aovs, cn_oiio_channel layers[CN_AOV_LAYERS]);
/* PNG beside the picture: F.png to F.depth.png and so on. Caller frees; NULL when out of memory. */
char *cn_aov_png_path(const char *png, unsigned aov);
bool cn_aov_pngs_exist(const char *png, unsigned which);
CN_NODISCARD cn_status cn_aov_pngs_remove(const char *png);
/* Each channel as grey or RGB. Depth is near / (near + depth), so that near is bright; a normal n is n / 2 + 1/2; 16
 * photos of coverage are white. */
CN_NODISCARD cn_status cn_aov_write_pngs(const cn_aovs *aovs, const char *png, double near_m,
                                         const cn_oiio_attribute *attributes);
#endif
