/* Rays rendered by the context's device. */
#ifndef CONURB_RENDER_ON_DEVICE_H
#define CONURB_RENDER_ON_DEVICE_H
#include "render/march.h"

/* Lets the device of the march's context render, where there is one. What it cannot do the processor does. */
void cn_raymarch_use_device(cn_raymarch *march);
#endif
