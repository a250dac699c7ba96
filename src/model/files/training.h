/* The training half of a recipe: the trainer, a table of hooks, and lg_training, the state that they work on.
 *
 * The driver (apps/common/train.c) fills a training with the user's hyperparameters. It calls
 *   read, describe, prepare or hold_out, problem; trains the model; then calls judge, save, release, close.
 * A comparison of sizes (--size auto) and a search repeat the hooks from describe to release. A hook that
 * returns a failure explains it in `error`; a sentence that begins with the name of an option, "--", is about
 * the command line. Warnings go to LG_WARN. */
#ifndef LG_TRAINING_H
#define LG_TRAINING_H

#include "core/core.h"
#include "model/files/recipe.h"
#include "settings/result.h"

/* How good the model is on the data that it learned from. `what` names the measure of `error` ("mean squared
 * error"; NULL: not known); `guessed` is the same measure for a simple guess, which `guess` names ("the mean
 * curve"). */
typedef struct lg_training_verdict {
    const char *what, *guess;
    double error, guessed;
    bool failed; /* the result is useless, and a warning has said why */
} lg_training_verdict;

typedef struct lg_training lg_training;
struct lg_training {
    const lg_context *context;
    const lg_recipe *recipe;
    void *run; /* (recipe->run_size bytes): hyperparameters, and facts about model and data */
    /* (trainer->state_size bytes): the trainer's own state; at the beginning zero, except for its options */
    void *state;
    const char *const *paths; /* arguments of the command; paths[0] is the data */
    size_t path_count;
    const char *model; /* path of the model file that is written or evaluated; may be NULL */
    uint64_t threads;
    /* resumed: a stored run is resumed. stored: a run from a file that `describe` must not change by presets;
     * NULL: presets apply. */
    bool resumed;
    const void *stored;
    const void *file;   /* contents of the model file that is evaluated; NULL in training */
    const char *preset; /* preset that the user asked for; may be NULL */
    bool (*given)(const lg_training *self, const char *option); /* whether the user gave the option */
    const void *user;                                           /* for `given` */
    /* `read` fills these members. */
    char sha256[LG_SHA256_TEXT];
    const char *failed; /* path of the file that a failure is about; NULL: paths[0] */
    /* `problem` fills these members. The options are filled before; `problem` may change them. */
    lg_fit_problem problem;
    lg_fit_options options;
    double *theta;  /* (problem.parameters): parameters to start from */
    lg_fit *fit;    /* owned by the driver */
    double seconds; /* wall time of the training, or of an evaluation without reading the data */
    /* `judge` and `evaluate` fill these members. */
    lg_result *results;
    /* the first first_count results are shown before the results of training */
    size_t result_count, result_room, first_count;
    bool results_lost; /* results are missing because memory ran out */
    lg_training_verdict verdict;
    double floor; /* truncation error of the integrator, in units of the loss; NaN: unknown */
    struct lg_training_block *blocks; /* memory of lg_training_alloc */
};

typedef struct lg_trainer {
    const char *data; /* the arguments, as shown to people: "DATA.h5"; "..." means that there may be more */
    size_t state_size;
    const lg_field *options; /* fields of `state` that a user sets and no file stores; may be NULL */
    const char *method;      /* name of the field that `methods` in other rows refers to; NULL: none */
    /* field that a search does not vary, since its own --validation-fraction replaces it; may be NULL */
    const char *held_out;
    /* values of the field "hidden" that --size auto compares, from small to large, ended by NULL; NULL: the
     * run has no such field */
    const char *const *sizes;
    bool presets;                               /* the trainer has the presets "thesis" and "best" */
    bool (*has_width)(const lg_training *self); /* whether the model has hidden layers; NULL: always */

    /* Reads the data. The sentence of a failure begins with the path of a file, or with an option. */
    lg_status (*read)(lg_training *self, lg_error *error);
    /* Completes the run by what the data determine and, without `stored`, by what a preset says
     * (lg_training_adopt). The hyperparameters of a stored run are in the run already. */
    lg_status (*describe)(lg_training *self, lg_error *error);
    /* For help texts: sets a run that has the defaults of the fields to what describe makes of it in case
     * `at`, by self->preset. The cases are the kinds of data and models; self->state is NULL. Returns false
     * beyond the last case. NULL: describe keeps the defaults. */
    bool (*usual)(lg_training *self, uint32_t at);
    /* prepare splits the data into training and test part. hold_out is for a search: it holds out `part` of
     * the training part. What they find out about the data goes into the run. prepare may be NULL. */
    lg_status (*prepare)(lg_training *self, lg_error *error);
    lg_status (*hold_out)(lg_training *self, double part, lg_error *error); /* NULL: the fit draws the part */
    lg_status (*problem)(lg_training *self, lg_error *error);
    /* Computes results, verdict and floor at theta (problem.parameters), and may improve theta. */
    lg_status (*judge)(lg_training *self, double *theta, lg_error *error);
    /* The number that a search lowers; NaN if the model has none. NULL: the loss of the validation part at
     * the best epoch so far. */
    lg_status (*objective)(lg_training *self, double *out, lg_error *error);
    /* Fills the rest of the file structure; run, theta and provenance are set. Arrays are borrowed. NULL:
     * there is no rest. */
    lg_status (*save)(lg_training *self, void *file, lg_error *error);
    /* Computes results of the model in a file on the data that were read. The run is the file's. NULL:
     * `judge` is called with the parameters of the file. */
    lg_status (*evaluate)(lg_training *self, const void *file, lg_error *error);
    /* Rejects inputs x of a prediction by the model in a file that can have no answer (LG_INVALID_ARGUMENT),
     * and warns of inputs outside of the training range. NULL: no range is known. */
    lg_status (*inspect)(const lg_context *context, const void *file, const double *x, lg_error *error);
    void (*release)(lg_training *self); /* frees what prepare, hold_out and problem made; may be NULL */
    void (*close)(lg_training *self);   /* frees what read made; may be NULL */
} lg_trainer;

/* The row of --test, for a member of this name: a file with other data than those that are learned. */
#define LG_TEST_ROW(struct_, ...)                                                                            \
    LG_OPTION(struct_, test, STRING, __VA_ARGS__, .usual = true, .file = LG_FILE_READ)

/* Warns the user: a sentence for the context's log. */
#define LG_WARN(self, ...) lg_log_message((self)->context, LG_LOG_WARNING, __VA_ARGS__)

/* A training without paths and options. A caller that has the data puts them into `state`. */
lg_training lg_training_of(const lg_context *context, const lg_recipe *recipe, void *run, void *state);
/* Zeroed memory that lg_training_release frees. NULL if there is none; `error` then tells the size of the
 * network. */
void *lg_training_alloc(lg_training *self, size_t count, size_t size, lg_error *error);
/* Sets the pointer to a new array, or returns LG_OUT_OF_MEMORY from the hook. */
#define LG_TRAINING_ARRAY(self, pointer, count, error)                                                       \
    do {                                                                                                     \
        (pointer) = lg_training_alloc(self, count, sizeof *(pointer), error);                                \
        if ((pointer) == NULL) return LG_OUT_OF_MEMORY;                                                      \
    } while (0)
/* The lg_fit_settings in the run. */
lg_fit_settings *lg_training_settings(const lg_training *self);
/* Copies from the run `from` all hyperparameters that the user did not give. preset: only those without a
 * default value. */
void lg_training_adopt(lg_training *self, const void *from, bool preset);
/* "thesis" or "best", as the user asked for. If the user did not ask: "thesis" if Adam is asked for, by a
 * method that ends with Adam or, without a method, by an option that only Adam has (a rate, a batch) or by
 * single precision; else "best". */
const char *lg_training_preset(const lg_training *self);
const char *lg_preset_name(uint32_t value); /* NULL beyond the last preset */
/* As lg_field_describe. For a field of a recipe, shows the default of a run without options: its value, or
 * that data and model choose it. If the preset "thesis" has another value, "; thesis: " and this value
 * follow. Fields that only Adam uses have the defaults of "thesis". */
int lg_training_describe_field(const lg_field *row, char *text, size_t size);
/* Append results, which are shown in the order of these calls. LG_TELL: several that have names. */
void lg_result_add(lg_training *self, lg_result result);
void lg_result_list(lg_training *self, const lg_result *results);
#define LG_TELL(self, ...) lg_result_list(self, LG_RESULTS(__VA_ARGS__))
/* Begin and end a list, with bracket '[' and ']', or an object, with '{' and '}'. People see the numbers and
 * texts of an object under both names. lg_result_table: a list of objects, or an object of objects, that
 * people see as a table; `names` is the heading of the objects' names, or "". */
#define lg_result_table(self, key, begin, names)                                                             \
    lg_result_add(self, LG_SHOWN(key, NODE, names, .bracket = (begin)))
#define lg_result_open(self, key, begin) lg_result_table(self, key, begin, NULL)
#define lg_result_close(self, end)       lg_result_open(self, NULL, end)
/* An object of members that are made by LG_AS_REAL and the like. */
#define LG_RESULT_OBJECT(self, key, ...) lg_result_object(self, key, LG_RESULTS(__VA_ARGS__))
void lg_result_object(lg_training *self, const char *name, const lg_result *members);
/* The error of always guessing the most frequent class: the share of the others. */
double lg_guess_class(const uint64_t *confusion, uint32_t classes);
void lg_training_clear(lg_training *self); /* removes all results */
/* Finds a result by name. NULL: there is none outside lists and objects. */
const lg_result *lg_result_find(const lg_training *self, const char *name);
/* Calls the trainer's `judge`. LG_OUT_OF_MEMORY also if there was no room for a result. */
lg_status lg_training_judge(lg_training *self, double *theta, lg_error *error);
/* The validation loss in the epoch whose parameters are the model, the best one; NaN: none. */
double lg_training_validation(const lg_training *self);
/* Call the hook of the trainer, or do its default. */
lg_status lg_training_objective(lg_training *self, double *out, lg_error *error);
lg_status lg_training_hold_out(lg_training *self, double part, lg_error *error);
/* Calls `problem` and creates the fit. The data must be read and the run described. */
lg_status lg_training_create_fit(lg_training *self, lg_error *error);
/* Writes the model file with these parameters and the state of the fit. */
lg_status lg_training_save(lg_training *self, const char *path, double *theta,
                           const lg_provenance *provenance, lg_error *error);
/* Computes results of the contents of a model file on the data of `paths`: by `evaluate`, or without this
 * hook by `judge`, after the hooks that come before it in a training. */
lg_status lg_training_evaluate(lg_training *self, const void *file, lg_error *error);
/* release frees the fit and what describe, prepare and problem made; close also frees what read made. */
void lg_training_release(lg_training *self);
void lg_training_close(lg_training *self);

#endif
