/* Reads COLMAP's database. One thread at a time, and not while COLMAP writes. */
#ifndef CONURB_BRIDGE_SQLITE_H
#define CONURB_BRIDGE_SQLITE_H
#include "conurb/base.h"

typedef struct cn_colmap_database cn_colmap_database;

/* CN_ERR_FORMAT when the file is no database, is damaged, or lacks COLMAP's tables. */
CN_NODISCARD cn_status cn_colmap_database_open(cn_colmap_database **database, const char *path);
void cn_colmap_database_close(cn_colmap_database **database);
/* *camera: number of the camera of the photo of this name; 0 when the database has no such photo. */
CN_NODISCARD cn_status cn_colmap_database_camera(cn_colmap_database *database, const char *name, uint32_t *camera);
#endif
