#include "app.h"

#include "conurb/batch.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static cn_status run_submit(const cn_context *ctx, const cn_app_args *args)
{
    cn_submit_options o = { 0 };
    const char *folder, *engine = NULL;
    char self[PATH_MAX];
    double max_tasks = 0, cpus = 0;
    int quality;
    const cn_app_option options[] = {
        { "--engine", &engine, NULL, NULL },           { "--dry-run", NULL, NULL, &o.dry_run },
        { "--max-tasks", NULL, &max_tasks, NULL },     { "--cpus", NULL, &cpus, NULL },
        { "--template", &o.template_dir, NULL, NULL }, { "--program", &o.program, NULL, NULL },
        { "--quality", &o.quality, NULL, NULL },       { 0 }
    };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_app_parse_quality(o.quality, &quality));
    if (!engine || (strcmp(engine, "slurm") != 0 && strcmp(engine, "kubernetes") != 0))
        return cn_fail(CN_ERR_USAGE, "--engine %s: give slurm or kubernetes", engine ? engine : "is missing");
    if (max_tasks < 0 || max_tasks > 1e6 || cpus < 0 || cpus > 1024)
        return cn_fail(CN_ERR_USAGE, "--max-tasks goes to 1000000 and --cpus to 1024");
    o.engine = strcmp(engine, "slurm") == 0 ? CN_ENGINE_SLURM : CN_ENGINE_KUBERNETES;
    o.max_tasks = (uint32_t)max_tasks;
    o.cpus = (uint32_t)cpus;
    const ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
    self[n > 0 ? n : 0] = '\0';
    if (!o.program) o.program = n > 0 ? self : "conurb";
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status = cn_city_submit(ctx, city, &o);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_submit = {
    "submit",
    "the same stages on a cluster: Slurm or Kubernetes",
    "usage: conurb submit CITY --engine slurm|kubernetes [--dry-run] [--max-tasks N] [--cpus N] [--template DIR] "
    "[--program PATH]\n"
    "                     [--quality preview|standard|high|reference]\n\n"
    "  --dry-run      write scripts to CITY/jobs and print the commands, submit nothing\n"
    "  --max-tasks N  tasks of a stage at once\n"
    "  --cpus N       processors of a task (default: from the plan's estimate)\n"
    "  --template DIR a site's own slurm.sbatch or kubernetes.yaml; jobs/ of the sources has those to start from\n"
    "  --program PATH the conurb that the tasks run (default: this one)\n\n"
    "Only what is missing is submitted. CITY must be on a file system that every node sees, under the same name.\n\n"
    "example: conurb submit /shared/beach --engine slurm --max-tasks 20 && conurb status /shared/beach --watch",
    run_submit,
};
