/* Shared by the readers of fields. */
#ifndef LG_SETTINGS_H
#define LG_SETTINGS_H

#include "liegrad/settings.h"

/* Sets the field's member of `run` without checks. `values` is one number, `count` numbers of a list, or the
 * position of a name. */
void lg_field_fill(const lg_field *row, const double *values, uint32_t count, void *run);

#endif
