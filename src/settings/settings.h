/* Shared by the readers of fields, and by the programs that search. */
#ifndef LG_SETTINGS_H
#define LG_SETTINGS_H

#include "liegrad/settings.h"

/* Sets the field's member of `run` without checks. `values` is one number, `count` numbers of a list, or the
 * position of a name. */
void lg_field_fill(const lg_field *row, const double *values, uint32_t count, void *run);

/* Finds the value with this name. no and false are the same name, and so are yes and true. */
bool lg_field_find_name(const lg_field *row, const char *text, uint32_t *value);

/* Returns true if the state, the number of reports and the values of the trial are valid for this space. */
bool lg_trial_is_possible(const lg_search_space *space, const lg_trial *trial);

#endif
