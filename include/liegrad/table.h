/* Tables of numbers, and networks for the regression or classification of their rows. The functions are in
 * the library liegrad, those from "files of table networks" on in liegrad_io. The guide is docs/tables.md.
 *
 * A table network computes for a row x of the input columns
 *   z = (x - mean)/scale    mean and scale of each column over the training rows
 *   f = net(z) [+ z A]      a network of liegrad/networks.h; with the option `linear` plus a linear map
 *   y = mean + scale f      LG_TABLE_REGRESSION: outputs in the units of the table, with mean and scale of
 *                           each output column over the training rows
 *   y = f                   LG_TABLE_CLASSIFICATION: one logit per class; the probabilities are softmax(y)
 *
 * The loss of a regression is the mean over rows and outputs of (f - t)^2, where t are the scaled outputs of
 * the table. The loss of a classification is the mean over rows of -log softmax(f)[class]. The parameters
 * theta are the parameters of the network, followed by A (inputs, outputs) if `linear` is set.
 */
#ifndef LIEGRAD_TABLE_H
#define LIEGRAD_TABLE_H

#include "liegrad/model.h"
#include "liegrad/series.h"

LG_BEGIN_DECLS

typedef enum lg_table_task { LG_TABLE_REGRESSION, LG_TABLE_CLASSIFICATION } lg_table_task;
#define LG_TABLE_TASK_COUNT 2
LG_API const char *lg_table_task_name(lg_table_task task); /* "regression", "classification"; else NULL */

#define LG_TABLE_LAYERS (LG_NET_MAX_LAYERS + 1) /* largest number of hidden layers */
#define LG_TABLE_SLICES 80                      /* no model has more slices of parameters */

typedef struct lg_table_options {
    lg_table_task task;
    lg_net_kind network;
    lg_activation activation;
    uint32_t hidden_count;            /* number of hidden layers, 1..LG_TABLE_LAYERS */
    uint32_t hidden[LG_TABLE_LAYERS]; /* widths of the hidden layers, which must all be equal */
    bool linear;                      /* true: z A is added to the output of the network */
} lg_table_options;

/* Immutable after lg_table_init; plain data. */
typedef struct lg_table {
    lg_table_options options;
    lg_net net;
} lg_table;

/* Makes a model. `outputs` is the number of output columns, or of classes. Errors: LG_INVALID_ARGUMENT (no or
 * unequal widths, an unknown task, fewer than two classes, a network that lg_net_init refuses). */
LG_API lg_status lg_table_init(lg_table *model, const lg_table_options *options, uint32_t inputs,
                               uint32_t outputs, lg_error *error);
LG_API size_t lg_table_parameters(const lg_table *model); /* number of parameters */
/* Describes slice `index` of the parameters: the slices of lg_net_slice, then "linear/weight" (if `linear` is
 * set). Returns false beyond the last slice. */
LG_API bool lg_table_slice(const lg_table *model, uint32_t index, lg_slice_info *out);
/* Draws theta (lg_table_parameters): the network by lg_net_initialise; A becomes 0. */
LG_API void lg_table_initialise(const lg_table *model, lg_rng *rng, double *theta);

/* ---- scaling ---- */

/* Computes mean and standard deviation (divisor: the number of rows) of each column of values (rows,
 * columns). It uses the rows with the indices chosen (count), or the first `count` rows if `chosen` is NULL.
 * A column gets scale 1 if it is constant up to the rounding of doubles (its range is at most 2^-48 of its
 * largest absolute value), or if its deviation is below the smallest normal number. Errors:
 * LG_INVALID_ARGUMENT (no rows), LG_NOT_FINITE. */
LG_API lg_status lg_table_scaler_fit(const lg_context *context, const double *values, uint32_t columns,
                                     const uint32_t *chosen, size_t count, lg_scaler *out);

/* ---- training ---- */

/* Scaled rows. The first `training` rows are the training part, the others the validation part. */
typedef struct lg_table_samples {
    size_t count, training;
    double *x;       /* (count, inputs) scaled inputs */
    double *y;       /* regression: (count, outputs) scaled outputs; classification: NULL */
    uint32_t *label; /* classification: (count); regression: NULL */
} lg_table_samples;

/* A model and its samples. All pointers are borrowed. */
typedef struct lg_table_problem {
    const lg_table *model;
    const lg_table_samples *samples;
    /* (lg_table_parameters), or NULL. The methods of lg_fit other than Adam add sum_i decay_i theta_i^2/2 to
     * the loss. */
    const double *decay;
} lg_table_problem;
/* Fills *out for lg_fit. `problem` is borrowed and must outlive the fit. A regression also has residuals and
 * their Jacobian, as least-squares methods need them. */
LG_API void lg_table_fit_problem(const lg_table_problem *problem, lg_fit_problem *out);

/* ---- evidence ----
 *
 * Bayesian regularisation of a regression: finds the parameters together with the strength of their weight
 * decay (MacKay, Neural Computation 4 (1992) 448; with the Gauss-Newton matrix: Foresee & Hagan 1997). Each
 * slice k of the parameters has a normal prior with precision alpha_k, and the scaled outputs have normal
 * noise with precision beta. The most probable theta is found by Levenberg-Marquardt, and alpha and beta are
 * estimated again after its steps:
 *   alpha_k = gamma_k/|theta_k|^2,  gamma_k = n_k - alpha_k tr (H^-1)_kk,  H = beta J^T J + diag(alpha)
 *   beta = (rows outputs - sum gamma)/|r|^2
 * Here r are the residuals, J is their Jacobian, and n_k the number of parameters in slice k. The weights of
 * a network that is wider than the data require are shrunk instead of fitted to the noise. */

/* The comments give the values of lg_table_evidence_options_init. */
typedef struct lg_table_evidence_options {
    size_t size;          /* sizeof(lg_table_evidence_options) */
    uint32_t evaluations; /* default 200: limit of evaluations of residuals and Jacobian */
    size_t rows; /* default 4000: largest number of training rows used, evenly chosen; 0: all are used */
    bool go_on;  /* default false; true: the search starts with the priors that `decay` holds */
} lg_table_evidence_options;
LG_API void lg_table_evidence_options_init(lg_table_evidence_options *options);

typedef struct lg_table_evidence_result {
    uint32_t evaluations; /* number of evaluations used */
    bool settled;         /* whether theta and the priors converged within the limit of evaluations */
    double effective;     /* sum of the gamma_k: effective number of parameters, which the data determine */
    double noise;         /* 1/sqrt(beta), standard deviation of the noise in the scaled outputs */
    /* logarithm of the probability of the data, without terms that depend only on the data */
    double evidence;
} lg_table_evidence_result;
/* Runs the search. theta (lg_table_parameters) holds the start and becomes the most probable parameters.
 * decay (one number per slice of lg_table_slice) becomes the weight decay of each slice, for all training
 * rows; lg_table_problem.decay takes this number for each parameter of the slice. problem->decay is not read.
 * `options` NULL stands for the defaults; `result` may be NULL. Models of different widths can be compared by
 * their evidence on the same rows: the higher evidence generalises better. Errors, theta and decay are
 * untouched: LG_UNSUPPORTED (a classification), LG_OUT_OF_MEMORY (also for more than 20000 parameters),
 * LG_NOT_FINITE, LG_CANCELLED. */
LG_API lg_status lg_table_evidence(const lg_context *context, const lg_table_problem *problem,
                                   const lg_table_evidence_options *options, double *theta, double *decay,
                                   lg_table_evidence_result *result, lg_error *error);

/* ---- as a program ---- */

/* Makes a program with the parameters `theta`, `mean`, `mean_rest` and `inverse_scale` (of the inputs), for a
 * regression also `output_mean` and `output_scale`, and the functions
 *   value        x (inputs) -> y (outputs)
 *   grad         x -> y, g: y and its Jacobian (outputs, inputs)
 *   probability  x -> probability (classes); only for a classification
 * `mean` and `mean_rest` sum to the mean of the scaler; `mean` is exact in single precision. theta and the
 * scalers are copied. The scaler `outputs` is not read for a classification and may be NULL. Errors:
 * LG_INVALID_ARGUMENT (a scaler with another number of columns), the errors of lg_program_build. */
LG_API lg_status lg_table_program(const lg_context *context, const lg_table *model, const lg_scaler *inputs,
                                  const lg_scaler *outputs, const double *theta, lg_program **out,
                                  lg_error *error);

/* ---- a regression in one call ---- */

/* The comments give the values of lg_table_fit_options_init. */
typedef struct lg_table_fit_options {
    size_t size;            /* sizeof(lg_table_fit_options) */
    lg_table_options model; /* default: regression by an MLP with two hidden layers of 16, tanh */
    lg_table_evidence_options evidence;
    uint32_t starts; /* default 3: fits from this many random starts; the highest evidence wins */
    uint64_t seed;   /* default 1 */
} lg_table_fit_options;
LG_API void lg_table_fit_options_init(lg_table_fit_options *options);

typedef struct lg_table_fit_result {
    lg_table_evidence_result evidence; /* of the best start; noise is in units of the outputs' deviations */
    uint32_t start;                    /* number of the best start, from 0 */
} lg_table_fit_result;

/* Learns y (rows, outputs) as a function of x (rows, inputs): scales the columns, finds weights and weight
 * decay by lg_table_evidence, so that a wide network does not learn the noise, and makes the program of
 * lg_table_program with the functions `value` and `grad`. It takes and gives numbers in the units of x and y.
 *
 *   lg_table_fit(NULL, x, 1, y, 1, rows, NULL, &program, NULL, &error);
 *   lg_program_eval(NULL, program, "value", 1, inputs, outputs, &error);
 *
 * `options` NULL stands for the defaults; `result` may be NULL. Errors, in which case *out is untouched:
 * LG_INVALID_ARGUMENT (no rows, a task other than regression, no start, options that lg_table_init refuses),
 * LG_NOT_FINITE (a number of x or y), LG_CANCELLED. */
LG_API lg_status lg_table_fit(const lg_context *context, const double *x, uint32_t inputs, const double *y,
                              uint32_t outputs, size_t rows, const lg_table_fit_options *options,
                              lg_program **out, lg_table_fit_result *result, lg_error *error);

/* ---- files of table networks (library liegrad_io from here on) ---- */

#define LG_TABLE_NAME 64 /* bytes of the name of a column or class, with the terminator */

/* Weight decay with one number per slice of the parameters (lg_table_slice). count 0 means no decay. */
typedef struct lg_table_decay {
    uint32_t count;
    double value[LG_TABLE_SLICES];
} lg_table_decay;

/* Model, training and data of a run. Models and checkpoints store it. */
typedef struct lg_table_run {
    lg_table model;
    /* training.validation is a fraction of the rows, which are drawn by training.seed */
    lg_fit_settings training;
    lg_table_decay decay; /* lg_table_problem.decay, by slice */
    uint64_t rows;        /* number of complete rows in the data */
    char data_sha256[LG_SHA256_TEXT];
} lg_table_run;
/* The fields of lg_table_run, ended by a row whose name is NULL (liegrad/settings.h). */
LG_API extern const lg_field lg_table_fields[];

typedef struct lg_table_file {
    LG_MODEL_FILE(lg_table_run);
    lg_scaler inputs, outputs; /* outputs is all zero for a classification */
    double *low, *high;        /* (inputs) least and largest value in the training rows; may be NULL */
    char (*input_name)[LG_TABLE_NAME];  /* (inputs) */
    char (*output_name)[LG_TABLE_NAME]; /* (outputs) names of the output columns, or of the classes */
    char class_column[LG_TABLE_NAME];   /* name of the class column of a classification; "" if unknown */
    /* Quality on the rows used for the last evaluation; rmse in scaled outputs. NaN if unknown. */
    double rmse, accuracy, f1;
} lg_table_file;

/* ---- tables of numbers ----
 *
 * These functions read columns by name from CSV, HDF5 and numpy files. docs/tables.md says what a column, a
 * name, a label and a missing cell are in each of them. */

typedef char lg_table_text[LG_TABLE_NAME];

/* The names of all columns of a file, in their order; "" for a column without a name. */
typedef struct lg_table_names {
    uint32_t count;
    lg_table_text *name;       /* (count) */
    const lg_context *context; /* in whose memory `name` is */
} lg_table_names;
/* Reads the names. Errors: LG_FORMAT also for a file that is not a table, and for a CSV header of numbers. */
LG_API lg_status lg_table_names_read(const lg_context *context, const char *path,
                                     const lg_read_options *options, lg_table_names *out, lg_error *error);
LG_API void lg_table_names_destroy(lg_table_names *names);

#define LG_TABLE_NO_CLASS UINT32_MAX /* label of a row whose class is missing */

typedef struct lg_table_data {
    size_t rows;
    uint32_t columns; /* number of columns that were read as numbers */
    double *values;   /* (rows, columns); NaN: the value is missing */
    size_t *line; /* (rows) line of the row in a text file; in other files the number of the row, from 1 */
    const char *place; /* what `line` counts: "line" or "row" */
    uint32_t *label;   /* (rows) class of the row, or LG_TABLE_NO_CLASS; NULL if no class column was read */
    uint32_t classes;  /* number of different classes */
    lg_table_text *class_name;   /* (classes) first numbers in rising order, then texts in bytewise order */
    bool cut;                    /* the last line of the file is incomplete and was left out */
    char sha256[LG_SHA256_TEXT]; /* of the numbers as little-endian doubles and the labels as texts */
    const lg_context *context;
} lg_table_data;

/* Reads the columns names (count) as numbers, in this order, and class_column as labels unless it is NULL.
 * Errors: the errors of lg_table_names_read; LG_INVALID_ARGUMENT (a column that is asked for twice);
 * LG_FORMAT, with file, line and column, for text in a column of numbers, an infinite number, rows of unequal
 * length, a column that is missing (the sentence lists the columns of the file) or occurs twice, an integer
 * beyond 2^53 in a column of numbers that no double equals, no row, and more than 1000 classes. */
LG_API lg_status lg_table_read(const lg_context *context, const char *path, const char *const *names,
                               uint32_t count, const char *class_column, const lg_read_options *options,
                               lg_table_data *out, lg_error *error);
LG_API void lg_table_data_destroy(lg_table_data *data);
/* Removes incomplete rows from tables (count) that were read from the same rows of a file, such as its inputs
 * and its outputs. A row is removed from all tables if a number or label is missing in any of them. *left_out
 * (may be NULL) becomes the number of removed rows. Errors, the tables are then unchanged:
 * LG_INVALID_ARGUMENT (tables with different numbers of rows), LG_FORMAT (no row is complete). */
LG_API lg_status lg_table_keep_complete(lg_table_data *const *tables, size_t count, size_t *left_out,
                                        lg_error *error);
/* Returns a port of a program (liegrad/program.h) for an input with `numbers` numbers. low and high of the
 * port become the range of all numbers of the table. lg_program_build then records with numbers from this
 * range. So it can notice that the C code of a function branches on its inputs, if the data would take
 * both branches. For a table without numbers the range is the default of lg_port. `name` is borrowed. */
LG_API lg_port lg_table_port(const lg_table_data *of, const char *name, uint32_t numbers);

/* ---- named tensors: safetensors files (huggingface.co/docs/safetensors) ---- */

typedef struct lg_tensor {
    char name[128];
    uint32_t rank;    /* 0..4 */
    uint64_t dims[4]; /* shape; the values are row-major */
    size_t count;     /* number of values */
    double *values;   /* (count) */
} lg_tensor;

typedef struct lg_tensors {
    size_t count;
    lg_tensor *tensor; /* (count), in the order of the header of the file */
    bool inputs_first; /* the file says that weights have the shape (in, out), as lg-export writes them */
    const lg_context *context; /* in whose memory the tensors are */
} lg_tensors;

/* Reads all tensors of a file; their types may be F64, F32, F16 and BF16. The header is checked before any
 * number is read. Errors: LG_NOT_FOUND, LG_FILE, LG_FORMAT with the name of the tensor (another type, a
 * header or offsets that do not fit, a key that occurs twice, bytes that belong to two tensors or to no
 * tensor, more than 4 dimensions, numbers that are not finite, more than 2^30 numbers), LG_CANCELLED. */
LG_API lg_status lg_tensors_read(const lg_context *context, const char *path, lg_tensors *out,
                                 lg_error *error);
LG_API void lg_tensors_destroy(lg_tensors *tensors);

LG_END_DECLS

#endif
