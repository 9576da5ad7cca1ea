/* conurb/renderer.h: views of a city, rendered one after another from a queue, with cancellation and progressive
 * passes.
 *
 * Threads: every function may be called from any thread at any time, but for cn_renderer_destroy, which is called once
 * and last. A renderer starts one thread of its own at the first submit. It renders one pass at a time, on all threads
 * of the pool. The context, its pool and the city are borrowed until cn_renderer_destroy: while a job is unfinished the
 * pool must not be used for anything else. The log of the context is called on the renderer's thread.
 *
 * Memory: at most compose.max_tiles + 1 tiles are open at once. A tile whose file changes is opened again. Each pass
 * looks which tiles are trained: those that were added or removed while the renderer lives are seen by the next one. */
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

/* read_only: nothing is written into the city. An appearance that was not aligned between the tiles before is then
 * shown as each tile has it. Else missing alignments are made and kept, as `conurb render` does. CN_ERR_DATA when there
 * is no plan. A city without a trained tile gives empty pictures until one is trained. */
CN_API CN_NODISCARD cn_status cn_renderer_create(cn_renderer **renderer, const cn_context *ctx, const cn_city *city,
                                                 bool read_only);
/* Cancels every job, waits until the one at work has stopped, and frees the renderer. Handles of jobs stay valid until
 * they are released. NULL is fine. */
CN_API void cn_renderer_destroy(cn_renderer **renderer);

/* Passes of a picture, coarse to fine, as bits: each side is divided by 8, 4, 2 and 1, and rounded up. The full pass is
 * the same to the bit whether others came before it or not. */
enum { CN_PASS_EIGHTH = 1, CN_PASS_QUARTER = 2, CN_PASS_HALF = 4, CN_PASS_FULL = 8, CN_PASS_ALL = 15 };
typedef enum cn_encoding { CN_ENCODING_NONE, CN_ENCODING_PNG, CN_ENCODING_JPEG } cn_encoding;

/* One pass. All that it points to belongs to the job. */
typedef struct cn_render_result {
    int pass;                  /* CN_PASS_* */
    const cn_picture *picture; /* linear ACEScg and depth, as cn_render_tile has them; exposure_ev is not applied */
    const uint8_t *encoded;    /* the picture through view and look, over black; NULL for CN_ENCODING_NONE */
    size_t encoded_size;
    char tile[32];          /* id of the tile that has the most part; "" when no tile is in reach */
    const uint32_t *owners; /* of each pixel the tile of the plan that has the most part; UINT32_MAX: none; or NULL */
} cn_render_result;

/* Zeroed members have the meaning that is said of 0 or NULL. Everything is copied by cn_renderer_submit. */
typedef struct cn_render_request {
    cn_camera camera;         /* its size is that of the full pass */
    cn_view view;             /* the pose; the name may be NULL */
    const char *appearance;   /* as `conurb render --appearance` takes it; NULL: mean */
    const char *tile;         /* id of a tile to show alone, in its reach or not; NULL: the blend of all */
    const cn_appearance *row; /* a row of that tile, instead of appearance; NULL: none */
    const char *blend;        /* a name of cn_blend_parse; NULL: from city.yaml */
    const char *display_view; /* of the OpenColorIO config; NULL: from city.yaml */
    const char *look;         /* NULL: from city.yaml */
    double exposure_ev;       /* of the encoded picture, beside that of city.yaml */
    bool owners;              /* whether the result has them; of a blend of all tiles, not of one alone */
    unsigned passes;          /* CN_PASS_*, at least one */
    cn_encoding encoding;
    int quality;  /* of JPEG, 1 to 100; 0: 90 */
    int priority; /* higher ones come first; of equal ones a coarser pass, then the older job */
    uint64_t
        stream; /* not 0: this job cancels the unfinished ones of the same stream, such as a viewer's older frames */
    /* NULL, or called on the renderer's thread: after each pass with CN_OK and the result, which lives until it
     * returns, or once with the failure that ends the job, result NULL and its text in cn_error_message(). It may
     * submit, cancel and release, but not wait or destroy. */
    void (*deliver)(void *user, cn_render_job *job, cn_status status, const cn_render_result *result);
    void *user;
} cn_render_request;

/* *job (may be NULL): a handle that the caller releases. CN_ERR_USAGE for a request that makes no sense; what else is
 * wrong (an unknown appearance, view or tile) ends the job. */
CN_API CN_NODISCARD cn_status cn_renderer_submit(cn_renderer *renderer, const cn_render_request *request,
                                                 cn_render_job **job);
/* Asks a job to end with CN_ERR_INTERRUPTED; fine when it has ended. A pass at work stops at the next block of 64 rays
 * of each thread. */
CN_API void cn_renderer_cancel(cn_render_job *job);
/* Waits until the job has ended, or ctx (may be NULL) asks to stop, which cancels it. Returns how it ended. result (may
 * be NULL): the last pass, until the job is released. */
CN_API CN_NODISCARD cn_status cn_renderer_wait(cn_render_job *job, const cn_context *ctx, cn_render_result *result);
/* Gives the handle back; the job goes on. *job becomes NULL. */
CN_API void cn_renderer_release(cn_render_job **job);

#ifdef __cplusplus
}
#endif
#endif
