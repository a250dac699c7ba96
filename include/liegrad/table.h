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

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/series.h"
#include "liegrad/settings.h"

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

/* ---- files of table networks (library liegrad_io from here on) ---- */

#define LG_TABLE_NAME 64 /* bytes of a column's or a class' name */

/* One number for each slice of the parameters (lg_table_slice); none: 0. */
typedef struct lg_table_decay {
    uint32_t count;
    double value[LG_TABLE_SLICES];
} lg_table_decay;

typedef struct lg_table_run {
    lg_table model;
    lg_training training; /* validation: of the rows, drawn by the seed */
    lg_table_decay decay; /* of lg_table_problem, by slice */
    uint64_t rows;        /* complete rows of the data */
    char data_sha256[LG_SHA256_TEXT];
} lg_table_run;
LG_API extern const lg_field lg_table_fields[]; /* of lg_table_run */

typedef struct lg_table_file {
    lg_table_run run;
    size_t parameters;
    double *theta;                      /* (parameters); stored as training.dtype */
    lg_scaler inputs, outputs;          /* outputs: of a regression; else zeros */
    double *low, *high;                 /* (inputs): least and largest value of the training rows; NULL */
    char (*input_name)[LG_TABLE_NAME];  /* (inputs) */
    char (*output_name)[LG_TABLE_NAME]; /* (outputs) columns, or the names of the classes */
    char class_column[LG_TABLE_NAME];   /* of a classification, "" unknown */
    double rmse, accuracy, f1;          /* on the rows it was judged on, in scaled outputs; NaN: unknown */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT];
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_table_file;

/* Kind "table": /model/layer1/weight ... as lg_table_slice names them, /scaler/{inputs, outputs}/{mean,
 * scale}, /range/{low, high} (inputs), texts /names/{inputs, outputs}, root attributes `class_column`,
 * `rmse`, `accuracy`, `f1`; laws as for the other kinds. A model written by hand needs `kind`, the weights,
 * /scaler and the attributes of /model: `task` (regression, classification), `network`, `activation`,
 * `hidden` ("32,32"), `linear`, `inputs`, `outputs`; without /names columns are "x1", "x2", ... and "y1", ...
 * */
LG_API lg_status lg_model_save_table(const lg_context *context, const char *path, const lg_table_file *file,
                                     const lg_fit *fit, lg_error *error);
LG_API lg_status lg_model_load_table(const lg_context *context, const char *path,
                                     const lg_read_options *options, lg_table_file *out, lg_error *error);
LG_API void lg_table_file_destroy(lg_table_file *file);

/* ---- tables of numbers ----
 *
 * Tables of numbers: CSV, HDF5 or numpy files in, columns by name. Library liegrad_io. The guide is
 * docs/tables.md.
 *
 * - CSV: a header with names, then a row a line, separated by commas, semicolons or tabs. Quotes, CRLF, a
 *   byte order mark, blank lines and lines that begin with # are understood. "", nan, NA, N/A and null are
 *   missing.
 * - HDF5: data sets of the root with one number a row are columns of that name, in the order of their names.
 *   A data set (rows, k) of rank 2 is k columns; attribute `columns` (a list of texts, or one with commas)
 *   names them, otherwise they are NAME0, NAME1, ... Texts can be classes.
 * - numpy: one array (.npy, version 1 to 3) of numbers, (rows) or (rows, k), in C or Fortran order: c0, c1,
 *   ... */

typedef char lg_table_text[LG_TABLE_NAME];

/* The names of all columns of a file, in order; "" for one without a name. Errors: LG_NOT_FOUND, LG_FILE,
 * LG_FORMAT (nothing that is a table, a header of numbers), LG_OUT_OF_MEMORY. */
typedef struct lg_table_names {
    uint32_t count;
    lg_table_text *name;       /* (count) */
    const lg_context *context; /* whose memory it is in */
} lg_table_names;
LG_API lg_status lg_table_names_read(const lg_context *context, const char *path,
                                     const lg_read_options *options, lg_table_names *out, lg_error *error);
LG_API void lg_table_names_destroy(lg_table_names *names); /* NULL or zeros are fine */

#define LG_TABLE_NO_CLASS UINT32_MAX

typedef struct lg_table_data {
    size_t rows;
    uint32_t columns;          /* numbers of a row */
    double *values;            /* (rows, columns); NaN: missing */
    size_t *line;              /* (rows): of a text file; else the row, from 1 */
    const char *place;         /* what `line` counts: "line" or "row" */
    uint32_t *label;           /* (rows) with a class column, or NULL; LG_TABLE_NO_CLASS: missing */
    uint32_t classes;          /* different labels */
    lg_table_text *class_name; /* (classes), numbers in rising order, else bytewise */
    bool cut;                  /* the last line was cut off and is left out */
    char sha256[LG_SHA256_TEXT];
    const lg_context *context;
} lg_table_data;

/* Reads the columns `names` (count) as numbers and, where it is not NULL, `class_column` as labels. Errors:
 * those of lg_table_names_read; LG_FORMAT with file, line and column: text in a column of numbers, an
 * infinite number, rows of unequal length, a column that is missing (the sentence lists those there are) or
 * there twice, no row, more than 1000 classes. */
LG_API lg_status lg_table_read(const lg_context *context, const char *path, const char *const *names,
                               uint32_t count, const char *class_column, const lg_read_options *options,
                               lg_table_data *out, lg_error *error);
LG_API void lg_table_data_destroy(lg_table_data *data); /* NULL or zeros are fine */
/* Of `count` tables that were read from the same rows, as inputs and outputs are: leaves the rows out in
 * which a number or a label of any of them is missing. *left_out (NULL: not wanted): how many. Errors, the
 * tables as before: LG_INVALID_ARGUMENT (different numbers of rows), LG_FORMAT (no row is complete). */
LG_API lg_status lg_table_keep_complete(lg_table_data *const *tables, size_t count, size_t *left_out,
                                        lg_error *error);
/* A port of a program that takes `numbers` numbers of such rows, with their range: lg_program_build then
 * records at numbers as the data have them, and so sees a branch in C that the data would take both ways. No
 * number at all: -1 to 1. `name` is borrowed. */
LG_API lg_port lg_table_port(const lg_table_data *of, const char *name, uint32_t numbers);

/* ---- named tensors: safetensors files (huggingface.co/docs/safetensors) ---- */

typedef struct lg_tensor {
    char name[128];
    uint32_t rank;
    uint64_t dims[4]; /* row-major */
    size_t count;
    double *values; /* (count) */
} lg_tensor;

typedef struct lg_tensors {
    size_t count;
    lg_tensor *tensor;         /* (count), in the order of the header */
    bool inputs_first;         /* the file says that weights are (in, out), as lg-export writes them */
    const lg_context *context; /* whose memory it is in */
} lg_tensors;

/* All tensors of types F64, F32, F16 and BF16. Errors: LG_NOT_FOUND, LG_FILE, LG_FORMAT with the tensor
 * (another type, a header or offsets that do not fit, a key that is there twice, bytes that belong to two
 * tensors or to no tensor, more than 4 dimensions, numbers that are not finite, more than 2^30 numbers),
 * LG_OUT_OF_MEMORY, LG_CANCELLED. The header is checked before a number is read. On failure `out` is
 * untouched. */
LG_API lg_status lg_tensors_read(const lg_context *context, const char *path, lg_tensors *out,
                                 lg_error *error);
LG_API void lg_tensors_destroy(lg_tensors *tensors); /* NULL or zeros are fine */

LG_END_DECLS

#endif
