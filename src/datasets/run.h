/* The description of a training run as attributes of /model (what is learned) and /run (how and on what). */
#ifndef LG_RUN_H
#define LG_RUN_H

#include "datasets/h5.h"

lg_status lg_run_check(const char *path, const lg_hamiltonian_run *run, lg_error *error);
lg_status lg_run_put(lg_h5 *h5, const lg_hamiltonian_run *run, lg_error *error);
/* `complete`: every key of /run must be there; otherwise missing ones keep their defaults. */
lg_status lg_run_get(lg_h5 *h5, bool complete, lg_hamiltonian_run *run, lg_error *error);

#endif
