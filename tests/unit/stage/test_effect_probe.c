/* Probes decide where the evidence is near its threshold, within their budget. A table of the gain of each effect
 * replaces the trainings. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "effect/effect.h"
#include "stage/effect_probe.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { PHOTOS = 4 };

/* The result of a training: 20 dB plus the gain of each effect that is on. `noise` differs by photo, and its sign
 * changes with the effects that are on and with the round. */
typedef struct world {
    double worth[CN_MAX_EFFECTS], noise;
    uint32_t photos, trainings, rounds;
} world;

static world one_worth(uint32_t effect, double gain_db, double noise_db)
{
    world w = { .noise = noise_db, .photos = PHOTOS };
    w.worth[effect] = gain_db;
    return w;
}

static cn_status run(void *user, const cn_plan_tile *tile, uint32_t round, cn_probe_score *score)
{
    world *w = user;
    uint32_t n_on = round;
    *score = (cn_probe_score){ .n = w->photos };
    for (uint32_t e = 0; e < tile->n_effects; e++)
        n_on += tile->effects[e].on;
    for (uint32_t i = 0; i < w->photos; i++) {
        score->psnr[i] = 20 + i + ((n_on + i) & 1 ? w->noise : -w->noise);
        for (uint32_t e = 0; e < tile->n_effects; e++)
            score->psnr[i] += tile->effects[e].on ? w->worth[e] : 0;
    }
    w->trainings++;
    if (round + 1 > w->rounds) w->rounds = round + 1;
    return CN_OK;
}

/* Every effect of the registry, with evidence over its threshold as given: decided by evidence. */
static void init_tile(cn_plan_tile *tile, double over)
{
    *tile = (cn_plan_tile){ .id = "t", .n_effects = cn_effect_count };
    for (uint32_t i = 0; i < cn_effect_count; i++) {
        cn_plan_effect *e = &tile->effects[i];
        snprintf(e->name, sizeof e->name, "%s", cn_effect_list[i]->name);
        snprintf(e->reason, sizeof e->reason, "evidence");
        e->threshold = cn_effect_list[i]->threshold;
        e->evidence = over * e->threshold;
        e->on = over >= 1;
    }
}

static uint32_t index_of(const char *name)
{
    for (uint32_t i = 0; i < cn_effect_count; i++)
        if (strcmp(cn_effect_list[i]->name, name) == 0) return i;
    fail();
    return 0;
}

/* Low evidence is overwhelming for all effects but view dependence. */
static void leave_in_doubt(cn_plan_tile *tile, uint32_t effect, double over)
{
    cn_plan_effect *views = &tile->effects[index_of("view_dependence")];
    init_tile(tile, 0.01);
    views->evidence = 5 * views->threshold;
    views->on = true;
    tile->effects[effect].evidence = over * tile->effects[effect].threshold;
    tile->effects[effect].on = over >= 1;
}

static uint32_t decide(cn_plan_tile *tile, world *w, double steps)
{
    const cn_probe_budget budget = cn_probe_budget_of(tile, steps);
    const cn_probe_runner runner = { run, w };
    assert_int_equal(cn_probe_decide(NULL, &runner, &budget, tile), CN_OK);
    assert_true(w->trainings <= budget.trainings);
    assert_true((double)w->trainings * budget.steps <= steps);
    return w->trainings;
}

static void test_wrong_evidence_is_overruled(void **state)
{
    (void)state;
    const uint32_t sky = index_of("sky");
    cn_plan_tile tile;
    leave_in_doubt(&tile, sky, 0.6);
    world w = one_worth(sky, 0.7, 0.05);
    assert_int_equal(decide(&tile, &w, 600), 2);
    assert_true(tile.effects[sky].on);
    assert_string_equal(tile.effects[sky].reason, "probe: +0.7 dB");
    leave_in_doubt(&tile, sky, 1.5);
    w = one_worth(sky, -0.4, 0.05);
    assert_int_equal(decide(&tile, &w, 600), 2);
    assert_false(tile.effects[sky].on);
    assert_string_equal(tile.effects[sky].reason, "probe: -0.4 dB");
}

/* A gain below what the effect's time would gain otherwise. Many photos show so small a difference. */
static void test_gain_has_to_pay(void **state)
{
    (void)state;
    const uint32_t appearance = index_of("appearance");
    cn_plan_tile tile;
    leave_in_doubt(&tile, appearance, 1.2);
    world w = one_worth(appearance, 0.01, 0);
    w.photos = CN_VALIDATION_MOST;
    (void)decide(&tile, &w, 9000);
    assert_false(tile.effects[appearance].on);
}

/* Two standard errors of four photos are not significant. */
static void test_few_photos_want_more(void **state)
{
    (void)state;
    const uint32_t sky = index_of("sky");
    cn_plan_tile tile;
    leave_in_doubt(&tile, sky, 0.6);
    world w = one_worth(sky, 1.5, 0.55);
    (void)decide(&tile, &w, 400);
    assert_non_null(strstr(tile.effects[sky].reason, "not clear"));
}

/* Three photos that agree almost, by chance, do not decide alone. */
static void test_agreement_may_be_chance(void **state)
{
    (void)state;
    const uint32_t sky = index_of("sky");
    cn_plan_tile tile;
    leave_in_doubt(&tile, sky, 0.6);
    world w = one_worth(sky, 0.31, 0.02);
    w.photos = 3;
    (void)decide(&tile, &w, 400);
    assert_int_equal(w.rounds, 1);
    assert_false(tile.effects[sky].on);
    assert_non_null(strstr(tile.effects[sky].reason, "not clear"));
}

/* An unclear probe leaves the evidence's decision: chance must not take the codes from a city in many lights, nor give
 * them to photos that share one. */
static void test_evidence_decides_where_a_probe_is_not_clear(void **state)
{
    (void)state;
    const uint32_t appearance = index_of("appearance");
    const struct {
        double over, gain;
        bool on;
        const char *reason;
    } cases[] = { { 0.6, 0.4, false, "evidence; probe: +0.4 dB, not clear" },
                  { 1.5, -0.4, true, "evidence; probe: -0.4 dB, not clear" } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cn_plan_tile tile;
        leave_in_doubt(&tile, appearance, cases[i].over);
        world w = one_worth(appearance, cases[i].gain, 0.9);
        (void)decide(&tile, &w, 400);
        assert_int_equal(tile.effects[appearance].on, cases[i].on);
        assert_string_equal(tile.effects[appearance].reason, cases[i].reason);
    }
}

/* 2.7 standard errors of four photos are significant where the gain matters, and not where it is small. */
static void test_gain_that_matters_wants_less(void **state)
{
    (void)state;
    const uint32_t sky = index_of("sky");
    for (int small = 0; small < 2; small++) {
        cn_plan_tile tile;
        leave_in_doubt(&tile, sky, 0.6);
        world w = one_worth(sky, small ? 0.15 : 0.5, small ? 0.035 : 0.147);
        (void)decide(&tile, &w, 400);
        assert_int_equal(strstr(tile.effects[sky].reason, "not clear") != NULL, small);
        assert_int_equal(tile.effects[sky].on, !small);
    }
}

static void test_unclear_gain_leaves_the_evidence(void **state)
{
    (void)state;
    const uint32_t sky = index_of("sky");
    for (int on = 0; on < 2; on++) {
        cn_plan_tile tile;
        leave_in_doubt(&tile, sky, on ? 1.5 : 0.6);
        world w = one_worth(sky, 0.05, 3);
        assert_int_equal(decide(&tile, &w, 1e6), 2 * CN_PROBE_ROUNDS);
        assert_int_equal(w.rounds, CN_PROBE_ROUNDS);
        assert_int_equal(tile.effects[sky].on, on);
        assert_non_null(strstr(tile.effects[sky].reason, "not clear"));
    }
}

static void test_only_doubts_are_probed(void **state)
{
    (void)state;
    uint32_t effects[CN_MAX_EFFECTS];
    const uint32_t sky = index_of("sky"), refinement = index_of("pose_refinement"), views = index_of("view_dependence");
    cn_plan_tile tile;
    const double overwhelming[] = { 0, -1, 0.2, 5, NAN };
    for (uint32_t i = 0; i < 5; i++) {
        init_tile(&tile, overwhelming[i]);
        tile.effects[views].evidence = 5 * tile.effects[views].threshold;
        assert_int_equal(cn_probe_doubtful(&tile, effects), 0);
        assert_int_equal(cn_probe_budget_of(&tile, 1e9).n_effects, 0);
    }
    leave_in_doubt(&tile, sky, 0.6);
    snprintf(tile.effects[sky].reason, sizeof tile.effects[sky].reason, "city.yaml");
    assert_int_equal(cn_probe_doubtful(&tile, effects), 0);
    leave_in_doubt(&tile, refinement, 0.9);
    assert_int_equal(cn_probe_doubtful(&tile, effects), 0);
}

/* Tracked points may show no change with the direction, and there may be windows: a probe decides, and where it is not
 * clear, view dependence is on. */
static void test_low_evidence_may_tell_nothing(void **state)
{
    (void)state;
    static const struct {
        double over, gain_db, noise_db;
        bool on;
        const char *reason;
    } cases[] = { { -0.1, 0.05, 3, true, "default; probe: +0.1 dB, not clear" },
                  { 0.9, 0.05, 3, true, "default; probe: +0.1 dB, not clear" },
                  { -7, 0.9, 0.1, true, "probe: +0.9 dB" },
                  { -0.1, -0.6, 0.05, false, "probe: -0.6 dB" } };
    const uint32_t views = index_of("view_dependence"), appearance = index_of("appearance");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cn_plan_tile tile;
        uint32_t effects[CN_MAX_EFFECTS];
        leave_in_doubt(&tile, views, cases[i].over);
        assert_int_equal(cn_probe_doubtful(&tile, effects), 1);
        assert_int_equal(effects[0], views);
        assert_false(tile.effects[views].on);
        world w = one_worth(views, cases[i].gain_db, cases[i].noise_db);
        (void)decide(&tile, &w, 1e6);
        assert_int_equal(tile.effects[views].on, cases[i].on);
        assert_string_equal(tile.effects[views].reason, cases[i].reason);
        tile.effects[appearance].evidence = 0.7 * tile.effects[appearance].threshold;
        snprintf(tile.effects[views].reason, sizeof tile.effects[views].reason, "evidence");
        assert_int_equal(cn_probe_doubtful(&tile, effects), 2);
        assert_int_equal(effects[0], appearance);
        tile.effects[appearance].evidence = 9 * tile.effects[appearance].threshold; /* many lights */
        if (cases[i].over < 0) assert_int_equal(cn_probe_doubtful(&tile, effects), 0);
    }
}

static void test_budget(void **state)
{
    (void)state;
    uint32_t all[CN_MAX_EFFECTS];
    cn_plan_tile tile;
    init_tile(&tile, 0.5);
    const uint32_t sky = index_of("sky"), n = cn_probe_doubtful(&tile, all);
    tile.effects[sky].evidence = 0.9 * tile.effects[sky].threshold;
    assert_int_equal(cn_probe_budget_of(&tile, 399).n_effects, 0);
    assert_int_equal(cn_probe_budget_of(&tile, 400).n_effects, 1);
    assert_int_equal(cn_probe_budget_of(&tile, 400).effects[0], sky);
    assert_int_equal(cn_probe_budget_of(&tile, 1e6).n_effects, n);
    for (double steps = 0; steps < 20000; steps += 97) {
        const cn_probe_budget b = cn_probe_budget_of(&tile, steps);
        assert_true((double)b.steps * b.trainings <= steps);
        assert_true(!b.n_effects || b.trainings > b.n_effects);
        cn_plan_tile tried = tile;
        world w = one_worth(sky, 1, 2);
        (void)decide(&tried, &w, steps);
    }
}

/* Every effect in doubt gets its first pair, though the first ones stay unclear. */
static void test_no_effect_starves(void **state)
{
    (void)state;
    cn_plan_tile tile;
    init_tile(&tile, 0.5);
    world w = { .noise = 3, .photos = PHOTOS };
    (void)decide(&tile, &w, 2500);
    for (uint32_t e = 0; e < tile.n_effects; e++)
        if (!cn_effect_list[e]->unprobed) assert_non_null(strstr(tile.effects[e].reason, "probe"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wrong_evidence_is_overruled),
        cmocka_unit_test(test_gain_has_to_pay),
        cmocka_unit_test(test_few_photos_want_more),
        cmocka_unit_test(test_agreement_may_be_chance),
        cmocka_unit_test(test_evidence_decides_where_a_probe_is_not_clear),
        cmocka_unit_test(test_gain_that_matters_wants_less),
        cmocka_unit_test(test_unclear_gain_leaves_the_evidence),
        cmocka_unit_test(test_only_doubts_are_probed),
        cmocka_unit_test(test_low_evidence_may_tell_nothing),
        cmocka_unit_test(test_budget),
        cmocka_unit_test(test_no_effect_starves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
