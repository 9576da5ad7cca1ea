/* Messages that wait to be sent to a page. */
#ifndef CONURB_VIEW_OUT_H
#define CONURB_VIEW_OUT_H
#include "conurb/base.h"

enum { CN_OUT_ROOM = 32 }; /* bytes before a message that the WebSocket library writes into */

typedef struct cn_out {
    struct cn_out *next;
    int slot; /* an unsent message is replaced by the next one of its slot; -1: never */
    bool binary;
    size_t size;
    uint8_t *bytes; /* CN_OUT_ROOM free bytes, then the message */
} cn_out;
/* NULL when out of memory. bytes are copied; NULL: the caller fills them in later. */
cn_out *cn_out_create(const void *bytes, size_t size, bool binary, int slot);
void cn_out_destroy(cn_out *out);
#endif
