/* Hashes of what must be equal in two files: everything except measured times (names with "seconds") and the
 * command line. For HDF5 files the hash covers objects, attributes and their bytes, for CSV the other
 * columns, and for other files all bytes. */
#ifndef LG_TEST_DIGEST_H
#define LG_TEST_DIGEST_H

#include <hdf5.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/files.h"

typedef struct digesting {
    lg_sha256 sha;
    bool failed;
} digesting;

static inline bool digest_skips(const char *name) {
    const char *slash = strrchr(name, '/');
    return strstr(slash != NULL ? slash : name, "seconds") != NULL || strcmp(name, "command") == 0;
}

/* Hashes type, number of elements and bytes of a data set or attribute, as stored. */
static inline void digest_value(digesting *d, hid_t value, bool attribute) {
    const hid_t type = attribute ? H5Aget_type(value) : H5Dget_type(value);
    const hid_t space = attribute ? H5Aget_space(value) : H5Dget_space(value);
    const hssize_t count = H5Sget_simple_extent_npoints(space);
    const size_t bytes = H5Tget_size(type), all = bytes * (size_t)(count > 0 ? count : 0);
    char head[64], *data = malloc(all + 1);
    const herr_t read = all == 0    ? 0
                        : attribute ? H5Aread(value, type, data)
                                    : H5Dread(value, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data);
    d->failed = d->failed || read < 0 || count < 0;
    (void)snprintf(head, sizeof head, "%d %zu %lld", (int)H5Tget_class(type), bytes, (long long)count);
    lg_sha256_add(&d->sha, head, strlen(head));
    if (read >= 0) lg_sha256_add(&d->sha, data, all);
    free(data);
    (void)H5Sclose(space);
    (void)H5Tclose(type);
}

static inline herr_t digest_attribute(hid_t object, const char *name, const H5A_info_t *info, void *user) {
    digesting *d = user;
    (void)info;
    if (digest_skips(name)) return 0;
    const hid_t value = H5Aopen(object, name, H5P_DEFAULT);
    if (value < 0) return -1;
    lg_sha256_add(&d->sha, name, strlen(name) + 1);
    digest_value(d, value, true);
    return H5Aclose(value);
}

static inline herr_t digest_object(hid_t file, const char *name, const H5O_info_t *info, void *user) {
    digesting *d = user;
    if (digest_skips(name)) return 0;
    const hid_t object = H5Oopen(file, name, H5P_DEFAULT);
    if (object < 0) return -1;
    lg_sha256_add(&d->sha, name, strlen(name) + 1);
    if (info->type == H5O_TYPE_DATASET) digest_value(d, object, false);
    const herr_t done = H5Aiterate2(object, H5_INDEX_NAME, H5_ITER_INC, NULL, digest_attribute, d);
    (void)H5Oclose(object);
    return done;
}

static inline bool digest_h5(const char *path, digesting *d) {
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    if (file < 0) return false;
    d->failed = d->failed || H5Ovisit(file, H5_INDEX_NAME, H5_ITER_INC, digest_object, d) < 0;
    return H5Fclose(file) >= 0 && !d->failed;
}

/* Hashes all cells except in columns whose name contains "seconds". Returns false if the last line is
 * incomplete. */
static inline bool digest_csv(FILE *file, digesting *d) {
    static char line[65536];
    bool skipped[256] = {false}, head = true, whole = true;
    while (fgets(line, sizeof line, file) != NULL) {
        whole = strchr(line, '\n') != NULL;
        if (line[0] == '#') {
            lg_sha256_add(&d->sha, line, strlen(line));
            continue;
        }
        size_t column = 0;
        for (const char *cell = line; cell != NULL && column < 256; column++) {
            const char *end = strchr(cell, ',');
            const size_t length = end != NULL ? (size_t)(end - cell) + 1 : strlen(cell);
            const char *found = head ? strstr(cell, "seconds") : NULL;
            if (head) skipped[column] = found != NULL && found < cell + length;
            if (!skipped[column]) lg_sha256_add(&d->sha, cell, length);
            cell = end != NULL ? end + 1 : NULL;
        }
        head = false;
    }
    return whole;
}

static inline bool digest_bytes(FILE *file, digesting *d) {
    char data[65536];
    for (size_t n; (n = fread(data, 1, sizeof data, file)) > 0;) lg_sha256_add(&d->sha, data, n);
    return ferror(file) == 0;
}

static inline bool digest_ends(const char *path, const char *ending) {
    const size_t n = strlen(path), m = strlen(ending);
    return n >= m && strcmp(path + n - m, ending) == 0;
}

/* Returns false if the file does not exist or is incomplete. */
static inline bool digest_file(const char *path, char text[LG_SHA256_TEXT]) {
    digesting d = {.failed = false};
    bool whole = false;
    lg_sha256_init(&d.sha);
    if (digest_ends(path, ".h5")) {
        whole = digest_h5(path, &d);
    } else {
        FILE *file = fopen(path, "rb");
        if (file == NULL) return false;
        whole = digest_ends(path, ".csv") ? digest_csv(file, &d) : digest_bytes(file, &d);
        (void)fclose(file);
    }
    lg_sha256_finish(&d.sha, text);
    return whole;
}

#endif
