#include "app.h"

#include <string.h>

/* In the order in which people use them. */
const cn_app_command *const cn_app_commands[] = {
    &cn_app_init,    &cn_app_poses,      &cn_app_plan,   &cn_app_train,  &cn_app_match,    &cn_app_render,
    &cn_app_relight, &cn_app_appearance, &cn_app_eval,   &cn_app_steady, &cn_app_tradeoff, &cn_app_export,
    &cn_app_view,    &cn_app_run,        &cn_app_status, &cn_app_submit, &cn_app_doctor,
};
const int cn_app_n_commands = sizeof cn_app_commands / sizeof *cn_app_commands;

const cn_app_command *cn_app_find(const char *name)
{
    for (int i = 0; i < cn_app_n_commands; i++)
        if (strcmp(cn_app_commands[i]->name, name) == 0) return cn_app_commands[i];
    return NULL;
}
