#include "stage/effect_probe.h"

#include "base/number.h"
#include "effect/effect.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { STEPS_LEAST = 200, STEPS_MOST = 1500, SAMPLES_LEAST = 3 };
#define BAND 4.0 /* an effect is in doubt when its evidence is within this factor of the threshold */
/* dB. Found on herz-jesus' codes: with one case in twenty for all they were off in one plan of two (0.51, standard
 * error 0.17), though they gain 2 dB. By the probes of six sets and of seven made cities, no decision on another effect
 * changes. */
#define MATTERS 0.25
/* Three photos may agree by chance: on fountain-P11 the codes, which gain nothing at standard, gained 0.31 dB with a
 * standard error of 0.03. So a few further photos are reckoned with that spread as photos usually do, dB. */
#define USUAL_PHOTOS 2
#define USUAL_SPREAD 0.25

/* What an effect has to gain, dB. More steps in the same time would gain as much. Fox gains about 0.5 dB each time the
 * training is twice as long (tests/bench/README.md). */
static double price_of(const cn_effect *effect)
{
    return 0.5 * log2(1 + (double)effect->time_share);
}

/* Many lights have more evidence for codes of appearance than this, over its threshold. herz-jesus, where the sun comes
 * and goes, has 1.1 and gains 2 dB from view dependence; sacre-coeur, in many lights, has 2.2. */
#define MANY_LIGHTS 1.5

/* Whether the photos have one light, more or less, by the evidence for codes of appearance. */
static bool share_light(const cn_plan_tile *tile)
{
    for (uint32_t i = 0; i < tile->n_effects; i++)
        if (strcmp(tile->effects[i].name, "appearance") == 0)
            return tile->effects[i].evidence < MANY_LIGHTS * tile->effects[i].threshold;
    return false;
}

/* Evidence that can show that an effect is needed, but not that it is not: the tracked points of view dependence are
 * textured and matte, and windows have none. In many lights it tells enough, because there a direction also tells
 * which photo it is, and so its light: view dependence gains nothing on made cities, and costs sacre-coeur 0.4 dB. */
static bool tells_nothing(const cn_plan_tile *tile, const cn_plan_effect *e)
{
    const cn_effect *known = cn_effect_find(e->name);
    return known && known->on_unmeasured && e->evidence < e->threshold && share_light(tile);
}

/* Evidence that tells nothing comes in the middle. View dependence should not come before codes of appearance that are
 * nearer to their threshold: in a short training it stands for them (herz-jesus). */
static double distance_of(const cn_plan_tile *tile, const cn_plan_effect *e)
{
    if (tells_nothing(tile, e)) return log(BAND) / 2;
    return e->evidence > 0 && e->threshold > 0 ? fabs(log(e->evidence / e->threshold)) : INFINITY;
}

uint32_t cn_probe_doubtful(const cn_plan_tile *tile, uint32_t effects[CN_MAX_EFFECTS])
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < tile->n_effects; i++) {
        const cn_plan_effect *e = &tile->effects[i];
        const cn_effect *known = cn_effect_find(e->name);
        if (!known || known->unprobed || strcmp(e->reason, "evidence") != 0 || !(distance_of(tile, e) < log(BAND)))
            continue;
        uint32_t at = n++;
        for (; at && distance_of(tile, &tile->effects[effects[at - 1]]) > distance_of(tile, e); at--)
            effects[at] = effects[at - 1];
        effects[at] = i;
    }
    return n;
}

cn_probe_budget cn_probe_budget_of(const cn_plan_tile *tile, double steps)
{
    cn_probe_budget b = { 0 };
    b.n_effects = cn_probe_doubtful(tile, b.effects);
    while (b.n_effects && steps < (double)STEPS_LEAST * (b.n_effects + 1))
        b.n_effects--;
    if (!b.n_effects) return b;
    b.steps = (uint32_t)fmin(steps / (b.n_effects + 1), STEPS_MOST);
    /* A round of an effect trains at most two sides: with it and without it. */
    b.trainings = (uint32_t)fmin(steps / b.steps, 2.0 * CN_PROBE_ROUNDS * b.n_effects);
    return b;
}

/* The choice so far, with what its trainings reached. */
typedef struct side {
    cn_plan_tile tile; /* lists are borrowed */
    cn_probe_score score[CN_PROBE_ROUNDS];
    bool known[CN_PROBE_ROUNDS];
} side;

typedef struct gains {
    double sum, squares, seconds;
    uint32_t n;
} gains;

static double mean_of(const gains *g)
{
    return g->sum / g->n;
}
static double error_of(const gains *g)
{
    const double squares = fmax(g->squares - g->n * mean_of(g) * mean_of(g), 0), seen = squares / (g->n - 1.0),
                 variance = (squares + USUAL_PHOTOS * USUAL_SPREAD * USUAL_SPREAD) / (g->n - 1.0 + USUAL_PHOTOS);
    return sqrt(fmax(seen, variance) / g->n);
}
/* Student's t for n samples: what one case in twenty exceeds, either way; one in ten. */
static double significant(uint32_t n, bool rare)
{
    static const double twenty[] = { 4.30, 3.18, 2.78, 2.57, 2.45, 2.36 },
                        ten[] = { 2.92, 2.35, 2.13, 2.02, 1.94, 1.89 };
    const uint32_t i = n - SAMPLES_LEAST;
    if (i >= sizeof ten / sizeof *ten) return rare ? 2.3 : 1.86;
    return rare ? twenty[i] : ten[i];
}

/* A difference that matters may be by chance in one case of ten, a small one in one of twenty. */
static bool is_clear(const gains *g, double price)
{
    if (g->n < SAMPLES_LEAST) return false;
    const double gain = fabs(mean_of(g) - price);
    return gain > significant(g->n, gain < MATTERS) * error_of(g);
}

static cn_status score_of(const cn_probe_runner *runner, side *s, uint32_t round, uint32_t *left)
{
    if (s->known[round]) return CN_OK;
    CN_TRY(runner->run(runner->user, &s->tile, round, &s->score[round]));
    s->known[round] = true;
    (*left)--;
    return CN_OK;
}

/* Gains of the effect, which is on in one side and off in the other. */
static void add_gains(gains *g, const cn_probe_score *base, const cn_probe_score *turned, bool on_in_base)
{
    for (uint32_t i = 0; i < base->n && i < turned->n; i++) {
        const double gain = (turned->psnr[i] - base->psnr[i]) * (on_in_base ? -1 : 1);
        if (!isfinite(gain)) continue;
        g->sum += gain;
        g->squares += gain * gain;
        g->n++;
    }
    g->seconds += base->seconds + turned->seconds;
}

/* Trainings that are left, and effects that wait for their first pair. One training is kept for each of these. */
typedef struct remaining {
    uint32_t trainings, effects;
} remaining;

static cn_status try_effect(const cn_probe_runner *runner, side *base, uint32_t effect, remaining *left, side *turned,
                            gains *g)
{
    const double price = price_of(cn_effect_find(base->tile.effects[effect].name));
    *turned = (side){ .tile = base->tile };
    turned->tile.effects[effect].on = !base->tile.effects[effect].on;
    for (uint32_t round = 0; round < CN_PROBE_ROUNDS && !is_clear(g, price); round++) {
        const uint32_t wanted = 1 + !base->known[round];
        if (left->trainings < wanted + (round || left->effects > left->trainings ? left->effects : 0)) break;
        CN_TRY(score_of(runner, base, round, &left->trainings));
        CN_TRY(score_of(runner, turned, round, &left->trainings));
        add_gains(g, &base->score[round], &turned->score[round], base->tile.effects[effect].on);
    }
    return CN_OK;
}

static void write_decision(const cn_context *ctx, const gains *g, cn_plan_effect *e, const char *by, double price)
{
    const bool clear = is_clear(g, price);
    if (clear)
        cn_print(e->reason, sizeof e->reason, "probe: %+.1f dB", mean_of(g));
    else
        cn_print(e->reason, sizeof e->reason, "%s; probe: %+.1f dB, not clear", by, mean_of(g));
    char line[200];
    cn_print(line, sizeof line, "probe: %+.2f dB (standard error %.2f, price %.2f) in %.0f s", mean_of(g), error_of(g),
             price, g->seconds);
    if (clear)
        cn_log(ctx, CN_LOG_INFO, "%s: %s: %s", e->name, line, e->on ? "on" : "off");
    else
        cn_log(ctx, CN_LOG_INFO, "%s: %s: %s by %s, because the difference is not clear", e->name, line,
               e->on ? "on" : "off", by);
}

cn_status cn_probe_decide(const cn_context *ctx, const cn_probe_runner *runner, const cn_probe_budget *budget,
                          cn_plan_tile *tile)
{
    side base = { .tile = *tile };
    remaining left = { .trainings = budget->trainings };
    for (uint32_t i = 0; i < budget->n_effects; i++) {
        const uint32_t effect = budget->effects[i];
        cn_plan_effect *e = &tile->effects[effect];
        const double price = price_of(cn_effect_find(e->name));
        side turned;
        gains g = { 0 };
        left.effects = budget->n_effects - i - 1;
        CN_TRY(try_effect(runner, &base, effect, &left, &turned, &g));
        if (g.n < SAMPLES_LEAST) continue;
        const bool by_default = tells_nothing(tile, e);
        const bool on = is_clear(&g, price) ? mean_of(&g) > price : e->on || by_default;
        if (on != e->on) base = turned;
        e->on = on;
        write_decision(ctx, &g, e, by_default ? "default" : "evidence", price);
    }
    return CN_OK;
}
