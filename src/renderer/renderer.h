/* The inside of a renderer. Stages render with it on their own thread; its own thread renders jobs. */
#ifndef CONURB_RENDERER_RENDERER_H
#define CONURB_RENDERER_RENDERER_H
#include "conurb/colour.h"
#include "conurb/renderer.h"
#include "renderer/alignment.h"
#include "renderer/aov.h"

#include <pthread.h>

struct cn_renderer {
    cn_context ctx;
    const cn_city *city;
    const cn_dataset *dataset;
    cn_dataset own; /* when no dataset was lent */
    bool read_only;
    pthread_mutex_t turn; /* held while rendering: tiles and pool are for one caller at a time */
    cn_tile_cache tiles;
    cn_colour *colour; /* for jobs */
    /* the queue, under the lock */
    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct cn_render_job *first; /* unfinished jobs, oldest first */
    pthread_t thread;
    bool started, closing;
};

/* For stages: the dataset and the folder of tiles are borrowed until the renderer is destroyed. */
CN_NODISCARD cn_status cn_renderer_open(cn_renderer **renderer, const cn_context *ctx, const cn_city *city,
                                        const cn_dataset *dataset, const char *folder);
/* Renders on the calling thread, with its context: all tiles blended, or one tile (below tiles.n) alone. */
enum { CN_RENDERER_BLEND = -1 };
CN_NODISCARD cn_status cn_renderer_draw(cn_renderer *renderer, const cn_context *ctx, const cn_tile_cache_view *view,
                                        int64_t tile, cn_picture *picture);
/* The same, and what is asked for beside it. Caller deinits aovs. */
CN_NODISCARD cn_status cn_renderer_draw_aovs(cn_renderer *renderer, const cn_context *ctx,
                                             const cn_tile_cache_view *view, unsigned which, cn_picture *picture,
                                             cn_aovs *aovs);
/* What short rays show, each by the tile that owns the middle of its range (blended at borders, as with ownership).
 * rgba[n][4] is the caller's: linear, premultiplied. */
typedef struct cn_renderer_light {
    const cn_render_options *options;
    const cn_appearance_spec *appearance;
    const double (*range_m)[2]; /* of each ray, metres along it */
} cn_renderer_light;
CN_NODISCARD cn_status cn_renderer_shade(cn_renderer *renderer, const cn_context *ctx, const cn_renderer_light *light,
                                         const cn_ray_list *rays, float *rgba);
/* cn_tile_cache_align, and a row of an appearance in one tile. */
CN_NODISCARD cn_status cn_renderer_align(cn_renderer *renderer, const cn_context *ctx, const cn_appearance_spec *spec,
                                         bool make, uint64_t *hash);
CN_NODISCARD cn_status cn_renderer_row(cn_renderer *renderer, const cn_context *ctx, const cn_appearance_spec *spec,
                                       const cn_tile *tile, cn_appearance *row);

/* Encodes a picture for the display: *rgb[height * width * 3]; the caller frees it. NULL after a failure. */
CN_NODISCARD cn_status cn_renderer_display(const cn_colour *colour, const cn_display_transform *display,
                                           cn_unseen unseen, const cn_picture *picture, float **rgb);

/* ---- jobs ---- */
typedef enum cn_job_state { CN_JOB_QUEUED, CN_JOB_RUNNING, CN_JOB_ENDED } cn_job_state;
struct cn_render_job {
    cn_render_job *next;
    cn_render_request request; /* texts and row are copies */
    char *texts[5];
    cn_appearance row;
    double crop_m[6];
    cn_appearance_spec spec; /* of request.appearance, once prepared */
    bool prepared;
    unsigned passes;                     /* passes left; only for the renderer's thread */
    unsigned references;                 /* from the queue and from a handle; atomic */
    int stop;                            /* set by cn_stop */
    uint64_t samples, samples_at_cancel; /* atomic; samples evaluated: in all, and until the cancellation */
    cn_picture picture;
    uint8_t *encoded;
    uint32_t *owners;
    cn_aovs aovs;
    cn_render_result result;
    /* under the lock */
    pthread_mutex_t lock;
    pthread_cond_t ended;
    cn_job_state state;
    cn_status status;
    char message[1024];
};

/* Renders the coarsest of the passes left. */
CN_NODISCARD cn_status cn_render_job_pass(cn_renderer *renderer, cn_render_job *job);
void cn_renderer_queue_close(cn_renderer *renderer);
#endif
