#include "batch/submit.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/process.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const char cn_kubernetes_template[];

/* Names of objects: lower case letters, digits and '-', at most 63 with the number of a pod behind them. A Job that has
 * ended keeps its name and cannot be changed. So the name has a hash of the folder, the items and the time. */
static void object_name(const cn_submission *s, const cn_submit_job *job, char out[64])
{
    char hex[17];
    cn_hash_hex(cn_hash_text(0, "%s\n%s\n%.6f", s->city->folder, job->list, cn_clock_s(CLOCK_REALTIME)), hex);
    snprintf(out, 64, "conurb-%.30s-%s-%.8s", cn_path_base(s->city->folder), job->stage, hex);
    for (char *p = out; *p; p++)
        *p = isalnum((unsigned char)*p) ? (char)tolower((unsigned char)*p) : '-';
}

/* What a pod does: `program` with the city and, in an array, with the item of its index. tail: the last options. */
static char *write_command(const cn_submission *s, const cn_submit_job *job, const char *program, const char *city,
                           const char *tail)
{
    const char *stage = job->stage, *quality = s->options->quality;
    const bool train = strcmp(stage, "train") == 0, group = strcmp(stage, "group") == 0;
    if (strcmp(stage, "merge") == 0)
        return cn_format("%s poses %s --merge%s && exec %s plan %s%s", program, city, tail, program, city, tail);
    if (strcmp(stage, "eval") == 0 || strcmp(stage, "match") == 0)
        return cn_format("exec %s %s %s%s", program, stage, city, tail);
    if (strcmp(stage, "prepare") == 0)
        return cn_format("%s poses %s --split%s && { [ -e %s/poses/groups/groups.json ] || { %s poses %s%s && exec %s "
                         "plan %s%s; }; }",
                         program, city, tail, city, program, city, tail, program, city, tail);
    char *items = cn_shell_word(job->list), *text = NULL;
    if (items)
        text = cn_format("exec %s %s %s --%s \"$(sed -n \"$((JOB_COMPLETION_INDEX + 1))p\" %s)\"%s%s%s", program,
                         group ? "poses" : stage, city,
                         train   ? "tile"
                         : group ? "group"
                                 : "chunk",
                         items, tail, train && quality ? " --quality " : "", train && quality ? quality : "");
    free(items);
    return text;
}

static char *command_of(const cn_submission *s, const cn_submit_job *job)
{
    const cn_submit_options *o = s->options;
    char *city = cn_shell_word(s->city->folder), *device = cn_submit_device_option(o);
    char *program = o->program ? cn_shell_word(o->program) : strdup("conurb");
    char *tail = device ? cn_format(" --threads %u%s", job->cpus, device) : NULL;
    char *text = city && program && tail ? write_command(s, job, program, city, tail) : NULL;
    char *quoted = text ? cn_yaml_string(text) : NULL;
    char *owned[] = { city, device, program, tail, text };
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
        free(owned[i]);
    return quoted;
}

/* A group that failed stops nobody. */
static bool groups_are_due(const cn_submission *s)
{
    for (uint32_t i = 0; i < s->graph.n; i++) {
        const cn_job_node *node = &s->graph.nodes[i];
        if (strcmp(node->stage, "group") == 0 && !node->done && !node->failed) return true;
    }
    return false;
}

static bool is_due(const cn_submission *s, const char *stage)
{
    for (uint32_t i = 0; i < s->graph.n; i++)
        if (strcmp(s->graph.nodes[i].stage, stage) == 0 && !s->graph.nodes[i].done) return true;
    return false;
}

/* Whether all that a job reads is made. Kubernetes has no order among Jobs, and pods that wait would keep the
 * processors and the memory that the others need: so a Job is written when it can begin. */
static bool is_ready(const cn_submission *s, const cn_submit_job *job)
{
    const char *stage = job->stage;
    if (strcmp(stage, "group") == 0) return groups_are_due(s);
    if (strcmp(stage, "merge") == 0) return !groups_are_due(s);
    if (strcmp(stage, "eval") == 0 || strcmp(stage, "match") == 0) return !is_due(s, "train");
    return strcmp(stage, "render") != 0 || (!is_due(s, "train") && !is_due(s, "match"));
}

static cn_status write_job(const cn_submission *s, const cn_submit_job *job, FILE *out)
{
    char name[64], n[16], parallelism[16], cpus[16], memory[16];
    const uint32_t tasks = job->n ? job->n : 1, most = s->options->max_tasks;
    object_name(s, job, name);
    snprintf(n, sizeof n, "%u", tasks);
    snprintf(parallelism, sizeof parallelism, "%u", most && most < tasks ? most : tasks);
    snprintf(cpus, sizeof cpus, "%u", job->cpus);
    snprintf(memory, sizeof memory, "%u", job->memory_mb);
    char *folder = strndup(s->city->folder, (size_t)(cn_path_base(s->city->folder) - s->city->folder));
    /* The path without a final slash. */
    if (folder && strlen(folder) > 1) folder[strlen(folder) - 1] = '\0';
    char *mount = folder ? cn_yaml_string(folder) : NULL, *command = command_of(s, job), *text = NULL;
    cn_status status = cn_fail(CN_ERR_NOMEM, "out of memory for a manifest");
    if (mount && command) {
        const cn_blank blanks[] = { { "name", name },
                                    { "stage", job->stage },
                                    { "n", n },
                                    { "parallelism", parallelism },
                                    { "cpus", cpus },
                                    { "memory_mb", memory },
                                    { "version", cn_version() },
                                    { "mount", mount },
                                    { "command", command },
                                    { NULL, NULL } };
        status = cn_template_fill(s->options->template_dir, "kubernetes.yaml", cn_kubernetes_template, blanks, &text);
    }
    if (status == CN_OK) fprintf(out, "---\n%s", text);
    char *owned[] = { folder, mount, command, text };
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
        free(owned[i]);
    return status;
}

static void keep_line(void *user, char *line)
{
    snprintf(user, 512, "%s", line);
}

static cn_status apply(const cn_submission *s, const char *path)
{
    const char *const argv[] = { "kubectl", "apply", "-f", path, NULL };
    char said[512] = "";
    int code = 0;
    const cn_status status = cn_process_run(s->ctx, argv, "/dev/null", keep_line, said, &code);
    if (status == CN_ERR_TOOL)
        return cn_fail(CN_ERR_TOOL, "kubectl cannot be run; take %s to a machine that has it, or use --dry-run", path);
    CN_TRY(status);
    return code ? cn_fail(CN_ERR_TOOL, "kubectl refused %s: %s", path, said) : CN_OK;
}

static cn_status write_jobs(const cn_submission *s, FILE *out, uint32_t *n)
{
    for (uint32_t i = 0; i < s->n_jobs; i++) {
        if (!is_ready(s, &s->jobs[i])) continue;
        CN_TRY(write_job(s, &s->jobs[i], out));
        ++*n;
    }
    return CN_OK;
}

cn_status cn_submit_kubernetes(cn_submission *s)
{
    char *path = cn_path_join(s->dir, "kubernetes.yaml"), *text = NULL;
    size_t size = 0;
    uint32_t n = 0;
    FILE *stream = path ? open_memstream(&text, &size) : NULL;
    cn_status status = stream ? write_jobs(s, stream, &n) : cn_fail(CN_ERR_NOMEM, "out of memory for a manifest");
    if (stream && fclose(stream) != 0 && status == CN_OK)
        status = cn_fail(CN_ERR_NOMEM, "out of memory for a manifest");
    if (status == CN_OK && n) status = cn_file_write(path, text, size);
    if (status == CN_OK && n) cn_log(s->ctx, CN_LOG_INFO, "kubectl apply -f %s", path);
    if (status == CN_OK && (n < s->n_jobs || is_due(s, "plan")))
        cn_log(s->ctx, CN_LOG_INFO, "other stages follow: submit again when what is submitted has ended");
    if (status == CN_OK && n && !s->options->dry_run) status = apply(s, path);
    free(text);
    free(path);
    return status;
}
