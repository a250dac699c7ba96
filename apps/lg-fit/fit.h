/* Regression and classification of tables: what the commands share. */
#ifndef LG_APPS_FIT_H
#define LG_APPS_FIT_H

#include "common/train.h"
#include "liegrad/tables.h"

extern const app_command train_command, evaluate_command, predict_command, search_command, import_command;

/* ---- columns and rows (table.c) ---- */

typedef struct column_names {
    uint32_t count;
    lg_table_text *name; /* freed with free */
} column_names;
/* a,"b, in s",c: names with CSV's quotes where they are needed; blanks around names do not count. Usage
 * errors for empty, long and repeated names; an exit code. */
int parse_names(const app *self, const char *option, const char *text, column_names *out);
/* One name, as it is or in quotes. */
int parse_class(const app *self, const char *text, lg_table_text out);
/* The names as parse_names takes them. Freed with free. */
char *list_names(const column_names *names);
bool has_name(const column_names *names, const char *name);
void free_names(column_names *names);

/* A table with the columns of a model: inputs, then the outputs of a regression. */
typedef struct fit_table {
    const char *path;
    lg_table_data data;
    uint32_t inputs, outputs; /* outputs: 0 for a classification */
    size_t left_out;          /* rows with missing cells */
} fit_table;
/* The table with rows as they are. */
lg_status load_table(const app *self, const char *path, const column_names *inputs,
                     const column_names *outputs, const char *class_column, fit_table *out, lg_error *error);
/* Rows with missing cells are left out, which is told. An exit code; no row is left: an error. */
int leave_incomplete(const app *self, fit_table *table);
/* load_table, told; `complete`: then leave_incomplete. An exit code. */
int read_table(const app *self, const char *path, const column_names *inputs, const column_names *outputs,
               const char *class_column, bool complete, fit_table *out);
static inline const double *table_row(const fit_table *table, size_t row) {
    return table->data.values + row * table->data.columns;
}
/* Warnings for cells of the columns first .. first + names->count - 1 that lie far from all others of their
 * column, for eight columns at most; `follows`: what follows from such cells. */
void warn_far(const app *self, const fit_table *table, uint32_t first, const column_names *names,
              const char *follows);
/* MODEL.h5 and TABLE, the arguments of a command. */
typedef struct fitted_table {
    lg_table_file file;
    fit_table table;
} fitted_table;
/* Into zeros; ends the command where one cannot be read. `judged`: the table has the outputs or classes too,
 * and rows with missing cells are left out. */
void read_fitted_table(const app *self, bool judged, fitted_table *out);
void fitted_table_destroy(fitted_table *of);
/* Labels become numbers of the model's classes. A class that the model does not know is an error. */
int match_classes(const app *self, fit_table *table, const lg_table_text *name, uint32_t classes);

/* ---- judging (judge.c) ---- */

typedef struct judgement {
    size_t rows, outside;       /* outside: rows with an input beyond the training range by a tenth of it */
    size_t infinite;            /* rows with a prediction that is not finite */
    double *truth, *prediction; /* (rows, outputs) of a regression; of a classification NULL */
    double *rmse, *r2;          /* (outputs); not finite where they overflow; r2 NaN for a constant column */
    double scaled_rmse;         /* over all outputs, in their scales */
    double accuracy, f1;        /* of a classification; f1 of class 1 of two, else the mean */
    uint64_t *confusion;        /* (classes, classes): truth by rows */
    double log_loss;
} judgement;
/* The model of a file; the caller destroys it. */
lg_status table_model(const app *self, const lg_table_file *file, lg_model **out, lg_error *error);
/* Over the rows `chosen` (count; NULL: all) of a table. */
lg_status judge_rows(const app *self, const lg_table_file *file, const fit_table *table,
                     const uint32_t *chosen, size_t count, judgement *out, lg_error *error);
void judgement_free(judgement *j);
void judgement_json(app_json *json, const lg_table_file *file, const judgement *j);
void judgement_print(const lg_table_file *file, const judgement *j);
/* A warning for rows whose prediction is not finite; the exit code. */
int warn_infinite(const app *self, size_t infinite, size_t rows, const char *path);
/* The same for the errors of a judgement. */
int warn_judgement(const app *self, const lg_table_file *file, const judgement *j, const char *path);
/* The far cells of a regression's outputs in a table that is judged. */
void warn_far_outputs(const app *self, const lg_table_file *file, const fit_table *table);
bool are_finite(const double *y, uint32_t count);
/* A warning for rows outside of the training range. */
void warn_outside(const app *self, size_t outside, size_t rows, const char *path, const char *model);
/* Whether an input of a row is beyond the training range by more than a tenth of it. */
bool is_outside(const lg_table_file *file, const double *x);
/* Probabilities from logits, in place. */
void softmax(double *y, uint32_t classes);

/* Predicted against true, or the table of confusion. */
lg_status draw_judgement(const app *self, const char *picture, const lg_table_file *file, const judgement *j,
                         lg_error *error);

#endif
