/* lg-export: what its files have in common.
 *
 * A model becomes five files. What is the same for every model of a kind is C code below code/ (fragments,
 * built into the executable as text); what differs between models is data: sizes, tables and weights, written
 * by the functions here.
 *
 *   NAME.h          inputs, outputs, units, order, provenance, error; sizes; prototypes
 *   NAME.c          constants and tables of this model, then the fragments its kind needs
 *   NAME_weights.c  all arrays
 *   NAME_test.c     golden vectors and code/frame/test_main.c
 *   Makefile
 *
 * Fragments are C99 and C++14 without warnings (-Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow
 * -pedantic), need libm alone, and follow these rules: functions static but for those of NAME.h, no static
 * variables; `real` is the type; numbers are REAL(0.5), with a point; mathematics by macros of the prelude
 * (EXP, SIN, COS, SQRT, FABS, FLOOR, ATAN2, ...); sizes and indices int; RESTRICT for restrict; arrays in
 * `work` alone, but for a few numbers; no recursion, no function pointers; loops over tables instead of
 * unrolled code. The letters NAME_ at the beginning of a word become the model's name and _.
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

/* ---- what a kind of model gives ---- */

enum { EXPORT_UNITS = 256 };

typedef struct export_options {
    const char *name;            /* a C identifier */
    const char *file;            /* the model's file, without its folder */
    char sha256[LG_SHA256_TEXT]; /* of that file, "" where it is not known */
    lg_dtype dtype;              /* of the exported code */
    const lg_scheme *scheme;     /* of Hamiltonians, never NULL there */
    const char *functions;       /* of programs: names with commas, NULL: all */
    bool compact;                /* of programs: loops instead of straight code */
    uint64_t golden;             /* golden vectors in the self-test, >= 1 */
    uint64_t seed;               /* of their inputs */
    char input_units[EXPORT_UNITS], output_units[EXPORT_UNITS]; /* as the model's file has them, or "" */
} export_options;

/* Golden vectors of the self-test. Inputs are numbers of the exported type (export_round), outputs what the
 * library computes from them in double with the stored parameters. */
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

/* A model as C under construction; texts hold finished C with the name in place. */
typedef struct export_source {
    const export_options *options;
    size_t inputs, outputs;
    bool written; /* the library wrote arrays, and the code with its prelude, in the texts below */
    bool bundle;  /* a program: functions of its own instead of NAME_eval and NAME_grad, all of the sizes and
                     golden vectors in the texts below */
    size_t functions; /* of a bundle */
    size_t work;      /* NAME_WORK_SIZE, in reals, enough for every function */
    size_t stack; /* NAME_STACK_SIZE: bound on the frames of functions that call each other, in bytes, gcc and
                     clang, -O0 to -O3 */
    size_t calls; /* so many functions, or fewer, call each other; 0: `stack` bounds the sum of all frames */
    size_t depth; /* maps one after another; the stated tolerance is 20 eps depth condition */
    double condition; /* 1, or by how much the model multiplies rounding, told in `about` */
    text about; /* lines (without comment signs, any bytes) for the head of NAME.h: what it is, inputs, units,
                   order, data, error */
    text sizes; /* #define NAME_LINKS 1 ... for NAME.h */
    text declarations; /* prototypes with comments, beside NAME_eval and NAME_grad */
    text arrays;       /* extern declarations of arrays, for NAME.c */
    text weights;      /* their definitions, for NAME_weights.c */
    text code;         /* enumerations, tables and fragments, for NAME.c */
    text test;         /* for NAME_test.c, before code/test_main.c: `extra` */
    export_golden golden;
    char fragments[4096]; /* names already added, each followed by a blank */
    size_t parameters;    /* of the model; 0: `numbers` is told */
    size_t numbers;       /* reals in NAME_weights.c */
    size_t integers;      /* ints there */
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
/* NAME_TOLERANCE: 20 eps depth condition. */
double export_tolerance(const export_source *source);
/* input_units and output_units from the attributes of /model in the file, "" where there are none. */
void export_read_units(const app *self, const char *path, export_options *options);
/* Lines for `about`: these, or `otherwise` where the file has none. */
void export_units(export_source *source, const char *otherwise);
/* Lines for `about`: command line, seed, CPU and version of the training, SHA-256 of its data ("": unknown).
 */
void export_provenance(export_source *source, const lg_provenance *provenance, const char *sha256);
void export_source_free(export_source *source);

/* ---- golden vectors (golden.c) ---- */

/* Zeroed arrays for options->golden vectors (inputs and outputs of `source` are set): jacobian and extras as
 * asked for. */
void export_golden_make(export_source *source, bool jacobian, size_t extras, const char *extra_name);
/* Whether all are finite in the exported type and so are the squares of their norms, which the self-test
 * takes. */
bool export_golden_fits(const export_source *source);
/* Their text for NAME_test.c. */
void export_golden_write(const export_source *source, text *to);

/* ---- code that the library writes (bundle.c) ---- */

/* A function of a model's program, and what it is called in C. Those of NAME_eval and NAME_grad stand first:
 * NAME.h declares them by itself. */
typedef struct export_function {
    const char *function, *name;
    size_t work; /* out: reals of work memory that it needs */
    bool hidden; /* static: for fragments behind it */
} export_function;
/* Adds their code, arrays and weights. `compact` as lg_c_options has it. An exit code; a sentence has been said on failure. */
int export_bundle(const app *self, export_source *source, lg_program *program, bool compact,
                  export_function *functions, size_t count);
/* lg_program_set_parameter of all of them, rounded. */
lg_status export_round_parameters(const export_source *source, lg_program *program);

/* ---- kinds (one file each; golden vectors included) ---- */

/* An exit code; a sentence has been said on failure. `source->options` is set by the caller. */
int export_hamiltonian(const app *self, const lg_model_file *file, export_source *source);
int export_surrogate(const app *self, const lg_model_file *file, export_source *source);
int export_detector(const app *self, const lg_model_file *file, export_source *source);
int export_classifier(const app *self, const char *path, export_source *source);
int export_program(const app *self, const char *path, export_source *source);
/* All functions of a program under their own names; destroys it. `path`: of the model's file. */
int export_whole(const app *self, const char *path, lg_program *program, export_source *source);

/* ---- the model's name in C (name.c) ---- */

/* Why it cannot be the name, or NULL: not a C identifier, a word of C, C++ or the code, too long. */
const char *export_name_problem(const char *name);
/* One made from the file's name (without folder), to be freed; NULL when none can be. */
char *export_name_from(const char *file);

/* ---- files (files.c) ---- */

enum { EXPORT_FILES = 5 };
/* NAME.h, NAME.c, NAME_weights.c, NAME_test.c, Makefile; freed with free. */
char *export_file_name(const export_options *options, size_t file);
/* The five files in folder `out`: composed in memory, written to a temporary folder, renamed. A folder that
 * does not exist or is empty gets all or none; in another one these five are replaced one by one when all are
 * written, and only where they are free or begin with the line by which lg-export marks its files for this
 * name. A model of numbers that are not finite, or whose golden vectors are not, is refused. An exit code; a
 * sentence has been said on failure. */
int export_write(const app *self, const export_source *source, const char *out);

#endif
