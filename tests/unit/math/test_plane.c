/* Nearest places in a plane: the same answers as a search of all places, with far fewer comparisons. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "math/plane.h"

#include <math.h>
#include <stdlib.h>

enum { MANY = 100000, FEW = 600, K = 20 };
typedef enum layout { SCATTERED, GRID, NORTH_SOUTH, ONE_PLACE, LAYOUTS } layout;

static double (*make(layout how, uint32_t n))[2]
{
    double(*places)[2] = calloc(n, sizeof *places);
    assert_non_null(places);
    for (uint32_t i = 0; i < n; i++) {
        const double x = cn_rng_below(1, 1, i, 1000003), y = cn_rng_below(1, 2, i, 1000003);
        places[i][0] = how == SCATTERED ? x : how == GRID ? floor(x / 50000) : 7;
        places[i][1] = how == SCATTERED || how == NORTH_SOUTH ? y : how == GRID ? floor(y / 50000) : 7;
    }
    return places;
}

/* The k nearest by a search of all places: backwards from self, then forwards. Of equally far places, the later one
 * comes after. */
static uint32_t by_looking_at_all(const double (*places)[2], uint32_t n, uint32_t self, cn_plane_found *best)
{
    uint32_t found = 0;
    for (uint32_t step = 0; step < n; step++) {
        const uint32_t j = step < self ? self - 1 - step : step;
        if (j == self) continue;
        const double dx = places[j][0] - places[self][0], dy = places[j][1] - places[self][1];
        const cn_plane_found c = { dx * dx + dy * dy, j };
        uint32_t at = found;
        while (at > 0 && best[at - 1].square > c.square)
            at--;
        if (at >= K) continue;
        if (found < K) found++;
        for (uint32_t k = found - 1; k > at; k--)
            best[k] = best[k - 1];
        best[at] = c;
    }
    return found;
}

static void test_same_neighbours(void **state)
{
    (void)state;
    for (layout how = 0; how < LAYOUTS; how++)
        for (uint32_t n = 1; n <= FEW; n = n * 3 + 1) {
            double(*places)[2] = make(how, n);
            cn_plane plane;
            assert_true(cn_plane_init(&plane, (const double(*)[2])places, NULL, n));
            for (uint32_t i = 0; i < n; i++) {
                cn_plane_found a[K], b[K];
                const uint32_t found = cn_plane_neighbours(&plane, i, K, a);
                assert_int_equal(found, by_looking_at_all((const double(*)[2])places, n, i, b));
                for (uint32_t k = 0; k < found; k++)
                    assert_true(a[k].index == b[k].index && a[k].square == b[k].square);
            }
            cn_plane_deinit(&plane);
            free(places);
        }
}

static void test_same_nearest(void **state)
{
    (void)state;
    for (layout how = 0; how < LAYOUTS; how++) {
        double(*places)[2] = make(how, FEW);
        cn_plane plane;
        assert_true(cn_plane_init(&plane, (const double(*)[2])places, NULL, FEW));
        for (uint32_t i = 0; i < FEW; i++) {
            const double at[2] = { cn_rng_below(2, 1, i, 30), cn_rng_below(2, 2, i, how == GRID ? 30 : 1000003) };
            double least = INFINITY;
            uint32_t nearest = 0;
            for (uint32_t k = 0; k < FEW; k++) {
                const double dx = places[k][0] - at[0], dy = places[k][1] - at[1];
                if (dx * dx + dy * dy < least) least = dx * dx + dy * dy, nearest = k;
            }
            assert_int_equal(cn_plane_nearest(&plane, at), nearest);
        }
        cn_plane_deinit(&plane);
        free(places);
    }
}

typedef struct seen {
    uint32_t n, times[FEW];
} seen;
static bool see(void *user, uint32_t index)
{
    seen *s = user;
    if (s) s->times[index]++, s->n++;
    return true;
}

static void test_same_overlaps(void **state)
{
    (void)state;
    for (layout how = 0; how < LAYOUTS; how++) {
        double(*places)[2] = make(how, FEW), radii[FEW];
        for (uint32_t i = 0; i < FEW; i++)
            radii[i] = (how == GRID ? 0.5 : 10000) * cn_rng_below(3, 1, i, i % 100 ? 3 : 60);
        cn_plane plane;
        assert_true(cn_plane_init(&plane, (const double(*)[2])places, radii, FEW));
        for (uint32_t i = 0; i < FEW; i++) {
            seen s = { 0 };
            uint32_t n = 0;
            assert_true(cn_plane_overlaps(&plane, i, see, &s));
            for (uint32_t k = i + 1; k < FEW; k++) {
                const bool overlap =
                    hypot(places[i][0] - places[k][0], places[i][1] - places[k][1]) < radii[i] + radii[k];
                assert_int_equal(s.times[k], overlap);
                n += overlap;
            }
            assert_int_equal(s.n, n);
        }
        cn_plane_deinit(&plane);
        free(places);
    }
}

/* Of a hundred thousand places, a query compares some hundred, wherever the places are. */
static void test_few_observations(void **state)
{
    (void)state;
    for (layout how = 0; how < LAYOUTS; how++) {
        double(*places)[2] = make(how, MANY), *radii = calloc(MANY, sizeof *radii);
        cn_plane plane;
        cn_plane_found found[K];
        assert_non_null(radii);
        for (uint32_t i = 0; i < MANY; i++) /* one circle holds a tenth of the scattered, the others some neighbours */
            radii[i] = how == GRID || how == ONE_PLACE ? 0 : how == NORTH_SOUTH ? 10 : i == 0 ? 150000 : 2000;
        assert_true(cn_plane_init(&plane, (const double(*)[2])places, radii, MANY));
        for (uint32_t i = 0; i < MANY; i++)
            assert_int_equal(cn_plane_neighbours(&plane, i, K, found), K);
        assert_true(plane.n_compared < 400ull * MANY);
        plane.n_compared = 0;
        for (uint32_t i = 0; i < MANY; i++)
            cn_plane_nearest(&plane, (double[]){ places[i][0] + 0.3, places[i][1] - 0.2 });
        assert_true(plane.n_compared < 100ull * MANY);
        plane.n_compared = 0;
        for (uint32_t i = 0; i < MANY; i++)
            assert_true(cn_plane_overlaps(&plane, i, see, NULL));
        assert_true(plane.n_compared < 400ull * MANY);
        cn_plane_deinit(&plane);
        free(places);
        free(radii);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_same_neighbours), cmocka_unit_test(test_same_nearest),
                                        cmocka_unit_test(test_same_overlaps), cmocka_unit_test(test_few_observations) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
