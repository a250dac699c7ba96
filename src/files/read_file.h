/* Input files. */
#ifndef LG_READ_FILE_H
#define LG_READ_FILE_H

#include <stdint.h>
#include <stdio.h>

#include "liegrad/io.h"

/* A regular file to be read, and its size. Never waits, as opening a pipe that nobody writes to would.
 * Errors: LG_NOT_FOUND; LG_FILE (no regular file, cannot be read). */
lg_status lg_read_open(const char *path, FILE **out, uint64_t *bytes, lg_error *error);
/* Up to `room` bytes from its beginning; their number, 0 where it cannot be read. */
size_t lg_read_first(const char *path, void *out, size_t room);

#endif
