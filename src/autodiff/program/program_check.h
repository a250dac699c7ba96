/* Checks of parts that are added to a program. */
#ifndef LG_PROGRAM_CHECK_H
#define LG_PROGRAM_CHECK_H

#include "autodiff/program/program.h"

/* `what` describes the part in the error message, for example "a function". */
lg_status lg_program_check_name(const char *what, const char *name, lg_error *error);
/* Whether the rank is at most `most` and the number of elements is not too large. */
bool lg_program_shape_is_sound(const lg_shape *shape, uint32_t most);
/* Makes all checks that lg_program_take_function promises, except for the name. */
lg_status lg_program_check_function(const lg_program *program, const lg_function *function, lg_error *error);

#endif
