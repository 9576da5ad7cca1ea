#include "train/parameters.h"

#include <math.h>
#include <stdlib.h>

enum {
    ENCODE_BLOCKS = 8, /* an encoder processes a batch in so many items */
    MAX_PARTS = 64     /* of a section, each the work of one thread */
};

static size_t pad16(size_t n)
{
    return (n + 15) & ~(size_t)15;
}

/* Enough parts to keep every thread busy. A section's samples are read once for each part, so more would cost time. */
static uint32_t parts_for(unsigned threads, uint32_t sections)
{
    uint32_t parts = 1;
    while (parts * sections < 2 * threads && parts < MAX_PARTS)
        parts *= 2;
    return parts;
}

void cn_parameters_size(cn_parameters *p, size_t n_photo, size_t n_shared, unsigned threads)
{
    p->table_n = 2 * p->field.entries;
    p->state_n = (p->table_n / 16 + p->field.n_sections + 1) * CN_STATE_BLOCK;
    p->section_parts = parts_for(threads, p->field.n_sections);
    p->photo_at = pad16(p->field.n_weights);
    p->shared_at = pad16(p->photo_at + n_photo);
    p->n = pad16(p->shared_at + n_shared);
}

void cn_parameters_carve(cn_parameters *p, cn_arena *arena)
{
    p->table = CN_ARENA_NEW(arena, uint16_t, p->table_n);
    p->table_state = CN_ARENA_NEW(arena, uint16_t, p->state_n);
    p->value = CN_ARENA_NEW(arena, float, p->n);
    p->grad = CN_ARENA_NEW(arena, float, p->n);
    p->derived = CN_ARENA_NEW(arena, float, p->field.n_derived);
}

/* The entries of one part of a section, in whole blocks of state. A small section may have no entries left for it. */
static cn_range part_of(const cn_parameters *p, uint32_t section, uint32_t part)
{
    const uint32_t entries = p->field.section[section].entries, together = p->field.section[section].together,
                   unit = together ? together : 8; /* a block of state has 8 entries */
    const uint32_t units = (entries + unit - 1) / unit, a = (units + p->section_parts - 1) / p->section_parts,
                   first = a * part * unit, end = a * (part + 1) * unit;
    if (first >= entries) return (cn_range){ entries, 0 };
    return (cn_range){ first, (end < entries ? end : entries) - first };
}

void cn_parameters_carve_scratch(const cn_parameters *p, cn_arena *arena, cn_part_scratch *scratch)
{
    size_t largest = 0;
    for (uint32_t l = 0; l < p->field.n_sections; l++) {
        const cn_range first = part_of(p, l, 0);
        if (first.count > largest) largest = first.count;
    }
    scratch->grad = CN_ARENA_NEW(arena, float, 2 * largest);
    scratch->touched = CN_ARENA_NEW(arena, uint8_t, largest / CN_TOUCH + 1);
}

uint16_t *cn_parameters_state(const cn_parameters *p, uint32_t section)
{
    return p->table_state + (p->field.section[section].first / 8 + (size_t)section) * CN_STATE_BLOCK;
}

cn_status cn_parameters_init(cn_parameters *p, uint64_t seed)
{
    float *table = malloc(sizeof *table * p->table_n);
    if (!table) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of training");
    p->field.type->init(&p->field, seed, table, p->value);
    for (uint32_t l = 0; l < p->field.n_sections; l++) {
        const size_t first = 2 * (size_t)p->field.section[l].first;
        for (size_t i = 0; i < 2 * (size_t)p->field.section[l].entries; i++)
            cn_float_split(table[first + i], &p->table[first + i], cn_state_at(cn_parameters_state(p, l), i));
    }
    for (size_t i = 2 * (p->field.entries - p->field.fixed); i < p->table_n; i++)
        p->table[i] = cn_bf16_from_float(table[i]);
    free(table);
    return CN_OK;
}

static void set_entries(void *user, uint32_t section, uint32_t first, uint32_t n, const float (*pairs)[2])
{
    const cn_parameters *p = user;
    const size_t in_table = 2 * (size_t)p->field.section[section].first;
    for (size_t i = 2 * (size_t)first; i < 2 * ((size_t)first + n); i++) {
        uint16_t *state = cn_state_at(cn_parameters_state(p, section), i);
        cn_float_split(pairs[i / 2 - first][i % 2], &p->table[in_table + i], state);
        state[CN_STATE_M] = state[CN_STATE_V] = 0;
    }
}

cn_field_change cn_parameters_change(cn_parameters *p, uint64_t seed, uint32_t step)
{
    return (cn_field_change){
        .seed = seed, .step = step, .table = (uint32_t *)(void *)p->table, .set = set_entries, .user = p
    };
}

void cn_parameters_derive(cn_parameters *p)
{
    p->field.type->prepare(&p->field, p->value, p->derived);
}

cn_field_params cn_parameters_view(const cn_parameters *p)
{
    return (cn_field_params){ (const uint32_t *)(const void *)p->table, p->value, p->derived, 0, NULL };
}

bool cn_parameters_finite(const cn_parameters *p)
{
    bool finite = true;
    for (size_t i = 0; i < p->n; i++)
        finite &= isfinite(p->value[i]) != 0;
    for (size_t i = 0; i < p->table_n; i++)
        finite &= (p->table[i] & 0x7f80u) != 0x7f80u;
    return finite;
}

void cn_parameters_list(const cn_parameters *p, cn_checkpoint *c)
{
    cn_checkpoint_add(c, "table", CN_BF16, p->table_n, p->table);
    cn_checkpoint_add(c, "table.state", CN_BF16, p->state_n, p->table_state);
    cn_checkpoint_add(c, "flat.value", CN_F32, p->n, p->value);
}

size_t cn_parameters_encode_items(const cn_parameters *p)
{
    return (size_t)p->field.n_encoders * ENCODE_BLOCKS;
}

void cn_parameters_encode(const cn_parameters *p, const cn_kernel *kernel, size_t item, cn_batch *b)
{
    const uint32_t encoder = (uint32_t)(item / ENCODE_BLOCKS);
    const size_t block = item % ENCODE_BLOCKS;
    const size_t first = (size_t)b->counts->n_panels * block / ENCODE_BLOCKS,
                 last = (size_t)b->counts->n_panels * (block + 1) / ENCODE_BLOCKS;
    p->field.type->encode(&p->field, kernel, encoder,
                          &(cn_field_encoding){ (const uint32_t *)(const void *)p->table, b->pos + first * 3 * CN_PANEL,
                                                last - first, b->enc + first * p->field.enc_rows * CN_PANEL });
}

size_t cn_parameters_update_items(const cn_parameters *p)
{
    return (size_t)p->field.n_sections * p->section_parts;
}

/* Computes gradients and applies Adam at once, so that the gradients stay in the cache. The last sections are the
 * largest and slowest, so they come first. */
void cn_parameters_update(cn_parameters *p, const cn_kernel *kernel, size_t item, const cn_batch *b,
                          const cn_adam *adam, cn_part_scratch *scratch)
{
    const uint32_t l = p->field.n_sections - 1 - (uint32_t)item / p->section_parts;
    const cn_range range = part_of(p, l, (uint32_t)item % p->section_parts);
    const size_t stride = (size_t)p->field.enc_rows * CN_PANEL;
    if (!range.count) return;
    for (uint32_t g = 0; g < b->n_groups; g++) {
        if (!b->group_live[g]) continue;
        const size_t first = b->group_panel[g];
        const cn_encode_gradient in = { b->pos + first * 3 * CN_PANEL,
                                        b->enc + first * stride,
                                        stride,
                                        cn_batch_panels(b->group_live[g]),
                                        &range,
                                        scratch->grad,
                                        scratch->touched };
        p->field.type->encode_backward(&p->field, kernel, (const uint32_t *)(const void *)p->table, l, &in);
    }
    kernel->adam_table(adam, p->table + 2 * ((size_t)p->field.section[l].first + range.first),
                       cn_state_at(cn_parameters_state(p, l), 2 * (size_t)range.first), scratch->grad, scratch->touched,
                       2 * (size_t)range.count);
}
