/* What readers of fields share. */
#ifndef LG_SETTINGS_H
#define LG_SETTINGS_H

#include "liegrad/fields.h"

/* Sets the value of the run, unchecked: one number, `count` numbers of a list, or positions of names. */
void lg_field_fill(const lg_field *row, const double *values, uint32_t count, void *run);

#endif
