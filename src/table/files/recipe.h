/* Where the training of a table begins: the width, the priors and the parameters that make the data most
 * probable. */
#ifndef LG_TABLE_RECIPE_H
#define LG_TABLE_RECIPE_H

#include "liegrad/io.h"

/* Beyond this many parameters the matrix of Levenberg-Marquardt takes too long. */
enum { LG_TABLE_MOST_LM = 1500 };
/* Multiplications in an evaluation of residuals, Jacobian and matrix, with what it costs beside them. */
double lg_table_work(const lg_table *model, double rows);
uint32_t lg_table_slices(const lg_table *model); /* arrays of parameters */
/* Parameters as the run's seed draws them. lg_free frees *theta, which is NULL after a failure. */
lg_status lg_table_first_parameters(const lg_context *context, const lg_table_run *run, double **theta,
                                    lg_error *error);

typedef struct lg_table_start {
    const lg_context *context;
    lg_table_run *run;               /* gets the width and the priors */
    const lg_table_problem *problem; /* of the run's model */
    lg_table_evidence_result evidence;
} lg_table_start;
/* The run, which is for a regression, gets priors, and with `any_width` one hidden layer of the width with
 * the highest evidence. *theta (freed with lg_free, also after a failure): the parameters to start from. What
 * is done is bounded by work, not by a clock. Errors: those of lg_table_init and lg_table_evidence. */
lg_status lg_table_find_start(lg_table_start *state, bool any_width, double **theta, lg_error *error);

#endif
