/* Whether a text is SVG that every reader takes. */
#ifndef CONURB_TESTS_SVG_H
#define CONURB_TESTS_SVG_H
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdbool.h>
#include <string.h>

/* One tag from '<' on: its end, and whether it opens (+1), closes (-1) or stands alone (0); its name. Attributes are
 * quoted. */
static const char *read_tag(const char *p, int *depth, char name[32])
{
    const bool closes = p[1] == '/';
    size_t n = strspn(p + 1 + closes, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ");
    assert_true(n > 0 && n < 32);
    memcpy(name, p + 1 + closes, n);
    name[n] = '\0';
    for (p += 1 + closes + n; *p != '>' && *p != '/';) {
        p += strspn(p, " \n");
        if (*p == '>' || *p == '/') break;
        n = strcspn(p, "=<>\" \n");
        assert_true(n > 0 && p[n] == '=' && p[n + 1] == '"');
        p += n + 2;
        n = strcspn(p, "\"<");
        assert_true(p[n] == '"');
        p += n + 1;
    }
    *depth = *p == '/' ? 0 : closes ? -1 : 1;
    if (*p == '/') p++;
    assert_true(*p == '>');
    return p + 1;
}

/* Characters that XML 1.0 takes, in UTF-8 as RFC 3629 has it. */
static void check_characters(const char *text)
{
    static const uint32_t least[] = { 0, 0x80, 0x800, 0x10000 };
    for (const unsigned char *c = (const unsigned char *)text; *c; c++) {
        const int more = *c < 0x80 ? 0 : *c >> 5 == 6 ? 1 : *c >> 4 == 14 ? 2 : *c >> 3 == 30 ? 3 : -1;
        if (more < 0) fail_msg("byte %02x begins no character: %.40s", *c, (const char *)c);
        uint32_t code = more ? *c & (0x3fu >> more) : *c;
        for (int i = 0; i < more; i++) {
            if (c[1] >> 6 != 2) fail_msg("a character is cut: %.40s", (const char *)c);
            code = code << 6 | (*++c & 0x3fu);
        }
        assert_true(code >= 0x20 || code == '\n');
        assert_true(code < 0xd800 || (code > 0xdfff && code != 0xfffe && code != 0xffff && code <= 0x10ffff));
        assert_true(code >= least[more]);
    }
}

/* Tags nest, bare & and < do not occur, and every number is one. Returns how many tags there are. */
static size_t check_well_formed(const char *text)
{
    char open[16][32], name[32];
    int n_open = 0, depth;
    size_t n = 0;
    assert_true(strncmp(text, "<svg ", 5) == 0);
    check_characters(text);
    for (const char *p = text; *p;) {
        if (*p == '&') assert_true(strncmp(p, "&lt;", 4) == 0 || strncmp(p, "&amp;", 5) == 0);
        if (*p != '<') {
            p++;
            continue;
        }
        const char *tag = p;
        p = read_tag(p, &depth, name);
        const size_t size = (size_t)(p - tag);
        assert_null(memmem(tag, size, "nan", 3));
        assert_null(memmem(tag, size, "\"inf", 4));
        assert_null(memmem(tag, size, "-inf", 4));
        n++;
        if (depth > 0) {
            assert_true(n_open < 16);
            strcpy(open[n_open++], name);
        } else if (depth < 0) {
            assert_true(n_open > 0);
            assert_string_equal(open[--n_open], name);
        }
    }
    assert_int_equal(n_open, 0);
    return n;
}
#endif
