/* Who may speak to the server. */
#include "view/guard.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

static void hosts(void **state)
{
    (void)state;
    static const char *const good[] = { "localhost",  "localhost:8080", "127.0.0.1:7007", "127.3.2.1",
                                        "[::1]:7007", "[::1]",          "LOCALHOST:1" };
    static const char *const bad[] = {
        "",           "evil.com",    "evil.com:7007",    "localhost.evil.com", "127.0.0.1.evil.com",
        "localhost:", "localhost:x", "localhost:123456", "192.168.1.5:7007",   "[::1",
        ":7007",      "localhost/a", "a@localhost"
    };
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        assert_true(cn_guard_knows_host(good[i], "127.0.0.1", "machine"));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(cn_guard_knows_host(bad[i], "127.0.0.1", "machine"));
    /* Where everybody may come, by address or by the machine's name. */
    assert_true(cn_guard_knows_host("192.168.1.5:7007", "0.0.0.0", "machine"));
    assert_true(cn_guard_knows_host("[fe80::1]:7007", "::", "machine"));
    assert_true(cn_guard_knows_host("machine:7007", "0.0.0.0", "machine.site.org"));
    assert_true(cn_guard_knows_host("machine.site.org", "0.0.0.0", "machine.site.org"));
    assert_false(cn_guard_knows_host("machine.evil.com", "0.0.0.0", "machine.site.org"));
    assert_false(cn_guard_knows_host("machines", "0.0.0.0", "machine"));
    assert_false(cn_guard_knows_host("evil.com", "0.0.0.0", "machine"));
    assert_false(cn_guard_knows_host("evil.com", "0.0.0.0", ""));
}

static void origins(void **state)
{
    (void)state;
    assert_true(cn_guard_knows_origin("", "localhost:7007"));
    assert_true(cn_guard_knows_origin("http://localhost:7007", "localhost:7007"));
    assert_true(cn_guard_knows_origin("https://localhost:7007", "localhost:7007"));
    assert_false(cn_guard_knows_origin("http://localhost:7008", "localhost:7007"));
    assert_false(cn_guard_knows_origin("http://evil.com", "localhost:7007"));
    assert_false(cn_guard_knows_origin("null", "localhost:7007"));
    assert_false(cn_guard_knows_origin("http://localhost:7007.evil.com", "localhost:7007"));
}

static void tokens(void **state)
{
    (void)state;
    char a[CN_TOKEN_SIZE], b[CN_TOKEN_SIZE], found[CN_TOKEN_SIZE], cookie[256];
    assert_int_equal(cn_guard_make_token(a), CN_OK);
    assert_int_equal(cn_guard_make_token(b), CN_OK);
    assert_int_equal(strlen(a), CN_TOKEN_SIZE - 1);
    assert_string_not_equal(a, b);
    assert_true(cn_guard_same_token(a, a));
    assert_false(cn_guard_same_token(b, a));
    assert_false(cn_guard_same_token("", a));
    snprintf(cookie, sizeof cookie, "%sx", a);
    assert_false(cn_guard_same_token(cookie, a));
    cookie[CN_TOKEN_SIZE - 2] = '\0'; /* one short */
    assert_false(cn_guard_same_token(cookie, a));

    char name[CN_GUARD_COOKIE_SIZE], other[CN_GUARD_COOKIE_SIZE];
    cn_guard_cookie_name(7007, name);
    cn_guard_cookie_name(65535, other);
    snprintf(cookie, sizeof cookie, "other=1; %s=%s; %s=%s; more=2", other, b, name, a);
    cn_guard_cookie_token(cookie, 7007, found);
    assert_string_equal(found, a);
    cn_guard_cookie_token(cookie, 65535, found); /* another server of this host */
    assert_string_equal(found, b);
    cn_guard_cookie_token(cookie, 700, found);
    assert_string_equal(found, "");
    snprintf(cookie, sizeof cookie, "not_%s=x", name);
    cn_guard_cookie_token(cookie, 7007, found);
    assert_string_equal(found, "");
    snprintf(cookie, sizeof cookie, "%s=%s%s", name, a, b);
    cn_guard_cookie_token(cookie, 7007, found);
    assert_string_equal(found, "");
}

static void loopback(void **state)
{
    (void)state;
    assert_true(cn_guard_is_loopback("127.0.0.1") && cn_guard_is_loopback("::1") && cn_guard_is_loopback("localhost"));
    assert_false(cn_guard_is_loopback("0.0.0.0") || cn_guard_is_loopback("::") || cn_guard_is_loopback("10.0.0.1") ||
                 cn_guard_is_loopback("127.example.org"));
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(hosts), cmocka_unit_test(origins), cmocka_unit_test(tokens),
                                        cmocka_unit_test(loopback) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
