#include "fake.h"

#include "../common.h"
#include "base/file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char dir[64], said[LOGGED];

static void need(bool good, const char *what)
{
    if (good) return;
    fprintf(stderr, "fake.c: %s failed\n", what);
    exit(1);
}

cn_context fake_ctx = { .log = log_append, .user = said };

void fake_begin(void)
{
    strcpy(dir, "/tmp/conurb-batch-XXXXXX");
    said[0] = '\0';
    need(mkdtemp(dir) != NULL, "mkdtemp");
}

void fake_end(void)
{
    need(folder_remove(dir) == 0, "removing the folder");
}

const char *fake_dir(void)
{
    return dir;
}

const char *fake_log(void)
{
    return said;
}

void fake_write(const char *name, const char *text)
{
    char *path = cn_format("%s/%s", dir, name);
    need(path && cn_file_write(path, text, strlen(text)) == CN_OK, name);
    free(path);
}

char *fake_read(const char *name)
{
    char *path = cn_format("%s/%s", dir, name), *text = NULL;
    size_t size;
    if (cn_file_exists(path))
        need(cn_file_read(path, 1 << 20, &text, &size) == CN_OK, name);
    else
        text = strdup("");
    free(path);
    need(text != NULL, name);
    return text;
}

void fake_no_program(void)
{
    need(setenv("PATH", dir, 1) == 0, "setenv");
}

void fake_program(const char *name, const char *script)
{
    char *path = cn_format("%s/%s", dir, name),
         *text = cn_format("#!/bin/sh\nprintf '%%s\\n' \"$@\" '' >>'%s/calls'\n%s\n", dir, script),
         *search = cn_format("%s:/usr/bin:/bin", dir);
    need(path && text && search, "cn_format");
    fake_write(name, text);
    need(chmod(path, 0700) == 0 && setenv("PATH", search, 1) == 0, "chmod");
    free(path);
    free(text);
    free(search);
}

void fake_submission_begin(cn_submission *submission, cn_city *city, const cn_submit_options *options, const char *name)
{
    fake_begin();
    *city = (cn_city){ .folder = cn_format("%s/%s", dir, name) };
    *submission = (cn_submission){ .ctx = &fake_ctx, .city = city, .options = options };
    submission->dir = cn_city_path(city, "jobs");
    need(submission->dir && cn_folder_make(submission->dir) == CN_OK, "making the folder of jobs");
}

void fake_submission_end(cn_submission *submission, cn_city *city)
{
    for (uint32_t i = 0; i < submission->n_jobs; i++)
        free(submission->jobs[i].list);
    free(submission->dir);
    free(city->folder);
    fake_end();
}
