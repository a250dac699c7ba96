/* How a table is learned: its columns and rows, where the training begins, how good the model is. */
#ifndef LG_TABLE_RECIPE_H
#define LG_TABLE_RECIPE_H

#include "core/text.h"
#include "liegrad/tables.h"
#include "model/files/learning.h"

/* ---- columns (columns.c) ---- */

/* What a user says, as texts; NULL: nothing. */
typedef struct lg_table_given {
    const char *inputs, *outputs, *without, *class_column, *test;
} lg_table_given;
extern const lg_field lg_table_given_rows[], lg_table_column_rows[]; /* the second without `test` */

/* Inputs, outputs, the column with the classes and what is left out, from names and their defaults. Errors,
 * with a sentence about an option or the file: a column that is missing, named twice, or has two roles. */
lg_status lg_table_choose(lg_learning *self, lg_error *error);
/* a,"b, in s",c: names with CSV's quotes where they are needed; blanks around names do not count. Errors,
 * with a sentence about the option: LG_INVALID_ARGUMENT (empty, long and repeated names), LG_OUT_OF_MEMORY.
 * The caller destroys the names whatever is returned. */
lg_status lg_table_names_parse(const lg_context *context, const char *option, const char *text,
                               lg_table_names *out, lg_error *error);
/* The list that is read so. */
void lg_table_names_list(const lg_table_names *names, lg_text *to);
/* One name, as it is or in quotes. */
lg_status lg_table_class_parse(const char *text, lg_table_text out, lg_error *error);

/* ---- rows (rows.c) ---- */

/* A table with the columns of a model: inputs, then the outputs of a regression. */
typedef struct lg_table_sheet {
    const char *path;
    lg_table_data data;
    uint32_t inputs, outputs; /* outputs: 0 for a classification */
    size_t left_out;          /* rows with missing cells */
} lg_table_sheet;
/* The rows as they are; class_column NULL: none. Warns of a last line that was cut off. */
lg_status lg_table_sheet_read(const lg_context *context, const char *path, const lg_table_names *inputs,
                              const lg_table_names *outputs, const char *class_column, lg_table_sheet *out,
                              lg_error *error);
static inline const double *lg_table_sheet_row(const lg_table_sheet *sheet, size_t row) {
    return sheet->data.values + row * sheet->data.columns;
}
/* The table that is learned, without constant inputs, and the table of --test; or the table that the model of
 * self->file is judged on. */
lg_status lg_table_read_rows(lg_learning *self, lg_error *error);
/* Warns of cells of the columns first .. first + count - 1 that lie far from all others of their column, for
 * eight columns at most; `follows`: what follows from such cells. */
lg_status lg_table_warn_far(const lg_context *context, const lg_table_sheet *sheet, uint32_t first,
                            const lg_table_text *name, uint32_t count, const char *follows, lg_error *error);
/* Warns of equal rows, and of those that stand on both sides of the split. */
lg_status lg_table_warn_repeated(lg_learning *self, lg_error *error);

/* ---- judging (judge.c) ---- */

typedef struct lg_table_judgement {
    size_t rows, outside;       /* outside: rows with an input beyond the training range by a tenth of it */
    size_t infinite;            /* rows with a prediction that is not finite */
    double *truth, *prediction; /* (rows, outputs) of a regression; of a classification NULL */
    double *rmse, *r2;          /* (outputs); not finite where they overflow; r2 NaN for a constant column */
    double scaled_rmse;         /* over all outputs, in their scales */
    double accuracy, f1;        /* of a classification; f1 of class 1 of two, else the mean */
    uint64_t *confusion;        /* (classes, classes): truth by rows */
    double log_loss;
} lg_table_judgement;
/* The model of a file; the caller destroys it. */
lg_status lg_table_model(const lg_context *context, const lg_table_file *file, lg_model **out,
                         lg_error *error);
/* Over the rows `chosen` (count; NULL: all); the arrays are the learning's. */
lg_status lg_table_judge(lg_learning *self, const lg_table_file *file, const lg_table_sheet *sheet,
                         const uint32_t *chosen, size_t count, lg_table_judgement *out, lg_error *error);
void lg_table_tell(lg_learning *self, const lg_table_file *file, const lg_table_judgement *j);
/* Warns of predictions and errors that are not finite; true: there are some. */
bool lg_table_warn_infinite(const lg_context *context, size_t infinite, size_t rows, const char *path);
bool lg_table_warn_errors(const lg_context *context, const lg_table_file *file, const lg_table_judgement *j,
                          const char *path);
/* Warns of rows outside of the training range of `model`, a path. */
void lg_table_warn_outside(const lg_context *context, size_t outside, size_t rows, const char *path,
                           const char *model);
/* Whether an input of a row is beyond the training range by more than a tenth of it. */
bool lg_table_is_outside(const lg_table_file *file, const double *x);
bool lg_table_are_finite(const double *y, uint32_t count);
void lg_table_softmax(double *y, uint32_t classes); /* probabilities from logits, in place */

/* ---- where the training begins (start.c) ---- */

/* Beyond this many parameters the matrix of Levenberg-Marquardt takes too long. */
enum { LG_TABLE_MOST_LM = 1500 };
/* Work of one evaluation of residuals, Jacobian and matrix: multiplications, and other costs in units of a
 * multiplication. */
double lg_table_work(const lg_table *model, double rows);
uint32_t lg_table_slices(const lg_table *model); /* arrays of parameters */
/* Parameters as the run's seed draws them. */
lg_status lg_table_first_parameters(lg_learning *self, double **theta, lg_error *error);
/* The run, which is for a regression, gets priors, and with `any_width` one hidden layer of the width with
 * the highest evidence; self->theta are the parameters to start from. What is done is bounded by work, not by
 * a clock. Errors: those of lg_table_init and lg_table_evidence. */
lg_status lg_table_find_start(lg_learning *self, bool any_width, lg_error *error);

/* ---- the learner (recipe.c) ---- */

typedef struct lg_table_state {
    lg_table_given given;           /* first: the rows of the options begin here */
    lg_table_names inputs, outputs; /* outputs: of a classification the classes */
    lg_table_names without;         /* columns that are neither */
    lg_table_text class_name;       /* of the column with the classes; "" for a regression */
    lg_table_sheet table, test;     /* learned or judged; of --test */
    uint32_t *order;                /* (rows): the training rows, then the validation part */
    size_t trained;
    bool few_told;            /* that there are few rows */
    lg_scaler scaler;         /* of all columns */
    lg_table_far *far;        /* (inputs): cells of the training rows that say nothing of the others */
    lg_table_samples samples; /* scaled, in that order */
    lg_table_evidence_result evidence;
    lg_table_problem problem;
    lg_table_file file; /* borrows */
    lg_table_judgement learned, judged;
    const char *part; /* "validation", "test" or "training", which is judged */
} lg_table_state;
static inline bool lg_table_is_regression(const lg_table_state *s) {
    return s->given.class_column == NULL;
}

#endif
