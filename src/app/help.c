/* Prints the table of commands as --help, as man pages and as completion for bash. */
#include "app.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

enum { LINE = 80 };

/* Prints text in lines of at most LINE columns. The first begins at column `at`, the others at `indent`. An empty line
 * in the text separates paragraphs. */
static void print_wrapped(const char *text, int at, int indent)
{
    bool first = true;
    while (*text) {
        const int gap = (int)strspn(text, " \n");
        const bool paragraph = strncmp(text, "\n\n", 2) == 0;
        text += gap;
        const int n = (int)strcspn(text, " \n");
        if (!n) break;
        if (paragraph || (!first && at + 1 + n > LINE)) {
            printf("%s%*s", paragraph ? "\n\n" : "\n", indent, "");
            at = indent;
        } else if (!first) {
            putchar(' ');
            at++;
        }
        printf("%.*s", n, text);
        at += n;
        first = false;
        text += n;
    }
    putchar('\n');
}

void cn_app_print_commands(void)
{
    printf("conurb %s: turns photos of a place into a model that can be rendered and relit\n\n"
           "usage: conurb COMMAND CITY [OPTIONS]\n\n"
           "CITY is a folder that `conurb init` makes. It holds all that the commands write.\n\n",
           cn_version());
    for (int i = 0; i < cn_app_n_commands; i++)
        printf("  %-10s %s\n", cn_app_commands[i]->name, cn_app_commands[i]->summary);
    printf("\nconurb COMMAND --help shows the options of a command and an example.\n\n"
           "example: conurb init beach --photos photos && conurb run beach\n");
}

/* Writes "--tile ID" to out and returns its length. */
static int option_words(const cn_app_option *o, char out[128])
{
    return snprintf(out, 128, "--%s%s%s", o->name, o->argument ? " " : "", o->argument ? o->argument : "");
}

static void print_options(const cn_app_option *options)
{
    char words[128], values[256] = "", text[1024];
    for (const cn_app_option *o = options; o && o->name; o++) {
        const int n = option_words(o, words);
        printf("  %s", words);
        if (n > 20)
            printf("\n%*s", 24, "");
        else
            printf("%*s", 22 - n, "");
        const bool choice = o->kind == CN_APP_CHOICE;
        if (choice) cn_app_list_values(o->values, values);
        snprintf(text, sizeof text, "%s%s%s", o->help, choice ? ". Values: " : "", choice ? values : "");
        print_wrapped(text, 24, 24);
    }
}

void cn_app_print_help(const cn_app_command *command)
{
    const char *lead = "usage:";
    printf("%s\n\n", command->summary);
    for (const char *form = command->forms; *form; form += strspn(form, "\n")) {
        const int n = (int)strcspn(form, "\n");
        printf("%s conurb %s %.*s%s\n", lead, command->name, n, form, command->options ? " [OPTIONS]" : "");
        lead = "      ";
        form += n;
    }
    if (command->about) {
        putchar('\n');
        print_wrapped(command->about, 0, 0);
    }
    putchar('\n');
    print_options(command->options);
    print_options(cn_app_common_options);
    printf("\nexample: %s\n", command->example);
}

/* ---- man pages ---- */

/* Escapes text for groff: a backslash begins an escape, a minus would become a hyphen, and a dot or quote at the start
 * of a line begins a request. */
static void put_roff(FILE *out, const char *text, size_t n)
{
    bool line_start = true;
    for (size_t i = 0; i < n; i++) {
        if (text[i] == '\n' && i + 1 < n && text[i + 1] == '\n') {
            fputs("\n.PP\n", out);
            i++;
            line_start = true;
            continue;
        }
        if (line_start && (text[i] == '.' || text[i] == '\'')) fputs("\\&", out);
        if (text[i] == '\\')
            fputs("\\e", out);
        else if (text[i] == '-')
            fputs("\\-", out);
        else
            fputc(text[i], out);
        line_start = text[i] == '\n';
    }
}

static void put_text(FILE *out, const char *text)
{
    put_roff(out, text, strlen(text));
    fputc('\n', out);
}

static void put_head(FILE *out, const char *name, const char *summary)
{
    char title[64];
    size_t n = 0;
    for (const char *c = name; *c && n + 1 < sizeof title; c++)
        title[n++] = (char)toupper((unsigned char)*c);
    title[n] = '\0';
    fprintf(out, ".TH %s 1 \"\" \"conurb %s\" \"Conurb\"\n.nh\n.SH NAME\n", title, cn_version());
    put_roff(out, name, strlen(name));
    fputs(" \\- ", out);
    put_text(out, summary);
    fputs(".SH SYNOPSIS\n", out);
}

static void put_man_options(FILE *out, const cn_app_option *options)
{
    for (const cn_app_option *o = options; o && o->name; o++) {
        fputs(".TP\n\\fB\\-\\-", out);
        put_roff(out, o->name, strlen(o->name));
        fputs("\\fR", out);
        if (o->argument) {
            fputs(" \\fI", out);
            put_roff(out, o->argument, strlen(o->argument));
            fputs("\\fR", out);
        }
        fputc('\n', out);
        put_roff(out, o->help, strlen(o->help));
        if (o->kind == CN_APP_CHOICE) {
            char values[256];
            cn_app_list_values(o->values, values);
            fputs(". Values: ", out);
            put_roff(out, values, strlen(values));
        }
        fputs(".\n", out);
    }
}

static void put_command_page(FILE *out, const cn_app_command *c)
{
    char name[64];
    snprintf(name, sizeof name, "conurb-%s", c->name);
    put_head(out, name, c->summary);
    for (const char *form = c->forms; *form; form += strspn(form, "\n")) {
        const size_t n = strcspn(form, "\n");
        fprintf(out, "%s\\fBconurb %s\\fR ", form == c->forms ? "" : ".br\n", c->name);
        put_roff(out, form, n);
        fputs(" [\\fIOPTIONS\\fR]\n", out);
        form += n;
    }
    fputs(".SH DESCRIPTION\n", out);
    put_text(out, c->about ? c->about : c->summary);
    fputs(".SH OPTIONS\n", out);
    put_man_options(out, c->options);
    put_man_options(out, cn_app_common_options);
    fputs(".SH EXAMPLE\n", out);
    put_text(out, c->example);
    fputs(".SH SEE ALSO\n.BR conurb (1)\n", out);
}

static void put_exit_codes(FILE *out)
{
    static const cn_status codes[] = { CN_OK,       CN_ERR_INTERNAL, CN_ERR_USAGE,  CN_ERR_CONFIG,
                                       CN_ERR_DATA, CN_ERR_FORMAT,   CN_ERR_IO,     CN_ERR_NOMEM,
                                       CN_ERR_TOOL, CN_ERR_VERSION,  CN_ERR_LOCKED, CN_ERR_INTERRUPTED };
    fputs(".SH EXIT STATUS\n", out);
    for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) {
        fprintf(out, ".TP\n%d\n", (int)codes[i]);
        put_text(out, cn_status_name(codes[i]));
    }
}

static void put_main_page(FILE *out)
{
    put_head(out, "conurb", "turns photos of a place into a model that can be rendered and relit");
    fputs("\\fBconurb\\fR \\fICOMMAND\\fR \\fICITY\\fR [\\fIOPTIONS\\fR]\n.SH DESCRIPTION\n", out);
    put_text(out, "CITY is a folder that `conurb init` makes. It holds all that the commands write. "
                  "After a stop, run the same command again: it resumes.");
    fputs(".SH COMMANDS\n", out);
    for (int i = 0; i < cn_app_n_commands; i++) {
        fprintf(out, ".TP\n.BR conurb\\-%s (1)\n", cn_app_commands[i]->name);
        put_text(out, cn_app_commands[i]->summary);
    }
    fputs(".SH OPTIONS\n.TP\n\\fB\\-\\-version\\fR\nshow the version.\n", out);
    put_man_options(out, cn_app_common_options);
    put_exit_codes(out);
    fputs(".SH EXAMPLE\n", out);
    put_text(out, "conurb init beach --photos photos && conurb run beach");
}

/* ---- completion ---- */

static void put_names(FILE *out, const cn_app_option *options)
{
    for (const cn_app_option *o = options; o && o->name; o++)
        fprintf(out, " --%s", o->name);
}

static void put_value_words(FILE *out, const cn_app_command *c)
{
    for (const cn_app_option *o = c->options; o && o->name; o++)
        if (o->values) fprintf(out, "        '%s --%s') words='%s' ;;\n", c->name, o->name, o->values);
}

static void put_takes_value(FILE *out, const cn_app_command *c)
{
    bool any = false;
    for (const cn_app_option *o = c->options; o && o->name; o++) {
        if (o->kind == CN_APP_FLAG || o->values) continue;
        fprintf(out, "%s'%s --%s'", any ? " | " : "        ", c->name, o->name);
        any = true;
    }
    if (any) fputs(") return ;;\n", out);
}

/* When the function leaves COMPREPLY empty, bash offers file names. */
static void put_completion(FILE *out)
{
    fputs("# Completion of conurb for bash. Written by conurb itself.\n"
          "_conurb()\n{\n"
          "    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} words=\n"
          "    local command=${COMP_WORDS[1]}\n"
          "    COMPREPLY=()\n"
          "    # bash splits --tile=X into three words.\n"
          "    if [ \"$word\" = = ]; then\n        word=\n"
          "    elif [ \"$before\" = = ]; then\n        before=${COMP_WORDS[COMP_CWORD - 2]}\n    fi\n"
          "    if [ \"$COMP_CWORD\" = 1 ]; then\n        words='--help --version help",
          out);
    for (int i = 0; i < cn_app_n_commands; i++)
        fprintf(out, " %s", cn_app_commands[i]->name);
    fputs("'\n    elif [[ $before = --* ]]; then\n        case \"$command $before\" in\n", out);
    for (int i = 0; i < cn_app_n_commands; i++) {
        put_value_words(out, cn_app_commands[i]);
        put_takes_value(out, cn_app_commands[i]);
    }
    fprintf(out, "        *' --threads') return ;;\n        esac\n    fi\n");
    fputs("    if [ -z \"$words\" ] && [[ $word = -* ]]; then\n        case $command in\n", out);
    for (int i = 0; i < cn_app_n_commands; i++) {
        fprintf(out, "        %s) words='", cn_app_commands[i]->name);
        put_names(out, cn_app_commands[i]->options);
        put_names(out, cn_app_common_options);
        fputs("' ;;\n", out);
    }
    fputs("        esac\n    elif [ -z \"$words\" ] && [ \"$COMP_CWORD\" = 3 ]; then\n        case $command in\n", out);
    for (int i = 0; i < cn_app_n_commands; i++)
        if (cn_app_commands[i]->verbs)
            fprintf(out, "        %s) words='%s' ;;\n", cn_app_commands[i]->name, cn_app_commands[i]->verbs);
    fputs(
        "        esac\n    fi\n"
        "    if [ -n \"$words\" ]; then\n        mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$word\")\n    fi\n"
        "}\ncomplete -o bashdefault -o default -F _conurb conurb\n",
        out);
}

static cn_status make_folder(const char *path)
{
    return mkdir(path, 0777) == 0 || errno == EEXIST ? CN_OK : cn_fail(CN_ERR_IO, "%s: %s", path, strerror(errno));
}

static cn_status finish(FILE *out, const char *path)
{
    const bool good = !ferror(out);
    return fclose(out) == 0 && good ? CN_OK : cn_fail(CN_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
}

/* command NULL: the main page. */
static cn_status write_page(const char *dir, const cn_app_command *command)
{
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/man1/conurb%s%s.1", dir, command ? "-" : "", command ? command->name : "");
    FILE *out = fopen(path, "w");
    if (!out) return cn_fail(CN_ERR_IO, "%s: %s", path, strerror(errno));
    if (command)
        put_command_page(out, command);
    else
        put_main_page(out);
    return finish(out, path);
}

cn_status cn_app_write_pages(const char *dir)
{
    char path[PATH_MAX];
    CN_TRY(make_folder(dir));
    snprintf(path, sizeof path, "%s/man1", dir);
    CN_TRY(make_folder(path));
    CN_TRY(write_page(dir, NULL));
    for (int i = 0; i < cn_app_n_commands; i++)
        CN_TRY(write_page(dir, cn_app_commands[i]));
    snprintf(path, sizeof path, "%s/completions", dir);
    CN_TRY(make_folder(path));
    snprintf(path, sizeof path, "%s/completions/conurb", dir);
    FILE *out = fopen(path, "w");
    if (!out) return cn_fail(CN_ERR_IO, "%s: %s", path, strerror(errno));
    put_completion(out);
    return finish(out, path);
}
