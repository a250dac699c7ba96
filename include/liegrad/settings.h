/* Settings: fields, which describe everything that a user can set, and searches over them.
 *
 * A field is a row of a table. It says where a value lies in a structure (the "run"), its type, range,
 * default and meaning. Command lines, ranges of searches, grids of studies, attributes of files, the
 * comparison of a resumed run with the stored one, JSON and docs/data/hyperparameters.md are all made from
 * the same rows.
 *
 *   lg_surrogate_run run;
 *   lg_fields_default(lg_surrogate_fields, &run);
 *   const lg_field *lr = lg_field_find(lg_surrogate_fields, "lr");
 *   lg_status status = lg_field_set(lr, "1e-3", &run, &error);
 *
 * The functions are in the library liegrad, those from "files of searches" on in liegrad_io. Functions for
 * one field take the structure that its table is for as `run`.
 */
#ifndef LIEGRAD_SETTINGS_H
#define LIEGRAD_SETTINGS_H

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* The type of the member, and how its value is written as text. */
typedef enum lg_field_type {
    LG_FIELD_REAL,   /* double */
    LG_FIELD_U64,    /* uint64_t */
    LG_FIELD_U32,    /* uint32_t */
    LG_FIELD_FLAG,   /* bool; 0 or 1 in HDF5 files, one of two names elsewhere */
    LG_FIELD_NAME,   /* an enumeration, or a bool with two names; written by name everywhere */
    LG_FIELD_WHOLES, /* a list of whole numbers; as text they are separated by commas */
    LG_FIELD_REALS,  /* a list of real numbers; as text they are separated by commas */
    LG_FIELD_PHRASE, /* a value of any type; `parse` and `phrase` of the field read and write its text */
    LG_FIELD_SWITCH, /* bool; a command-line option without a value, which sets the member to true */
    LG_FIELD_STRING, /* const char *, borrowed; the empty text is refused */
    LG_FIELD_TEXT,   /* char array, such as a name; with an option "" a fact that the user cannot set */
    LG_FIELD_SHOWN,  /* a text that the function `show` makes from several members; the user cannot set it */
    /* The following types occur only as keys of YAML files: */
    LG_FIELD_NAMES, /* a list of names */
    LG_FIELD_NODE,  /* any YAML node; the program that reads the file interprets it */
    LG_FIELD_MAP    /* a mapping; its keys have rows too, such as "inputs.hold" below the row "inputs" */
} lg_field_type;

/* What a command does with the file whose name is the value of a LG_FIELD_STRING. LG_FILE_READ is also for
 * lists of files, separated by commas, and for a LG_FIELD_PHRASE. */
typedef enum lg_file_use {
    LG_FILE_NOT,      /* the text is not the name of a file, or the command itself does all checks */
    LG_FILE_READ,     /* reads the file */
    LG_FILE_WRITTEN,  /* the command writes an HDF5 file */
    LG_FILE_TEXT,     /* the command writes a text file */
    LG_FILE_STREAMED, /* the command writes a text file, or writes into a pipe or device */
    LG_FILE_DRAWN     /* the command draws a plot (.svg or .png), and writes its data and script next to it */
} lg_file_use;

/* Largest number of elements in a list, and bytes that suffice for any value as text. */
#define LG_FIELD_LIST_MAX  256
#define LG_FIELD_TEXT_SIZE 4096

/* Types of list members for which a field needs neither `array` nor `get` and `put`. */
typedef struct lg_wholes {
    size_t count;
    uint32_t values[LG_FIELD_LIST_MAX];
} lg_wholes;
typedef struct lg_reals {
    size_t count;
    double values[LG_FIELD_LIST_MAX];
} lg_reals;

/* One field. A table of fields ends with a row whose name is NULL. Members that a type
 * does not need are zero. */
typedef struct lg_field {
    const char *name; /* name in files and grids, such as lr_step */
    /* Name on command lines. NULL: `name` with - instead of _. "": the field has no command-line option. */
    const char *option;
    const char *json; /* name in JSON; NULL: `name` */
    bool usual;       /* --help lists it also where a command has many options */
    /* For a hyperparameter: the HDF5 group in which files store it, "model" or "run" (a resumed run must have
     * the same value), or "" if no file stores it. NULL: the field is not a hyperparameter (but a path, a
     * plot, or a key of a scene), and a search cannot vary it. */
    const char *group;
    lg_field_type type;
    size_t offset, size; /* offset and size of the member in the structure, bytes */
    double low, high;    /* range of a number, or of each number of a list; both ends are included */
    bool above;          /* `low` itself is not in the range */
    /* An option with this mark must be given. A key of a YAML file with this mark must be there if the
     * mapping that it belongs to is there. */
    bool required;
    const char *needs;   /* an option that must be given, too; NULL: none */
    const char *without; /* options that must not be given with it, separated by commas; NULL: none */
    lg_file_use file;    /* for types STRING and PHRASE */
    const char *kind;    /* for LG_FILE_WRITTEN: the attribute `kind` of the file */
    bool adam;           /* the field applies only if Adam takes part in the training */
    bool optional; /* files of earlier versions may lack it; their readers then use a default of their own */
    /* Bit v is set: the field applies to runs whose method has number v. 0: it applies to all runs. */
    uint32_t methods;
    /* For types FLAG and NAME: the names of the values 0, 1, ..., either from a function that returns NULL
     * beyond the last value, or as a list that ends with NULL. For type PHRASE, value_name gives the values
     * that are single words. For type U64 these are words in place of a number: high + 1, high + 2, ... */
    const char *(*value_name)(uint32_t value);
    uint32_t value_count; /* value_name is called only below it; 0: it returns NULL beyond the last value */
    /* For type NAME: if the user gives another name, the message lists the allowed names, then says this
     * advice. May be NULL. */
    const char *hint;
    const char *const *names;
    /* For type NAME, if the member is a pointer to an entry of a table: returns the entry for a value. */
    const void *(*value_at)(uint32_t value);
    /* For lists whose member is an array of uint32_t (WHOLES) or double (REALS). `counted`: offset of the
     * uint32_t with their number in the structure; 0: there are always `most`. */
    bool array;
    size_t counted;
    /* For other lists whose member is not lg_wholes or lg_reals: `get` copies the numbers out and returns how
     * many there are, `put` stores them. */
    uint32_t (*get)(const void *member, double *values);
    void (*put)(void *member, const double *values, uint32_t count);
    uint32_t least, most; /* lengths that a list may have; most = 0: LG_FIELD_LIST_MAX */
    const char *longer;   /* advice in the error message for a longer list; may be NULL */
    void (*show)(const void *run, char *text, size_t size); /* for type SHOWN: makes the text */
    /* For type PHRASE: `parse` reads a text into the member and leaves it unchanged on failure; `phrase`
     * writes the text of the member. `form` describes the allowed texts that are not names of the row,
     * such as "phases as in adam:100,lbfgs", for --help and error messages. */
    lg_status (*parse)(const char *text, void *member, lg_error *error);
    void (*phrase)(const void *member, char *text, size_t size);
    const char *form;
    const char *value;     /* the value before any is given, as text; NULL: there is none, see `otherwise` */
    const char *otherwise; /* where the default comes from, such as "the preset's"; NULL: it is `value` */
    const char *unit;      /* what --help shows for the value, such as W in --box=W; NULL stands for NAME */
    const char *meaning;   /* one sentence without its full stop */
} lg_field;

/* A row for `member` of `struct_`; more designated initialisers may follow as the last arguments. */
#define LG_FIELD(struct_, group_, name_, type_, member, ...)                                                 \
    {                                                                                                        \
        .group = group_, .name = name_, .type = LG_FIELD_##type_, .offset = offsetof(struct_, member),       \
        .size = sizeof(((struct_ *)0)->member), __VA_ARGS__                                                  \
    }
/* A row for an option that is not a hyperparameter and has the name of its member. The last arguments are the
 * meaning, and then any designated initialisers. */
#define LG_OPTION(struct_, member, type_, unit_, ...)                                                        \
    LG_FIELD(struct_, NULL, #member, type_, member, .unit = unit_, .meaning = __VA_ARGS__)
/* For a row whose member is an array with its number of entries in `count`. */
#define LG_COUNTED(struct_, count) .array = true, .counted = offsetof(struct_, count)
#define LG_ANY_REAL                .low = -1e300, .high = 1e300
#define LG_POSITIVE                .high = 1e300, .above = true
/* Initialises `names` of a row: the first name belongs to value 0. LG_NAMED takes the names of an enumeration
 * with `count` values from a function. */
#define LG_NAMED(function, count) .value_name = (function), .value_count = (count)
#define LG_NAMES(...)                                                                                        \
    .names = (const char *const[]) {                                                                         \
        __VA_ARGS__, NULL                                                                                    \
    }
#define LG_FIELD_END                                                                                         \
    { .name = NULL }

/* Finds the row with this name or command-line name. NULL if the table has no such row. */
LG_API const lg_field *lg_field_find(const lg_field *table, const char *name);
/* Writes the command-line name, cut to `size` bytes; "" if the field has no option. */
LG_API void lg_field_option(const lg_field *entry, char *text, size_t size);
/* Writes a description such as "Width of the hidden layers (1 to 1048576; default the preset's)". Only
 * hyperparameters are described with their range. Returns the length as snprintf does. */
LG_API int lg_field_describe(const lg_field *entry, char *text, size_t size);

/* Sets the value in `run` from a text. A SWITCH becomes true, whatever the text. Errors, `run` is then
 * untouched: LG_INVALID_ARGUMENT with a sentence that says which values are possible, those of `parse`. */
LG_API lg_status lg_field_set(const lg_field *entry, const char *text, void *run, lg_error *error);
/* Writes the value in `run` as a text that lg_field_set can read, cut to `size` bytes. "?" for a value
 * without a name. */
LG_API void lg_field_show(const lg_field *entry, const void *run, char *text, size_t size);
/* Returns the name of a value; NULL beyond the last value, and for a field without names. */
LG_API const char *lg_field_name(const lg_field *entry, uint32_t value);
/* Returns a number (types REAL, U64, U32), or the value of a flag or name as a number; NaN for other
 * types. */
LG_API double lg_field_number(const lg_field *entry, const void *run);
/* Returns the exact value of a whole number, flag, name or switch; 0 for other types. */
LG_API uint64_t lg_field_whole(const lg_field *entry, const void *run);
/* Copies the numbers of a list to values (LG_FIELD_LIST_MAX) and returns how many there are; 0 for other
 * types. */
LG_API uint32_t lg_field_list(const lg_field *entry, const void *run, double *values);
/* Whether a number is in its range, or a value has a name; true for other types. */
LG_API bool lg_field_fits(const lg_field *entry, const void *run);
/* Copies the value of this field from one structure to another. */
LG_API void lg_field_copy(const lg_field *entry, const void *from, void *to);
/* Sets every field of the table that has a fixed default (`value`); all others are unchanged. */
LG_API void lg_fields_default(const lg_field *table, void *run);

/* ---- numbers in texts ---- */

/* Reads a decimal number, which must be the whole text: [+-] digits with an optional point and exponent,
 * independent of the locale. Errors: LG_FORMAT for anything else (empty, "9,81", "9.81m", "0x1p3", "nan"),
 * LG_NOT_FINITE if it overflows, LG_UNSUPPORTED for digits alone that no double equals, such as
 * 9007199254740993 (2^53 + 1); *out is then the nearest double. */
LG_API lg_status lg_number_parse(const char *text, double *out);
/* Reads a whole number 0..UINT64_MAX, digits only, which must be the whole text. Errors: LG_FORMAT for
 * anything else, also for a larger number. */
LG_API lg_status lg_integer_parse(const char *text, uint64_t *out);

/* ---- searches ----
 *
 * A search over hyperparameters can be resumed, and bad trials are stopped early. It knows nothing of the
 * model: for the search a trial is a list of values, an objective to be minimised, and the reports that it
 * makes while it runs.
 *
 * A sampler chooses the values of trial t. Those of "random" depend only on the seed, the ranges and t. So an
 * interrupted search continues with the same trials, and trials may run in any order. Those of "tpe" (the
 * tree-structured Parzen estimator with the defaults of Optuna, each range alone) depend on the trials that
 * have ended, too: the same trials give the same values. Those of "grid" are all combinations of the choices,
 * of the integers of ranges with at most 16, and of levels of the other ranges, with even steps from one end
 * to the other. */

typedef enum lg_range_kind {
    LG_RANGE_UNIFORM,     /* uniform in [low, high); a grid has the value high, too */
    LG_RANGE_LOG_UNIFORM, /* the logarithm is uniform; low > 0 */
    LG_RANGE_INTEGER,     /* whole numbers low..high, both ends included */
    LG_RANGE_CHOICE       /* one of the choices; the value is its index */
} lg_range_kind;

#define LG_RANGE_MAX         32 /* largest number of ranges */
#define LG_RANGE_MAX_CHOICES 16
#define LG_RANGE_NAME        32 /* bytes of the name of a range or choice, with the terminator */

/* One hyperparameter that a search varies. */
typedef struct lg_range {
    char name[LG_RANGE_NAME];
    lg_range_kind kind;
    double low, high; /* not used for LG_RANGE_CHOICE */
    uint32_t choices; /* number of choices, for LG_RANGE_CHOICE */
    char choice[LG_RANGE_MAX_CHOICES][LG_RANGE_NAME];
} lg_range;

typedef struct lg_search_space {
    size_t count;
    lg_range ranges[LG_RANGE_MAX];
} lg_search_space;

typedef enum lg_trial_state { LG_TRIAL_DONE, LG_TRIAL_PRUNED, LG_TRIAL_FAILED } lg_trial_state;
#define LG_TRIAL_STATE_COUNT 3
LG_API const char *lg_trial_state_name(lg_trial_state state); /* "done", "pruned", "failed" */

/* A rung is a point in the course of a trial at which its objective is compared with earlier trials. */
#define LG_TRIAL_REPORTS 16 /* largest number of rungs */

typedef struct lg_trial {
    uint64_t number; /* number of the trial: 0, 1, ... */
    lg_trial_state state;
    double objective; /* to be minimised. The last reported one if the trial was pruned; NaN if it failed */
    double seconds;   /* wall time; the search sets it if the trial has not done so */
    uint64_t parameters, epochs;     /* number of parameters of the model; epochs done */
    double value[LG_RANGE_MAX];      /* drawn value of each range */
    uint32_t reports;                /* number of rungs reached */
    double report[LG_TRIAL_REPORTS]; /* objective at each rung reached */
    /* The planned epochs (0 after lg_search_settle), and the epochs done when each rung was reported. */
    uint64_t planned, report_epoch[LG_TRIAL_REPORTS];
} lg_trial;

/* The comments give the values of lg_search_options_init. */
typedef struct lg_search_options {
    size_t size;   /* sizeof(lg_search_options) */
    uint64_t seed; /* default 1 */
    /* Default 5, 0..LG_TRIAL_REPORTS. The rungs divide the epochs of a trial into rungs + 1 equal parts. 0
     * means that no trial is stopped early. */
    uint32_t rungs;
    uint32_t warm_up; /* default 5: a trial is stopped at a rung only if so many earlier trials reached it */
    /* Default 0.5, in (0, 1]. A trial is stopped at a rung if at least this part of the earlier trials that
     * reached the rung were better there. */
    double quantile;
    uint32_t sampler; /* default 0, random; lg_search_sampler_name lists them */
    /* Default 50, the number of trials that are planned. A grid divides its ranges as finely as possible with
     * at most so many points; its trial t is point t. The other samplers do not depend on it. */
    uint64_t trials;
} lg_search_options;
LG_API void lg_search_options_init(lg_search_options *options);
/* The name of a sampler: "random", "tpe", ...; NULL beyond the last one. */
LG_API const char *lg_search_sampler_name(uint32_t sampler);

/* Checks a space. Errors: LG_INVALID_ARGUMENT with a sentence for
 * - no range, more than LG_RANGE_MAX ranges, or two ranges with the same name
 * - low above high, a bound that is not finite, or a bound that is not positive in a logarithmic range
 * - bounds of an integer range that are not whole or are beyond 2^53
 * - no choice, more than LG_RANGE_MAX_CHOICES choices, or the same choice twice
 * - a name or choice that is empty, too long, or contains a double quote or a control character */
LG_API lg_status lg_search_space_check(const lg_search_space *space, lg_error *error);

/* The handle by which a running trial talks to its search. */
typedef struct lg_search lg_search;
/* A trial calls this after `done` of its `total` epochs with its current objective. The objective is recorded
 * for all rungs that were passed since the last report. Returns true if the trial is to stop: because it is
 * too bad at one of these rungs, or because the objective is not finite. After the last epoch (done = total)
 * only an objective that is not finite gives true. */
LG_API bool lg_search_report(lg_search *search, uint64_t done, uint64_t total, double objective);

typedef struct lg_search_problem {
    /* Runs one trial. It reads trial->number and trial->value, calls lg_search_report, and sets
     * trial->objective, parameters and epochs. `error` is never NULL. It returns
     * - LG_OK: the trial is then pruned if a report returned true, failed if the objective is not finite, and
     *   done otherwise
     * - LG_CANCELLED: the search stops and the trial is not kept. But if a report returned true before,
     *   LG_CANCELLED means the same as LG_OK, so the status of lg_fit_run can be returned unchanged
     * - any other status: the trial has failed for the reason in `error`, and the search goes on */
    lg_status (*run)(void *user, lg_search *search, lg_trial *trial, lg_error *error);
    void *user;
} lg_search_problem;

/* ---- trials run in any order, and at the same time on other threads, processes or machines ---- */

/* The search calls this when `trial` passes a rung, to get the other trials that it is compared with. It sets
 * *trials and *count to the trials with lower numbers, after lg_search_settle, and returns true. It returns
 * false if one of them has neither reached the rung nor ended; `trial` then goes on, and lg_search_settle
 * decides later whether it should have stopped. `user` is problem->user. A sampler that learns also calls it
 * before the trial, with rung LG_TRIAL_BEGINS, to get the trials from which it chooses the values; false
 * means that no trial has ended. */
#define LG_TRIAL_BEGINS UINT32_MAX
typedef bool (*lg_search_known)(void *user, const lg_trial *trial, uint32_t rung, const lg_trial **trials,
                                size_t *count);
/* Runs the trial `number` and fills *trial. `known` NULL means that nothing is known of other trials. Returns
 * LG_OK also for a trial that failed; `why` (may be NULL) then has the reason. Errors: LG_CANCELLED (the
 * trial is not to be kept), LG_INVALID_ARGUMENT (lg_search_space_check rejects the space, or an option is out
 * of range). */
LG_API lg_status lg_search_run_trial(const lg_search_space *space, const lg_search_options *options,
                                     const lg_search_problem *problem, lg_search_known known, uint64_t number,
                                     lg_trial *trial, lg_error *why);
/* Sorts the trials by number. A trial that ran on beyond the rung where it would have stopped if it had known
 * all trials with lower numbers is changed into a trial that was stopped there. If no number is missing and
 * `run` is a pure function of its trial, the trials are then the same in whatever order and by whichever
 * processes they ran, except for `seconds`. */
LG_API void lg_search_settle(const lg_search_options *options, lg_trial *trials, size_t count);

/* Returns the index of the trial with state LG_TRIAL_DONE and the lowest objective; of equal ones the trial
 * with the lowest number. Returns `count` if no trial is done. */
LG_API size_t lg_search_best(const lg_trial *trials, size_t count);

/* ---- files of searches (library liegrad_io) ---- */

#define LG_SEARCH_FIXED_TEXT 64

/* The options that a search varies (space) and the options that it holds fixed. Names and values are as on
 * the command line. */
typedef struct lg_search_file {
    lg_search_space space;
    size_t fixed_count;
    char fixed_name[LG_RANGE_MAX][LG_RANGE_NAME];
    char fixed_value[LG_RANGE_MAX][LG_SEARCH_FIXED_TEXT];
    /* Lines of the file on which the ranges and the fixed options stand, for messages of the caller. */
    uint32_t line[LG_RANGE_MAX], fixed_line[LG_RANGE_MAX];
    struct lg_trial_layout *layout; /* of the table of a study (internal); NULL: the table of a search */
} lg_search_file;
/* Reads the YAML (or JSON) file of a search (docs/files.md). Errors, with the line: LG_FORMAT also for a
 * space that lg_search_space_check refuses, a name that occurs twice (also as a fixed option and a range),
 * and names that do not begin with a letter or have other characters than letters, digits, - and _. */
LG_API lg_status lg_search_file_read(const lg_context *context, const char *path, lg_search_file *out,
                                     lg_error *error);
/* Writes trials as CSV (docs/files.md); their numbers must rise. Numbers have 17 digits, or are nan, inf or
 * -inf. The first line, `# seed S space HASH setting HASH`, ties the file to its search. The first hash is of
 * the ranges. The second hash is of the fixed options and of `setting` (NULL stands for ""), any text that
 * says what else the results depend on, such as the SHA-256 of the data and the options of the search.
 * Errors: LG_INVALID_ARGUMENT (a space that lg_search_space_check refuses, a trial that could not be read
 * back). */
LG_API lg_status lg_trials_write(const lg_context *context, const char *path, const lg_search_file *search,
                                 uint64_t seed, const char *setting, const lg_trial *trials, size_t count,
                                 lg_error *error);
/* Writes the first line of this file without "# ": `seed S space HASH setting HASH`. */
#define LG_SEARCH_LABEL 96
#define LG_SEARCH_SEED  "seed " /* a label begins with these bytes */
LG_API void lg_search_label(const lg_search_file *search, uint64_t seed, const char *setting,
                            char label[LG_SEARCH_LABEL]);
/* Reads the trials of a file to trials (room), and sets *count. The ranges, fixed options, seed and setting
 * must be the ones that were written. A last line without its line end is ignored: this trial was not saved
 * completely and must run again. Errors: LG_NOT_FOUND (no such file), LG_INVALID_ARGUMENT (the file belongs
 * to another search, and the sentence says what differs; or it has more than `room` trials), LG_FORMAT (with
 * the line), LG_FILE. */
LG_API lg_status lg_trials_read(const lg_context *context, const char *path, const lg_search_file *search,
                                uint64_t seed, const char *setting, size_t room, lg_trial *trials,
                                size_t *count, lg_error *error);

LG_END_DECLS

#endif
