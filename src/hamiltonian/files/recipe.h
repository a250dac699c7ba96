/* Learning a Hamiltonian: what lg-hamiltonian's demo and study use besides the trainer. */
#ifndef LG_HAMILTONIAN_RECIPE_H
#define LG_HAMILTONIAN_RECIPE_H

#include "liegrad/hamiltonian.h"
#include "liegrad/settings.h"

/* State of the trainer. A caller that has the trajectories already sets `data` and does not call `read`. */
typedef struct lg_hamiltonian_state {
    bool newton;            /* option --newton */
    const char *constraint; /* option --constraint, a file with the function `constraint`; or NULL */
    lg_trajectories data;
    lg_hamiltonian_problem problem;
    /* The first integral of the penalty if it is in a file; else program is NULL. */
    lg_program *program;
    lg_first_integral integral;
} lg_hamiltonian_state;
extern const lg_field lg_hamiltonian_options[];

/* The keys of a grid, as rows of lg_grid, and whether all its runs share this hyperparameter: the grid varies
 * some of them, and derives the seed. */
extern const lg_field lg_grid_keys[];
bool lg_grid_shares(const lg_field *row);

/* Loads the program of run->penalty_integral, which the caller destroys, and sets run->penalty_sha256. */
lg_status lg_penalty_load(const lg_context *context, lg_hamiltonian_run *run, lg_program **out,
                          lg_error *error);

#endif
