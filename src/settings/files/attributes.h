/* Reads and writes fields as attributes of HDF5 files. Numbers and flags are stored as numbers, everything
 * else as texts. */
#ifndef LG_ATTRIBUTES_H
#define LG_ATTRIBUTES_H

#include "liegrad/settings.h"

#include "files/h5.h"

/* Fails with LG_NOT_FINITE for a real that is not finite, with `status` for a value out of range. */
lg_status lg_field_check(const char *path, const lg_field *row, const void *run, lg_status status,
                         lg_error *error);
lg_status lg_field_write(lg_h5 *h5, const lg_field *row, const void *run, lg_error *error);
/* Fails with LG_NOT_FOUND if there is no such attribute. Does not check ranges. */
lg_status lg_field_read(lg_h5 *h5, const lg_field *row, void *run, lg_error *error);
/* Reads and checks; whatever is wrong with the attribute is LG_FORMAT or LG_NOT_FINITE. */
lg_status lg_field_get(lg_h5 *h5, const lg_field *row, void *run, lg_error *error);

#endif
