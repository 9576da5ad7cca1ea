/* Text: escaping, widths, lines. */
#include "chart/chart.h"

#include <math.h>
#include <string.h>

#define UNKNOWN 0xfffdu /* stands for bytes that are not UTF-8 */

/* The next character of a text and its number of bytes (RFC 3629). */
static uint32_t next_character(const char *text, size_t *bytes)
{
    const unsigned char *c = (const unsigned char *)text;
    static const uint32_t least[] = { 0, 0, 0x80, 0x800, 0x10000 };
    const size_t n = c[0] < 0x80 ? 1 : c[0] >> 5 == 6 ? 2 : c[0] >> 4 == 14 ? 3 : c[0] >> 3 == 30 ? 4 : 0;
    *bytes = 1;
    if (n <= 1) return n ? c[0] : UNKNOWN;
    uint32_t code = c[0] & (0x7fu >> n);
    for (size_t i = 1; i < n; i++) {
        if (c[i] >> 6 != 2) return UNKNOWN; /* the end of the text, too */
        code = code << 6 | (c[i] & 0x3fu);
    }
    if (code < least[n] || code > 0x10ffff || code >> 11 == 0x1b) return UNKNOWN;
    *bytes = n;
    return code;
}

/* XML 1.0 does not allow control characters, U+FFFE and U+FFFF. */
static void print_escaped(FILE *out, const char *text, size_t size)
{
    for (size_t i = 0, n; i < size; i += n) {
        const uint32_t code = next_character(text + i, &n);
        if (code == '<')
            fputs("&lt;", out);
        else if (code == '&')
            fputs("&amp;", out);
        else if (code == UNKNOWN || code == 0xfffe || code == 0xffff)
            fputs("\xef\xbf\xbd", out);
        else if (code >= 0x20)
            fwrite(text + i, 1, n, out);
    }
}

static void print_line(const cn_chart *chart, const cn_text_block *at, const cn_letters *l, const char *text,
                       size_t size)
{
    static const char *const anchors[] = { "", " text-anchor=\"middle\"", " text-anchor=\"end\"" };
    if (!(isfinite(at->x) && isfinite(at->y))) return;
    fprintf(chart->out, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"%g\"%s%s", at->x, at->y, l->size, anchors[l->anchor],
            l->bold ? " font-weight=\"bold\"" : "");
    if (l->colour) fprintf(chart->out, " fill=\"%s\"", l->colour);
    if (l->halo) fprintf(chart->out, " stroke=\"#fff\" stroke-width=\"%g\" paint-order=\"stroke\"", l->bold ? 4. : 3.);
    fputc('>', chart->out);
    print_escaped(chart->out, text, size);
    fputs("</text>\n", chart->out);
}

void cn_chart_text(const cn_chart *chart, double x, double y, const cn_letters *letters, const char *text)
{
    print_line(chart, &(cn_text_block){ .x = x, .y = y }, letters, text, strlen(text));
}

/* Widths in font sizes: DejaVu Sans, by kind of letter. */
static double width_of(uint32_t code)
{
    if (code >= 0x2e80) return 1;
    if (code >= 0x80) return 0.65;
    if (strchr("ijlI.,:;'|! ", (int)code)) return 0.34;
    if (strchr("frt()[]/-", (int)code)) return 0.41;
    if (strchr("mwMW@%", (int)code)) return 0.98;
    return code >= 'A' && code <= 'Z' ? 0.72 : 0.64;
}

double cn_chart_text_width(const cn_letters *letters, const char *text)
{
    double sum = 0;
    for (size_t i = 0, n; text[i]; i += n)
        sum += width_of(next_character(text + i, &n));
    return sum * letters->size * (letters->bold ? 1.1 : 1);
}

/* Bytes of the first line: up to the last place to break that fits, or to the last character that does. */
static size_t first_line(const cn_text_block *b, const cn_letters *letters, const char *text)
{
    double room = b->width / letters->size / (letters->bold ? 1.1 : 1);
    size_t n = 0, whole = 0;
    for (size_t i = 0; text[i]; i += n) {
        room -= width_of(next_character(text + i, &n));
        if (room < 0) return whole ? whole : i ? i : n;
        if (text[i] == b->after) whole = i + n;
    }
    return strlen(text);
}

double cn_chart_wrap(const cn_chart *chart, const cn_text_block *block, const cn_letters *letters, const char *text)
{
    cn_text_block at = *block;
    for (uint32_t line = 1; *text && line <= block->most_lines; line++) {
        size_t n = first_line(block, letters, text), shown = n;
        at.y += block->line;
        while (shown > 0 && text[shown - 1] == ' ')
            shown--;
        if (line == block->most_lines && text[n]) {
            char cut[512];
            snprintf(cut, sizeof cut, "%.*s...", (int)(shown < 500 ? shown : 500), text);
            print_line(chart, &at, letters, cut, strlen(cut));
        } else
            print_line(chart, &at, letters, text, shown);
        text += n;
        while (*text == ' ')
            text++;
    }
    return at.y;
}
