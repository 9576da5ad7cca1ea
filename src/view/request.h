/* Requests of a page: one JSON object per message. A photo to fit a light to comes as a binary message: the length of
 * its head (4 bytes, little endian), the head (JSON), and the file. The input is not trusted. */
#ifndef CONURB_VIEW_REQUEST_H
#define CONURB_VIEW_REQUEST_H
#include "conurb/pose.h"

#include <jansson.h>

enum { CN_ASK_MAX_BYTES = 262144, CN_ASK_MAX_UPLOAD = 32 << 20, CN_ASK_MAX_PHOTO_PIXELS = 128 << 20 };
enum { CN_ASK_MAX_PIXELS = 8 << 20, CN_ASK_MAX_SIDE = 4096 };
/* Pictures that a page may have in progress: the view, the comparison, a thumbnail, a depth query. */
enum { CN_ASK_SLOTS = 4, CN_ASK_SLOT_PROBE = 3 };

typedef enum cn_ask_kind {
    CN_ASK_VIEW,      /* a picture */
    CN_ASK_CANCEL,    /* cancel the picture of a slot */
    CN_ASK_CITY,      /* facts: tiles, photos, views and looks */
    CN_ASK_TILE,      /* a tile's effects and training curve */
    CN_ASK_POINTS,    /* the sparse points */
    CN_ASK_PHOTO,     /* a photo, as JPEG */
    CN_ASK_TRANSIENT, /* the transients of a photo */
    CN_ASK_SAVE,
    CN_ASK_LIST,
    CN_ASK_LOAD,
    CN_ASK_FILM,      /* render a saved path */
    CN_ASK_FILM_STOP, /* stop rendering it, or fitting */
    CN_ASK_FILM_SHOW, /* the film, to be played in the page, or one of its pictures */
    CN_ASK_FIT        /* fit a light to a photo; only as a binary message */
} cn_ask_kind;

typedef enum cn_channel {
    CN_CHANNEL_COLOUR,
    CN_CHANNEL_DEPTH,
    CN_CHANNEL_NORMAL,
    CN_CHANNEL_OPACITY,
    CN_CHANNEL_TILES, /* the tile of each pixel */
    CN_CHANNEL_OCCLUSION,
    CN_CHANNEL_COVERAGE /* how many photos support the surface */
} cn_channel;

/* A parsed request. A text that the page did not give is "". */
typedef struct cn_ask {
    cn_ask_kind kind;
    uint32_t id; /* the page's own number, which the answer repeats */
    /* CN_ASK_VIEW; slot of CN_ASK_CANCEL too */
    uint32_t slot;
    cn_camera camera; /* a pinhole */
    cn_view view;     /* without a name */
    bool moving;      /* one fast picture; else it is refined pass by pass */
    cn_channel channel;
    double exposure_ev;
    bool cropped;
    double crop_m[6];                 /* as in cn_render_options */
    char appearance[2048], blend[32]; /* these and the crop: of a film too */
    char display_view[64], look[64];  /* these and exposure_ev: of a film and a photo too */
    char photo[256]; /* "", or the photo whose pose and lens the picture has, instead of the ones above */
    /* of photo, tile, path or light */
    char name[256];
    uint32_t width;     /* of a photo or a film */
    bool straight;      /* CN_ASK_PHOTO: without the distortion of its lens */
    uint32_t frame;     /* CN_ASK_FILM_SHOW: this one of its pictures, from 1; 0: the film */
    bool is_appearance; /* CN_ASK_SAVE, CN_ASK_LIST, CN_ASK_LOAD: a light, else a path */
    json_t *data;       /* CN_ASK_SAVE, */
    bool fresh;         /* which replaces nothing */
    uint8_t *bytes;     /* CN_ASK_FIT: the photo's file */
    size_t n_bytes;
} cn_ask;

/* Parses a message; the caller deinits the result. CN_ERR_USAGE: the message says what is wrong; then there is nothing
 * to free, and id is the request's, or 0 where it has none. */
CN_NODISCARD cn_status cn_ask_parse(cn_ask *ask, const char *text, size_t size);
/* The same for a binary message. Copies the file. */
CN_NODISCARD cn_status cn_ask_parse_upload(cn_ask *ask, const uint8_t *message, size_t size);
void cn_ask_deinit(cn_ask *ask);
/* Whether a name is safe as a file name: 1 to 64 letters, digits, blanks, '_' or '-'; the first is not a blank. */
bool cn_ask_name_is_safe(const char *name);
#endif
