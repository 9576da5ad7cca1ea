#include "app.h"

#include <getopt.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_OPTIONS = 64, FIRST_CODE = 256 };

const cn_app_option cn_app_common_options[] = {
    { "threads", "N", "use N threads; by default one for each processor", CN_APP_TEXT,
      offsetof(cn_app_common, threads_text), NULL },
    { "device", "NAME",
      "where to train and render: auto, cpu, gpu, gpu:1 and so on, as listed by conurb doctor; several with commas, or "
      "gpu:all, train several tiles at once. By default $CONURB_DEVICE, else for plan, train and run train.device of "
      "city.yaml, else a graphics processor where there is one, else cpu",
      CN_APP_TEXT, offsetof(cn_app_common, device), "auto cpu gpu gpu:0 gpu:all" },
    { "help", NULL, "show this help", CN_APP_FLAG, offsetof(cn_app_common, help), NULL },
    { 0 }
};

/* An option, and the address of its value. */
typedef struct place {
    const cn_app_option *option;
    void *at;
} place;

typedef struct table {
    struct option getopt[MOST_OPTIONS + 1];
    place places[MOST_OPTIONS];
    int n;
} table;

static cn_status add_options(table *t, const cn_app_option *options, void *values)
{
    for (const cn_app_option *o = options; o && o->name; o++) {
        if (t->n == MOST_OPTIONS) return cn_fail(CN_ERR_INTERNAL, "a command has more than %d options", MOST_OPTIONS);
        const int takes = o->kind == CN_APP_FLAG ? no_argument : required_argument;
        t->getopt[t->n] = (struct option){ o->name, takes, NULL, FIRST_CODE + t->n };
        t->places[t->n++] = (place){ o, (char *)values + o->offset };
    }
    return CN_OK;
}

static cn_status take_number(const cn_app_option *o, const char *text, double *number)
{
    char *end;
    *number = strtod(text, &end);
    if (end != text && o->kind == CN_APP_TIME && *end) {
        /* The unit is optional: "60s" and "60" mean the same. */
        if (*end == 'm') *number *= 60;
        if (*end == 'h') *number *= 3600;
        end += *end == 's' || *end == 'm' || *end == 'h';
    }
    return *end || end == text ? cn_fail(CN_ERR_USAGE, "--%s needs a number, not '%s'", o->name, text) : CN_OK;
}

void cn_app_list_values(const char *values, char out[256])
{
    size_t used = 0;
    const char *last = strrchr(values, ' ');
    for (const char *c = values; *c && used < 250; c++) {
        const char *piece = *c != ' ' ? (char[2]){ *c, 0 } : c == last ? " or " : ", ";
        for (; *piece; piece++)
            out[used++] = *piece;
    }
    out[used] = '\0';
}

static cn_status take_choice(const cn_app_option *o, const char *text)
{
    const size_t length = strlen(text);
    for (const char *word = o->values; length; word++) {
        const size_t n = strcspn(word, " ");
        if (n == length && strncmp(word, text, n) == 0) return CN_OK;
        word += n;
        if (!*word) break;
    }
    char list[256];
    cn_app_list_values(o->values, list);
    return cn_fail(CN_ERR_USAGE, "--%s %s: give %s", o->name, text, list);
}

static cn_status take_value(const place *p, const char *text)
{
    const cn_app_option *o = p->option;
    if (o->kind == CN_APP_FLAG) {
        *(bool *)p->at = true;
        return CN_OK;
    }
    if (o->kind == CN_APP_NUMBER || o->kind == CN_APP_TIME) return take_number(o, text, p->at);
    if (o->kind == CN_APP_CHOICE) CN_TRY(take_choice(o, text));
    *(const char **)p->at = text;
    return CN_OK;
}

/* The error for a word that getopt_long rejects. */
static cn_status refuse(const table *t, int answer, const char *word)
{
    const bool known = optopt >= FIRST_CODE && optopt < FIRST_CODE + t->n;
    if (!known) return cn_fail(CN_ERR_USAGE, "no option '%s'; see --help", word);
    const char *name = t->places[optopt - FIRST_CODE].option->name;
    return cn_fail(CN_ERR_USAGE, answer == ':' ? "--%s needs a value" : "--%s takes no value", name);
}

static cn_status take_operand(const cn_app_command *command, const char *word, cn_app_call *call)
{
    if (call->n == command->max_operands) return cn_fail(CN_ERR_USAGE, "'%s': too many words; see --help", word);
    call->operands[call->n++] = word;
    return CN_OK;
}

static cn_status take_threads(cn_app_common *common)
{
    if (!common->threads_text) return CN_OK;
    char *end;
    const long n = strtol(common->threads_text, &end, 10);
    if (end == common->threads_text || *end || n < 1 || n > 1024)
        return cn_fail(CN_ERR_USAGE, "--threads: give 1 to 1024");
    common->threads = (unsigned)n;
    return CN_OK;
}

cn_status cn_app_parse(const cn_app_command *command, int n, char **words, cn_app_common *common, void *values,
                       cn_app_call *call)
{
    table t = { 0 };
    *call = (cn_app_call){ .options = values };
    *common = (cn_app_common){ 0 };
    if (command->defaults)
        memcpy(values, command->defaults, command->size);
    else
        memset(values, 0, command->size);
    CN_TRY(add_options(&t, command->options, values));
    CN_TRY(add_options(&t, cn_app_common_options, common));
    /* optind 0 resets getopt. In the short options, '-' returns operands in their place, as code 1, and ':' reports a
     * missing value separately. */
    optind = 0;
    opterr = 0;
    for (;;) {
        const char *word = words[optind ? optind : 1];
        const int code = getopt_long(n, words, "-:", t.getopt, NULL);
        if (code == -1) break;
        if (code == 1)
            CN_TRY(take_operand(command, optarg, call));
        else if (code >= FIRST_CODE)
            CN_TRY(take_value(&t.places[code - FIRST_CODE], optarg));
        else
            CN_TRY(refuse(&t, code, word));
    }
    /* The words after a "--" are operands. */
    for (; optind < n; optind++)
        CN_TRY(take_operand(command, words[optind], call));
    if (common->help) return CN_OK;
    CN_TRY(take_threads(common));
    return call->n < command->min_operands ? cn_fail(CN_ERR_USAGE, "give the city's folder; see --help") : CN_OK;
}

int cn_app_quality(const char *name)
{
    static const char *const names[] = { "preview", "standard", "high", "reference", "compact" };
    for (int i = 0; name && i < CN_QUALITIES; i++)
        if (strcmp(names[i], name) == 0) return i;
    return -1;
}
