#include "batch/submit.h"

#include "base/file.h"
#include "base/process.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const char cn_kubernetes_template[];

/* Names of objects: lower case letters, digits and '-', at most 63. */
static void object_name(const char *city, const char *stage, char out[64])
{
    snprintf(out, 64, "conurb-%.40s-%s", city, stage);
    for (char *p = out; *p; p++)
        *p = isalnum((unsigned char)*p) ? (char)tolower((unsigned char)*p) : '-';
}

static char *command_of(const cn_submission *s, const cn_submit_job *job)
{
    char *city = cn_shell_word(s->city->folder), *items = cn_shell_word(job->list), *text = NULL;
    const char *quality = s->options->quality;
    if (!city || !items)
        text = NULL;
    else if (strcmp(job->stage, "train") == 0)
        text = cn_format(
            "exec conurb train %s --tile \"$(sed -n \"$((JOB_COMPLETION_INDEX + 1))p\" %s)\" --threads %u%s%s", city,
            items, job->cpus, quality ? " --quality " : "", quality ? quality : "");
    else if (strcmp(job->stage, "render") == 0)
        text =
            cn_format("exec conurb render %s --chunk \"$(sed -n \"$((JOB_COMPLETION_INDEX + 1))p\" %s)\" --threads %u",
                      city, items, job->cpus);
    else if (strcmp(job->stage, "group") == 0)
        text =
            cn_format("exec conurb poses %s --group \"$(sed -n \"$((JOB_COMPLETION_INDEX + 1))p\" %s)\" --threads %u",
                      city, items, job->cpus);
    else if (strcmp(job->stage, "merge") == 0)
        text = cn_format("conurb poses %s --merge --threads %u && exec conurb plan %s --threads %u", city, job->cpus,
                         city, job->cpus);
    else if (strcmp(job->stage, "eval") == 0 || strcmp(job->stage, "match") == 0)
        text = cn_format("exec conurb %s %s --threads %u", job->stage, city, job->cpus);
    else
        text = cn_format("conurb poses %s --split --threads %u && { [ -e %s/poses/groups/groups.json ] || { conurb "
                         "poses %s --threads %u && exec conurb plan %s --threads %u; }; }",
                         city, job->cpus, city, city, job->cpus, city, job->cpus);
    free(city);
    free(items);
    char *quoted = text ? cn_yaml_string(text) : NULL;
    free(text);
    return quoted;
}

/* What a job waits for: match and eval wait for every tile, renders for the match, the merge for every group. */
static char *wait_of(const cn_submission *s, const cn_submit_job *job)
{
    const bool render = strcmp(job->stage, "render") == 0;
    const bool merge = strcmp(job->stage, "merge") == 0;
    const bool waits = render || merge || strcmp(job->stage, "eval") == 0 || strcmp(job->stage, "match") == 0;
    char *city = cn_shell_word(s->city->folder);
    /* The tiles are done when they are trained as the pods before train them. */
    const char *quality = s->options->quality;
    char *text = city ? waits ? cn_format("until conurb status %s --done %s%s%s; do sleep 30; done", city,
                                          render  ? "match"
                                          : merge ? "group"
                                                  : "train",
                                          quality ? " --quality " : "", quality ? quality : "")
                              : cn_format("%s", "true")
                      : NULL;
    char *quoted = text ? cn_yaml_string(text) : NULL;
    free(text);
    free(city);
    return quoted;
}

static cn_status write_job(const cn_submission *s, const cn_submit_job *job, FILE *out)
{
    char name[64], n[16], parallelism[16], cpus[16], memory[16];
    const uint32_t tasks = job->n ? job->n : 1, most = s->options->max_tasks;
    object_name(cn_path_base(s->city->folder), job->stage, name);
    snprintf(n, sizeof n, "%u", tasks);
    snprintf(parallelism, sizeof parallelism, "%u", most && most < tasks ? most : tasks);
    snprintf(cpus, sizeof cpus, "%u", job->cpus);
    snprintf(memory, sizeof memory, "%u", job->memory_mb);
    char *folder = strndup(s->city->folder, (size_t)(cn_path_base(s->city->folder) - s->city->folder));
    /* The path without a final slash. */
    if (folder && strlen(folder) > 1) folder[strlen(folder) - 1] = '\0';
    char *mount = folder ? cn_yaml_string(folder) : NULL, *command = command_of(s, job), *wait = wait_of(s, job),
         *text = NULL;
    cn_status status = cn_fail(CN_ERR_NOMEM, "out of memory for a manifest");
    if (mount && command && wait) {
        const cn_blank blanks[] = { { "name", name },
                                    { "stage", job->stage },
                                    { "n", n },
                                    { "parallelism", parallelism },
                                    { "cpus", cpus },
                                    { "memory_mb", memory },
                                    { "version", cn_version() },
                                    { "mount", mount },
                                    { "command", command },
                                    { "wait", wait },
                                    { NULL, NULL } };
        status = cn_template_fill(s->options->template_dir, "kubernetes.yaml", cn_kubernetes_template, blanks, &text);
    }
    if (status == CN_OK) fprintf(out, "---\n%s", text);
    char *owned[] = { folder, mount, command, wait, text };
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

cn_status cn_submit_kubernetes(cn_submission *s)
{
    char *path = cn_path_join(s->dir, "kubernetes.yaml"), *text = NULL;
    size_t size = 0;
    FILE *stream = path ? open_memstream(&text, &size) : NULL;
    cn_status status = stream ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a manifest");
    for (uint32_t i = 0; i < s->n_jobs && status == CN_OK; i++)
        status = write_job(s, &s->jobs[i], stream);
    if (stream && fclose(stream) != 0 && status == CN_OK)
        status = cn_fail(CN_ERR_NOMEM, "out of memory for a manifest");
    if (status == CN_OK) status = cn_file_write(path, text, size);
    if (status == CN_OK) cn_log(s->ctx, CN_LOG_INFO, "kubectl apply -f %s", path);
    if (status == CN_OK && strcmp(s->jobs[0].stage, "prepare") == 0)
        cn_log(s->ctx, CN_LOG_INFO,
               "poses and plan, or the groups of many photos, come first; submit again when they are done");
    if (status == CN_OK && strcmp(s->jobs[s->n_jobs - 1].stage, "merge") == 0)
        cn_log(s->ctx, CN_LOG_INFO, "groups, poses and plan come first; submit again when they are done");
    if (status == CN_OK && !s->options->dry_run) status = apply(s, path);
    free(text);
    free(path);
    return status;
}
