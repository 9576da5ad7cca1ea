/* What a page asks for: one JSON object a message. Every byte is foreign. */
#ifndef CONURB_VIEW_REQUEST_H
#define CONURB_VIEW_REQUEST_H
#include "conurb/pose.h"

#include <jansson.h>

enum { CN_ASK_MAX_BYTES = 262144, CN_ASK_MAX_PIXELS = 8 << 20, CN_ASK_MAX_SIDE = 4096 };
/* A viewer has so many pictures in the making at once: the view, the one beside it, a thumbnail, a probe of depth. */
enum { CN_ASK_SLOTS = 4, CN_ASK_SLOT_PROBE = 3 };

typedef enum cn_ask_kind {
    CN_ASK_VIEW,      /* a picture */
    CN_ASK_CANCEL,    /* the picture of a slot is not wanted any more */
    CN_ASK_CITY,      /* what there is: tiles, photos, views and looks */
    CN_ASK_TILE,      /* a tile's effects and training curve */
    CN_ASK_POINTS,    /* the sparse points */
    CN_ASK_PHOTO,     /* a photo, as JPEG */
    CN_ASK_TRANSIENT, /* what training took for standing in that photo only */
    CN_ASK_SAVE,
    CN_ASK_LIST,
    CN_ASK_LOAD,
    CN_ASK_FILM,     /* render a saved path */
    CN_ASK_FILM_STOP /* and give that up */
} cn_ask_kind;

typedef enum cn_channel {
    CN_CHANNEL_COLOUR,
    CN_CHANNEL_DEPTH,
    CN_CHANNEL_NORMAL,
    CN_CHANNEL_OPACITY,
    CN_CHANNEL_TILES /* which tile drew what */
} cn_channel;

/* Texts are "" where the page gave none. */
typedef struct cn_ask {
    cn_ask_kind kind;
    uint32_t id; /* the page's own number, which the answer repeats */
    /* CN_ASK_VIEW; slot of CN_ASK_CANCEL too */
    uint32_t slot;
    cn_camera camera; /* a pinhole */
    cn_view view;     /* without a name */
    bool moving;      /* one quick picture; else it is refined pass by pass */
    cn_channel channel;
    double exposure_ev;
    char appearance[600], blend[32], display_view[64], look[64];
    /* of photo, tile, path or light */
    char name[256];
    uint32_t width;     /* of a photo or a film */
    bool is_appearance; /* CN_ASK_SAVE, CN_ASK_LIST, CN_ASK_LOAD: a light, else a path */
    json_t *data;       /* CN_ASK_SAVE */
} cn_ask;

/* Reads a message; whoever calls deinits. CN_ERR_USAGE says what is wrong with it, and nothing has to be freed then. */
CN_NODISCARD cn_status cn_ask_parse(cn_ask *ask, const char *text, size_t size);
void cn_ask_deinit(cn_ask *ask);
/* Whether a name can be a file's: letters, digits, blank, '_', '-', 1 to 64 of them, the first no blank. */
bool cn_ask_name_is_safe(const char *name);
#endif
