/* Photos in overlapping groups: sizes, cores, overlap, what has no GPS, and the file. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "pose/groups.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SIDE = 24, N = SIDE * SIDE, MOST = 60 };

static double places[N][2];

/* Photos on a grid, each paired with those up to two steps away. */
static void make_pairs(cn_photo_pairs *pairs, uint32_t cut)
{
    *pairs = (cn_photo_pairs){ 0 };
    for (uint32_t a = 0; a < N; a++) {
        places[a][0] = 10.0 * (a % SIDE);
        places[a][1] = 10.0 * (a / SIDE);
        for (uint32_t b = a + 1; b < N; b++) {
            const int dx = (int)(b % SIDE) - (int)(a % SIDE), dy = (int)(b / SIDE) - (int)(a / SIDE);
            const bool across = cut && (a % SIDE < cut) != (b % SIDE < cut);
            if (dx >= -2 && dx <= 2 && dy <= 2 && !across) assert_true(cn_photo_pairs_add(pairs, a, b));
        }
    }
}

/* Every photo is in one core; groups are no larger than MOST; both parts are sorted and hold a photo once. */
static void check_groups(const cn_photo_groups *groups)
{
    uint32_t cores[N] = { 0 };
    for (uint32_t g = 0; g < groups->n; g++) {
        const cn_photo_group *group = &groups->groups[g];
        uint8_t here[N] = { 0 };
        assert_true(group->n <= MOST && group->n_core >= 1 && group->n_core <= group->n);
        for (uint32_t i = 0; i < group->n; i++) {
            assert_true(group->photos[i] < N);
            assert_int_equal(here[group->photos[i]]++, 0);
            if (i && i != group->n_core) assert_true(group->photos[i] > group->photos[i - 1]);
            cores[group->photos[i]] += i < group->n_core;
        }
    }
    for (uint32_t i = 0; i < N; i++)
        assert_int_equal(cores[i], 1);
}

/* Photos that two groups have in common. */
static uint32_t common(const cn_photo_group *a, const cn_photo_group *b)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < a->n; i++)
        for (uint32_t k = 0; k < b->n; k++)
            n += a->photos[i] == b->photos[k];
    return n;
}

static void split(const cn_photo_pairs *pairs, bool placed, cn_photo_groups *groups)
{
    const cn_group_split how = { N, placed ? (const double(*)[2])places : NULL, pairs, MOST };
    assert_int_equal(cn_photo_groups_split(&how, groups), CN_OK);
}

/* Groups that are tied by ten photos or more form so many parts. */
static void check_ties(const cn_photo_groups *groups, uint32_t parts)
{
    uint32_t part[N];
    for (uint32_t g = 0; g < groups->n; g++)
        part[g] = g;
    for (uint32_t a = 0; a < groups->n; a++)
        for (uint32_t b = 0; b < a; b++) {
            if (common(&groups->groups[a], &groups->groups[b]) < 10) continue;
            const uint32_t from = part[a], to = part[b];
            for (uint32_t g = 0; g < groups->n; g++)
                if (part[g] == from) part[g] = to;
        }
    uint32_t seen[N] = { 0 }, distinct = 0;
    for (uint32_t g = 0; g < groups->n; g++)
        distinct += seen[part[g]]++ == 0;
    assert_int_equal(distinct, parts);
}

static void test_by_place(void **state)
{
    (void)state;
    cn_photo_pairs pairs;
    cn_photo_groups groups, again;
    make_pairs(&pairs, 0);
    split(&pairs, true, &groups);
    split(&pairs, true, &again);
    check_groups(&groups);
    check_ties(&groups, 1);
    assert_int_equal(groups.n, N / (MOST * 6 / 10));
    assert_int_equal(groups.n, again.n);
    for (uint32_t g = 0; g < groups.n; g++) {
        const cn_photo_group *a = &groups.groups[g], *b = &again.groups[g];
        assert_int_equal(a->n, b->n);
        assert_memory_equal(a->photos, b->photos, a->n * sizeof *a->photos);
        /* Cores are compact: a square of 36 photos spans six steps. */
        double low[2] = { 1e9, 1e9 }, high[2] = { 0, 0 };
        for (uint32_t i = 0; i < a->n_core; i++)
            for (int k = 0; k < 2; k++) {
                const double at = places[a->photos[i]][k];
                if (at < low[k]) low[k] = at;
                if (at > high[k]) high[k] = at;
            }
        assert_true(high[0] - low[0] <= 90 && high[1] - low[1] <= 90);
    }
    cn_photo_groups_deinit(&groups);
    cn_photo_groups_deinit(&again);
    cn_photo_pairs_deinit(&pairs);
}

static void test_by_pairs_alone(void **state)
{
    (void)state;
    cn_photo_pairs pairs;
    cn_photo_groups groups;
    make_pairs(&pairs, 0);
    split(&pairs, false, &groups);
    check_groups(&groups);
    check_ties(&groups, 1);
    cn_photo_groups_deinit(&groups);
    cn_photo_pairs_deinit(&pairs);
}

/* Two parts of a city that no pair ties are never in one group. */
static void test_separate_parts(void **state)
{
    (void)state;
    cn_photo_pairs pairs;
    cn_photo_groups groups;
    make_pairs(&pairs, 11);
    for (int placed = 0; placed < 2; placed++) {
        split(&pairs, placed, &groups);
        check_groups(&groups);
        check_ties(&groups, 2);
        for (uint32_t g = 0; g < groups.n; g++)
            for (uint32_t i = 1; i < groups.groups[g].n; i++)
                assert_int_equal(groups.groups[g].photos[i] % SIDE < 11, groups.groups[g].photos[0] % SIDE < 11);
        cn_photo_groups_deinit(&groups);
    }
    cn_photo_pairs_deinit(&pairs);
}

/* Photos without any pair are put together, not one a group. */
static void test_lone_photos(void **state)
{
    (void)state;
    const cn_photo_pairs none = { 0 };
    cn_photo_groups groups;
    split(&none, false, &groups);
    check_groups(&groups);
    assert_int_equal(groups.n, N / (MOST * 6 / 10));
    cn_photo_groups_deinit(&groups);
}

static void test_places(void **state)
{
    (void)state;
    cn_photo photos[6] = { { 0 } };
    const cn_photo_index index = { .photos = photos, .n_photos = 6, .n_gps = 4 };
    double(*at)[2];
    for (int i = 0; i < 6; i++) {
        photos[i].has_gps = i != 1 && i != 2;
        photos[i].latitude_deg = 48;
        photos[i].longitude_deg = 11 + 0.001 * i;
    }
    assert_int_equal(cn_photo_places(&index, &at), CN_OK);
    assert_non_null(at);
    assert_memory_equal(at[1], at[0], sizeof at[1]);
    assert_memory_equal(at[2], at[3], sizeof at[2]);
    assert_true(at[5][0] - at[3][0] > 148 && at[5][0] - at[3][0] < 150);
    free(at);
    for (int i = 0; i < 6; i++)
        photos[i].longitude_deg = 11;
    assert_int_equal(cn_photo_places(&index, &at), CN_OK);
    assert_null(at);
}

static void write_text(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
}

static void test_file(void **state)
{
    (void)state;
    char path[] = "/tmp/conurb-groups-XXXXXX";
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    close(fd);
    cn_photo_pairs pairs;
    cn_photo_groups groups, read;
    make_pairs(&pairs, 0);
    split(&pairs, true, &groups);
    assert_int_equal(cn_photo_groups_save(&groups, "key", "GPS", path), CN_OK);
    assert_int_equal(cn_photo_groups_load(&read, "key", N, path), CN_OK);
    check_groups(&read);
    assert_int_equal(read.n, groups.n);
    assert_memory_equal(read.groups[3].photos, groups.groups[3].photos, groups.groups[3].n * sizeof(uint32_t));
    cn_photo_groups_deinit(&read);
    assert_int_equal(cn_photo_groups_load(&read, "other", N, path), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "other photos or settings"));
    assert_int_equal(cn_photo_groups_load(&read, "key", 10, path), CN_ERR_FORMAT);
    assert_null(read.groups);
    write_text(path, "{\"version\": 9, \"key\": \"key\", \"groups\": []}");
    assert_int_equal(cn_photo_groups_load(&read, "key", N, path), CN_ERR_VERSION);
    write_text(path, "{\"version\": 1, \"key\": \"key\", \"groups\": [{\"core\": [1, -2], \"shared\": []}]}");
    assert_int_equal(cn_photo_groups_load(&read, "key", N, path), CN_ERR_FORMAT);
    write_text(path, "{\"version\": 1, \"key\": \"key\", \"groups\": [{\"core\": [1]}]}");
    assert_int_equal(cn_photo_groups_load(&read, "key", N, path), CN_ERR_FORMAT);
    cn_photo_groups_deinit(&groups);
    cn_photo_pairs_deinit(&pairs);
    unlink(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_by_place),       cmocka_unit_test(test_by_pairs_alone),
        cmocka_unit_test(test_separate_parts), cmocka_unit_test(test_lone_photos),
        cmocka_unit_test(test_places),         cmocka_unit_test(test_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
