/* Reads and writes fields as attributes of HDF5 files. Numbers and flags are stored as numbers, everything
 * else as texts. */
#ifndef LG_ATTRIBUTES_H
#define LG_ATTRIBUTES_H

#include "liegrad/settings.h"

#include "files/h5.h"

/* Formats "/run: attribute lr" for error messages. Returns `text`. */
const char *lg_field_place(const lg_field *row, char *text, size_t size);
lg_status lg_field_write(lg_h5 *h5, const lg_field *row, const void *run, lg_error *error);
/* Fails with LG_NOT_FOUND if there is no such attribute. Does not check ranges. */
lg_status lg_field_read(lg_h5 *h5, const lg_field *row, void *run, lg_error *error);

#endif
