/* Matches of pairs of photos: by Conurb and then verified by COLMAP, or both by COLMAP. */
#include "base/file.h"
#include "pose/colmap.h"
#include "pose/pair_matcher.h"
#include "pose/retrieval.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EVERY_PAIR 200 /* photos at most of which every pair is matched, unless the settings say otherwise */
#define LONG_LIST 1000 /* number of photos from which matching every pair gives a warning */
/* COLMAP saves its matches at the end of each block. Its default block is 50 x 50 photos or 1225 pairs, so a small
 * collection is one block, and a killed run loses all matches. Use smaller blocks. */
enum { LEAST_BLOCK = 6, MOST_BLOCK = 50, BLOCKS = 8 };     /* photos; blocks a side */
enum { LEAST_PAIRS = 100, MOST_PAIRS = 1225, PARTS = 50 }; /* pairs; parts of the list */

/* COLMAP skips pairs that are in the database. Keep those of a killed run with the same inputs; remove those of other
 * inputs, such as another matcher. */
static cn_status begin_matches(cn_colmap_job *j)
{
    char *begun = cn_job_marker(j, j->stage, "begun"), *done = cn_job_marker(j, j->stage, "done");
    const bool room = begun && done, fresh = room && !cn_file_exists(begun) && !cn_file_exists(done);
    free(begun);
    free(done);
    if (!room) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(cn_job_unmark(j));
    if (cn_job_is_marked(j, "begun")) {
        cn_log(j->ctx, CN_LOG_INFO, "matching resumes with the matches of an earlier run");
        return CN_OK;
    }
    if (!fresh) {
        int exit_code;
        const char *const argv[] = { j->options->colmap, "database_cleaner", "--type", "matches",
                                     "--database_path",  j->database,        NULL };
        CN_TRY(cn_job_remove_marker(j, j->stage, "begun"));
        CN_TRY(cn_job_run(j, argv, &exit_code));
        if (exit_code) return cn_job_failed(j, exit_code);
    }
    return cn_job_mark(j, "begun");
}

static cn_status match(cn_colmap_job *j, const char *command, const char *const *extra)
{
    const char *const base[] = { j->options->colmap,
                                 command,
                                 "--database_path",
                                 j->database,
                                 "--SiftMatching.use_gpu",
                                 "0",
                                 "--SiftMatching.num_threads",
                                 j->threads,
                                 NULL };
    const char *argv[CN_JOB_WORDS];
    int n = 0, exit_code;
    cn_job_words(argv, &n, base);
    cn_job_words(argv, &n, extra);
    cn_job_words(argv, &n, j->way->matches);
    CN_TRY(cn_job_run(j, argv, &exit_code));
    return exit_code ? cn_job_failed(j, exit_code) : CN_OK;
}

static cn_matcher choose_matcher(const cn_colmap_job *j)
{
    if (j->way->every_pair && j->index->n_photos <= EVERY_PAIR) return CN_MATCH_EXHAUSTIVE;
    if (j->options->matcher != CN_MATCH_AUTO) return j->options->matcher;
    if (2 * (uint64_t)j->index->n_gps > j->index->n_photos) return CN_MATCH_GPS;
    return j->index->n_photos <= EVERY_PAIR ? CN_MATCH_EXHAUSTIVE : CN_MATCH_RETRIEVAL;
}

static cn_status match_part(cn_colmap_job *j, const char *path, const cn_photo_pairs *part)
{
    const char *const extra[] = { "--match_list_path", path, "--match_type", "pairs", NULL };
    char *text;
    size_t size;
    CN_TRY(cn_photo_pairs_text(j->index, j->linked, part, &text, &size));
    cn_status status = cn_file_write(path, text, size);
    free(text);
    return status == CN_OK ? match(j, "matches_importer", extra) : status;
}

/* One part of the list at a time, because COLMAP saves its matches at the end of a list. Pairs that have matches are
 * only verified. */
static cn_status match_parts(cn_colmap_job *j, const cn_photo_pairs *pairs)
{
    char *path = cn_path_join(j->dir, "pairs.txt");
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    const size_t most = (size_t)fmin(fmax(j->total / PARTS, LEAST_PAIRS), MOST_PAIRS);
    for (size_t at = 0, n; at < pairs->n && status == CN_OK; at += n) {
        n = pairs->n - at < most ? pairs->n - at : most;
        j->part = (double)n;
        status = match_part(j, path, &(cn_photo_pairs){ pairs->items + at, n, n });
        if (status != CN_OK) break;
        j->base += (double)n;
        cn_job_tell(j, j->base);
    }
    free(path);
    return status;
}

/* Matches the pairs here, and lets COLMAP verify them. */
static cn_status match_exactly(cn_colmap_job *j, const cn_photo_pairs *pairs)
{
    cn_photo_pairs left = { 0 };
    CN_TRY(cn_pairs_match(j, pairs));
    CN_TRY(cn_pairs_unverified(j, pairs, &left));
    cn_log(j->ctx, CN_LOG_INFO, "%zu of %zu pairs have matches that COLMAP has to verify", left.n, pairs->n);
    cn_job_begin(j, "verification", (double)left.n);
    const cn_status status = match_parts(j, &left);
    cn_photo_pairs_deinit(&left);
    j->stage = "matches";
    return status;
}

static cn_status match_pairs(cn_colmap_job *j, const cn_photo_pairs *pairs, bool exactly)
{
    cn_job_mix(j, pairs->items, pairs->n * sizeof *pairs->items);
    if (cn_job_is_done(j)) return CN_OK;
    cn_log(j->ctx, CN_LOG_INFO, "matching %zu pairs of photos", pairs->n);
    cn_job_begin(j, "matches", (double)pairs->n);
    CN_TRY(begin_matches(j));
    CN_TRY(exactly ? match_exactly(j, pairs) : match_parts(j, pairs));
    return cn_job_mark_done(j);
}

/* COLMAP's own lists: every pair; for a film, each photo with the next ones. */
static cn_status match_by_colmap(cn_colmap_job *j, cn_matcher matcher)
{
    const uint32_t n = j->index->n_photos;
    cn_job_mix(j, &matcher, sizeof matcher);
    if (cn_job_is_done(j)) return CN_OK;
    cn_job_begin(j, "matches", matcher == CN_MATCH_SEQUENTIAL ? n : 0.5 * n * (n - 1.0));
    CN_TRY(begin_matches(j));
    if (matcher == CN_MATCH_SEQUENTIAL) {
        CN_TRY(match(j, "sequential_matcher", NULL));
        return cn_job_mark_done(j);
    }
    char block[16];
    const char *const extra[] = { "--ExhaustiveMatching.block_size", block, NULL };
    snprintf(block, sizeof block, "%.0f", fmin(fmax(n / BLOCKS, LEAST_BLOCK), MOST_BLOCK));
    CN_TRY(match(j, "exhaustive_matcher", extra));
    return cn_job_mark_done(j);
}

static cn_status match_alike(cn_colmap_job *j, bool exactly)
{
    cn_photo_pairs pairs = { 0 };
    CN_TRY(cn_photo_pairs_retrieve(j, &pairs));
    j->stage = "matches";
    const cn_status status = match_pairs(j, &pairs, exactly);
    cn_photo_pairs_deinit(&pairs);
    return status;
}

static cn_status match_without_gps(cn_colmap_job *j, cn_matcher matcher, bool exactly)
{
    const uint32_t n = j->index->n_photos;
    cn_photo_pairs pairs = { 0 };
    if (matcher == CN_MATCH_EXHAUSTIVE && n > LONG_LIST)
        cn_log(j->ctx, CN_LOG_WARN,
               "matching every pair of %u photos takes long; poses.matcher: retrieval takes much less", n);
    if (!exactly) return match_by_colmap(j, matcher);
    const bool sequence = matcher == CN_MATCH_SEQUENTIAL;
    CN_TRY(sequence ? cn_photo_pairs_in_sequence(j->index, &pairs) : cn_photo_pairs_all(n, &pairs));
    const cn_status status = match_pairs(j, &pairs, true);
    cn_photo_pairs_deinit(&pairs);
    return status;
}

cn_status cn_colmap_matches(cn_colmap_job *j)
{
    /* Options of a way to match are COLMAP's. */
    const bool exactly = j->options->match_with == CN_MATCH_WITH_CONURB && !j->way->matches;
    cn_photo_pairs pairs = { 0 };
    cn_matcher matcher = choose_matcher(j);
    cn_job_begin(j, "matches", 0.0);
    cn_job_mix_words(j, j->way->matches);
    cn_job_mix(j, exactly ? "exact" : "colmap", 5);
    if (matcher == CN_MATCH_GPS) {
        CN_TRY(cn_photo_pairs_near(j->index, j->options->neighbours, &pairs));
        const bool some = pairs.n > 0;
        const cn_status status = some ? match_pairs(j, &pairs, exactly) : CN_OK;
        cn_photo_pairs_deinit(&pairs);
        if (some || status != CN_OK) return status;
        cn_log(j->ctx, CN_LOG_WARN, "GPS gives the same place for most photos: pairs are chosen without it");
        matcher = j->index->n_photos <= EVERY_PAIR ? CN_MATCH_EXHAUSTIVE : CN_MATCH_RETRIEVAL;
    }
    return matcher == CN_MATCH_RETRIEVAL ? match_alike(j, exactly) : match_without_gps(j, matcher, exactly);
}
