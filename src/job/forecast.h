/* Predicted time and memory of training, for each preset. */
#ifndef CONURB_JOB_FORECAST_H
#define CONURB_JOB_FORECAST_H
#include "job/config.h"

/* Logs a line a tile and one for the city: each preset's time and memory on this machine. The first time measures for some seconds. */
CN_NODISCARD cn_status cn_forecast(const cn_context *ctx, const cn_config *config, const cn_plan *plan);
#endif
