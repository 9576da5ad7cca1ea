/* The items of a job, in a file. */
#include "batch/submit.h"

#include "base/file.h"
#include "base/hash.h"

#include <stdio.h>
#include <stdlib.h>

/* The name is a hash of the content: a task in the queue keeps the list it was submitted with. */
cn_status cn_submit_write_list(const cn_submission *s, cn_submit_job *job)
{
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    if (!stream) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < job->n; i++)
        fprintf(stream, "%s\n", job->items[i]);
    if (!job->n) fputc('\n', stream);
    cn_status status = fclose(stream) == 0 ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    char hex[17];
    if (status == CN_OK) {
        cn_hash_hex(cn_hash64(text, size), hex);
        job->list = cn_format("%s/%s-%.8s.items", s->dir, job->stage, hex);
        status = job->list ? cn_file_write(job->list, text, size) : cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    free(text);
    return status;
}
