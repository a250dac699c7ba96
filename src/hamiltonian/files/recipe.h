/* Learning a Hamiltonian: what lg-hamiltonian's demo and study use besides the trainer. */
#ifndef LG_HAMILTONIAN_RECIPE_H
#define LG_HAMILTONIAN_RECIPE_H

#include "liegrad/hamiltonian.h"
#include "liegrad/settings.h"

/* State of the trainer. A caller that has the trajectories already sets `data` and does not call `read`. */
typedef struct lg_hamiltonian_state {
    bool newton; /* option --newton */
    lg_trajectories data;
    lg_hamiltonian_problem problem;
} lg_hamiltonian_state;
extern const lg_field lg_hamiltonian_options[];

#endif
