/* The nearest points of a cloud, against a search of all points. How the type `points` grows and prunes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "field/field.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static float uniform(unsigned stream, size_t i)
{
    return cn_rng_float(9, stream, i);
}

typedef struct rig {
    cn_field field;
    uint32_t *table;
} rig;

static void rig_init(rig *r, double log2_points, double neighbours)
{
    cn_field_options o;
    assert_int_equal(cn_field_options_preset("points", CN_QUALITY_PREVIEW, &o), CN_OK);
    assert_int_equal(cn_field_options_set(&o, "log2_points", log2_points), CN_OK);
    assert_int_equal(cn_field_options_set(&o, "neighbours", neighbours), CN_OK);
    assert_int_equal(cn_field_options_set(&o, "finest_cells", 32), CN_OK);
    assert_int_equal(cn_field_layout(&r->field, &o, (cn_field_inputs){ 0 }), CN_OK);
    float *table = calloc(2 * r->field.entries, sizeof *table), *weights = calloc(r->field.n_weights, sizeof *weights);
    r->table = calloc(r->field.entries, sizeof *r->table);
    assert_true(table && weights && r->table);
    r->field.type->init(&r->field, 1, table, weights);
    for (size_t i = 0; i < r->field.entries; i++)
        r->table[i] = cn_bf16_from_float(table[2 * i]) | (uint32_t)cn_bf16_from_float(table[2 * i + 1]) << 16;
    free(table);
    free(weights);
}

static uint32_t count(const rig *r, uint32_t level)
{
    uint32_t n = 0;
    float x[3];
    for (uint32_t slot = 0; slot < cn_cloud_slots(&r->field.cloud); slot++)
        n += cn_cloud_point(&r->field.cloud, r->table, level, slot, x);
    return n;
}

/* With cells that share buckets, and with a bucket for each cell. */
static void nearest(double log2_points, uint32_t level)
{
    rig r;
    rig_init(&r, log2_points, 8);
    const cn_cloud *c = &r.field.cloud;
    const float radius = cn_cloud_radius(c, level);
    uint32_t slot, found = 0;
    for (size_t i = 0; i < 4000; i++)
        (void)cn_cloud_insert(c, r.table, level,
                              (float[3]){ uniform(1, 3 * i), uniform(1, 3 * i + 1), uniform(1, 3 * i + 2) }, 0.1f,
                              &slot);
    for (size_t q = 0; q < 200; q++) {
        const float x[3] = { uniform(2, 3 * q), uniform(2, 3 * q + 1), uniform(2, 3 * q + 2) };
        cn_cloud_near near;
        uint32_t closer = 0, within = 0;
        cn_cloud_find(c, r.table, level, x, &near);
        for (uint32_t s = 0; s < cn_cloud_slots(c); s++) {
            float p[3], square = 0;
            if (!cn_cloud_point(c, r.table, level, s, p)) continue;
            for (int a = 0; a < 3; a++)
                square += (x[a] - p[a]) * (x[a] - p[a]) / (radius * radius);
            within += square < 1;
            closer += near.n && square < near.square[near.n - 1] * 0.9999f;
        }
        assert_int_equal(near.n, within < 8 ? within : 8);
        assert_true(!near.n || closer <= near.n - 1);
        for (uint32_t i = 1; i < near.n; i++)
            assert_true(near.square[i] >= near.square[i - 1]);
        found += near.n;
    }
    assert_true(found > 20);
    free(r.table);
}

static void test_nearest(void **state)
{
    (void)state;
    nearest(16, 0);
    nearest(12, 0);
    nearest(14, 1);
}

/* No point moves by more than its 17 bits allow; a full bucket and a near point refuse another. */
static void test_insert(void **state)
{
    (void)state;
    rig r;
    rig_init(&r, 10, 8);
    const cn_cloud *c = &r.field.cloud;
    uint32_t slot, n = 0;
    float x[3], p[3];
    for (size_t i = 0; i < 40; i++) {
        for (size_t a = 0; a < 3; a++)
            x[a] = 0.5f + 0.01f * uniform(3, 3 * i + a);
        if (!cn_cloud_insert(c, r.table, 0, x, 0, &slot)) continue;
        assert_true(cn_cloud_point(c, r.table, 0, slot, p));
        for (int a = 0; a < 3; a++)
            assert_true(fabsf(p[a] - x[a]) < 1.0f / 131072);
        assert_false(cn_cloud_insert(c, r.table, 0, x, 0.5f, &slot));
        n++;
    }
    assert_int_equal(n, CN_CLOUD_BUCKET);
    cn_cloud_remove(c, r.table, 0, slot);
    assert_false(cn_cloud_point(c, r.table, 0, slot, p));
    assert_int_equal(count(&r, 0), CN_CLOUD_BUCKET - 1);
    free(r.table);
}

static uint32_t n_set;
static void set(void *user, uint32_t section, uint32_t first, uint32_t n, const float (*pairs)[2])
{
    const rig *r = user;
    assert_true(section < r->field.n_sections && first + n <= r->field.section[section].entries);
    assert_int_equal(n, CN_CLOUD_PAIRS);
    assert_true(pairs[CN_CLOUD_PAIRS - 1][1] == 0);
    n_set++;
}

/* Usable places and sparse points get points. Cells with matter get more; those in empty space go. */
static void test_grow_and_prune(void **state)
{
    (void)state;
    rig r;
    rig_init(&r, 16, 8);
    static uint8_t usable[CN_OCC_CELLS];
    static float seen[CN_OCC_CELLS];
    static uint32_t bits[CN_OCC_CELLS / 32];
    const float points[2][3] = { { 0.3f, 0.3f, 0.3f }, { 0.7f, 0.7f, 0.7f } };
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        usable[c] = c % CN_OCC_RES < CN_OCC_RES / 2;
    cn_field_change change = { .seed = 1, .table = r.table, .points = points, .n_points = 2, .usable = usable };
    change.set = set;
    change.user = &r;
    r.field.type->place(&r.field, &change);
    const uint32_t coarse = count(&r, 0);
    assert_true(coarse > 12000 && coarse < 20000); /* eight in each cell of the usable half */
    assert_int_equal(count(&r, 1), 2);

    /* A cell near the first point holds matter. Nothing is left about the second. */
    const uint32_t cell = 36 + CN_OCC_RES * (36 + CN_OCC_RES * 36);
    seen[cell] = 0.9f;
    bits[cell >> 5] |= 1u << (cell & 31);
    change.seen = seen;
    change.bits = bits;
    for (change.step = 1; change.step < 40; change.step++)
        r.field.type->adapt(&r.field, &change);
    assert_true(n_set > 0);
    float x[3];
    uint32_t near = 0;
    for (uint32_t slot = 0; slot < cn_cloud_slots(&r.field.cloud); slot++)
        if (cn_cloud_point(&r.field.cloud, r.table, 2, slot, x)) {
            assert_true(x[0] < 0.35f && x[0] > 0.25f);
            near++;
        }
    assert_true(near > 1);
    assert_true(count(&r, 0) >= coarse); /* the coarsest level stays */

    /* Points with no confidence left go, on every level. */
    for (size_t i = 0; i < cn_cloud_value_entries(&r.field.cloud); i += CN_CLOUD_PAIRS)
        r.table[i + CN_CLOUD_PAIRS - 1] = (uint32_t)cn_bf16_from_float(-2) << 16;
    seen[cell] = 0;
    r.field.type->adapt(&r.field, &change);
    for (uint32_t l = 0; l < r.field.cloud.n_levels; l++)
        assert_int_equal(count(&r, l), 0);
    free(r.table);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nearest),
        cmocka_unit_test(test_insert),
        cmocka_unit_test(test_grow_and_prune),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
