/* Between fit.c, the command, and warm_up.c, the fits before the last one. */
#ifndef LG_APPS_IDENTIFY_FIT_H
#define LG_APPS_IDENTIFY_FIT_H

#include "lg-identify/identify.h"

typedef struct training {
    lg_machine_model_run *run;
    identify_data data;
    double position_noise[LG_MACHINE_COORDINATES], velocity_noise[LG_MACHINE_COORDINATES];
    lg_machine_problem problem;
    size_t *start;
    lg_fit_problem fit_problem;
    lg_fit *fit;
} training;

bool is_noisy(const training *t);
/* Levenberg-Marquardt takes a forward sweep for each parameter: it wins while these are few. */
bool are_few(const lg_machine *machine);
void take_loss_scales(training *t); /* the run's become the problem's */
/* Parameters from short windows, from which longer ones can be predicted; the scales of the loss, and the
 * substeps where they are not given. theta: those of the machine, in and out. */
lg_status warm_up(const app *self, training *t, const lg_fit_options *how, double *theta, lg_error *error);

#endif
