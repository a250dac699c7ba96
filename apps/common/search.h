/* What every `search` command shares: random search over the options of its program's `train`, resumable,
 * with early stopping; its options, table of trials, result and picture.
 *
 * The command gives a search_task and returns search_main(...). A trial of the task, `run`, gets an app and
 * values as if the trial's options had been given to `train`; it makes the fit with search_fit_options and
 * hands it to search_fit. */
#ifndef LG_APPS_SEARCH_H
#define LG_APPS_SEARCH_H

#include "common/app.h"
#include "liegrad/io.h"
#include "liegrad/nn.h"
#include "liegrad/search.h"

typedef struct search_values {
    const char *out, *plot;
    bool resume;
    uint64_t trials, rungs, warm_up;
    double quantile, validation;
} search_values;

#define SEARCH_DEFAULTS                                                                                      \
    { .trials = 50, .rungs = 5, .warm_up = 5, .quantile = 0.5, .validation = 0.1 }

/* Rows of a command's table whose values are a search_values. */
#define SEARCH_ROWS(validation_help)                                                                         \
    APP_ROW_SIZE(search_values, trials, "trials", "n", 1, 1000000,                                           \
                 "Planned total, earlier ones included (default 50)"),                                       \
        APP_ROW_TEXT(search_values, out, "out", "FILE.csv", "The table of trials, written after each"),      \
        APP_ROW_FLAG(search_values, resume, "resume",                                                        \
                     "Continue the search of that table; without it a table that is there is replaced"),     \
        APP_ROW_SIZE(search_values, rungs, "rungs", "r", 0, LG_TRIAL_REPORTS,                                \
                     "Points of a trial where it is compared with earlier ones (default 5; 0: never)"),      \
        APP_ROW_SIZE(search_values, warm_up, "warm-up", "n", 0, 1000000,                                     \
                     "Trials that must have passed a rung before others are stopped there (default 5)"),     \
        APP_ROW_REAL(search_values, quantile, "quantile", "Q", 1e-9, 1,                                      \
                     "A trial is stopped where this part of the earlier ones was better (default 0.5)"),     \
        APP_ROW_REAL(search_values, validation, "validation", "F", 1e-9, 0.9, validation_help),              \
        APP_ROW_TEXT(search_values, plot, "plot", "FILE.svg|.png", "Draw objective and best so far")

#define SEARCH_DETAILS                                                                                       \
    "The file has `ranges`, options of train each with one of {uniform: [a, b]}, {log-uniform: [a, b]}, "    \
    "{integer: [a, b]}, {choice: [a, ...]}, and `fixed`, options with a value; what neither says is the "    \
    "preset's. A trial depends on the seed and its number alone. One that fails is kept as such; exit "      \
    "code 4 when none was done. Ctrl-C keeps the finished trials and ends with exit code 130; --resume "     \
    "continues to the same table."

/* A trial while it is trained. */
typedef struct search_trial search_trial;

typedef struct search_task {
    const app_command *train; /* its options are searched, its values are the defaults */
    size_t values_size;       /* of the struct behind train->values */
    /* Whether a search may vary or fix the option: it belongs to the model or its training, not to files. */
    bool (*is_hyperparameter)(const char *option);
    /* Why a search cannot set the option to this text, after "'option' "; NULL: it can. May be NULL: it
     * always can. */
    const char *(*refused)(const char *option, const char *text);
    /* Reads the data (argument 1) and gives their SHA-256; an exit code. What it leaves in `user` is freed by
     * the caller of search_main. */
    int (*read)(void *user, const app *app, char sha256[LG_SHA256_TEXT]);
    /* Trains with these options, holding out `validation` of the training part. */
    lg_status (*run)(void *user, app *train, void *values, double validation, search_trial *trial,
                     lg_error *error);
    void *user;
} search_task;

/* Arguments RANGES.yaml DATA.h5; returns the exit code. */
int search_main(app *app, const search_values *values, const search_task *task);

/* Hyperparameters of `training`, threads, progress and early stopping. */
lg_fit_options search_fit_options(search_trial *trial, const lg_training *training);
/* Trains `fit`, which was created with these options, and sets the trial's result. `objective(user)` is to be
 * lowered; it is asked where a rung is passed, and at the end. */
lg_status search_fit(search_trial *trial, lg_fit *fit, size_t parameters, double (*objective)(void *user),
                     void *user, lg_error *error);

#endif
