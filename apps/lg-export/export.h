/* lg-export: declarations that the files of this folder share.
 *
 * A model becomes five files. Code that is the same for every model of a kind stands in fragments: C files
 * below code/, which are built into the executable as text. Sizes, tables and weights differ from model to
 * model; the functions declared here write them.
 *
 *   NAME.h          inputs, outputs, units, order, provenance, error; sizes; prototypes
 *   NAME.c          constants and tables of this model, then the fragments that its kind needs
 *   NAME_weights.c  all arrays
 *   NAME_test.c     golden vectors and code/frame/test_main.c
 *   Makefile
 *
 * Fragments are C99 and C++14 without warnings (-Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow
 * -pedantic), need libm alone, and follow these rules:
 *   - All functions but the ones declared in NAME.h are static. There are no static variables.
 *   - The type of numbers is `real`; constants are written REAL(0.5), with a point. Sizes and indices are
 *     int.
 *   - Mathematics uses macros of the prelude (EXP, SIN, COS, SQRT, FABS, FLOOR, ATAN2, ...); RESTRICT means
 *     restrict.
 *   - Arrays live in `work`, except arrays of a few numbers.
 *   - No recursion and no function pointers; loops over tables instead of unrolled code.
 * NAME_ at the beginning of a word is replaced by the model's name and _. */
#ifndef LG_EXPORT_H
#define LG_EXPORT_H

#include "autodiff/program/program.h"
#include "common/app.h"
#include "liegrad/integrators.h"
#include "liegrad/program.h"

typedef lg_text text;

/* Ends the command if the call fails; the message names the model's file. `job` has `self` and `source`. */
#define EXPORT_MUST(job, call) APP_MUST_FILE((job)->self, (job)->source->options->file, call)

/* ---- options and sources ---- */

enum { EXPORT_UNITS = 256 };

/* The options of the command, and what follows from them and the model. */
typedef struct export_options {
    const char *out, *scheme_name; /* As they were given. */
    int target;
    const char *name;            /* A C identifier. */
    const char *file;            /* Name of the model's file, without its folder. */
    char sha256[LG_SHA256_TEXT]; /* SHA-256 of the model's file; "" if unknown. */
    lg_dtype dtype;              /* Type of the exported code's numbers. */
    /* Scheme of the exported step; NULL: the target takes the model's own scheme. Never NULL when the C of a
     * Hamiltonian's faces is written. */
    const lg_scheme *scheme;
    const char *functions;  /* Programs: names separated by commas; NULL: all functions. */
    bool compact;           /* Programs: loops instead of straight code. */
    lg_reals sensor, drift; /* Controllers: noise of an observer; empty: its defaults. */
    double forget;          /* Controllers: seconds in which an adaptation forgets. */
    uint64_t golden;        /* Number of golden vectors in the self-test, >= 1. */
    uint64_t seed;          /* Seed of the golden vectors' random inputs. */
    /* From the model's file; "" if it has none. */
    char input_units[EXPORT_UNITS], output_units[EXPORT_UNITS];
} export_options;

enum { EXPORT_MOST_FURTHER = 6 };

/* Golden vectors of the self-test. The inputs are rounded to the exported type (export_round). From these
 * inputs the library computes the outputs in double precision, with the stored parameters. */
typedef struct export_golden {
    size_t count;
    double *x;        /* (count, inputs) */
    double *y;        /* (count, outputs) */
    double *jacobian; /* (count, outputs, inputs); NULL if the model has no NAME_grad. */
    /* Further results, which a test_*.c below code/ computes from x one behind the other in `static void
     * extra(x, out, work)`. */
    struct {
        double *values; /* (count, size) */
        size_t size;
    } further[EXPORT_MOST_FURTHER];
    size_t furthers;
    const char *further_name; /* What the self-test calls them: "field and step". */
} export_golden;

/* A file that is going to be written. */
typedef struct export_file {
    char *name; /* File name without folder. */
    text content;
} export_file;
enum { EXPORT_MOST_FILES = 16 };

/* A function of a bundle that keeps a memory, its last input and its output. In C the memory stays in
 * place: a fragment of the function's name defines NAME_<function>, and calls the static
 * NAME_<function>_next. The golden vectors come from one run: each row of `inputs` is one
 * call, and the first call gets the memory `start`. */
typedef struct export_memory {
    const char *function;
    double *inputs; /* (rows, numbers of the other inputs) */
    double *start;  /* (numbers) */
    size_t rows, numbers;
    size_t work; /* Numbers of work of the fragment alone. */
} export_memory;
enum { EXPORT_MOST_RUNS = 2 };

/* The C of a model under construction. The texts hold finished C, in which the model's name is already
 * inserted. */
typedef struct export_source {
    const export_options *options;
    union {
        struct {
            /* Lines for the head of NAME.h: description, inputs, units, order, data, error. They have no
             * comment signs and may hold any bytes. */
            text about;
            text state, input; /* What the numbers of x and of u are, in words; may be empty. */
            /* One name for each number of x and of u, each followed by a newline; may be empty. */
            text places, inputs_each;
            text range; /* Lines about the range of the training data; may be empty. */
            text delay; /* "inputs act 2 rows of the log, ... later than they are logged"; may be empty. */
            text sizes; /* "#define NAME_LINKS 1" and others, for NAME.h. */
            text declarations; /* Prototypes with comments, besides NAME_eval and NAME_grad. */
            text arrays;       /* `extern` declarations of the arrays, for NAME.c. */
            text weights;      /* Definitions of the arrays, for NAME_weights.c. */
            text code;         /* Enumerations, tables and fragments, for NAME.c. */
            text test;         /* NAME_test.c has it before code/frame/test_main.c: `extra` and its tables. */
            /* Of a bundle: fragments that follow the bundle's code; more code of the self-test, and its row
             * of the table of functions. All may be empty. */
            text further_code, further_test, further_row;
            text products; /* What the Makefile builds besides the objects: names, each after a blank. */
            text rules;    /* Rules that build these products, for the end of the Makefile. */
        };
        text texts[18]; /* all of these; source.c checks their number */
    };
    size_t inputs, outputs;
    /* True for a program: its functions keep their own names, there is no NAME_eval or NAME_grad. All sizes
     * and golden vectors then stand in the texts `sizes` and `test`. */
    bool bundle;
    size_t functions;                    /* Number of functions of a bundle. */
    size_t further_size;                 /* The number of values in the output of further_row. */
    export_memory run[EXPORT_MOST_RUNS]; /* Of functions with a memory. */
    size_t runs;
    bool scene; /* The program was made from a scene, a text file. */
    bool maps;  /* The program's functions are maps from inputs to outputs: none is the rate of a state. */
    /* Stands between NAME_ and the names of the bundle's functions in C: "" or "c_". */
    const char *prefix;
    size_t work; /* NAME_WORK_SIZE: number of reals that is enough for every function. */
    /* NAME_STACK_SIZE in bytes: bound on the sum of the stack frames of functions that call each other, with
     * gcc and clang, -O0 to -O3. */
    size_t stack;
    size_t calls; /* Bound on the depth of calls; 0: `stack` bounds the sum of all frames. */
    /* Number of maps that are applied one after another; the stated tolerance is 20 eps depth condition. */
    size_t depth;
    /* 1, or the factor by which the model multiplies rounding errors; `about` explains the factor. */
    double condition;
    export_golden golden;
    size_t parameters;    /* Number of the model's parameters; 0: `numbers` is reported instead. */
    size_t numbers;       /* Number of reals in NAME_weights.c. */
    size_t integer_bytes; /* Size of the tables of integers in NAME_weights.c. */
    size_t lost;          /* How many numbers of the model are too small for the exported type. */
    /* First the initial state (`starts` numbers: a state at rest on the manifold, or the state of the scene),
     * then the initial values of the tunable parameters (`tunable` numbers, inputs that all rows share); or
     * NULL. */
    double *start;
    size_t starts, tunable;
    double step; /* Time between two points of the training data; 0: unknown. */
    double stop; /* End time of the scene; 0: unknown. */
    bool single; /* True: the target chose single precision by itself. */
    bool coarse; /* True: rounding may spoil a tenth of a result or more. */
    size_t file_count;
    export_file files[EXPORT_MOST_FILES];
} export_source;

/* The fragments: the text of <name>.c below code/, and of files with other endings, which are part of their
 * names. The table ends with a row of NULL. */
extern const lg_named_text export_fragments[];
/* Returns the text of a fragment, or a line with #error if there is no fragment of this name. */
const char *export_fragment_text(const char *name);

/* Add a fragment (<fragment>.c below code/) to source->code and to source->test. */
void export_code(export_source *source, const char *fragment);
void export_test_code(export_source *source, const char *fragment);
/* Add a constant: export_size a `#define NAME_<constant>` for NAME.h, export_constant an enumeration constant
 * for NAME.c, which is called <constant> without a prefix. */
void export_size(export_source *source, const char *constant, size_t value, const char *comment);
void export_constant(export_source *source, const char *constant, size_t value);
/* Add a real constant, `static const real constant = ...;`, and an array of numbers to a text. */
void export_real(const export_source *source, text *to, const char *constant, double value);
void export_reals(const export_source *source, text *to, const char *array, const double *values,
                  size_t count);
/* Adds the bytes of numbers to a text; `about` is marked if one of them does not fit the type or is lost. */
void export_raw(const export_options *options, text *to, text *about, const double *values, size_t count);
/* Rounds a number to the exported type and returns it as double. */
double export_round(const export_options *options, double value);
double export_eps(const export_options *options); /* Machine epsilon of the exported type. */
/* Euclidean norm of a - b (count numbers); b NULL: norm of a. */
double export_norm(const double *a, const double *b, size_t count);
/* No self-test accepts a larger error. export_bound_tolerance remembers in the source if one wanted to. */
#define EXPORT_MOST_TOLERANCE 0.1
double export_bound_tolerance(export_source *source, double tolerance);
/* Value of NAME_TOLERANCE: 20 eps depth condition, at most EXPORT_MOST_TOLERANCE. */
double export_tolerance(const export_source *source);
/* Reads input_units and output_units from the attributes of /model in the file; "" for a missing
 * attribute. */
void export_read_units(const app *self, const char *path, export_options *options);
/* Adds lines to `about`: the file's units, or `otherwise` if the file has none. */
void export_units(export_source *source, const char *otherwise);
/* Adds lines to `about`: command line, seed, CPU and version of the training, and the SHA-256 of its data
 * (NULL or "": unknown). */
void export_provenance(export_source *source, const lg_provenance *provenance, const char *sha256);
/* Adds the same lines for a file of any kind, without the SHA-256 of its data; nothing for a scene. */
void export_file_provenance(const app *self, export_source *source, const char *path);
/* Begins with empty texts and no files. */
void export_source_begin(export_source *source, const export_options *options);
void export_source_free(export_source *source);

/* ---- golden vectors (golden.c) ---- */

/* Allocates zeroed arrays for options->golden vectors; source->inputs and source->outputs must be set.
 * `jacobian`: there are Jacobians. */
void export_golden_make(export_source *source, bool jacobian);
/* Adds `size` further results to each golden vector, all 0, and returns them. The self-test
 * prints the last name that is not NULL. */
double *export_golden_further(export_source *source, size_t size, const char *name);
/* Returns the sum of the squares of `values`, computed in the exported type and in the order of the
 * self-test. Returns 0 for NULL. */
double export_squares(const export_options *options, const double *values, size_t count);
/* Returns whether all numbers are finite in the exported type, and also the squares of their norms, which the
 * self-test computes. */
bool export_golden_fits(const export_source *source);
/* The frame of NAME_test.c with `count` golden vectors: types and constants before the tables and the
 * functions that compute results; then the list of functions (rows) and what compares, in
 * code/frame/test_main.c. `largest`: number of results of the longest function. */
void export_test_begin(const export_source *source, size_t count, text *to);
void export_test_end(const export_source *source, const text *rows, size_t largest, text *to);
/* Writes the self-test of a model that is no bundle. */
void export_golden_write(const export_source *source, text *to);

/* ---- code that the library writes (bundle.c) ---- */

/* A function of a model's program, and its name in C. If the model has outputs, NAME_eval and NAME_grad are
 * the first two functions of a list; the head of NAME.h declares these two. */
typedef struct export_function {
    const char *function, *name;
    /* Outputs: reals of work memory that the function needs; operations one after another. */
    size_t work, depth;
    bool hidden; /* True: the function is static, for the fragments that follow it. */
} export_function;
/* Adds code, arrays, weights and declarations of the given functions, which the program must have, without
 * the first `skip` declarations. Returns the errors of lg_program_write_c. */
lg_status export_c(export_source *source, lg_program *program, export_function *functions, size_t count,
                   bool compact, int skip, lg_c_source **out, lg_error *error);
/* Adds the same, written with loops, without the declarations that NAME.h has. If a number does not fit the
 * exported type, export_write reports it later. */
void export_bundle(const app *self, export_source *source, lg_program *program, export_function *functions,
                   size_t count);
/* Rounds all parameters of the program to the exported type. */
lg_status export_round_parameters(export_source *source, lg_program *program);

/* ---- checks of moving models (motion.c, machine/machine_words.c) ---- */

/* Refuses a scheme that has no explicit step on the space: prints a message and returns APP_EXIT_USAGE. */
void export_check_scheme(const app *self, const lg_space *space, bool separable, const lg_scheme *scheme);
/* Warns if the model's inputs act later than they are logged. */
void export_warn_delay(const app *self, const export_source *source);

/* ---- the library's own results (program.c) ---- */

/* A plan of a function and its work memory. */
typedef struct export_evaluation {
    lg_plan *plan;
    void *work;
    const lg_port *in, *out;
    size_t ins, outs;
    lg_dtype dtype;
} export_evaluation;
/* `most`: lg_plan_options.most_work; 0: its default. Returns the errors of lg_program_find and
 * lg_plan_create. */
lg_status export_evaluation_open(const lg_program *program, const char *function, lg_dtype dtype, double most,
                                 export_evaluation *e, lg_error *error);
/* x holds all inputs one behind the other, y all outputs. */
void export_evaluate(const export_evaluation *e, const double *x, double *y);
void export_evaluation_close(export_evaluation *e);
/* Draws the numbers of a port within its range, or from -1 to 1 if it has none. Returns how many. */
size_t export_draw_port(const lg_port *port, lg_rng *rng, double *x);
/* Measures by how much a function of the program multiplies rounding errors: evaluates it in single precision
 * at `points` inputs and compares the results with double precision. x holds the inputs one behind the other,
 * as numbers of single precision. *out is the largest error over (eps of single precision times depth); it is
 * infinite or NaN where single precision cannot hold the results. */
lg_status export_amplification(const lg_program *program, const char *function, const double *x,
                               size_t points, size_t depth, double *out, lg_error *error);

/* ---- models that are exported without faces (golden vectors included) ---- */

/* A failure ends the command. The caller sets `source->options`. */
void export_classifier(const app *self, const char *path, export_source *source);
void export_program(const app *self, const char *path, export_source *source); /* or a scene */
/* A controller: `control` and what else --functions names, with a closed loop in the self-test
 * (policy/policy.c). export_policy_load describes it for every target, and returns its program. */
void export_policy(const app *self, const char *path, export_source *source);
lg_program *export_policy_load(const app *self, const char *path, export_source *source);
/* Names of functions of a program, each once; the program owns them. */
typedef struct export_names {
    const char *name[LG_PROGRAM_MAX_FUNCTIONS];
    size_t count;
} export_names;
/* Adds a function's name. False: the program has no such function. */
bool export_add_name(export_names *names, const lg_program *program, const char *function);
/* Exports functions of a program (NULL: all but those that training alone needs) under their own names, with
 * source->prefix before them. `path`: the model's file. */
void export_whole(const app *self, const char *path, lg_program *program, const export_names *functions,
                  export_source *source);

/* ---- targets: exports for other tools (one file each) ---- */

/* Warns that a file of an unknown kind is not a model, and says why (load.c). */
void export_warn_program(const app *self, const lg_error *why);
/* Loads a model of any kind as a program, and sets the initial state and the step of `source` (load.c). */
void export_load(const app *self, const char *path, const char *kind, export_source *source,
                 lg_program **out);
/* Loads a scene of lg-simulate as a program. `tunable`: the scene's parameters become inputs (scene.c). */
void export_load_scene(const app *self, const char *path, bool tunable, export_source *source,
                       lg_program **out);
/* Inputs and outputs of a function of a program; none if there is no such function. */
typedef struct export_ports {
    const lg_port *in, *out;
    size_t ins, outs;
} export_ports;
export_ports export_ports_of(const lg_program *program, const char *function);
size_t export_numbers(const lg_port *ports, size_t count); /* in all ports */
size_t export_parameters(const lg_program *program);       /* numbers in all parameters */
/* Whether a function is left out of exports because training alone needs it (lg_program_is_fitted) and the
 * program has other functions. */
bool export_trains_only(const lg_program *program, size_t function);
/* Finds the functions that a target exports: the names given with --functions; otherwise the names of `usual`
 * (ends with NULL) that the program has; if it has none of these, all functions but derivatives and those
 * that training alone needs. `usual` NULL: the target is C, and names are given. */
void export_choose(const app *self, const export_options *options, const lg_program *program,
                   const char *const *usual, export_names *out);
/* Returns the name of a derivative of a function. Adds the derivative if the program lacks it. Warns and
 * returns NULL if it cannot be made. */
const char *export_derive(const app *self, lg_program *program, lg_derivative_kind kind,
                          const char *function);

/* A target: a row, which stands in the target's own file. The list of all targets is in main.c. */
typedef struct export_target {
    /* Makes the files from the model's program. NULL (targets of plain C): the model's faces or functions are
     * written as C instead. */
    void (*build)(const app *self, const char *path, lg_program *program, export_source *source);
    void (*add)(export_source *source); /* Adds files besides the C files; may be NULL. */
    bool tunable;                       /* Parameters of a scene become inputs. */
    /* Why the target needs double precision ("an FMU computes"): --dtype f32 is refused with these words; or
     * NULL. */
    const char *wide;
} export_target;

/* ---- the model's name in C (name.c) ---- */

/* Returns why `name` is refused, or NULL if it is accepted. Refused are names that are not C identifiers, too
 * long, or words of C, C++ or the exported code. */
const char *export_name_problem(const char *name);
/* Makes a name from the file's name (without folder), to be freed; NULL if no valid name can be made. */
char *export_name_from(const char *file);

/* ---- files (files.c) ---- */

/* Adds a file. If its format (known by the ending) has comments, it begins with a comment that names
 * lg-export as its writer. Files of other formats must hold the words "lg-export: NAME" in their first 500
 * bytes. A %s in the name stands for the model's name. */
text *export_add_file(export_source *source, const char *name);
/* Add what the numbers of x and u are, and the delay of the inputs: export_tell_words as plain lines,
 * export_add_words as lines inside a comment. */
void export_tell_words(const export_source *source, text *to);
void export_add_words(const export_source *source, text *to);
/* Adds text for a Makefile: NAME_. and NAME_x become the model's name with . and _x, %NAME% becomes the
 * name. */
void export_add_named(const export_source *source, const char *lines, text *to);
/* Adds to the Makefile: products that `all` makes and `clean` removes, and the rules for them. NAME_. and
 * NAME_x become the model's name. Must be called before export_compose. */
void export_add_rules(export_source *source, const char *products, const char *rules);
/* Adds NAME.h, NAME.c, NAME_weights.c, NAME_test.c and the Makefile, made from the texts of `source`. */
void export_compose(export_source *source);
/* Writes the files to folder `out`: first to a temporary folder, then they are renamed. If `out` does not
 * exist or is empty, it gets all files or none. In any other folder the files are replaced one by one after
 * all of them are written. An existing file is replaced only if it holds the words by which lg-export marks
 * its files for this name. A model with numbers or golden vectors that are not finite is rejected. */
void export_write(const app *self, const export_source *source, const char *out);

#endif
