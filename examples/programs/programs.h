/* Models that the library does not contain, written as a user would write them. */
#ifndef EXAMPLE_PROGRAMS_H
#define EXAMPLE_PROGRAMS_H

#include <liegrad/program.h>

/* Training data and options: `steps` steps of Adam, each on `batch` random samples, with a learning rate that
 * decreases from `rate` to 0. columns[i] (samples, numbers per row) are the values for input i of the
 * program's function `loss`, whose output is one number for all rows. */
typedef struct training {
    const double *const *columns;
    size_t samples, steps;
    uint32_t batch;
    double rate;
} training;
/* Trains the program. *first and *last (may be NULL) become the loss over all samples before and after. */
lg_status train(lg_program *program, const training *how, double *first, double *last, lg_error *error);

/* Each function makes a trained program. *how becomes the data (static storage) and options for further
 * training. */
lg_status make_throw(lg_program **out, training *how, lg_error *error);     /* MLP between scalers */
lg_status make_driven(lg_program **out, training *how, lg_error *error);    /* neural ODE, RK4, variable h */
lg_status make_attitude(lg_program **out, training *how, lg_error *error);  /* MLP on SO(3) x R^3, CF4 */
lg_status make_waveforms(lg_program **out, training *how, lg_error *error); /* convolutions, max pooling */

/* Adds the derivatives of `function` and checks them (use.c). Returns 0 if a check fails. */
int use(lg_program *program, const char *function);
/* Returns 1 if both programs give the same bits at a random input, else 0 (use.c). */
int same(const lg_program *a, const lg_program *b, const char *function);
/* Saves `driven` as the model FOLDER/driven-model.h5 and makes steps with it (moves.c). Returns 0 on
 * failure. */
int moves(const char *folder, lg_program *driven);
/* Bounds over a box, and a certificate of an attitude controller (proofs.c). Returns 0 on failure. */
int proofs(void);

#endif
