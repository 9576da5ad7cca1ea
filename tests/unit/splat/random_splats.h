/* Splats at random, for tests that write and read them. */
#ifndef CONURB_TEST_RANDOM_SPLATS_H
#define CONURB_TEST_RANDOM_SPLATS_H
#include "conurb/splat.h"

/* n splats, at most reach_m from the origin along each axis; the same for the same seed. The caller destroys them. */
cn_splats *random_splats(uint32_t n, uint32_t degree, const double origin[3], float reach_m, uint64_t seed);
#endif
