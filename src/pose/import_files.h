/* A list of files that an import is read from. */
#ifndef CONURB_POSE_IMPORT_FILES_H
#define CONURB_POSE_IMPORT_FILES_H
#include "conurb/base.h"

typedef struct cn_import_files {
    char **paths;
    uint32_t n;
} cn_import_files;
/* Takes ownership of the path, also on failure; NULL is CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_import_files_add(cn_import_files *files, char *path);
/* Adds the JSON files of a folder, in order of name. */
CN_NODISCARD cn_status cn_import_files_add_json(cn_import_files *files, const char *folder);
void cn_import_files_deinit(cn_import_files *files);
#endif
