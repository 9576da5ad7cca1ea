/* Disjoint sets (Tarjan 1975): parent[i] is i for the root of a set. A caller joins two by setting a root's parent. */
#ifndef CONURB_BASE_DISJOINT_H
#define CONURB_BASE_DISJOINT_H
#include <stdint.h>

/* The root of i's set; shortens the way to it. */
static inline uint32_t cn_root_of(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}
#endif
