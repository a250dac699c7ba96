/* lg-export: declarations that its files share.
 *
 * A model becomes five files. Code that is the same for every model of a kind are fragments: C files below
 * code/, built into the executable as text. Sizes, tables and weights differ between models; the functions
 * here write them.
 *
 *   NAME.h          inputs, outputs, units, order, provenance, error; sizes; prototypes
 *   NAME.c          constants and tables of this model, then the fragments its kind needs
 *   NAME_weights.c  all arrays
 *   NAME_test.c     golden vectors and code/frame/test_main.c
 *   Makefile
 *
 * Fragments are C99 and C++14 without warnings (-Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow
 * -pedantic), need libm alone, and follow these rules: functions are static except those of NAME.h, no static
 * variables; `real` is the type; numbers are REAL(0.5), with a point; mathematics by macros of the prelude
 * (EXP, SIN, COS, SQRT, FABS, FLOOR, ATAN2, ...); sizes and indices int; RESTRICT for restrict; arrays only
 * in `work`, except a few numbers; no recursion, no function pointers; loops over tables instead of unrolled
 * code. The letters NAME_ at the beginning of a word become the model's name and _.
 */
#ifndef LG_EXPORT_H
#define LG_EXPORT_H

#include "common/app.h"
#include "core/text.h"
#include "liegrad/integrators.h"
#include "liegrad/io.h"
#include "liegrad/model.h"
#include "liegrad/program.h"

typedef lg_text text;

/* ---- options and sources ---- */

enum { EXPORT_UNITS = 256 };

typedef struct export_options {
    const char *name;            /* a C identifier */
    const char *file;            /* the model's file, without its folder */
    char sha256[LG_SHA256_TEXT]; /* of that file, "" if unknown */
    lg_dtype dtype;              /* of the exported code */
    const lg_scheme *scheme;     /* of Hamiltonians, never NULL there */
    const char *functions;       /* of programs: names with commas, NULL: all */
    bool compact;                /* of programs: loops instead of straight code */
    uint64_t golden;             /* golden vectors in the self-test, >= 1 */
    uint64_t seed;               /* of their inputs */
    char input_units[EXPORT_UNITS], output_units[EXPORT_UNITS]; /* from the model's file, or "" */
} export_options;

/* Golden vectors of the self-test. Inputs are numbers of the exported type (export_round). The library
 * computes the outputs from them in double with the stored parameters. */
typedef struct export_golden {
    size_t count;
    double *x;        /* (count, inputs) */
    double *y;        /* (count, outputs) */
    double *jacobian; /* (count, outputs, inputs), or NULL: the model has no NAME_grad */
    size_t extras; /* numbers that test_*.c below code/ computes from x in `static void extra(x, out, work)`;
                      0: none */
    double *extra; /* (count, extras) */
    const char *extra_name; /* "field and step" */
} export_golden;

/* A file as it will be written. */
typedef struct export_file {
    char *name; /* in the folder */
    text content;
} export_file;
enum { EXPORT_MOST_FILES = 16 };

/* The C of a model under construction. The texts hold finished C with the model's name. */
typedef struct export_source {
    const export_options *options;
    size_t inputs, outputs;
    bool written; /* the library wrote arrays, and the code with its prelude, in the texts below */
    bool bundle;  /* a program: functions of its own instead of NAME_eval and NAME_grad, all of the sizes and
                     golden vectors in the texts below */
    size_t functions;   /* of a bundle */
    const char *prefix; /* of its functions in C, behind NAME_: "" or "c_" */
    size_t work;        /* NAME_WORK_SIZE, in reals, enough for every function */
    size_t stack; /* NAME_STACK_SIZE: bound on the frames of functions that call each other, in bytes, gcc and
                     clang, -O0 to -O3 */
    size_t calls; /* bound on the depth of calls; 0: `stack` bounds the sum of all frames */
    size_t depth; /* number of maps in succession; the stated tolerance is 20 eps depth condition */
    double condition; /* 1, or the factor by which the model multiplies rounding; `about` explains it */
    text about;       /* lines (without comment signs, any bytes) for the head of NAME.h: description, inputs,
                   units, order, data, error */
    text state, input;        /* words for the numbers of x and u, or empty */
    text places, inputs_each; /* a name for each of their numbers, each followed by a newline, or empty */
    text range;               /* lines on the range of the data, or empty */
    text delay;               /* "inputs act 2 rows of the log, ... later than they are logged", or empty */
    text sizes;               /* #define NAME_LINKS 1 ... for NAME.h */
    text declarations;        /* prototypes with comments, beside NAME_eval and NAME_grad */
    text arrays;              /* extern declarations of arrays, for NAME.c */
    text weights;             /* their definitions, for NAME_weights.c */
    text code;                /* enumerations, tables and fragments, for NAME.c */
    text test;                /* for NAME_test.c, before code/test_main.c: `extra` */
    export_golden golden;
    char fragments[4096]; /* names already added, each followed by a blank */
    size_t parameters;    /* of the model; 0: `numbers` is told */
    size_t numbers;       /* reals in NAME_weights.c */
    size_t integers;      /* ints there */
    size_t lost;          /* numbers of the model that are too small for the exported type */
    double *start; /* (starts) a state at rest on the manifold, then (tunable) values of the shared inputs
                               behind the first input; or NULL */
    size_t starts, tunable;
    double step;   /* between two points of the training data, 0 unknown */
    double stop;   /* the end of the scene, 0 unknown */
    bool single;   /* the target chose single precision */
    text products; /* what the Makefile makes beside the objects: names, each behind a blank */
    text rules;    /* how: rules for the end of the Makefile */
    size_t file_count;
    export_file files[EXPORT_MOST_FILES];
} export_source;

/* The fragments: <name>.c below code/ as text. The table ends with a row of NULL. */
typedef struct export_fragment {
    const char *name, *text;
} export_fragment;
extern const export_fragment export_fragments[];
/* `#error` for a name that is none. */
const char *export_fragment_text(const char *name);

/* Adds a fragment (<fragment>.c below code/) to source->code, once. */
void export_code(export_source *source, const char *fragment);
/* The same to source->test. */
void export_test_code(export_source *source, const char *fragment);
/* `#define`s for NAME.h, enumeration constants for NAME.c: NAME of the constant as it stands. */
void export_size(export_source *source, const char *constant, size_t value, const char *comment);
void export_constant(export_source *source, const char *constant, size_t value);
/* A real constant for NAME.c: `static const real constant = ...;` */
void export_real(export_source *source, const char *constant, double value);
/* `extern const NAME_real NAME_<array>[count]`: a table of its own in NAME_weights.c with a comment; values
 * are rounded to the exported type there. */
typedef struct export_part {
    const char *comment; /* "layer1/weight (3, 100)" */
    size_t count;
    const double *values;
} export_part;
void export_array(export_source *source, const char *array, const export_part *parts, size_t count);
/* `extern const int NAME_<array>[count]`; values below 2^31. */
void export_integers(export_source *source, const char *array, const char *comment, const uint32_t *values,
                     size_t count);
/* To the exported type and back. */
double export_round(const export_options *options, double value);
double export_eps(const export_options *options); /* of the exported type */
/* |a - b| of `count` numbers; b NULL: |a|. */
double export_norm(const double *a, const double *b, size_t count);
/* NAME_TOLERANCE: 20 eps depth condition. */
double export_tolerance(const export_source *source);
/* input_units and output_units from the attributes of /model in the file, "" where there are none. */
void export_read_units(const app *self, const char *path, export_options *options);
/* Lines for `about`: the file's units, or `otherwise` if the file has none. */
void export_units(export_source *source, const char *otherwise);
/* Lines for `about`: command line, seed, CPU and version of the training, SHA-256 of its data ("": unknown).
 */
void export_provenance(export_source *source, const lg_provenance *provenance, const char *sha256);
/* The same of a file of any kind. */
void export_file_provenance(const app *self, export_source *source, const char *path);
/* Empty texts, no files. */
void export_source_begin(export_source *source, const export_options *options);
void export_source_free(export_source *source);

/* ---- golden vectors (golden.c) ---- */

/* Makes zeroed arrays for options->golden vectors; inputs and outputs of `source` are already set. `jacobian`
 * and `extras` say which arrays there are besides x and y. */
void export_golden_make(export_source *source, bool jacobian, size_t extras, const char *extra_name);
/* Whether all numbers, and the squares of their norms that the self-test computes, are finite in the exported
 * type. */
bool export_golden_fits(const export_source *source);
/* Writes the golden vectors as text for NAME_test.c. */
void export_golden_write(const export_source *source, text *to);

/* ---- code that the library writes (bundle.c) ---- */

/* A function of a model's program, and its name in C. Those of NAME_eval and NAME_grad stand first; NAME.h
 * always declares these two. */
typedef struct export_function {
    const char *function, *name;
    size_t work, depth; /* out: reals of work memory that it needs; operations one after another */
    bool hidden;        /* static: for the fragments after it */
} export_function;
/* Adds code, arrays, weights and all declarations but the first `skip` of a program's functions; `source` has
 * name and type. Errors: those of lg_program_write_c. */
lg_status export_c(export_source *source, lg_program *program, const lg_c_options *how, int skip,
                   lg_c_source **out, lg_error *error);
/* The same of functions with loops, all of which the program has. A number that does not fit the type is left
 * to export_write. Returns an exit code; on failure a message has been printed. */
int export_bundle(const app *self, export_source *source, lg_program *program, export_function *functions,
                  size_t count);
/* Replaces all parameters of the program by their rounded values. */
lg_status export_round_parameters(export_source *source, lg_program *program);

/* ---- what models are (motion.c, machine/machine_words.c) ---- */

/* Schemes without an explicit step on the space: a sentence and APP_EXIT_USAGE. */
int export_check_scheme(const app *self, const lg_space *space, bool separable, const lg_scheme *scheme);
/* A warning where inputs act later. */
void export_warn_delay(const app *self, const export_source *source);

/* ---- the library's own results (program.c) ---- */

/* A plan of a function with memory for it. */
typedef struct export_evaluation {
    lg_plan *plan;
    void *work;
    const lg_port *in, *out;
    size_t ins, outs;
    bool single;
} export_evaluation;
/* `most`: lg_plan_options.most_work, 0: the default. Errors: those of lg_plan_create. */
lg_status export_evaluation_open(const lg_program *program, size_t function, lg_dtype dtype, double most,
                                 export_evaluation *e, lg_error *error);
/* All inputs one behind the other, all outputs likewise. */
void export_evaluate(const export_evaluation *e, const double *x, double *y);
void export_evaluation_close(export_evaluation *e);
/* Numbers within the range of a port, or from -1 to 1; returns how many. */
size_t export_draw_port(const lg_port *port, lg_rng *rng, double *x);
/* By how much a function of the program multiplies rounding, seen in the library's own single precision at
 * `points` inputs, one behind the other, numbers of single precision: the largest error over its eps times
 * the depth; infinite or NaN where single precision cannot hold the results. */
lg_status export_amplification(lg_program *program, size_t function, const double *x, size_t points,
                               size_t depth, double *out, lg_error *error);

/* ---- files without faces (golden vectors included) ---- */

/* These return an exit code; on failure a message has been printed. The caller sets `source->options`. */
int export_classifier(const app *self, const char *path, export_source *source);
int export_program(const app *self, const char *path, export_source *source);
/* Functions of a program (a list with commas; NULL: all) under their own names, with source->prefix. `path`:
 * of the model's file. */
int export_whole(const app *self, const char *path, lg_program *program, const char *functions,
                 export_source *source);

/* ---- targets: tools that take more than C (one file each) ---- */

/* Warns that a file of an unknown kind is no model, and why (load.c). */
void export_warn_program(const app *self, const lg_error *why);
/* A model as a program, whatever its kind, and start and step of `source` (load.c). */
int export_load(const app *self, const char *path, const char *kind, export_source *source, lg_program **out);
/* A scene of lg-simulate as a program; `tunable`: its parameters are inputs (scene.c). */
int export_load_scene(const app *self, const char *path, bool tunable, export_source *source,
                      lg_program **out);
/* Inputs or outputs of a function of a program; NULL and 0: it has no such function. */
const lg_port *export_ports(const lg_program *program, const char *function, bool outputs, size_t *count);
/* The functions that a target offers, a list with commas to be freed: those of --functions, or else those of
 * `usual` (ends with NULL) that the program has; of a program that has none of them all but derivatives.
 * NULL: a message has been printed. */
char *export_choose(const app *self, const export_options *options, const lg_program *program,
                    const char *const *usual);
/* Name of a derivative of a function, to be freed; the program gets it if it has not got it yet. NULL: it
 * cannot be had, and a warning says why. */
char *export_derive(const app *self, lg_program *program, lg_derivative_kind kind, const char *function);

/* A target: a row in a file that has what it writes, and its name in the list. */
typedef struct export_target {
    /* Fills the files from the model's program; NULL: the C of its faces. Returns an exit code; on failure a
     * message has been printed. */
    int (*build)(const app *self, const char *path, lg_program *program, export_source *source);
    void (*add)(export_source *source); /* files beside those of C, or NULL */
    bool tunable;                       /* parameters of a scene are inputs */
    const char *wide; /* "an FMU computes": it is in double precision, --dtype f32 is refused; or NULL */
} export_target;

/* ---- the model's name in C (name.c) ---- */

/* Returns the reason why `name` is refused, or NULL: not a C identifier, a word of C, C++ or the code, too
 * long. */
const char *export_name_problem(const char *name);
/* A name made from the file's name (without folder), to be freed; NULL if that is impossible. */
char *export_name_from(const char *file);

/* ---- files (files.c) ---- */

/* Adds a file, which begins with a comment that says who wrote it where its format (by the ending) has
 * comments; other formats need the words "lg-export: NAME" in their first 500 bytes. %s in the name: the
 * model's. */
text *export_add_file(export_source *source, const char *name);
/* Lines (without comment signs, any bytes) inside of a comment, broken where they are long. */
void export_add_lines(text *to, const char *lines);
/* What the numbers of x and u are, and the delay: as lines, and inside of a comment. */
void export_tell_words(const export_source *source, text *to);
void export_add_words(const export_source *source, text *to);
/* Text of a Makefile: NAME_. and NAME_x become the model's name with . and _x, %NAME% the name. */
void export_add_named(const export_source *source, const char *lines, text *to);
/* Adds to the Makefile: what `all` makes and `clean` removes, and rules for it. NAME_. and NAME_x become the
 * model's name. Before export_compose. */
void export_add_rules(export_source *source, const char *products, const char *rules);
/* Adds NAME.h, NAME.c, NAME_weights.c, NAME_test.c and Makefile of what `source` has. */
void export_compose(export_source *source);
/* Writes the files to folder `out`: to a temporary folder, then they are renamed. A folder that does not
 * exist or is empty gets all or none. In any other folder they are replaced one by one after all are
 * written. An existing file is replaced only if it has the words by which lg-export marks its files for this
 * name. A model with numbers or golden vectors that are not finite is refused. Returns an exit code; on
 * failure a message has been printed. */
int export_write(const app *self, const export_source *source, const char *out);

#endif
