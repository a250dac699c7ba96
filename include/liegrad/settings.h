/* Fields: what a user can set, as rows of tables. A row says where a value lies in a structure, its type,
 * range, default and meaning. Command lines, ranges of searches, grids of studies, attributes of files, the
 * comparison of a resumed run with the stored one, JSON and docs/hyperparameters.md all read the same rows.
 *
 *   lg_surrogate_run run;
 *   lg_fields_default(lg_surrogate_fields, &run);
 *   const lg_field *lr = lg_field_find(lg_surrogate_fields, "lr");
 *   lg_status status = lg_field_set(lr, "1e-3", &run, &error);
 */
#ifndef LIEGRAD_SETTINGS_H
#define LIEGRAD_SETTINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* What the member is, and how its value is written. */
typedef enum lg_field_type {
    LG_FIELD_REAL,   /* double */
    LG_FIELD_U64,    /* uint64_t */
    LG_FIELD_U32,    /* uint32_t */
    LG_FIELD_FLAG,   /* bool; 0 or 1 in files, one of two names elsewhere */
    LG_FIELD_NAME,   /* an enumeration, or a bool with two names; a name everywhere */
    LG_FIELD_WHOLES, /* a list of whole numbers; commas separate them in a text */
    LG_FIELD_REALS,  /* a list of numbers, likewise */
    LG_FIELD_PHRASE, /* a value that `parse` reads from a text and `phrase` writes */
    LG_FIELD_SWITCH, /* bool; an option without a value: true when it is given */
    LG_FIELD_STRING, /* const char *, borrowed; an empty text is refused */
    LG_FIELD_TEXT,   /* char array; a fact about the data, which cannot be set */
    LG_FIELD_SHOWN,  /* a text that `show` makes from several members; also a fact */
    /* In files of keys alone: */
    LG_FIELD_NAMES, /* a list of names */
    LG_FIELD_NODE,  /* whatever stands there; its reader looks at it */
    LG_FIELD_MAP    /* a mapping, whose keys have rows of their own: "inputs", "inputs.hold" */
} lg_field_type;

/* What a command does with the file that a STRING names. */
typedef enum lg_file_use {
    LG_FILE_NOT,      /* the text names no file, or the command looks after it alone */
    LG_FILE_READ,     /* an input */
    LG_FILE_WRITTEN,  /* the file is replaced */
    LG_FILE_STREAMED, /* the file is replaced; a pipe or a device is written to */
    LG_FILE_DRAWN     /* a picture, .svg or .png: its data and script, next to it, are replaced too */
} lg_file_use;

/* The most numbers in a list, and room for any value as text. */
#define LG_FIELD_LIST_MAX  256
#define LG_FIELD_TEXT_SIZE 4096

/* Members for lists, which need neither `get` nor `put`. */
typedef struct lg_wholes {
    size_t count;
    uint32_t values[LG_FIELD_LIST_MAX];
} lg_wholes;
typedef struct lg_reals {
    size_t count;
    double values[LG_FIELD_LIST_MAX];
} lg_reals;

/* A table ends with a row whose name is NULL. */
typedef struct lg_field {
    const char *name; /* in files and grids, such as lr_step */
    /* On command lines, and with _ for - in JSON; NULL: the name with - for _; "": none. */
    const char *option;
    /* Of a hyperparameter: the HDF5 group that stores it, "model" or "run" (a resumed run must have the same
     * value), or "" when no file stores it. NULL: the row is no hyperparameter (a path, a picture, a key of a
     * scene); a search cannot draw it. */
    const char *group;
    lg_field_type type;
    size_t offset, size; /* of the member in the structure */
    double low, high;    /* of each number */
    bool above;          /* low itself is refused */
    bool required;       /* the option must be given; a file that has the mapping must have the key */
    lg_file_use file;    /* STRING */
    bool adam;           /* it applies only where Adam takes part in the training */
    bool optional;       /* files of earlier versions lack it; the run then has the default for files */
    uint32_t methods;    /* bit v: it applies when the run's method is number v; 0: always */
    /* FLAG, NAME: the names by value, from a function that returns NULL beyond the last, or as a list that
     * ends with NULL. PHRASE: value_name gives the single words. */
    const char *(*value_name)(uint32_t value);
    const char *const *names;
    const void *(*value_at)(uint32_t value); /* NAME, and the member is a pointer into a table: the entry */
    /* Lists in other members than lg_wholes and lg_reals: `get` copies the numbers out and returns how many,
     * `put` stores them. */
    uint32_t (*get)(const void *member, double *values);
    void (*put)(void *member, const double *values, uint32_t count);
    uint32_t most;      /* numbers of a list, at most LG_FIELD_LIST_MAX; 0: so many */
    const char *longer; /* what to do with more; may be NULL */
    void (*show)(const void *run, char *text, size_t size); /* SHOWN */
    /* PHRASE: `parse` reads a text into the member, which a failure leaves as it was; `phrase` writes the
     * text back. `form` says which texts there are besides the single words. */
    lg_status (*parse)(const char *text, void *member, lg_error *error);
    void (*phrase)(const void *member, char *text, size_t size);
    const char *form;
    const char *value;     /* the default as text; NULL: `otherwise` says where the default comes from */
    const char *otherwise; /* "the preset's" */
    const char *unit;      /* what --help calls a value; NULL: NAME */
    const char *meaning;   /* one sentence without its full stop */
} lg_field;

/* A row for `member` of `struct_`; the last arguments are designated initialisers. */
#define LG_FIELD(struct_, group_, name_, type_, member, ...)                                                 \
    {                                                                                                        \
        .group = group_, .name = name_, .type = LG_FIELD_##type_, .offset = offsetof(struct_, member),       \
        .size = sizeof(((struct_ *)0)->member), __VA_ARGS__                                                  \
    }
/* A row for an option that is no hyperparameter, called like its member; designated initialisers may follow
 * the meaning. */
#define LG_OPTION(struct_, member, type_, unit_, ...)                                                        \
    LG_FIELD(struct_, NULL, #member, type_, member, .unit = unit_, .meaning = __VA_ARGS__)
#define LG_ANY_REAL .low = -1e300, .high = 1e300
#define LG_POSITIVE .high = 1e300, .above = true
/* The function that gives a row's names: value 0 has the first name. */
#define LG_NAMES(...)                                                                                        \
    .names = (const char *const[]) {                                                                         \
        __VA_ARGS__, NULL                                                                                    \
    }
#define LG_FIELD_END                                                                                         \
    { .name = NULL }

/* Finds the row with this name, in files or on command lines. NULL: the table has no such row. */
LG_API const lg_field *lg_field_find(const lg_field *table, const char *name);
/* Its name on command lines, cut to `size` bytes; "" for one that has none. */
LG_API void lg_field_option(const lg_field *entry, char *text, size_t size);
/* "Width of the hidden layers (1 to 1048576; default the preset's)"; only hyperparameters tell the range.
 * Returns the length as snprintf does. */
LG_API int lg_field_describe(const lg_field *entry, char *text, size_t size);

/* Sets the run's value from text. LG_INVALID_ARGUMENT with a sentence that says which values are possible;
 * the run is untouched then. A SWITCH becomes true, whatever the text. */
LG_API lg_status lg_field_set(const lg_field *entry, const char *text, void *run, lg_error *error);
/* Sets a number, or a list of one number, to these bits; otherwise as lg_field_set with the number's text. */
LG_API lg_status lg_field_store(const lg_field *entry, double value, void *run, lg_error *error);
/* The run's value as lg_field_set takes it, cut to `size` bytes; "?" for an unknown name. */
LG_API void lg_field_show(const lg_field *entry, const void *run, char *text, size_t size);
/* The name of a value; NULL beyond the last, and for a row without names. */
LG_API const char *lg_field_name(const lg_field *entry, uint32_t value);
/* The value of a number, or the position of a name; NaN for other types. */
LG_API double lg_field_number(const lg_field *entry, const void *run);
/* The exact value of whole numbers, flags and names; 0 for other types. */
LG_API uint64_t lg_field_whole(const lg_field *entry, const void *run);
/* Copies the numbers of a list, at most LG_FIELD_LIST_MAX, and returns how many; 0 for other types. */
LG_API uint32_t lg_field_list(const lg_field *entry, const void *run, double *values);
/* Whether the number or name is within its range; true for other types. */
LG_API bool lg_field_fits(const lg_field *entry, const void *run);
/* Copies the value from one run to another. */
LG_API void lg_field_copy(const lg_field *entry, const void *from, void *to);
/* Sets every hyperparameter that has a default; the others are unchanged. */
LG_API void lg_fields_default(const lg_field *table, void *run);

/* A decimal number, consumed whole, whatever the locale: [+-] digits with optional point and exponent.
 * LG_FORMAT for anything else (empty, "9,81", "9.81m", "0x1p3", "nan"), LG_NOT_FINITE when it overflows. */
LG_API lg_status lg_number_parse(const char *text, double *out);
/* The same for a whole number 0..UINT64_MAX, digits only. */
LG_API lg_status lg_integer_parse(const char *text, uint64_t *out);

/* ---- random search ----
 *
 * Random search over hyperparameters. A search can be resumed, and bad trials are stopped early. It does not
 * depend on the model: a trial is a list of numbers, an objective to be lowered, and reports during the
 * trial.
 *
 * The values of trial t depend on the seed and t alone. So an interrupted search continues with the same
 * trials, and trials may run in any order. */

typedef enum lg_range_kind {
    LG_RANGE_UNIFORM,     /* [low, high) */
    LG_RANGE_LOG_UNIFORM, /* uniform in the logarithm; low > 0 */
    LG_RANGE_INTEGER,     /* low..high, whole numbers, both ends included */
    LG_RANGE_CHOICE       /* one of the choices; the value is its position */
} lg_range_kind;

#define LG_RANGE_MAX         32
#define LG_RANGE_MAX_CHOICES 16
#define LG_RANGE_NAME        32

typedef struct lg_range {
    char name[LG_RANGE_NAME];
    lg_range_kind kind;
    double low, high;
    uint32_t choices;
    char choice[LG_RANGE_MAX_CHOICES][LG_RANGE_NAME];
} lg_range;

typedef struct lg_search_space {
    size_t count;
    lg_range ranges[LG_RANGE_MAX];
} lg_search_space;

typedef enum lg_trial_state { LG_TRIAL_DONE, LG_TRIAL_PRUNED, LG_TRIAL_FAILED } lg_trial_state;
#define LG_TRIAL_STATE_COUNT 3
LG_API const char *lg_trial_state_name(lg_trial_state state); /* "done", "pruned", "failed" */

#define LG_TRIAL_REPORTS 16 /* rungs at which trials are compared */

typedef struct lg_trial {
    uint64_t number; /* 0, 1, ... */
    lg_trial_state state;
    double objective; /* to be lowered; pruned: the last one reported; NaN when failed */
    double seconds;   /* wall time, set by lg_search_run */
    uint64_t parameters, epochs;
    double value[LG_RANGE_MAX];
    uint32_t reports;                /* rungs reached */
    double report[LG_TRIAL_REPORTS]; /* objective at each */
    /* Of a trial that ran beside others: its planned epochs, and those done at each rung. 0: settled. */
    uint64_t planned, report_epoch[LG_TRIAL_REPORTS];
} lg_trial;

typedef struct lg_search_options {
    size_t size;     /* sizeof(lg_search_options) */
    uint64_t trials; /* 50: planned total, earlier ones included */
    uint64_t seed;   /* 1 */
    uint32_t rungs; /* 5, 0..LG_TRIAL_REPORTS: rungs divide a trial's epochs into rungs + 1 equal parts; 0: no
                     * early stopping */
    uint32_t warm_up; /* 5: trials that must have reached a rung before any trial is stopped there */
    double quantile;  /* 0.5, in (0, 1]: a trial is stopped at a rung when at least this part of the earlier
                       * trials was better there */
} lg_search_options;
LG_API void lg_search_options_init(lg_search_options *options);

/* LG_INVALID_ARGUMENT with a sentence:
 * - no range; two ranges of the same name
 * - low above high; a bound that is not finite, or not positive in a logarithmic range
 * - bounds of an integer range that are not whole or beyond 2^53
 * - no choice, or the same choice twice
 * - a name or choice that is empty or has a comma, a double quote or a control character */
LG_API lg_status lg_search_space_check(const lg_search_space *space, lg_error *error);

/* A trial's side of the search. */
typedef struct lg_search lg_search;
/* A trial calls this after `done` of its `total` epochs with its current objective, which is recorded for all
 * rungs passed since the last report. Returns true when the trial is to be stopped: at one of these rungs, or
 * because the objective is not finite. After the last epoch a finite objective never stops a trial. */
LG_API bool lg_search_report(lg_search *search, uint64_t done, uint64_t total, double objective);

typedef struct lg_search_problem {
    /* Runs one trial: reads trial->number and trial->value, reports, sets objective, parameters and epochs.
     * What it returns:
     * - LG_OK: the trial is pruned when a report said stop, failed when the objective is not finite, else
     *   done
     * - LG_CANCELLED: the search stops and the trial is not kept. After a report that said stop it means
     *   LG_OK, so the status of lg_fit_run may be returned as it is
     * - any other status: the trial failed with `error` (never NULL), and the search goes on */
    lg_status (*run)(void *user, lg_search *search, lg_trial *trial, lg_error *error);
    /* Called after each trial with all trials so far, the new one last: saves results. `error` holds LG_OK or
     * why the trial failed. A status other than LG_OK stops the search. The callback may be NULL. */
    lg_status (*finished)(void *user, const lg_trial *trials, size_t count, const lg_error *error);
    void *user;
} lg_search_problem;

/* Runs the trials whose numbers are not among the first *count of `trials` (room for options->trials), one
 * after the other by rising number, and appends them. The cancel flag is read before each trial. `options`
 * NULL: defaults. Errors, with the trials so far kept: LG_INVALID_ARGUMENT (the check refuses the space, an
 * option is out of range, an earlier trial is there twice or beyond the plan), LG_CANCELLED, the status of
 * `finished`. When `run` is a pure function of its trial, an interrupted and continued search ends with the
 * same trials as an uninterrupted one, except for their seconds. */
LG_API lg_status lg_search_run(const lg_context *context, const lg_search_space *space,
                               const lg_search_options *options, const lg_search_problem *problem,
                               lg_trial *trials, size_t *count, lg_error *error);
/* ---- trials beside each other: on other threads, processes, machines ---- */

/* What a trial learns of others where it passes a rung: sets *trials to those with lower numbers, settled.
 * False: one of them has not come so far; then the trial goes on, and lg_search_settle decides later. */
typedef bool (*lg_search_known)(void *user, const lg_trial *trial, uint32_t rung, const lg_trial **trials,
                                size_t *count);
/* Runs one trial. `known` NULL: nothing is known. LG_OK (a trial that failed, too: `why`), LG_CANCELLED (it
 * is not kept), or what lg_search_run refuses. */
LG_API lg_status lg_search_run_trial(const lg_search_space *space, const lg_search_options *options,
                                     const lg_search_problem *problem, lg_search_known known, uint64_t number,
                                     lg_trial *trial, lg_error *why);
/* Sorts the trials by number, and makes each that ran on where it would have been stopped one that was
 * stopped there: when all numbers below are there, they are those of lg_search_run, but for their seconds. */
LG_API void lg_search_settle(const lg_search_options *options, lg_trial *trials, size_t count);

/* Position of the done trial with the lowest objective; among equal ones, the lowest number. `count` when no
 * trial is done. */
LG_API size_t lg_search_best(const lg_trial *trials, size_t count);

/* ---- files of searches (library liegrad_io) ---- */

#define LG_SEARCH_FIXED_TEXT 64

/* The options that a search varies and those that it holds fixed: names and values as on the command line. */
typedef struct lg_search_file {
    lg_search_space space;
    size_t fixed_count;
    char fixed_name[LG_RANGE_MAX][LG_RANGE_NAME];
    char fixed_value[LG_RANGE_MAX][LG_SEARCH_FIXED_TEXT];
    uint32_t line[LG_RANGE_MAX], fixed_line[LG_RANGE_MAX]; /* of the file, for the caller's own messages */
} lg_search_file;
/* A YAML (or JSON) file:
 *   fixed: {network: discrete, batch: 32}
 *   ranges:
 *     architecture: {choice: [mlp, resnet]}
 *     layers: {integer: [0, 4]}
 *     gamma: {uniform: [0, 1e-2]}
 *     lr: {log-uniform: [1e-4, 1e-1]}
 * `fixed` may be missing. Errors: as for scenes, with the line; LG_FORMAT for what lg_search_space_check
 * refuses, a name that is both fixed and a range, names other than letters, digits, - and _. */
LG_API lg_status lg_search_file_read(const lg_context *context, const char *path, lg_search_file *out,
                                     lg_error *error);
/* Trials as CSV by rising number, one a line: trial, state, objective, parameters, epochs, seconds, one
 * column a range (choices by name), then the reports rung1, rung2, ... as far as any trial has them. Numbers
 * with 17 digits; nan, inf, -inf. The first line, `# seed S space HASH setting HASH`, ties the file to its
 * search: the ranges, and with the fixed options `setting` (NULL: ""), any text on what else the results
 * depend on, such as the SHA-256 of the data and the search's options. LG_INVALID_ARGUMENT: what
 * lg_search_space_check refuses, a trial that could not be read back. */
LG_API lg_status lg_trials_write(const lg_context *context, const char *path, const lg_search_file *search,
                                 uint64_t seed, const char *setting, const lg_trial *trials, size_t count,
                                 lg_error *error);
/* What the trials depend on, in short: the table's first line. */
#define LG_SEARCH_LABEL 96
LG_API void lg_search_label(const lg_search_file *search, uint64_t seed, const char *setting,
                            char label[LG_SEARCH_LABEL]);
/* Reads the trials of the same search: the ranges, fixed options, seed and setting that were written.
 * `trials` NULL and room 0: only counts them. A last line without its end is left out: that trial was not
 * saved and is to run again. LG_NOT_FOUND: no such file; LG_INVALID_ARGUMENT: of another search (the sentence
 * says what differs), or more than `room`; LG_FORMAT: with the line. */
LG_API lg_status lg_trials_read(const lg_context *context, const char *path, const lg_search_file *search,
                                uint64_t seed, const char *setting, size_t room, lg_trial *trials,
                                size_t *count, lg_error *error);

LG_END_DECLS

#endif
