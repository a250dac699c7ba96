/* The two halves of lg-hamiltonian train: its options, and the training. */
#ifndef LG_APPS_TRAIN_H
#define LG_APPS_TRAIN_H

#include "lg-hamiltonian/learning.h"

typedef struct train_values {
    fit_values fit;
    const char *integrator;
    int activation, potential, penalty_form;
    app_sizes hidden;
    uint64_t substeps;
    double penalty;
    bool newton;
} train_values;

/* What the command line gave, over the defaults. */
extern train_values train_given;
extern const app_option train_options[];

/* What was not given on the command line becomes the stored run's. */
void train_adopt(app *self, const lg_hamiltonian_run *stored);
/* The run that options and data describe. */
lg_status train_run(const app *self, const lg_trajectories *data, lg_hamiltonian_run *run, lg_error *error);

#endif
