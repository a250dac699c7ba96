/* The recipe of tables: columns and rows of a table, start of the training, and how good the model is. */
#ifndef LG_TABLE_RECIPE_H
#define LG_TABLE_RECIPE_H

#include "core/text.h"
#include "model/files/training.h"
#include "table/internal.h"

/* ---- columns (columns.c) ---- */

/* Values of the options, as texts; NULL: not given. */
typedef struct lg_table_given {
    const char *inputs, *outputs, *without, *class_column, *test;
} lg_table_given;
/* The options that set lg_table_given; lg_table_column_rows does not have `test`. */
extern const lg_field lg_table_given_rows[], lg_table_column_rows[];

/* Chooses inputs, outputs, the column with the classes and columns to leave out, from the options or by
 * default. Errors, with a sentence about an option or the file: a column that is missing, named twice, or has
 * two roles. */
lg_status lg_table_choose(lg_training *self, lg_error *error);
/* Reads a list of names like a,"b, in s",c. Names with commas stand in quotes as in CSV; blanks around names
 * do not count. Errors, with a sentence about the option: LG_INVALID_ARGUMENT (empty, long and repeated
 * names), LG_OUT_OF_MEMORY. The caller must destroy `out` even after an error. */
lg_status lg_table_names_parse(const lg_context *context, const char *option, const char *text,
                               lg_table_names *out, lg_error *error);
/* Reads one name, with or without quotes. */
lg_status lg_table_class_parse(const char *text, lg_table_text out, lg_error *error);

/* ---- rows (rows.c) ---- */

/* A table with the columns of a model: inputs, then the outputs of a regression. */
typedef struct lg_table_sheet {
    const char *path;
    lg_table_data data;
    uint32_t inputs, outputs; /* numbers of columns; outputs is 0 for a classification */
    size_t left_out;          /* number of rows left out because of missing cells */
} lg_table_sheet;
/* Reads all rows, also rows with missing cells. class_column may be NULL: no classes. Warns if the last line
 * was cut off. */
lg_status lg_table_sheet_read(const lg_context *context, const char *path, const lg_table_names *inputs,
                              const lg_table_names *outputs, const char *class_column, lg_table_sheet *out,
                              lg_error *error);
static inline const double *lg_table_sheet_row(const lg_table_sheet *sheet, size_t row) {
    return sheet->data.values + row * sheet->data.columns;
}
/* Reads the table to learn from, without its constant inputs, and the table of --test; or, with self->file,
 * the table on which that model is judged. */
lg_status lg_table_read_rows(lg_training *self, lg_error *error);
/* Warns of cells in columns first .. first + count - 1 that lie far from all other cells of their column, for
 * at most eight columns. `follows` is the part of the sentence that says what such cells do. */
lg_status lg_table_warn_far(const lg_context *context, const lg_table_sheet *sheet, uint32_t first,
                            const lg_table_text *name, uint32_t count, const char *follows, lg_error *error);
/* Warns of rows that occur repeatedly, and of rows that are in both the training and the validation part. */
lg_status lg_table_warn_repeated(lg_training *self, lg_error *error);

/* ---- judging (judge.c) ---- */

typedef struct lg_table_judgement {
    size_t rows, outside;       /* outside: rows for which lg_table_is_outside is true */
    size_t infinite;            /* rows with a prediction that is not finite */
    double *truth, *prediction; /* (rows, outputs) for a regression; else NULL */
    double *rmse, *r2;          /* (outputs); not finite after an overflow; r2 is NaN for a constant column */
    double scaled_rmse;         /* root mean square over all outputs, each in units of its scale */
    double accuracy, f1; /* for a classification; f1: of class 1 if there are two, else mean over classes */
    uint64_t *confusion; /* (classes, classes): one row per true class */
    double log_loss;
} lg_table_judgement;
/* Makes the model of a file; the caller must destroy it. */
lg_status lg_table_model(const lg_context *context, const lg_table_file *file, lg_model **out,
                         lg_error *error);
/* Judges the model on the rows `chosen` (count; NULL: all rows). Arrays of `out` are memory of the
 * training. */
lg_status lg_table_judge(lg_training *self, const lg_table_file *file, const lg_table_sheet *sheet,
                         const uint32_t *chosen, size_t count, lg_table_judgement *out, lg_error *error);
void lg_table_tell(lg_training *self, const lg_table_file *file, const lg_table_judgement *j);
/* Warn of predictions or errors that are not finite; return whether there are any. */
bool lg_table_warn_infinite(const lg_context *context, size_t infinite, size_t rows, const char *path);
bool lg_table_warn_errors(const lg_context *context, const lg_table_file *file, const lg_table_judgement *j,
                          const char *path);
/* Warns of rows outside of the training range; `model` is the model's path. */
void lg_table_warn_outside(const lg_context *context, size_t outside, size_t rows, const char *path,
                           const char *model);
/* Whether an input of a row is beyond its training range by more than a tenth of the range. */
bool lg_table_is_outside(const lg_table_file *file, const double *x);
bool lg_table_are_finite(const double *y, uint32_t count);
void lg_table_softmax(double *y, uint32_t classes); /* logits to probabilities, in place */

/* ---- start of the training (start.c) ---- */

/* With more parameters the matrix of Levenberg-Marquardt takes too long. */
enum { LG_TABLE_MOST_LM = 1500 };
/* Work of one evaluation of residuals, Jacobian and J^T J: the number of multiplications, and other costs in
 * units of a multiplication. */
double lg_table_work(const lg_table *model, double rows);
uint32_t lg_table_slices(const lg_table *model); /* number of arrays of parameters */
/* Draws parameters with the run's seed. */
lg_status lg_table_first_parameters(lg_training *self, const lg_table *model, double **theta,
                                    lg_error *error);
/* Only for a regression: gives the run priors and, with `any_width`, one hidden layer of the width with the
 * highest evidence; self->theta gets the parameters to start from. The effort is bounded by work, not by a
 * clock. Errors: from lg_table_init and lg_table_evidence. */
lg_status lg_table_find_start(lg_training *self, bool any_width, lg_error *error);

/* ---- the trainer (recipe.c) ---- */

typedef struct lg_table_state {
    lg_table_given given;           /* must be the first member: the options write to it */
    lg_table_names inputs, outputs; /* outputs: for a classification the classes */
    lg_table_names without;         /* columns to leave out */
    lg_table_text class_name;       /* the column with the classes; "" for a regression */
    lg_table_sheet table, test;     /* the table that is learned or judged; the table of --test */
    uint32_t *order;                /* (rows): indices of the training rows, then of the validation rows */
    size_t trained;
    bool few_told;            /* the warning of few rows was given */
    lg_scaler scaler;         /* for inputs and outputs */
    lg_table_samples samples; /* scaled rows in the order of `order` */
    lg_table_evidence_result evidence;
    lg_table_problem problem;
    lg_table_file file; /* borrows its arrays */
    /* usual: equals `learned`, unless a few rows have far larger errors; then it leaves these rows out */
    lg_table_judgement learned, usual, judged;
    const char *part; /* the rows that `judged` is about: "validation", "test" or "training" */
} lg_table_state;
static inline bool lg_table_is_regression(const lg_table_state *s) {
    return s->given.class_column == NULL;
}

#endif
