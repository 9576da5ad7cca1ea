#ifndef CONURB_TESTS_EMULATED_H
#define CONURB_TESTS_EMULATED_H
#include "kernel/kernel.h"
/* A set of sixteen lanes that runs on AVX2: slow, for tests. False where that is missing. */
bool emulated_fill(cn_kernel *k);
#endif
