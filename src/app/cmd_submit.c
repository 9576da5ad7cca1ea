#include "app.h"

#include "conurb/batch.h"
#include "conurb/device.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct options {
    cn_submit_options submit;
    const char *engine;
    double max_tasks, cpus;
} options;

static const cn_app_option table[] = {
    { "engine", "NAME", "the cluster's scheduler; required", CN_APP_CHOICE, offsetof(options, engine),
      "slurm kubernetes" },
    { "dry-run", NULL, "write the scripts to CITY/jobs and print the commands; submit nothing", CN_APP_FLAG,
      offsetof(options, submit.dry_run), NULL },
    { "max-tasks", "N", "run at most N tasks of a stage at the same time", CN_APP_NUMBER, offsetof(options, max_tasks),
      NULL },
    { "cpus", "N", "processors for each task; by default from the estimate of the plan", CN_APP_NUMBER,
      offsetof(options, cpus), NULL },
    { "template", "DIR",
      "folder with your own slurm.sbatch or kubernetes.yaml. The folder jobs/ of the sources has examples", CN_APP_TEXT,
      offsetof(options, submit.template_dir), NULL },
    { "program", "PATH", "the conurb program that the tasks run; by default this one (Kubernetes: that of the image)",
      CN_APP_TEXT, offsetof(options, submit.program), NULL },
    { "quality", "NAME", "preset, instead of the one in city.yaml; its other settings hold", CN_APP_CHOICE,
      offsetof(options, submit.quality), CN_APP_QUALITIES },
    { 0 }
};

/* The tasks use the device, on machines that may have others: only the form of its name is checked here. */
static cn_status choose_device(const cn_app_call *call, cn_submit_options *submit)
{
    const char *name = call->device ? call->device : getenv("CONURB_DEVICE");
    submit->device = name && *name ? name : NULL;
    cn_device *device = NULL;
    const cn_status status = submit->device ? cn_device_create(submit->device, &device) : CN_OK;
    cn_device_destroy(&device);
    if (status != CN_ERR_USAGE) return CN_OK;
    return cn_fail(status, "%s: %s", call->device ? "--device" : "CONURB_DEVICE", cn_error_message());
}

static cn_status run_submit(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_submit_options submit = o->submit;
    char self[PATH_MAX];
    if (!o->engine) return cn_fail(CN_ERR_USAGE, "--engine is missing: give slurm or kubernetes");
    if (o->max_tasks < 0 || o->max_tasks > 1e6 || o->cpus < 0 || o->cpus > 1024)
        return cn_fail(CN_ERR_USAGE, "--max-tasks: give 0 to 1000000; --cpus: give 0 to 1024");
    submit.engine = strcmp(o->engine, "slurm") == 0 ? CN_ENGINE_SLURM : CN_ENGINE_KUBERNETES;
    submit.max_tasks = (uint32_t)o->max_tasks;
    submit.cpus = (uint32_t)o->cpus;
    const ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
    self[n > 0 ? n : 0] = '\0';
    if (!submit.program && submit.engine == CN_ENGINE_SLURM) submit.program = n > 0 ? self : "conurb";
    CN_TRY(choose_device(call, &submit));
    cn_city *city;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = cn_city_submit(ctx, city, &submit);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_submit = {
    .name = "submit",
    .summary = "run the stages on a cluster: Slurm or Kubernetes",
    .forms = "CITY",
    .about =
        "Submits only the stages that are due. CITY must be on a file system that every node sees under the same path. "
        "Kubernetes has no order among jobs and gets only those that can begin: submit again when they have ended.",
    .example = "conurb submit /shared/beach --engine slurm --max-tasks 20",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .passes_device = true,
    .run = run_submit,
};
