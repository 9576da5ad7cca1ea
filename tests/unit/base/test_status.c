#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "conurb/base.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>

static void failure_keeps_code_and_text(void **state)
{
    (void)state;
    assert_int_equal(cn_fail(CN_ERR_DATA, "photo %s has %d pixels", "a.jpg", 0), CN_ERR_DATA);
    assert_string_equal(cn_error_message(), "photo a.jpg has 0 pixels");
}

static void message_can_wrap_the_last_message(void **state)
{
    (void)state;
    assert_int_equal(cn_fail(CN_ERR_IO, "disk full"), CN_ERR_IO);
    assert_int_equal(cn_fail(CN_ERR_IO, "tile A: %s", cn_error_message()), CN_ERR_IO);
    assert_string_equal(cn_error_message(), "tile A: disk full");
}

static void long_message_is_cut(void **state)
{
    (void)state;
    char text[3000];
    memset(text, 'x', sizeof text);
    text[sizeof text - 1] = '\0';
    assert_int_equal(cn_fail(CN_ERR_IO, "%s", text), CN_ERR_IO);
    assert_int_equal(strlen(cn_error_message()), 1023);
}

static void *fail_elsewhere(void *seen)
{
    *(bool *)seen = cn_error_message()[0] == '\0' && cn_fail(CN_ERR_IO, "other") == CN_ERR_IO;
    return NULL;
}

static void message_belongs_to_its_thread(void **state)
{
    (void)state;
    bool seen = false;
    pthread_t thread;
    assert_int_equal(cn_fail(CN_ERR_IO, "mine"), CN_ERR_IO);
    assert_int_equal(pthread_create(&thread, NULL, fail_elsewhere, &seen), 0);
    pthread_join(thread, NULL);
    assert_true(seen);
    assert_string_equal(cn_error_message(), "mine");
}

static void every_status_has_a_name(void **state)
{
    (void)state;
    for (int code = CN_OK; code <= CN_ERR_LOCKED; code++)
        assert_string_not_equal(cn_status_name((cn_status)code), "unknown status");
    assert_string_equal(cn_status_name(CN_ERR_INTERRUPTED), "interrupted");
    assert_string_equal(cn_status_name((cn_status)999), "unknown status");
}

typedef struct sink {
    char text[64];
    cn_log_level level;
    double done;
} sink;

static void take_log(void *user, cn_log_level level, const char *text)
{
    sink *s = user;
    s->level = level;
    snprintf(s->text, sizeof s->text, "%s", text);
}

static void take_progress(void *user, const cn_progress_report *report)
{
    ((sink *)user)->done = report->done;
}

static void context_forwards_to_its_sinks(void **state)
{
    (void)state;
    sink s = { 0 };
    int stop = 0;
    const cn_context ctx = { .log = take_log, .progress = take_progress, .user = &s, .stop = &stop };
    const cn_progress_report report = { .stage = "train", .done = 3 };
    cn_log(&ctx, CN_LOG_WARN, "%d photos", 7);
    cn_progress(&ctx, &report);
    assert_string_equal(s.text, "7 photos");
    assert_int_equal(s.level, CN_LOG_WARN);
    assert_true(s.done == 3);
    assert_false(cn_stopping(&ctx));
    stop = 1;
    assert_true(cn_stopping(&ctx));
}

static void empty_context_is_silent(void **state)
{
    (void)state;
    const cn_context empty = { 0 };
    const cn_progress_report report = { 0 };
    cn_log(NULL, CN_LOG_INFO, "nobody hears this");
    cn_log(&empty, CN_LOG_INFO, "nor this");
    cn_progress(NULL, &report);
    cn_progress(&empty, &report);
    assert_false(cn_stopping(NULL));
    assert_false(cn_stopping(&empty));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(failure_keeps_code_and_text), cmocka_unit_test(message_can_wrap_the_last_message),
        cmocka_unit_test(long_message_is_cut),         cmocka_unit_test(message_belongs_to_its_thread),
        cmocka_unit_test(every_status_has_a_name),     cmocka_unit_test(context_forwards_to_its_sinks),
        cmocka_unit_test(empty_context_is_silent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
