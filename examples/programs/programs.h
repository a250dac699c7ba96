/* Models that the library does not know, written as a user would write them. */
#ifndef EXAMPLE_PROGRAMS_H
#define EXAMPLE_PROGRAMS_H

#include <liegrad/program.h>

/* Each builds a program with random weights, trains it, and gives it away. */
lg_status make_throw(lg_program **out, lg_error *error);      /* MLP between scalers */
lg_status make_driven(lg_program **out, lg_error *error);     /* neural ODE, RK4 with a variable step */
lg_status make_attitude(lg_program **out, lg_error *error);   /* MLP field on SO(3) x R^3, CF4 */
lg_status make_waveforms(lg_program **out, lg_error *error);  /* convolutions and max pooling */

/* Lowers the program's function `loss`, whose inputs are the columns of a data set and whose output is one
 * number for all rows: `steps` steps of Adam on `batch` random samples each. columns[i]: (samples, what a row
 * of input i has). *first and *last (NULL: not wanted): the loss over all samples before and after. */
typedef struct training {
    const double *const *columns;
    size_t samples;
    uint32_t batch;
    size_t steps;
    double rate;
} training;
lg_status train(lg_program *program, const training *how, double *first, double *last, lg_error *error);

/* What is done with a trained program, whatever it is (use.c). `function` is the one that is differentiated.
 * False: something was not as it should be. */
int use(const char *name, lg_program *program, const char *function);

#endif
