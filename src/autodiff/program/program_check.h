/* Checks of what is added to a program. */
#ifndef LG_PROGRAM_CHECK_H
#define LG_PROGRAM_CHECK_H

#include "autodiff/program/program.h"

/* `what` stands in the message: "a function". */
lg_status lg_program_check_name(const char *what, const char *name, lg_error *error);
/* Its rank is at most `most`, and no number of elements is too large. */
bool lg_program_shape_is_sound(const lg_shape *shape, uint32_t most);
/* Everything that lg_program_add_function promises but its name. */
lg_status lg_program_check_function(const lg_program *program, const lg_function *function, lg_error *error);

#endif
