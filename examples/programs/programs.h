/* Models that the library does not know, written as a user would write them. */
#ifndef EXAMPLE_PROGRAMS_H
#define EXAMPLE_PROGRAMS_H

#include <liegrad/program.h>

/* What a program is trained on, and how: `steps` steps of Adam on `batch` random samples each, the rate
 * falling to 0. columns[i]: (samples, what a row has) of input i of the program's function `loss`, whose
 * output is one number for all rows. */
typedef struct training {
    const double *const *columns;
    size_t samples, steps;
    uint32_t batch;
    double rate;
} training;
/* *first and *last (NULL: not wanted): the loss over all samples before and after. */
lg_status train(lg_program *program, const training *how, double *first, double *last, lg_error *error);

/* Each makes a trained program, and says how it can be trained on: data of static storage. */
lg_status make_throw(lg_program **out, training *how, lg_error *error);    /* MLP between scalers */
lg_status make_driven(lg_program **out, training *how, lg_error *error);   /* neural ODE, RK4 of variable h */
lg_status make_attitude(lg_program **out, training *how, lg_error *error); /* MLP on SO(3) x R^3, CF4 */
lg_status make_waveforms(lg_program **out, training *how, lg_error *error); /* convolutions, max pooling */

/* Adds the derivatives of `function` and tries them (use.c). 0: something was not as it should be. */
int use(lg_program *program, const char *function);
/* Whether two programs give the same bits at a random input (use.c). */
int same(const lg_program *a, const lg_program *b, const char *function);
/* Saves `driven` as the model FOLDER/driven-model.h5, and takes steps with it (moves.c). */
int moves(const char *folder, lg_program *driven);

#endif
