/* Learning a Hamiltonian: what demo and study need besides the hooks. */
#ifndef LG_HAMILTONIAN_RECIPE_H
#define LG_HAMILTONIAN_RECIPE_H

#include "liegrad/io.h"

/* Of the learner. Who has the trajectories already sets `data` and does not call `read`. */
typedef struct lg_hamiltonian_state {
    bool newton; /* the option */
    lg_trajectories data;
    lg_hamiltonian_problem problem;
} lg_hamiltonian_state;
extern const lg_field lg_hamiltonian_options[];

#endif
