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
    /* The numbers, doubles or floats, must be above 0, or at least 0, or finite. lg_stored_load checks the
     * last two; all numbers of lg_stored_make must be finite. */
    bool positive, not_negative, finite;
    /* `data` is a number (uint32_t) below `names`, stored as the text that `name` gives it; else NULL. */
    const char *(*name)(uint32_t number);
    uint32_t names;
} lg_stored;

/* The messages of all functions name the path. lg_stored_load returns LG_FORMAT for numbers that are not what
 * `finite` and the other members say. */
lg_status lg_stored_save(const lg_archive_writer *to, const lg_stored *rows, size_t count, lg_error *error);
lg_status lg_stored_load(const lg_archive_reader *from, const lg_stored *rows, size_t count, lg_error *error);
/* LG_INVALID_ARGUMENT if a stored number is not the one that its row points to. The rows are single numbers
 * of the types U64 and F64. */
lg_status lg_stored_compare(const lg_archive_reader *from, const lg_stored *rows, size_t count,
                            lg_error *error);
/* Sets the pointer of a `pointed` row to new memory; LG_OUT_OF_MEMORY. */
lg_status lg_stored_allocate(const lg_context *context, const lg_stored *row, lg_error *error);
/* Allocates the arrays, which are all `pointed`, and loads them. Checks their shapes before, and that all
 * numbers are finite (LG_NOT_FINITE), and positive where they must be (LG_FORMAT). */
lg_status lg_stored_make(const lg_context *context, const lg_archive_reader *from, const lg_stored *rows,
                         size_t count, lg_error *error);

/* Turns LG_NOT_FOUND, LG_SHAPE and LG_INVALID_ARGUMENT, where the contents of a file cause them, into
 * LG_FORMAT, in the result and in `error` (may be NULL). */
lg_status lg_as_format(lg_status status, lg_error *error);

#endif
