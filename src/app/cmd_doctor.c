#include "app.h"

#include "conurb/batch.h"

#include <stdio.h>

static cn_status run_doctor(const cn_context *ctx, const cn_app_call *call)
{
    cn_checks checks;
    printf("conurb %s\n", cn_version());
    CN_TRY(cn_doctor(ctx, call->n ? call->operands[0] : ".", &checks));
    for (uint32_t i = 0; i < checks.n; i++) {
        const cn_check *c = &checks.list[i];
        printf("%-5s %-11s %s%s%s\n", c->good ? "good" : "LACK", c->name, c->found,
               c->found[0] && c->lack[0] ? "; " : "", c->lack);
    }
    cn_checks_deinit(&checks);
    return CN_OK;
}

const cn_app_command cn_app_doctor = {
    .name = "doctor",
    .summary = "check what this machine has, and what it lacks",
    .forms = "[FOLDER]",
    .about = "Lists libraries and their versions, the processor and the instruction set in use, memory, the disk at "
             "FOLDER, the geoid, COLMAP, Slurm, Kubernetes and graphics processors. (--device gpu:N trains and renders "
             "on one of them.) For each thing that is missing it says what that means.\n\nFOLDER is "
             "where a city "
             "is or will be; by default the current folder. A test file of 64 MiB is written there and removed.",
    .example = "conurb doctor beach",
    .max_operands = 1,
    .run = run_doctor,
};
