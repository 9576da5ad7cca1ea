/* conurb/renderer.h: renders views of a city from a queue of jobs, with cancellation and progressive passes.
 *
 * Threads: every function may be called from any thread, except cn_renderer_destroy, which is called once and last.
 * The renderer starts one thread of its own at the first submit. It renders one pass at a time, on all threads of the
 * pool. The context, its pool and the city are borrowed until cn_renderer_destroy. While a job is unfinished, do not
 * use the pool for anything else. The context's log callback runs on the renderer's thread.
 *
 * Memory: at most compose.max_tiles + 1 tiles are open at the same time. Each pass checks which tiles are trained, and
 * opens a tile again when its file has changed. So tiles may be added and removed while the renderer runs. */
#ifndef CONURB_RENDERER_H
#define CONURB_RENDERER_H
#include "conurb/base.h"
#include "conurb/city.h"
#include "conurb/render.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_renderer cn_renderer;
typedef struct cn_render_job cn_render_job;

/* read_only: nothing is written to the city. An appearance that is not aligned between tiles yet is shown as each tile
 * has it, and a tile in training is shown as its last checkpoint has it. Otherwise missing alignments are made and
 * kept, as in `conurb render`. While no tile is trained, pictures are empty. CN_ERR_DATA: the city has no plan. */
CN_API CN_NODISCARD cn_status cn_renderer_create(cn_renderer **renderer, const cn_context *ctx, const cn_city *city,
                                                 bool read_only);
/* Cancels every job, waits for the running one to stop, and frees the renderer. Job handles stay valid until they are
 * released. *renderer may be NULL. */
CN_API void cn_renderer_destroy(cn_renderer **renderer);

/* The passes of a picture, from coarse to fine, as bits. Width and height are divided by 8, 4, 2 and 1, and rounded
 * up. The full pass has the same bytes with and without the others before it. */
enum { CN_PASS_EIGHTH = 1, CN_PASS_QUARTER = 2, CN_PASS_HALF = 4, CN_PASS_FULL = 8, CN_PASS_ALL = 15 };
typedef enum cn_encoding { CN_ENCODING_NONE, CN_ENCODING_PNG, CN_ENCODING_JPEG } cn_encoding;

/* The result of one pass. Everything it points to is owned by the job. */
typedef struct cn_render_result {
    int pass;                  /* CN_PASS_* */
    const cn_picture *picture; /* linear ACEScg and depth, as in cn_picture; exposure_ev is not applied */
    const uint8_t *encoded;    /* the picture with view and look applied, over black; NULL for CN_ENCODING_NONE */
    size_t encoded_size;
    char tile[32]; /* id of the tile with the largest weight; "" when no tile is in reach */
    /* NULL, or per pixel the tile (index in the plan) with the largest share; UINT32_MAX: none */
    const uint32_t *owners;
    const cn_aovs *aovs; /* those that the request asks for; NULL: none */
} cn_render_result;

/* A request for one picture. Zero the struct first. cn_renderer_submit copies everything. */
typedef struct cn_render_request {
    cn_camera camera;         /* at the size of the full pass */
    cn_view view;             /* the pose; view.name may be NULL */
    const char *appearance;   /* as `conurb render --appearance` takes it; NULL: mean */
    const char *tile;         /* id of one tile to show alone, even out of its reach; NULL: all tiles, blended */
    const cn_appearance *row; /* with `tile`: a row of that tile, used instead of `appearance`; NULL: none */
    const char *blend;        /* a name of cn_blend_parse; NULL: from city.yaml */
    const char *display_view; /* a view of the OpenColorIO config; NULL: from city.yaml */
    const char *look;         /* NULL: from city.yaml */
    const double *crop_m;     /* as in cn_render_options; NULL: all of the city */
    double exposure_ev;       /* stops, added to those of city.yaml; for the encoded picture only */
    bool owners;              /* fill result.owners */
    unsigned aovs;            /* CN_AOV_* bits: channels that the result has too */
    bool draft;               /* coverage may be coarse, as it is in the first two passes, so that it comes soon */
    unsigned passes;          /* CN_PASS_* bits, at least one */
    cn_encoding encoding;
    int quality;  /* JPEG quality, 1 to 100; 0: 90 */
    int priority; /* higher first; at equal priority the coarser pass first, then the older job */
    /* Not 0: this job cancels unfinished jobs of the same stream, such as older frames of a viewer */
    uint64_t stream;
    /* NULL, or a callback on the renderer's thread. It is called after each pass with CN_OK and the result, which is
     * valid until the callback returns. When the job fails, it is called once with the status and result NULL;
     * cn_error_message() then has the text. It may submit, cancel and release jobs, but not wait or destroy. */
    void (*deliver)(void *user, cn_render_job *job, cn_status status, const cn_render_result *result);
    void *user;
} cn_render_request;

/* Puts a request into the queue. job: NULL, or it receives a handle that the caller releases. CN_ERR_USAGE: the
 * request is invalid. Other errors (an unknown appearance, view or tile) end the job later. */
CN_API CN_NODISCARD cn_status cn_renderer_submit(cn_renderer *renderer, const cn_render_request *request,
                                                 cn_render_job **job);
/* Asks a job to end with CN_ERR_INTERRUPTED. Has no effect when it has ended. A running pass stops after the current
 * block of 64 rays of each thread. */
CN_API void cn_renderer_cancel(cn_render_job *job);
/* Waits until the job has ended, and returns its status. When ctx (may be NULL) asks to stop, the job is cancelled.
 * result: NULL, or it receives the last pass, valid until the job is released. */
CN_API CN_NODISCARD cn_status cn_renderer_wait(cn_render_job *job, const cn_context *ctx, cn_render_result *result);
/* Releases the handle and sets *job to NULL. An unfinished job continues. */
CN_API void cn_renderer_release(cn_render_job **job);

#ifdef __cplusplus
}
#endif
#endif
