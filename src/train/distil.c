#include "train/distil.h"

#include "base/file.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A density is clear when it stops less than CLEAR of the light in a sample, and opaque when it stops nearly all: more
 * of either makes no difference to a picture. The difference of logits counts up to LARGEST, so that a few places that
 * are far off do not decide the step. Not measured apart. */
#define CLEAR 0.002f
#define OPAQUE 8.0f /* optical depth */
#define LARGEST 3.0f
#define OF_DENSITY 0.02f /* weight of the densities beside the colours; chosen on fox */
#define UNSEEN 0.02f     /* weight of a density that a ray does not show, beside that of one that it does */
#define LEAST_DENSITY 1e-12f

double cn_distil_share(const cn_field_options *field)
{
    const double share = cn_field_options_get(field, CN_FIELD_DISTILLED);
    return share > 0 ? share : 0;
}

#define TEACHER_SHARE (1.0 / 3) /* of a time budget */

bool cn_distil_makes_teacher(const cn_train_options *o)
{
    return !o->teacher && cn_distil_share(&o->field) > 0;
}

cn_train_options cn_distil_teacher(const cn_train_options *o)
{
    cn_train_options t = *o;
    t.field = o->teacher_field;
    t.steps = o->teacher_steps < o->steps ? o->teacher_steps : o->steps;
    t.time_budget_s = TEACHER_SHARE * o->time_budget_s;
    t.stop_gain_db = 0;
    t.validate = NULL;
    return t;
}

static void carve(cn_distil *d, cn_arena *arena, unsigned workers)
{
    const cn_field *field = &d->teacher->field;
    cn_field_acts counted, *acts = CN_ARENA_NEW(arena, cn_field_acts, workers);
    for (unsigned i = 0; i < workers; i++)
        field->type->acts_take(field, arena, CN_GROUP_CAP / CN_PANEL, acts ? &acts[i] : &counted);
    d->acts = acts;
}

/* A folder stands for one with a tile of this name. */
static char *path_of(const char *teacher, const char *tile)
{
    char *below = cn_format("%s/%s/tile.safetensors", teacher, tile);
    if (!below || cn_file_exists(below)) return below;
    free(below);
    return strdup(teacher);
}

cn_status cn_distil_open(cn_distil *d, const cn_train_options *options, const char *tile, unsigned workers)
{
    cn_arena counter;
    *d = (cn_distil){ .until = cn_distil_share(&options->field) };
    if (!(d->until > 0) || !options->teacher) return CN_OK;
    char *path = path_of(options->teacher, tile);
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", tile);
    const cn_status status = cn_file_exists(path)
                                 ? cn_tile_open(&d->teacher, path)
                                 : cn_fail(CN_ERR_IO,
                                           "%s: there is no such teacher; field.teacher names a tile.safetensors, or a "
                                           "folder with %s/tile.safetensors",
                                           path, tile);
    free(path);
    CN_TRY(status);
    cn_arena_count(&counter);
    carve(d, &counter, workers);
    CN_TRY(cn_arena_init(&d->memory, counter.used));
    carve(d, &d->memory, workers);
    return CN_OK;
}

void cn_distil_close(cn_distil *d)
{
    cn_tile_close(&d->teacher);
    cn_arena_deinit(&d->memory);
    *d = (cn_distil){ 0 };
}

static bool same_box(const cn_box *a, const cn_box *b)
{
    for (int i = 0; i < 3; i++)
        if (fabs(a->centre[i] - b->centre[i]) > 1e-6 * b->half_extent[i] ||
            fabs(a->half_extent[i] - b->half_extent[i]) > 1e-6 * b->half_extent[i])
            return false;
    return true;
}

static bool same_photos(const cn_tile *teacher, const cn_train_input *input)
{
    if (teacher->n_trained != input->tile->n_photos) return false;
    for (uint32_t i = 0; input->scene && i < teacher->n_trained; i++)
        if (strcmp(teacher->names[i], input->scene->views[input->tile->photos[i]].name) != 0) return false;
    return true;
}

static bool same_effects(const cn_effect_pack *a, const cn_effect_pack *b)
{
    if (a->n_on != b->n_on || a->n_shared != b->n_shared) return false;
    for (uint32_t e = 0; e < a->n_on; e++)
        if (strcmp(a->on[e].effect->name, b->on[e].effect->name) != 0) return false;
    return true;
}

cn_status cn_distil_begin(const cn_distil *d, const cn_train_input *input, const cn_box *box,
                          const cn_train_effects *effects, cn_parameters *p)
{
    const cn_tile *teacher = d->teacher;
    if (!teacher) return CN_OK;
    const char *differ = !same_box(&teacher->box, box)                   ? "bounds"
                         : !same_photos(teacher, input)                  ? "photos"
                         : !same_effects(&teacher->pack, &effects->pack) ? "effects"
                                                                         : NULL;
    if (differ)
        return cn_fail(CN_ERR_CONFIG,
                       "tile %s cannot learn from the teacher that field.teacher names, which was trained with other "
                       "%s; train that teacher with this plan, or remove field.teacher",
                       input->tile->id, differ);
    for (uint32_t e = 0; e < effects->pack.n_on; e++) {
        const cn_effect_step *to = &effects->pack.on[e];
        memcpy(p->value + p->photo_at + to->photo, teacher->effect_params + teacher->pack.on[e].photo,
               sizeof(float) * teacher->n_trained * to->effect->photo_params);
    }
    memcpy(p->value + p->shared_at, teacher->shared, sizeof(float) * effects->pack.n_shared);
    cn_train_effects_derive(effects, p);
    return CN_OK;
}

void cn_distil_occupy(const cn_distil *d, cn_occupancy *occ, uint8_t *usable)
{
    for (uint32_t c = 0; d->teacher && c < CN_OCC_CELLS; c++) {
        if (d->teacher->occupancy[c / 32] >> (c % 32) & 1) continue;
        usable[c] = 0;
        if (occ->seen[c] > 0) occ->seen[c] = 0;
    }
    if (d->teacher) cn_occupancy_restore(occ);
}

static void encode(const cn_tile *teacher, const cn_kernel *kernel, const cn_field_acts *acts, const float *pos,
                   size_t n_panels)
{
    const cn_field *field = &teacher->field;
    for (uint32_t e = 0; e < field->n_encoders; e++)
        field->type->encode(field, kernel, e, &(cn_field_encoding){ teacher->params.table, pos, n_panels, acts->enc });
}

void cn_distil_logits(const cn_distil *d, const cn_kernel *kernel, unsigned worker, const float *pos, size_t n_panels,
                      float *logit)
{
    const cn_field *field = &d->teacher->field;
    encode(d->teacher, kernel, &d->acts[worker], pos, n_panels);
    field->type->logits(field, kernel, &d->teacher->params, &d->acts[worker], n_panels, logit);
    for (size_t i = 0; i < n_panels * CN_PANEL; i++)
        logit[i] = logf(fmaxf(cn_density(field->type->density, logit[i]), LEAST_DENSITY));
}

const float *cn_distil_colours(const cn_distil *d, const cn_kernel *kernel, unsigned worker, const float *pos,
                               uint32_t n, const cn_worker *of)
{
    const cn_field *field = &d->teacher->field;
    const cn_field_acts *acts = &d->acts[worker];
    const size_t panels = cn_batch_panels(n);
    encode(d->teacher, kernel, acts, pos, panels);
    field->type->density_pass(field, kernel, &d->teacher->params, acts, panels);
    for (size_t i = 0; i < panels * CN_PANEL; i++) {
        float *at = acts->in + (i / CN_PANEL * field->colour_in + field->geo_rows) * CN_PANEL + i % CN_PANEL;
        const float *row = of->conditioning + (i < n ? of->live_ray[i] : 0) * (size_t)field->conditioning;
        for (size_t c = 0; c < field->conditioning; c++)
            at[c * CN_PANEL] = row[c];
    }
    field->type->colour_pass(field, kernel, &d->teacher->params, acts, panels);
    return acts->out;
}

/* Colours are compared as square roots, about as an eye does. */
static float root_of(float x, float *slope)
{
    const float root = sqrtf(cn_field_light(x));
    *slope = 0.5f * cn_field_light_gradient(root * root) / fmaxf(root, 1e-6f);
    return root;
}

static float density_difference(float field, float teacher, float length)
{
    const float clear = logf(CLEAR / length), opaque = logf(OPAQUE / length), to = fminf(fmaxf(teacher, clear), opaque);
    if ((teacher <= clear && field <= clear) || (teacher >= opaque && field >= opaque)) return 0;
    return fminf(fmaxf(field - to, -LARGEST), LARGEST);
}

void cn_distil_compare(const cn_field *field, const cn_worker *of, uint32_t n, const float *length, const float *out,
                       float scale)
{
    for (size_t i = 0; i < n; i++) {
        const size_t panel = i / CN_PANEL, lane = i % CN_PANEL, sample = of->live[i];
        const float logit = of->acts.in[panel * field->colour_in * CN_PANEL + lane];
        of->d_logit[i] = OF_DENSITY * scale * (UNSEEN + of->weight[i]) *
                         density_difference(logit, of->logit[sample], length[sample]);
        for (size_t c = 0; c < 3; c++) {
            const size_t at = (panel * 4 + c) * CN_PANEL + lane;
            float slope, unused;
            const float difference = root_of(of->acts.out[at], &slope) - root_of(out[at], &unused);
            of->d.out[at] = 2 * scale * of->weight[i] * difference * slope;
        }
    }
}
