/* Arrays in an archive. One list of rows says what is stored, for saving and for loading. */
#ifndef LG_STORED_H
#define LG_STORED_H

#include "core/core.h"

typedef struct lg_stored {
    const char *path;
    lg_element type;
    uint32_t rank; /* 0: one number */
    uint64_t dims[3];
    void *data;   /* NULL: the row is not stored */
    bool pointed; /* `data` points to a pointer to the numbers */
} lg_stored;

/* The messages of all functions name the path. */
lg_status lg_stored_save(const lg_archive_writer *to, const lg_stored *rows, size_t count, lg_error *error);
lg_status lg_stored_load(const lg_archive_reader *from, const lg_stored *rows, size_t count, lg_error *error);
/* LG_FORMAT if the archive has another shape; called before memory of this size is allocated. */
lg_status lg_stored_check(const lg_archive_reader *from, const lg_stored *rows, size_t count,
                          lg_error *error);
/* LG_NOT_FINITE if a number of a row is not finite. */
lg_status lg_stored_finite(const lg_stored *row, lg_error *error);
/* Allocates the arrays, which are all `pointed`, and loads them. Checks their shapes and that all numbers are
 * finite. */
lg_status lg_stored_make(const lg_context *context, const lg_archive_reader *from, const lg_stored *rows,
                         size_t count, lg_error *error);

/* Turns LG_NOT_FOUND, LG_SHAPE and LG_INVALID_ARGUMENT, where the contents of a file cause them, into
 * LG_FORMAT, in the result and in `error` (may be NULL). */
lg_status lg_as_format(lg_status status, lg_error *error);

#endif
