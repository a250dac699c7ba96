/* Fields as attributes of HDF5 files: numbers and flags as numbers, the rest as texts. */
#ifndef LG_ATTRIBUTES_H
#define LG_ATTRIBUTES_H

#include "files/h5.h"

/* "/run: attribute lr", for sentences; returns `text`. */
const char *lg_field_place(const lg_field *row, char *text, size_t size);
lg_status lg_field_write(lg_h5 *h5, const lg_field *row, const void *run, lg_error *error);
/* LG_NOT_FOUND when there is no such attribute. Ranges are not checked. */
lg_status lg_field_read(lg_h5 *h5, const lg_field *row, void *run, lg_error *error);

#endif
