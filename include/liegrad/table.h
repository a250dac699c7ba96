/* Table networks: regression or classification of the rows of a table.
 *
 *   z = (x - mean)/scale           inputs (n) by column, with mean and scale of the training rows
 *   f = net(z) [+ z A]             a network of liegrad/networks.h, with `linear` a linear map beside it
 *   y = mean + scale f             LG_TABLE_REGRESSION: outputs in the units of the table
 *   y = f                          LG_TABLE_CLASSIFICATION: a logit a class; probabilities are softmax(y)
 *
 * Loss: regression, the mean over rows and outputs of (f - t)^2, t the scaled outputs; classification, the
 * mean of -log softmax(f)[class]. Parameters: those of the network, then A (inputs, outputs).
 */
#ifndef LIEGRAD_TABLE_H
#define LIEGRAD_TABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/networks.h"
#include "liegrad/nn.h"
#include "liegrad/program.h"
#include "liegrad/series.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

typedef enum lg_table_task { LG_TABLE_REGRESSION, LG_TABLE_CLASSIFICATION } lg_table_task;
#define LG_TABLE_TASK_COUNT 2
LG_API const char *lg_table_task_name(lg_table_task task); /* "regression", "classification"; else NULL */

#define LG_TABLE_LAYERS (LG_NET_MAX_LAYERS + 1)
#define LG_TABLE_SLICES 80 /* at least the slices of any model */

typedef struct lg_table_options {
    lg_table_task task;
    lg_net_kind network;
    lg_activation activation;
    uint32_t hidden_count;            /* 1..LG_TABLE_LAYERS: the first layer and those after it */
    uint32_t hidden[LG_TABLE_LAYERS]; /* widths, all equal */
    bool linear;
} lg_table_options;

/* Immutable after lg_table_init; plain data. */
typedef struct lg_table {
    lg_table_options options;
    lg_net net;
} lg_table;

/* `outputs`: columns, or classes. Errors, with a sentence: LG_INVALID_ARGUMENT (no or unequal widths, an
 * unknown task, fewer than two classes, what lg_net_init refuses). */
LG_API lg_status lg_table_init(lg_table *model, const lg_table_options *options, uint32_t inputs,
                               uint32_t outputs, lg_error *error);
LG_API size_t lg_table_parameters(const lg_table *model);
/* Slices of the parameter vector: those of lg_net_slice, then "linear/weight". False beyond the last. */
LG_API bool lg_table_slice(const lg_table *model, uint32_t index, lg_slice_info *out);
/* Draws the parameters; A is 0. */
LG_API void lg_table_initialise(const lg_table *model, lg_rng *rng, double *theta);

/* ---- scaling ---- */

/* Mean and standard deviation (divisor: the number of rows) of the columns of values (rows, columns) over
 * the rows `chosen` (count; NULL: the first `count`). A column that is constant to rounding, or whose
 * deviation is below the smallest normal number, has scale 1. Free with lg_scaler_destroy. Errors:
 * LG_INVALID_ARGUMENT (no rows), LG_OUT_OF_MEMORY, LG_NOT_FINITE. */
LG_API lg_status lg_table_scaler_fit(const lg_context *context, const double *values, uint32_t columns,
                                     const uint32_t *chosen, size_t count, lg_scaler *out);

/* Cells of a column that lie far from the others: more than 30 times as far from the median as the middle
 * one of all cells that are not equal to it, if together such cells have more than half of the sum of squared
 * distances from the median. One cell may be enough: mean and deviation say then where it lies and nothing
 * of the others. The rule has no unit, and knows columns that have one value nearly everywhere. */
typedef struct lg_table_far {
    double median, limit;   /* limit of |x - median|/2; INFINITY: no cell is far */
    size_t count, farthest; /* of far cells; the row of the farthest */
} lg_table_far;
/* x_i = values[i stride], i < rows, without NaN. Errors: LG_INVALID_ARGUMENT (no rows), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_table_find_far(const lg_context *context, const double *values, size_t stride,
                                   size_t rows, lg_table_far *out);
LG_API bool lg_table_is_far(const lg_table_far *far, double x);

/* ---- training ---- */

/* Rows scaled by the scalers. The first `training` of them are learned, the others are the validation part.
 */
typedef struct lg_table_samples {
    size_t count, training;
    double *x;       /* (count, inputs) */
    double *y;       /* regression: (count, outputs); else NULL */
    uint32_t *label; /* classification: (count); else NULL */
} lg_table_samples;

/* Borrowed. decay (lg_table_parameters) or NULL: decay_i/2 theta_i^2 is added to the loss, by methods other
 * than Adam. */
typedef struct lg_table_problem {
    const lg_table *model;
    const lg_table_samples *samples;
    const double *decay;
} lg_table_problem;
/* Fills a problem for lg_fit. `problem` must outlive the fit. Regression has residuals and their Jacobian. */
LG_API void lg_table_fit_problem(const lg_table_problem *problem, lg_fit_problem *out);

/* How much the data say of the weights (MacKay, Neural Computation 4 (1992) 448; with the Gauss-Newton
 * matrix: Foresee & Hagan 1997). Each slice of the parameters has a normal prior of precision alpha, the
 * scaled outputs have noise of precision beta; the most probable theta is sought by Levenberg-Marquardt, and
 * alpha and beta are estimated again on the way:
 *   alpha_k = gamma_k/|theta_k|^2,  gamma_k = n_k - alpha_k tr (H^-1)_kk,  H = beta J^T J + diag(alpha)
 *   beta = (rows outputs - sum gamma)/|r|^2
 * A network that is wider than the data need is shrunk, not fitted to the noise. Regression. */
typedef struct lg_table_evidence_options {
    size_t size;          /* sizeof(lg_table_evidence_options) */
    uint32_t evaluations; /* 200: of residuals and Jacobian, at most */
    size_t rows;          /* 4000: as many training rows at most, evenly chosen */
    bool go_on;           /* false; true: decay holds the priors to begin with */
} lg_table_evidence_options;
LG_API void lg_table_evidence_options_init(lg_table_evidence_options *options);

typedef struct lg_table_evidence_result {
    uint32_t evaluations; /* used */
    bool settled;         /* theta and the priors had come to rest before the last evaluation */
    double effective;     /* sum gamma: parameters that the data determine */
    double noise;         /* 1/sqrt(beta), in units of the scaled outputs */
    double evidence;      /* logarithm of the probability of the data, up to a constant of them alone */
} lg_table_evidence_result;
/* theta (in/out): the start and the most probable parameters. decay (one for each slice): that of
 * lg_table_problem for all training rows. Models of other widths may be compared by their evidence on the
 * same rows: the higher one generalises better. Errors, theta and decay untouched: LG_UNSUPPORTED
 * (classification), LG_OUT_OF_MEMORY, LG_NOT_FINITE, LG_CANCELLED. */
LG_API lg_status lg_table_evidence(const lg_context *context, const lg_table_problem *problem,
                                   const lg_table_evidence_options *options, double *theta, double *decay,
                                   lg_table_evidence_result *result, lg_error *error);

/* ---- as a program ---- */

/* A bundle on the parameters `theta`, `mean`, `mean_rest`, `inverse_scale` of the inputs, and of a regression
 * `output_mean`, `output_scale`:
 *   value        x -> y
 *   grad         x -> y, g: (outputs, inputs)
 *   probability  x -> probability (classes); classification alone
 * `outputs` is not read for a classification. Errors: those of lg_program_build. */
LG_API lg_status lg_table_program(const lg_context *context, const lg_table *model, const lg_scaler *inputs,
                                  const lg_scaler *outputs, const double *theta, lg_program **out,
                                  lg_error *error);

LG_END_DECLS

#endif
