/* Databases as COLMAP makes them, for tests. All functions fail the test when SQLite fails. */
#ifndef CONURB_TESTS_COLMAP_DATABASE_H
#define CONURB_TESTS_COLMAP_DATABASE_H
#include <stddef.h>
#include <stdint.h>

/* COLMAP 3.8's tables of cameras, images, descriptors, keypoints, matches and two_view_geometries, empty. */
void colmap_database_make(const char *path);
/* descriptors: n of 128 bytes. */
void colmap_database_add(const char *path, uint32_t photo, const char *name, const uint8_t *descriptors, uint32_t n);
/* keypoints: x, y and an affine shape, n of them. */
void colmap_database_add_keypoints(const char *path, uint32_t photo, const float (*keypoints)[6], uint32_t n);
/* n verified matches of photos a and b. */
void colmap_database_relate(const char *path, uint32_t a, uint32_t b, uint32_t n);
/* Runs a statement with a number ?1 and two blobs ?2, ?3; b may be NULL. */
void colmap_database_bind(const char *path, const char *sql, int64_t key, const void *a, size_t a_size, const void *b,
                          size_t b_size);
void colmap_database_run(const char *path, const char *sql);
/* Number in the first row and column of a query's answer. */
int64_t colmap_database_ask(const char *path, const char *sql);
/* All matches and geometries as text, in the order of pairs. The caller frees it. */
char *colmap_database_dump(const char *path);
#endif
