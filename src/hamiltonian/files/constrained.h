/* Constraints of the user in files of trajectories and of models: the function `constraint` below /functions,
 * with `potential` and `mass` as far as they are known (liegrad/constraint.h). */
#ifndef LG_HAMILTONIAN_FILES_CONSTRAINED_H
#define LG_HAMILTONIAN_FILES_CONSTRAINED_H

#include "files/h5.h"
#include "liegrad/hamiltonian.h"

/* Makes the constraint of an open file: of the program `given`, or if it is NULL, of the file's functions.
 * *out becomes NULL if the file has no such function. */
lg_status lg_h5_constraint(lg_h5 *h5, const lg_program *given, lg_constraint **out, lg_error *error);
/* Writes the functions of the constraint of trajectories. */
lg_status lg_h5_put_constraint(lg_h5 *h5, const lg_constraint *constraint, lg_error *error);
/* Add the bytes of a packed function of the program to the hash; the function `constraint`. */
lg_status lg_hash_function(const lg_context *context, const lg_program *program, size_t function,
                           lg_sha256 *state);
lg_status lg_constraint_hash(const lg_constraint *constraint, lg_sha256 *state);
/* Sets the family and n from data->constraint, and checks the size of a state. */
lg_status lg_constrained_size(const char *path, lg_trajectories *data, lg_error *error);
/* Checks that G has full rank at all points, and that all first points lie on T*Q; with `project` these are
 * projected instead. Sets data->starts_off. */
lg_status lg_constrained_points(const char *path, bool project, lg_trajectories *data, lg_error *error);

#endif
