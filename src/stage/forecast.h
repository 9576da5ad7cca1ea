/* Predicted time and memory of training, for each preset. */
#ifndef CONURB_STAGE_FORECAST_H
#define CONURB_STAGE_FORECAST_H
#include "city/config.h"
#include "city/workspace.h"
#include "conurb/device.h"
#include "conurb/train.h"

/* Names of the presets, by cn_quality. */
enum { CN_PRESETS = 4 };
extern const char *const cn_preset_names[CN_PRESETS];
/* The speed of this machine, from the user's cache. The caller destroys it. */
CN_NODISCARD cn_status cn_speed_open(cn_train_speed **speed);
/* Bytes that training a tile may take on this machine: most of its memory, and at most plan.max_tile_gb. */
uint64_t cn_forecast_room(const cn_config *config);
/* The device of ctx that is not the processor; NULL: there is none. */
const cn_device_info *cn_forecast_device(const cn_context *ctx);
/* Logs one line per tile and one for the city: time and memory of each preset on this machine, and what the time
 * budget of city.yaml would choose. The first call measures for some seconds. */
CN_NODISCARD cn_status cn_forecast(const cn_context *ctx, const cn_config *config, const cn_plan *plan,
                                   const cn_dataset *dataset);
/* Bytes that a tile's training takes of a device's memory, with its photos. 0: the processor has to train it. */
uint64_t cn_forecast_device_bytes(const cn_train_options *options, const cn_train_input *input);
#endif
