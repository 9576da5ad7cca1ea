/* Messages that wait for a page. */
#include "view/session.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static void wake(void *user)
{
    (void)user;
}

static bool next_is(cn_session *s, const char *text)
{
    cn_out *out = cn_session_next(s);
    const bool it = out && out->size == strlen(text) && memcmp(out->bytes + CN_OUT_ROOM, text, out->size) == 0;
    cn_out_destroy(out);
    return it;
}

/* A page that reads nothing for minutes while a film is made, or while tiles are trained. */
static void a_slow_page_gets_the_newest_progress(void **state)
{
    (void)state;
    cn_live *live = malloc(sizeof *live);
    assert_non_null(live);
    cn_live_init(live, NULL, wake, NULL);
    cn_session *s = cn_session_take(live);
    assert_non_null(s);
    cn_live_send_all(live, "a film begins", -1);
    for (char step[] = "0"; step[0] <= 'z'; step[0]++) {
        cn_live_send_all(live, step, CN_SLOT_STATE);
        cn_live_send_all(live, step, CN_SLOT_PROGRESS);
    }
    cn_live_send_all(live, "it is done", -1);
    assert_false(cn_session_overrun(s));
    assert_true(next_is(s, "a film begins"));
    assert_true(next_is(s, "z") && next_is(s, "z"));
    assert_true(next_is(s, "it is done"));
    assert_null(cn_session_next(s));
    /* What a page must get is not left out: there is an end to it. */
    for (int i = 0; i <= CN_OUT_MAX; i++)
        cn_live_send_all(live, "it is done", -1);
    assert_true(cn_session_overrun(s));
    cn_session_leave(s);
    cn_live_deinit(live);
    free(live);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_slow_page_gets_the_newest_progress) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
