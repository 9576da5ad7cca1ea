/* Files: whole reads, atomic replacement (temporary name, fsync, rename, fsync of the folder), folders.
 * Failures are CN_ERR_IO (or CN_ERR_NOMEM) and name the path and the reason. Any thread, but only one at a time may
 * write one path. */
#ifndef CONURB_BASE_FILE_H
#define CONURB_BASE_FILE_H
#include "conurb/base.h"
#include <dirent.h>
#include <stdio.h>

/* Reads a whole file; *data is NUL-terminated past size; caller frees. CN_ERR_FORMAT above max_bytes (0: 1 GiB). */
CN_NODISCARD cn_status cn_file_read(const char *path, size_t max_bytes, char **data, size_t *size);
/* Replaces path atomically and durably with these bytes. */
CN_NODISCARD cn_status cn_file_write(const char *path, const void *data, size_t size);

/* A file that is being written under a temporary name in the same folder. Writes to `stream` need no check: commit
 * reports what failed. Either commit or abort releases everything. */
typedef struct cn_writer {
    FILE *stream;
    char *path, *temporary;
} cn_writer;
CN_NODISCARD cn_status cn_writer_open(cn_writer *writer, const char *path);
CN_NODISCARD cn_status cn_writer_commit(cn_writer *writer); /* flush, fsync, rename; on failure the old file stays */
/* Removes the temporary; safe after commit and when zeroed. */
void cn_writer_abort(cn_writer *writer);
/* Fails as writing the file will, where that can be known before what it takes hours to make: its folder is missing or
 * must not be written to, or path is a folder. */
CN_NODISCARD cn_status cn_file_check(const char *path);
/* The temporary name used for path ("d/x.png": "d/.x.tmp-PID.png"), for libraries that write files themselves and go by
 * the extension; then cn_file_replace. Caller frees; NULL when out of memory. */
char *cn_file_temporary(const char *path);
CN_NODISCARD cn_status cn_file_replace(const char *temporary, const char *path); /* on failure temporary is removed */

bool cn_file_exists(const char *path);
CN_NODISCARD cn_status
cn_folder_make(const char *path); /* makes the folder and its parents, durably; no error when it exists */
CN_NODISCARD cn_status cn_folder_of_make(const char *path); /* the folder that path lies in */
/* Removes a folder with all that is in it; no error when it does not exist. */
CN_NODISCARD cn_status cn_folder_remove(const char *path);
/* The next name in an open folder, except "." and ".."; NULL at the end. The name is valid until the next call.
 * CN_ERR_IO: the folder cannot be read; the message names it. */
CN_NODISCARD cn_status cn_folder_next(DIR *dir, const char *path, const char **name);
CN_NODISCARD cn_status cn_file_remove(const char *path); /* removes the file durably; no error when it does not exist */
/* fsync of the folder that path lies in: makes renames, new files and removals in it durable. */
CN_NODISCARD cn_status cn_file_sync_folder(const char *path);
/* Removes the temporaries (cn_file_temporary) that dead processes left in folder: those at least age_s old, and only
 * those for "STEM" or "STEM.x" when stem is not NULL. The caller must know that no process writes them (age_s 0), or
 * give an age that no running writer can reach. No error when the folder does not exist. */
CN_NODISCARD cn_status cn_folder_sweep(const char *folder, const char *stem, double age_s);
/* printf into a new string; caller frees; NULL when out of memory. */
char *cn_format(const char *format, ...) CN_PRINTF(1, 2);
char *cn_path_join(const char *folder, const char *name); /* caller frees; name alone when it is absolute */
const char *cn_path_base(const char *path);               /* after the last '/' */
/* As people sort names: a run of digits counts as a number, so photo2 is before photo10. 0 for equal names only. */
int cn_path_compare(const char *a, const char *b);
/* The numbers 0 to n - 1 in the order of their names by cn_path_compare; equal names by number. name(of, i) is the name
 * of i, and lives as long as the call. The caller frees the list; NULL when out of memory. */
uint32_t *cn_path_order(uint32_t n, const char *(*name)(const void *of, uint32_t i), const void *of);
CN_NODISCARD cn_status cn_path_absolute(const char *path, char **absolute); /* must exist; caller frees */
#endif
