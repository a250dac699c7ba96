/* The training half of a recipe: a learner, a table of hooks, and the learning that they work on.
 *
 * The driver (apps/common/train.c) fills a learning with the hyperparameters of the user and calls
 *   read, describe, prepare or hold_out, problem, then trains, then judge and save, then release and close.
 * A race of sizes and a search go from describe to release again and again. A hook that returns a status
 * says in `error` why it fails; a sentence that begins with the name of an option, "--", is about the command
 * line. What is no failure but should be told goes to LG_WARN. */
#ifndef LG_LEARNING_H
#define LG_LEARNING_H

#include "core/core.h"
#include "model/files/recipe.h"

/* One number or text of a result; or where a list or an object begins or ends. */
typedef struct lg_result {
    const char *name;   /* in JSON; static; NULL in a list and where one ends */
    const char *label;  /* what it is, for people; static, may be NULL */
    lg_field_type type; /* LG_FIELD_REAL, LG_FIELD_U64 or LG_FIELD_STRING */
    double real;
    uint64_t whole;
    const char *text; /* borrowed; NULL: unknown */
    char bracket;     /* [ { ] }, or 0: a number or a text */
} lg_result;

/* How good the model is on the data that it learned: its `error`, the `what` ("mean squared error"), and the
 * error of a simple guess ("the mean curve"). what NULL: not known. */
typedef struct lg_learning_verdict {
    const char *what, *guess;
    double error, guessed;
    bool failed; /* the result is of no use, and a warning said why */
} lg_learning_verdict;

typedef struct lg_learning lg_learning;
struct lg_learning {
    const lg_context *context;
    const lg_recipe *recipe;
    void *run; /* (recipe->run_size bytes): hyperparameters, and facts about model and data */
    void
        *state; /* (learner->state_size bytes) the learner's own; zero at the beginning but for its options */
    const char *const *paths; /* the arguments of the command; the first one is the data */
    size_t path_count;
    const char *model; /* path of the model file that is written or evaluated; may be NULL */
    uint64_t threads;
    /* A stored run is resumed; `stored` is this run while it has the last word about the facts. */
    bool resumed;
    const void *stored;
    const void *file;   /* the contents of the model file that is evaluated; NULL while a model is trained */
    const char *preset; /* the preset that the user asked for; may be NULL */
    bool (*given)(const lg_learning *self, const char *option); /* by the user */
    const void *user;                                           /* of `given` */
    /* Filled by `read`. */
    char sha256[LG_SHA256_TEXT];
    const char *failed; /* the file that a failure is about; NULL: paths[0] */
    /* Filled by `problem`; the options are filled before, and may be changed. */
    lg_fit_problem problem;
    lg_fit_options options;
    double *theta;  /* (problem.parameters) to start from */
    lg_fit *fit;    /* the driver's */
    double seconds; /* wall time of the training, or of an evaluation without its reading */
    /* Filled by `judge` and `evaluate`. */
    lg_result *results;
    size_t result_count, result_room, first_count; /* first_count: before what every training tells */
    bool results_lost;                             /* there was no memory for them */
    lg_learning_verdict verdict;
    double floor; /* the integrator's truncation error in units of the loss; NaN: not known */
    struct lg_learning_block *blocks; /* of lg_learning_alloc */
};

typedef struct lg_learner {
    const char *data; /* the paths, for people: "DATA.h5"; with "..." there may be more */
    size_t state_size;
    const lg_field *options;  /* of the state: what a user says and no file stores; may be NULL */
    const char *method;       /* the row whose value the other rows' `methods` are about; NULL: none */
    const char *held_out;     /* the row whose place --validation of a search takes; may be NULL */
    const char *kept;         /* the option that names one more file to be read; may be NULL */
    const char *const *sizes; /* values of the row "hidden" that --size auto compares, from small to large,
                               * ended by NULL; NULL: it has no such row */
    bool prior;               /* its loss is the square of noise, which --prior takes */
    bool presets;             /* it has the presets "thesis" and "best" */
    bool (*has_width)(const lg_learning *self); /* NULL: always */

    /* Reads the data; a sentence about a failure begins with the path of the file where it lacks one. */
    lg_status (*read)(lg_learning *self, lg_error *error);
    /* Completes the run: what the data say, and without `stored` what a preset says (lg_learning_adopt). The
     * hyperparameters of a stored run are adopted already. */
    lg_status (*describe)(lg_learning *self, lg_error *error);
    /* Splits the data: into training and test part, or, in a search, holding out `part` of the training part.
     * What it finds out about the data goes into the run. May be NULL. */
    lg_status (*prepare)(lg_learning *self, lg_error *error);
    lg_status (*hold_out)(lg_learning *self, double part, lg_error *error); /* NULL: the fit draws the part */
    lg_status (*problem)(lg_learning *self, lg_error *error);
    /* Results, verdict and floor at theta (problem.parameters), which it may improve. */
    lg_status (*judge)(lg_learning *self, double *theta, lg_error *error);
    /* In a search: what is to be lowered. NULL: the loss of the validation part at the best epoch so far. */
    double (*objective)(lg_learning *self);
    /* The rest of the file structure, which has run, theta and provenance; arrays are borrowed. NULL: none.
     */
    lg_status (*save)(lg_learning *self, void *file, lg_error *error);
    /* Results of a model on other data, which are read. The run is the file's. */
    lg_status (*evaluate)(lg_learning *self, const void *file, lg_error *error);
    void (*release)(lg_learning *self); /* what prepare, hold_out and problem made; may be NULL */
    void (*close)(lg_learning *self);   /* what read made; may be NULL */
} lg_learner;

/* A sentence for the user of the context. */
#define LG_WARN(self, ...) lg_log_message((self)->context, LG_LOG_WARNING, __VA_ARGS__)

/* A learning without paths and options: who has the data puts them in `state`. */
lg_learning lg_learning_of(const lg_context *context, const lg_recipe *recipe, void *run, void *state);
/* Zeroed memory that the learning frees where it is released. NULL, with a sentence about the size of the
 * network, when there is none. */
void *lg_learning_alloc(lg_learning *self, size_t count, size_t size, lg_error *error);
/* The pointer gets an array; or the hook ends. */
#define LG_LEARNING_ARRAY(self, pointer, count, error)                                                       \
    do {                                                                                                     \
        (pointer) = lg_learning_alloc(self, count, sizeof *(pointer), error);                                \
        if ((pointer) == NULL) return LG_OUT_OF_MEMORY;                                                      \
    } while (0)
/* The run's training. */
lg_training *lg_learning_training(const lg_learning *self);
/* What was not given becomes that of `from`, a run. `preset`: only where the rows have no default. */
void lg_learning_adopt(lg_learning *self, const void *from, bool preset);
/* "thesis" or "best", as was asked for. Else "thesis" where the user asks for Adam, by a method that ends
 * with it or, without a method, by an option of Adam's alone (a rate, a batch) or by single precision. */
const char *lg_learning_preset(const lg_learning *self);
const char *lg_preset_name(uint32_t value); /* NULL beyond the last */
/* Results are kept in the order in which they are told. */
void lg_result_real(lg_learning *self, const char *name, double value, const char *label);
void lg_result_whole(lg_learning *self, const char *name, uint64_t value, const char *label);
void lg_result_text(lg_learning *self, const char *name, const char *value, const char *label);
/* A list '[' or an object '{' begins, whose members are told until it ends; they are in JSON alone. */
void lg_result_open(lg_learning *self, const char *name, char bracket);
void lg_result_close(lg_learning *self, char bracket);
void lg_learning_clear(lg_learning *self); /* no results */
/* NULL: there is no such result, or it is a member of another one. */
const lg_result *lg_result_find(const lg_learning *self, const char *name);
/* The hooks of the learner, or their defaults. */
double lg_learning_objective(lg_learning *self);
lg_status lg_learning_hold_out(lg_learning *self, double part, lg_error *error);
/* The loss of the problem over all samples, in double precision. */
lg_status lg_learning_loss(const lg_learning *self, const double *theta, double *loss, lg_error *error);
/* Data are read, the run is described and the problem made; the fit is created. */
lg_status lg_learning_create_fit(lg_learning *self, lg_error *error);
/* Writes the model with these parameters and the state of the fit. */
lg_status lg_learning_save(lg_learning *self, const char *path, double *theta,
                           const lg_provenance *provenance, lg_error *error);
/* Results of a model file's contents on the data of `paths`: by `evaluate`, or as of a training on them. */
lg_status lg_learning_evaluate(lg_learning *self, const void *file, lg_error *error);
/* Frees what describe, prepare and problem made, and the fit; then what read made, too. */
void lg_learning_release(lg_learning *self);
void lg_learning_close(lg_learning *self);

#endif
