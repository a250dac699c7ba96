/* Programs: functions that were recorded once, with operations on a tape, and no longer need the tape.
 *
 * A program is a bundle of named functions on one set of parameters. Each function was recorded from C code
 * (lg_program_build) and can be
 *   - run without a tape, in the caller's memory (lg_plan): no allocation, no lock, any number of threads,
 *   - put on a tape again (lg_program_record): differentiated, trained on,
 *   - differentiated into further functions of the bundle (lg_program_derive),
 *   - saved and loaded (liegrad/io.h: files of kind `program`),
 *   - written as C99 (lg_program_write_c, the executable lg-export).
 *
 *   static lg_status value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
 *       *y = lg_mlp_record(tape, user, theta[0], 0, x[0]);
 *       return lg_tape_status(tape);
 *   }
 *
 * Rows. An input has one value for each row of a batch, (B, shape...) on the tape, or one value that all rows
 * share. A program serves every B >= 1: all numbers of rows in it are affine in B.
 *
 * The recording must not depend on the numbers in the inputs or parameters: no branch on a value, no value
 * read from the tape and put back. lg_program_build records eight times, at random points and three numbers
 * of rows. If the recordings differ, it refuses the function and names the difference. It cannot see a branch
 * that all these points take alike: ports should have the range of the data (lg_port.low, high).
 * Operations of the caller's own (lg_custom) cannot be in a program.
 */
#ifndef LIEGRAD_PROGRAM_H
#define LIEGRAD_PROGRAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

typedef struct lg_provenance lg_provenance;
typedef struct lg_read_options lg_read_options;

typedef struct lg_program lg_program;

/* An input or output of a function. */
typedef struct lg_port {
    const char *name; /* a C identifier, unique among the function's inputs and outputs */
    lg_shape shape;   /* of one row, without the batch axis: rank 0 to 3. Shared: of the whole, rank 0 to 4 */
    bool shared;      /* one value for all rows */
    const char *unit; /* NULL: unknown; at most 64 bytes, no control characters, \ " ? or comment marks */
    double low, high; /* inputs: the range in which recordings and checks draw random numbers, best that of
                         the data; 0, 0: -1 to 1 */
} lg_port;

/* The port's shape on a tape with `rows` rows: (rows, shape...), or the shape itself if it is shared. */
LG_API lg_shape lg_port_shape(const lg_port *port, size_t rows);

/* ---- building ---- */

/* Records the function: outputs from parameters and inputs, all variables of `tape` (of double precision).
 * Batched inputs have shape (B, port.shape...). A failure sticks to the tape or is returned. */
typedef lg_status (*lg_record_function)(void *user, lg_tape *tape, const lg_var *parameters,
                                        const lg_var *inputs, lg_var *outputs);

typedef struct lg_function_spec {
    const char *name; /* a C identifier, unique in the program */
    const lg_port *inputs;
    size_t input_count; /* at least 1 */
    const lg_port
        *outputs;        /* names and units; shape and `shared` are found by recording: (B, ...) is batched */
    size_t output_count; /* at least 1 */
    lg_record_function record;
    void *user;
} lg_function_spec;

/* To be used inside of a recording for lg_program_build: calls a function that the same program already has
 * and returns one of its outputs. The tape records the function's operations, as lg_program_record does. The
 * program keeps a call: its C, and plans with lg_plan_options.calls, contain the called function once,
 * however often it is called. Inputs: as many as the function has. Errors stick to the tape: LG_NOT_FOUND (no
 * such function or output so far, or no recording), those of lg_program_record. */
LG_API lg_var lg_program_call(lg_tape *tape, const char *function, size_t output, const lg_var *inputs);
/* Number of direct calls of `callee` in `function`. */
LG_API size_t lg_program_calls(const lg_program *program, size_t function, size_t callee);

/* A tensor of weights. */
typedef struct lg_parameter_spec {
    const char *name; /* a C identifier, unique in the program */
    lg_shape shape;
    const double *values; /* copied */
} lg_parameter_spec;

typedef struct lg_program_spec {
    size_t size; /* sizeof(lg_program_spec) */
    const lg_parameter_spec *parameters;
    size_t parameter_count; /* may be 0 */
    const lg_function_spec *functions;
    size_t function_count;   /* at least 1 */
    const char *description; /* a sentence or more, at most 4095 bytes; NULL: none */
} lg_program_spec;

LG_API void lg_program_spec_init(lg_program_spec *spec);
/* Errors, explained in `error` (may be NULL) with function, operation and scope: LG_INVALID_ARGUMENT (names,
 * shapes, no functions, nothing to record), LG_UNSUPPORTED (what was recorded differs from one recording to
 * another, an operation that lives in the process only), LG_OUT_OF_MEMORY, the tape's and those of `record`.
 * The context must outlive the program. */
LG_API lg_status lg_program_build(const lg_context *context, const lg_program_spec *spec, lg_program **out,
                                  lg_error *error);
/* Records one more function. Its recording may call all functions of the program (lg_program_call), also
 * loops and derivatives that were added after lg_program_build: a cost of a whole motion is a function that
 * calls a loop of steps. Errors as lg_program_build. On failure the program is as before. */
LG_API lg_status lg_program_add_function(lg_program *program, const lg_function_spec *function,
                                         lg_error *error);
LG_API void lg_program_destroy(lg_program *program); /* NULL is fine */

/* ---- contents ---- */

LG_API size_t lg_program_functions(const lg_program *program);
LG_API const char *lg_program_function_name(const lg_program *program, size_t function); /* NULL beyond */
LG_API lg_status lg_program_find(const lg_program *program, const char *name,
                                 size_t *function); /* LG_NOT_FOUND */
/* Ports of a function, borrowed; *count is set. NULL and 0 beyond. */
LG_API const lg_port *lg_program_inputs(const lg_program *program, size_t function, size_t *count);
LG_API const lg_port *lg_program_outputs(const lg_program *program, size_t function, size_t *count);
LG_API size_t lg_program_parameters(const lg_program *program);
/* Name, shape and values (borrowed) of parameter `index`; zeros beyond. */
LG_API lg_parameter_spec lg_program_parameter(const lg_program *program, size_t index);
/* New values, count(shape) of them. Plans made before keep the old ones. LG_NOT_FOUND: no such parameter;
 * LG_NOT_FINITE. */
LG_API lg_status lg_program_set_parameter(lg_program *program, size_t index, const double *values);
LG_API const char *lg_program_description(const lg_program *program); /* "" for none */
/* Operations in the function as it was recorded. */
LG_API size_t lg_program_operations(const lg_program *program, size_t function);

/* ---- on a tape ---- */

/* Records function number `function` on a tape of either type. `parameters`: lg_program_parameters variables
 * of their shapes, for training; NULL: the stored values, as constants. Inputs as at the recording, with
 * B rows. outputs: as many variables as the function has. Errors stick to the tape: LG_SHAPE,
 * LG_STALE_HANDLE, LG_NOT_FOUND (function), those of operations. On failure outputs are untouched. */
LG_API lg_status lg_program_record(lg_tape *tape, const lg_program *program, size_t function,
                                   const lg_var *parameters, const lg_var *inputs, lg_var *outputs);

/* ---- derivatives: further functions of the bundle ---- */

typedef enum lg_derivative_kind {
    LG_DERIVATIVE_FORWARD,            /* inputs, then fwd_<input> -> fwd_<output>: J times a direction */
    LG_DERIVATIVE_ADJOINT,            /* inputs, then adj_<output> -> adj_<input>: J^T times a cotangent */
    LG_DERIVATIVE_JACOBIAN,           /* inputs -> jac_<output>_<input> (count of output, count of input) */
    LG_DERIVATIVE_JACOBIAN_OF_ADJOINT /* inputs, then adj_<output> -> jac_adj_<input>_<by>, <by> an input or
                                         an adj_<output>: the Jacobian of the adjoint function */
} lg_derivative_kind;
#define LG_DERIVATIVE_KIND_COUNT 4

typedef struct lg_derivative {
    size_t size; /* sizeof(lg_derivative) */
    lg_derivative_kind kind;
    const char *function;
    const char *const *inputs; /* by which; NULL: all that are batched (adjoint: all) */
    size_t input_count;
    const char *const *outputs; /* of which; NULL: all that are batched (forward, adjoint: all) */
    size_t output_count;
    const char *name; /* of the new function; NULL: fwd1_<function>, adj1_<...>, jac_<...>, jac_adj1_<...> */
} lg_derivative;

LG_API void lg_derivative_init(lg_derivative *what);
/* Adds the derivative as a function. A Jacobian differentiates each row of the output by the same row of the
 * input. A trial finds rows that depend on other rows; they are refused. All directions are rows of one
 * batch, and lg_plan computes once what does not depend on the direction. Errors: LG_INVALID_ARGUMENT,
 * LG_NOT_FOUND (function, input or output), LG_UNSUPPORTED (a Jacobian by a shared input or of a shared
 * output), LG_NOT_DIFFERENTIABLE, LG_OUT_OF_MEMORY. On failure the program is as before. */
LG_API lg_status lg_program_derive(lg_program *program, const lg_derivative *what, lg_error *error);

/* Structural sparsity, whatever the parameters: pattern[a * n + b] = 1 where element a of one row of the
 * output may depend on element b of the same row of the input (n elements), else 0; `pattern` has
 * count(output) n bytes, shared ports count as a whole. Of a derived function, of its own outputs: J of
 * `value` is nonzero only where `value` itself depends, the Jacobian of `adj1_value` only where `adj1_value`
 * does. Errors: LG_NOT_FOUND (function, output, input), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_program_sparsity(const lg_program *program, size_t function, size_t output, size_t input,
                                     unsigned char *pattern, lg_error *error);

/* ---- loops ---- */

typedef struct lg_carry {
    const char *output, *input;
} lg_carry;

typedef struct lg_loop_spec {
    size_t size;          /* sizeof(lg_loop_spec) */
    const char *name;     /* of the new function */
    const char *function; /* that is called; it must not be a loop */
    size_t times;         /* 1 to 2^24 calls */
    /* After each call output carry[j].output becomes input carry[j].input, whose port is equal. The other
     * inputs stay the same. */
    const lg_carry *carry;
    size_t carry_count;
    /* Outputs whose values of all calls are wanted. Output X becomes the further output X_path of shape
     * (times, shape...), whose last entry equals X. */
    const char *const *path;
    size_t path_count;
} lg_loop_spec;

/* Adds a function that calls another function of the program again and again. It has the inputs and outputs
 * of the called function, then the paths. In plans and in C it is a loop; on a tape each call is recorded.
 * Errors: LG_INVALID_ARGUMENT (times, unequal ports, the called function is a loop), LG_NOT_FOUND (function,
 * input or output), LG_SHAPE (a path of too high a rank or too large), LG_OUT_OF_MEMORY. On failure the
 * program is as before. */
LG_API lg_status lg_program_add_loop(lg_program *program, const lg_loop_spec *loop, lg_error *error);

/* ---- running ---- */

/* A function prepared for a number of rows and a type. It has only the operations that the outputs need,
 * values that depend on parameters alone are computed in advance, equal subexpressions are computed once, and
 * memory is packed. Immutable: threads may share it, each with work memory of its own. It keeps nothing of
 * the program. */
typedef struct lg_plan lg_plan;

typedef struct lg_plan_options {
    size_t size;      /* sizeof(lg_plan_options) */
    size_t rows;      /* B >= 1; 1 */
    lg_dtype dtype;   /* LG_F64; LG_F32: parameters are rounded, everything is computed in single precision */
    bool mark_unfit;  /* true: a number of an input that is not finite makes all outputs NaN */
    bool compact;     /* true: small tensors too are computed in loops, not written out */
    bool packed;      /* true: less work memory, its tensors are not aligned to 64 bytes; slower */
    bool calls;       /* true: all calls share one plan of the called function; false: calls are inlined */
    size_t max_size;  /* of constants and of work memory; planning takes up to four times as much; 1 GiB.
                        * Beyond: LG_OUT_OF_MEMORY */
    double most_work; /* most operations on numbers in a run, and in computing constants; 1e13. Beyond:
                        * LG_UNSUPPORTED, with the number in the sentence */
} lg_plan_options;

LG_API void lg_plan_options_init(lg_plan_options *options);
/* `options` NULL: the defaults. Errors: LG_INVALID_ARGUMENT, LG_NOT_FOUND (function), LG_SHAPE (this number
 * of rows does not fit), LG_OUT_OF_MEMORY, LG_UNSUPPORTED (most_work). */
LG_API lg_status lg_plan_create(const lg_program *program, size_t function, const lg_plan_options *options,
                                lg_plan **out, lg_error *error);
LG_API void lg_plan_destroy(lg_plan *plan); /* NULL is fine */
/* Bytes, to be aligned to 64. */
LG_API size_t lg_plan_work_size(const lg_plan *plan);
/* Elements of an input or output for all rows; 0 beyond. */
LG_API size_t lg_plan_input_count(const lg_plan *plan, size_t input);
LG_API size_t lg_plan_output_count(const lg_plan *plan, size_t output);
/* inputs[i], outputs[j]: elements of the plan's type, row after row; outputs[j] NULL: not wanted. Outputs
 * overlap neither inputs nor work. Allocates nothing, takes no lock, cannot fail: a matrix that is not
 * positive definite makes its rows NaN. */
LG_API void lg_plan_eval(const lg_plan *plan, const void *const *inputs, void *const *outputs, void *work);

/* Plan and evaluation in one, for set-ups and tries: `function` for `rows` rows in double precision; arrays
 * as lg_plan_eval has them, one for each input and output. Allocates. Errors: LG_NOT_FOUND (function),
 * LG_INVALID_ARGUMENT (NULL), those of lg_plan_create. */
LG_API lg_status lg_program_eval(const lg_context *context, const lg_program *program, const char *function,
                                 size_t rows, const double *const *inputs, double *const *outputs,
                                 lg_error *error);

/* ---- C ---- */

/* Functions as source that is C99 and C++14, needs libm alone, allocates nothing and keeps no state: the
 * steps of a plan of one row, made in double precision. A file NAME.h has `sizes` and `declarations` (in
 * extern "C"); NAME.c begins with #include "NAME.h", then `arrays`, then `code`; NAME_weights.c has the same,
 * and `weights` instead of `code`. */
typedef struct lg_c_options {
    size_t size;              /* sizeof(lg_c_options) */
    const char *name;         /* a C identifier, with which all that is visible begins */
    lg_dtype dtype;           /* of the code; LG_F64 */
    const size_t *functions;  /* which, by number */
    size_t function_count;    /* 0: all */
    const char *const *names; /* of those functions in C, C identifiers; NULL, also one of them: its own */
    const bool *hidden; /* which of them are static and not declared, for code behind them; NULL: none */
    bool mark_unfit;    /* true (the default): as lg_plan_options has it */
    bool compact;       /* likewise, false: less code, slower where tensors are small */
} lg_c_options;
LG_API void lg_c_options_init(lg_c_options *options);

typedef struct lg_c_source {
    const lg_context *context;
    char *sizes; /* typedef ... NAME_real; #define NAME_<function>_WORK_SIZE, NAME_WORK_SIZE: the largest */
    /* void NAME_<function>(const NAME_real *<input>, ..., NAME_real *<output>, ..., NAME_real *work); for one
     * row. An output may be NULL: not wanted. work: numbers, any contents before, none of use after. Outputs
     * overlap neither inputs nor work. Names in capitals alone get a _. */
    char *declarations;
    char *arrays;     /* extern const ... NAME_weights[...]; "" where there are none */
    char *code;       /* prelude, functions of operations, functions of the program */
    char *weights;    /* what `arrays` declares: each number once, whichever functions read it */
    size_t functions; /* that are written */
    size_t *function, *work, *depth; /* by function: its number, numbers of work memory, and operations one
                                        after another at most, a sum of n terms as log2 n + 1 */
    size_t work_size, most_depth;    /* the largest */
    size_t stack_size;        /* bytes: bound on the frames of functions that call each other (gcc, clang,
                                        -O0 to -O3) */
    size_t stack_calls;       /* so many functions, or fewer, call each other */
    size_t numbers, integers; /* in the arrays */
    size_t lost; /* of LG_F32: numbers below 1.2e-38, not 0, that lose digits or become 0: a warning is due */
} lg_c_source;

/* Errors: LG_INVALID_ARGUMENT (options, a name that C or the code has already), LG_NOT_FOUND (a function),
 * LG_UNSUPPORTED (an operation without C, a tensor of 2^31 elements), LG_NOT_FINITE, LG_OUT_OF_MEMORY; those
 * of lg_plan_create. */
LG_API lg_status lg_program_write_c(const lg_program *program, const lg_c_options *options, lg_c_source **out,
                                    lg_error *error);
LG_API void lg_c_source_destroy(lg_c_source *source); /* NULL is fine */

/* ---- programs as plain data ----
 *
 * Functions of a program as plain data, as files hold them. For code that stores, inspects or translates
 * programs.
 *
 * An operation is identified by its name and the revision of its meaning. liegrad/ops.h says what each one
 * computes; docs/files.md has names, attributes and formulas. Three operations are leaves without inputs:
 *   `input`      whole[0].base is the number of the input
 *   `parameter`  whole[0].base is the number of the parameter
 *   `constant`   element j is reals[j % real_count]
 * `call` takes the inputs of the earlier function number whole[0].base and gives its output whole[1].base.
 *
 * Nothing is lost: lg_program_add_image of an image makes an equal function. */

/* The number base + rows B, where B is the number of rows of the batch. */
typedef struct lg_affine {
    int64_t base, rows;
} lg_affine;

#define LG_WHOLE_COUNT 4

typedef struct lg_operation {
    const char *name;
    uint32_t revision;      /* of the operation's meaning, from 1 on */
    const uint32_t *inputs; /* (input_count): operations before this one, by their place in the list */
    uint32_t input_count;
    uint32_t rank;
    lg_affine shape[LG_MAX_RANK]; /* of the output; 0 beyond the rank */
    lg_affine whole[LG_WHOLE_COUNT];
    double real;
    lg_affine reciprocal; /* not 0: 1/reciprocal is used instead of `real` */
    const double *reals;  /* (real_count): numbers of a constant, coefficients */
    uint32_t real_count;
    const uint32_t *indices; /* (index_count) */
    uint32_t index_count;
} lg_operation;

typedef struct lg_function_image {
    const char *name;
    const lg_port *inputs;
    size_t input_count;
    const lg_port *outputs;
    size_t output_count;
    lg_operation *operations;
    size_t operation_count;
    const uint32_t *results; /* (output_count): the operation of each output */
    /* times > 0: the function is a loop without operations. It calls function number `callee` of the program
     * `times` times. After a call output carry[i] becomes input i; LG_CARRY_NONE: input i stays. */
    uint32_t times, callee;
    const uint32_t *carry; /* (input_count) */
    /* The loop's last path_count outputs hold output path[k] of the callee from all calls,
     * (times, shape...). */
    const uint32_t *path;
    size_t path_count;
} lg_function_image;
#define LG_CARRY_NONE UINT32_MAX

/* The image borrows everything except `operations` from the program, which must outlive it. Memory comes from
 * the program's context. Errors: LG_NOT_FOUND (no such function), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_function_image_create(const lg_program *program, size_t function,
                                          lg_function_image **out);
LG_API void lg_function_image_destroy(lg_function_image *image); /* NULL is fine */

/* A program with parameters and a description, whose functions lg_program_add_image adds: `spec` has none.
 * Errors, with a sentence: the same as lg_program_build. */
LG_API lg_status lg_program_begin(const lg_context *context, const lg_program_spec *spec, lg_program **out,
                                  lg_error *error);

/* Copies the function into the program. Everything is checked: names, order, numbers of inputs, shapes,
 * attributes, payloads, finite numbers. Errors, with a sentence: LG_INVALID_ARGUMENT (names), LG_SHAPE
 * (ports), LG_FORMAT (operations), LG_VERSION (an operation of a later revision), LG_NOT_FINITE,
 * LG_OUT_OF_MEMORY. On failure the program is as before. */
LG_API lg_status lg_program_add_image(lg_program *program, const lg_function_image *image, lg_error *error);

/* ---- functions as bytes ----
 *
 * A function as the data set /functions/NAME of a file holds it; its name is not among the bytes.
 *
 *   whole     a number from 0 on: seven bits a byte, the lowest first; all bytes but the last have bit 8 set
 *   folded    a whole for a number that may be negative: 0, -1, 1, -2, ... are 0, 1, 2, 3, ...
 *   affine    whole 2 z + s, z the folded base; the folded rows follow if s is 1, else they are 0
 *   real      whole n, then n of the number's 8 bytes (IEEE 754, the lowest first): the lowest 8 - n are 0
 *   text      whole n <= 64, then n bytes. An empty unit is not known; names have letters, digits and _
 *   port      text name, text unit, whole 2 rank + shared, rank wholes (the shape), real low, real high
 *   operation whole k, whole m, fields. k counts the different operations, names with revisions, from 0 on;
 *             text name and whole revision follow a k that is new. Bit j of m: field j follows; fields that
 *             do not are 0 or empty:
 *               0 inputs: whole n, n wholes: how many operations back it lies, 1 for the one before
 *               1 shape: whole rank, rank affines      2 to 5 whole[0] to whole[3]: affines      6 real: real
 *               7 reals: whole n, n reals     8 indices: whole n, n wholes     9 reciprocal: affine
 *   function  whole 1 or 2 (the version), whole n, n ports (inputs), whole n, n ports (outputs), whole times.
 *             times 0: whole n, n operations, for each output a whole: its operation.
 *             Else a loop: whole callee, for each input a whole: its carry.
 *             Version 2, a loop with paths: then whole n, n wholes: path */

/* Writes the function to `bytes`, which has room for *size; *size becomes how many they are. NULL: only that.
 * Errors: LG_INVALID_ARGUMENT, with a sentence (no room; names, counts or numbers that cannot be). */
LG_API lg_status lg_function_pack(const lg_function_image *image, void *bytes, size_t *size, lg_error *error);

/* The image of `size` bytes, which may come from strangers; lg_program_add_image checks what it means. The
 * image owns its memory, at most *memory bytes; *memory is reduced by the bytes taken. The sentence of an
 * error has function, operation and field. Errors: LG_FORMAT (the bytes end too early or too late, more
 * numbers than they hold or *memory allows, bad texts), LG_VERSION, LG_OUT_OF_MEMORY. On failure *out and
 * *memory are untouched. */
LG_API lg_status lg_function_unpack(const lg_context *context, const char *name, const void *bytes,
                                    size_t size, size_t *memory, lg_function_image **out, lg_error *error);

/* ---- files of programs (library liegrad_io) ---- */

/* Kind "program": parameters, functions and operations as they were recorded, numbers to the last bit;
 * docs/files.md has the layout. A loaded program makes plans, derivatives and C with the same bits, and the
 * same bytes when it is saved again. `provenance` may be NULL. The program keeps the context. */
LG_API lg_status lg_program_save(const lg_context *context, const char *path, const lg_program *program,
                                 const lg_provenance *provenance, lg_error *error);
/* Loads the functions of a program or of a model. Checks everything as lg_program_add_image
 * (liegrad/program_image.h) does for memory: a program that loads is sound. All arrays together are within
 * options->max_size. LG_FORMAT also for unknown operations, LG_VERSION for operations of a later revision. */
LG_API lg_status lg_program_load(const lg_context *context, const char *path, const lg_read_options *options,
                                 lg_program **out, lg_error *error);

LG_END_DECLS

#endif
