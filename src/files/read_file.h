/* Opening and reading input files. */
#ifndef LG_READ_FILE_H
#define LG_READ_FILE_H

#include <stdint.h>
#include <stdio.h>

#include "liegrad/core.h"

/* Opens a regular file for reading and gets its size. It never blocks, as opening a pipe without a writer
 * would. Fails with LG_NOT_FOUND, or with LG_FILE if it is not a regular file or cannot be read. */
lg_status lg_read_open(const char *path, FILE **out, uint64_t *bytes, lg_error *error);
/* Reads up to `room` bytes from the beginning of the file; *got becomes the number of bytes. Errors: as
 * lg_read_open. */
lg_status lg_read_first(const char *path, void *out, size_t room, size_t *got, lg_error *error);

#endif
