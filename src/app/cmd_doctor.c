#include "app.h"

#include "conurb/batch.h"

#include <stdio.h>
#include <string.h>

static cn_status run_doctor(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder = ".";
    const cn_app_option none[] = { { 0 } };
    cn_checks checks;
    if (args->n) CN_TRY(cn_app_parse(args, &folder, none));
    printf("conurb %s\n", cn_version());
    CN_TRY(cn_doctor(ctx, folder, &checks));
    for (uint32_t i = 0; i < checks.n; i++) {
        const cn_check *c = &checks.list[i];
        printf("%-5s %-11s %s%s%s\n", c->good ? "good" : "LACK", c->name, c->found,
               c->found[0] && c->lack[0] ? "; " : "", c->lack);
    }
    cn_checks_deinit(&checks);
    return CN_OK;
}

const cn_app_command cn_app_doctor = {
    "doctor",
    "what this machine has and lacks",
    "usage: conurb doctor [FOLDER]\n\nLibraries and their versions, processor and kernel set, memory, the disk at "
    "FOLDER (64 MB are written there), the geoid, COLMAP,\n"
    "Slurm, Kubernetes; and what each lack means. FOLDER: where a city is or will be (default: here).\n\nexample: "
    "conurb doctor beach",
    run_doctor,
};
