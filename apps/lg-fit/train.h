/* Training on a table: what the files of `train` and `search` share. */
#ifndef LG_APPS_FIT_TRAIN_H
#define LG_APPS_FIT_TRAIN_H

#include "lg-fit/fit.h"

typedef struct train_values {
    const char *inputs, *outputs, *without, *class_column, *test;
} train_values;

typedef struct training {
    const train_values *given;
    lg_table_run *run;            /* all that determines the result */
    column_names inputs, outputs; /* outputs: of a classification the classes */
    column_names without;         /* columns that are neither */
    lg_table_text class_name;     /* of the column with the classes; "" for a regression */
    fit_table table, test;
    bool resumed;
    uint32_t *order; /* (rows): the training rows, then the validation part */
    size_t trained;
    bool few_told; /* that there are few rows */
    lg_scaler input_scaler, output_scaler;
    lg_table_far *far;        /* (inputs): cells of the training rows that say nothing of the others */
    lg_table_samples samples; /* scaled, in that order */
    double *decay;            /* (parameters), or NULL */
    lg_table_evidence_result evidence;
    lg_table_problem problem;
    lg_fit_problem fit_problem;
    lg_fit *fit;
} training;

static inline bool is_regression(const training *state) {
    return state->given->class_column == NULL;
}

static inline const char *class_column(const training *state) {
    return is_regression(state) ? NULL : state->class_name;
}

/* ---- data (train_data.c) ---- */

/* Columns, table and test table; `read` of a train_task, `user` is the training. */
int read_training(void *user, app *self, const char *path, char sha256[LG_SHA256_TEXT]);
/* Order of the rows, training and validation part, scalers and samples. */
lg_status split_rows(training *state, const app *self, lg_error *error);
/* Equal rows, and whether they stand on both sides of the split. */
void warn_duplicates(const app *self, const training *state);

/* ---- result (train_result.c) ---- */

/* Judges, writes the model, draws and reports; `finish` of a train_task. */
int finish_training(void *user, train_session *session);

#endif
