/* Programs: functions that were recorded once on a tape and then work without it. Library liegrad; files (the
 * last section) are in liegrad_io. docs/models.md is the guide.
 *
 * A program is a bundle of named functions that share one set of parameters (named tensors of doubles). Each
 * function was recorded from C code that uses operations on a tape (lg_program_build). A function can be
 *   - run without a tape, in the caller's memory (lg_plan): no allocation, no lock, any number of threads,
 *   - put on a tape again, to differentiate it or to train its parameters (lg_program_record),
 *   - differentiated into further functions of the program (lg_program_derive),
 *   - saved and loaded (lg_program_save, files of kind `program`),
 *   - written as C99 (lg_program_write_c, the executable lg-export).
 *
 * A function that computes an MLP whose parameters are theta[0]:
 *
 *   static lg_status value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
 *       *y = lg_mlp_record(tape, user, theta[0], 0, x[0]);
 *       return lg_tape_status(tape);
 *   }
 *
 * Rows. Inputs and outputs of a function are called ports. A port is either batched or shared. A batched port
 * has one value per row of a batch of B rows; on a tape its shape is (B, shape...). A shared port has one
 * value that all rows use. A program works for every B >= 1, because every dimension in it is a number of the
 * form base + rows B.
 *
 * What can be recorded. The sequence of operations must not depend on the numbers in inputs or parameters: no
 * C `if` on a value, no value that is read from the tape and put back as a constant. lg_program_build records
 * each function eight times, at random points and with three different numbers of rows. If the recordings
 * differ, it refuses the function and names the difference. It cannot notice a branch that goes the same way
 * at all these points; so each input should state the range of the real data (lg_port.low, high). Operations
 * of the caller (lg_custom) cannot be part of a program.
 *
 * Threads. A program may be read by several threads at once, but not while one of them changes it. The
 * context must outlive the program. Strings and arrays that a function returns are borrowed from the program,
 * unless its comment says otherwise. Functions, ports and parameters are numbered from 0.
 */
#ifndef LIEGRAD_PROGRAM_H
#define LIEGRAD_PROGRAM_H

#include "liegrad/tape.h"

LG_BEGIN_DECLS

typedef struct lg_provenance lg_provenance;
typedef struct lg_read_options lg_read_options;

typedef struct lg_program lg_program;

/* A port: an input or output of a function. */
typedef struct lg_port {
    const char *name; /* a C identifier, unique among the function's inputs and outputs */
    lg_shape shape;   /* batched: of one row, without the batch axis, rank 0 to 3; shared: rank 0 to 4 */
    bool shared;      /* false: batched, one value per row; true: one value that all rows use */
    const char *unit; /* NULL: unknown; at most 64 bytes, no control characters, \ " ? or comment marks */
    /* Range of an input: recordings and checks draw random numbers from it. It should be the range of the
     * data. 0 and 0 mean -1 to 1. Not used for outputs. */
    double low, high;
} lg_port;

/* Returns the shape that the port has on a tape with `rows` rows: (rows, shape...) if it is batched, else
 * `shape`. */
LG_API lg_shape lg_port_shape(const lg_port *port, size_t rows);

/* ---- building ---- */

/* The C code of a function: records the outputs, computed from parameters and inputs. `tape` is of double
 * precision. `parameters` and `inputs` are variables on it; batched inputs have shape (B, port.shape...).
 * Returns LG_OK, or a status for a failure that the tape does not know. */
typedef lg_status (*lg_record_function)(void *user, lg_tape *tape, const lg_var *parameters,
                                        const lg_var *inputs, lg_var *outputs);

typedef struct lg_function_spec {
    const char *name; /* a C identifier, unique in the program */
    const lg_port *inputs;
    size_t input_count; /* at least 1 */
    /* Only names and units are read. The recordings show the shape of an output, and whether it is batched:
     * its first axis is then B. */
    const lg_port *outputs;
    size_t output_count; /* at least 1 */
    lg_record_function record;
    void *user; /* passed to `record` */
} lg_function_spec;

/* Calls another function of the same program, and returns its output number `output`. It may only be used
 * inside of lg_function_spec.record, while lg_program_build or lg_program_add_function runs. The called
 * function must stand before this one in the program. `inputs` has as many variables as that function has
 * inputs. On the tape the operations of the called function are recorded, as by lg_program_record. The
 * program, however, stores a call: in C, and in plans with lg_plan_options.calls, the code of the called
 * function exists only once, however often it is called. Errors are kept by the tape: LG_NOT_FOUND (no
 * such function or output so far, or no function of a program is being recorded), the errors of
 * lg_program_record. */
LG_API lg_var lg_program_call(lg_tape *tape, const char *function, size_t output, const lg_var *inputs);
/* Returns how many calls of the function number `callee` stand in the function number `function`; calls
 * inside of called functions are not counted. */
LG_API size_t lg_program_calls(const lg_program *program, size_t function, size_t callee);

/* A parameter of a program: a named tensor. */
typedef struct lg_parameter_spec {
    const char *name; /* a C identifier, unique in the program */
    lg_shape shape;
    /* Copied; NULL: zeros. lg_program_fit starts there, so a function with sqrt needs other values. */
    const double *values;
} lg_parameter_spec;

typedef struct lg_program_spec {
    size_t size; /* sizeof(lg_program_spec) */
    const lg_parameter_spec *parameters;
    size_t parameter_count; /* may be 0 */
    const lg_function_spec *functions;
    size_t function_count;   /* at least 1 */
    const char *description; /* one or more sentences, at most 4095 bytes; NULL: none */
} lg_program_spec;

LG_API void lg_program_spec_init(lg_program_spec *spec);
/* Records all functions of `spec` and makes a program of them. `spec` is not kept. Errors, with the function,
 * the operation and the scope in `error`: LG_INVALID_ARGUMENT (bad names or ports, no functions, an output
 * that was not recorded), LG_SHAPE (an input is too large or its rank too high), LG_NOT_FINITE (a parameter
 * or a constant), LG_UNSUPPORTED (the recordings differ, or an operation of the caller was used), the status
 * of the tape or of `record`. */
LG_API lg_status lg_program_build(const lg_context *context, const lg_program_spec *spec, lg_program **out,
                                  lg_error *error);
/* Records one more function and adds it to the program. Its recording may call all functions that the program
 * already has (lg_program_call), also loops and derivatives that were added after lg_program_build: the cost
 * of a whole motion is a function that calls a loop of steps. Errors: those of lg_program_build. On failure
 * the program is unchanged. */
LG_API lg_status lg_program_add_function(lg_program *program, const lg_function_spec *function,
                                         lg_error *error);
LG_API void lg_program_destroy(lg_program *program);

/* ---- contents ---- */

LG_API size_t lg_program_functions(const lg_program *program); /* number of functions */
/* Returns the name of a function; NULL for a number that is too large. */
LG_API const char *lg_program_function_name(const lg_program *program, size_t function);
/* Gives the number of the function with this name. Errors: LG_NOT_FOUND (no such function; the message names
 * the functions of the program). */
LG_API lg_status lg_program_find(const lg_program *program, const char *name, size_t *function,
                                 lg_error *error);
/* Whether the function is marked as one that training alone needs, such as a loss. lg_program_fit
 * (liegrad/fit.h) marks the function that it made small, and files keep the mark. lg-export leaves marked
 * functions out, unless --functions names them. Reading returns false for NULL and for a number that is too
 * large. Error of setting: LG_INVALID_ARGUMENT (the number is too large). */
LG_API bool lg_program_is_fitted(const lg_program *program, size_t function);
LG_API lg_status lg_program_set_fitted(lg_program *program, size_t function, bool fitted);
/* Return the ports of a function and set *count to their number; NULL and 0 for a number that is too
 * large. */
LG_API const lg_port *lg_program_inputs(const lg_program *program, size_t function, size_t *count);
LG_API const lg_port *lg_program_outputs(const lg_program *program, size_t function, size_t *count);
LG_API size_t lg_program_parameters(const lg_program *program); /* number of parameters */
/* Returns name, shape and values of a parameter; a struct of zeros for a number that is too large. */
LG_API lg_parameter_spec lg_program_parameter(const lg_program *program, size_t index);
/* Replaces the values of a parameter; `values` has lg_shape_count(shape) numbers, which are copied. Plans
 * that were made before keep the old values. Errors: LG_NOT_FOUND (no such parameter), LG_NOT_FINITE. */
LG_API lg_status lg_program_set_parameter(lg_program *program, size_t index, const double *values);
LG_API const char *lg_program_description(const lg_program *program); /* "" if there is none */
/* The largest number of operations of a function. */
#define LG_PROGRAM_MAX_NODES (1u << 20)
/* Returns the number of operations of a function as it was recorded, before lg_plan_create simplifies it. */
LG_API size_t lg_program_operations(const lg_program *program, size_t function);

/* ---- on a tape ---- */

/* Records the operations of a function on a tape of either type. `parameters` has lg_program_parameters
 * variables of the parameters' shapes, for example variables that are trained; NULL: the stored values are
 * recorded as constants. `inputs` has one variable per input, with the shapes of lg_port_shape for a common
 * number of rows B. `outputs` gets one variable per output. Errors are kept by the tape and returned; then
 * `outputs` is unchanged: LG_SHAPE, LG_STALE_HANDLE, LG_NOT_FOUND (no such function), the errors of the
 * operations. */
LG_API lg_status lg_program_record(lg_tape *tape, const lg_program *program, size_t function,
                                   const lg_var *parameters, const lg_var *inputs, lg_var *outputs);

/* ---- derivatives: further functions of the program ---- */

/* What the new function computes. It has the inputs of the given function, followed by the inputs named here,
 * and the outputs named here (but not the outputs of the given function). J is the Jacobian of the chosen
 * outputs by the chosen inputs. Directions and tangents of a port, and its cotangents, have the shape of the
 * port. <input> and <output> stand for names of chosen inputs and outputs. */
typedef enum lg_derivative_kind {
    /* J times a direction: further inputs fwd_<input> (the direction), outputs fwd_<output>. */
    LG_DERIVATIVE_FORWARD,
    /* J^T times a cotangent: further inputs adj_<output> (the cotangent), outputs adj_<input>. */
    LG_DERIVATIVE_ADJOINT,
    /* J itself: outputs jac_<output>_<input>, of shape (count of output, count of input) per row. */
    LG_DERIVATIVE_JACOBIAN,
    /* The Jacobian of the function of LG_DERIVATIVE_ADJOINT: further inputs adj_<output>, outputs
     * jac_adj_<input>_<by>, where <by> is a chosen input or an adj_<output>. */
    LG_DERIVATIVE_JACOBIAN_OF_ADJOINT
} lg_derivative_kind;
#define LG_DERIVATIVE_KIND_COUNT 4

typedef struct lg_derivative {
    size_t size; /* sizeof(lg_derivative) */
    lg_derivative_kind kind;
    const char *function; /* name of the function to differentiate */
    /* Names of the inputs to differentiate by. NULL: all inputs; for the two kinds of Jacobians all batched
     * inputs. */
    const char *const *inputs;
    size_t input_count;
    /* Names of the outputs to differentiate. NULL: all outputs; for the two kinds of Jacobians all batched
     * outputs. */
    const char *const *outputs;
    size_t output_count;
    const char *name; /* of the new function; NULL: fwd1_, adj1_, jac_ or jac_adj1_ and the function's name */
} lg_derivative;

LG_API void lg_derivative_init(lg_derivative *what);
/* Adds the derivative to the program, as a new function. A Jacobian is of each row of the outputs by the same
 * row of the inputs. So an output row must not depend on other rows of the inputs: this is tried at random
 * points, and refused if it does. The Jacobian's columns (or rows) are computed as additional rows of one
 * batch, and lg_plan_create makes sure that what they have in common is computed only once. On failure the
 * program is unchanged. Errors: LG_INVALID_ARGUMENT (bad struct or name, nothing to differentiate, too many
 * ports), LG_NOT_FOUND (no such function, input or output), LG_UNSUPPORTED (a Jacobian by a shared input or
 * of a shared output, or rows depend on other rows), LG_NOT_DIFFERENTIABLE. */
LG_API lg_status lg_program_derive(lg_program *program, const lg_derivative *what, lg_error *error);

/* Finds out which elements of an output depend on which elements of an input, whatever the values of the
 * parameters are. pattern[a * n + b] = 1 if element a of one row of the output may depend on element b of the
 * same row of the input, else 0; n is the number of elements of the input's row. `pattern` has n bytes per
 * element of the output. A shared port counts as one row. Note that a derived function has its own pattern:
 * an entry of the Jacobian of `value` can only be nonzero where the pattern of `value` is 1, and an entry of
 * the Jacobian of `adj1_value` only where the pattern of `adj1_value` is 1. Every entry of a loop's pattern
 * is 1. Errors: LG_NOT_FOUND (no such function, output or input). */
LG_API lg_status lg_program_sparsity(const lg_program *program, size_t function, size_t output, size_t input,
                                     unsigned char *pattern, lg_error *error);

/* ---- loops ---- */

/* Output `output` of one call becomes input `input` of the next call. */
typedef struct lg_carry {
    const char *output, *input;
} lg_carry;

typedef struct lg_loop_spec {
    size_t size;          /* sizeof(lg_loop_spec) */
    const char *name;     /* of the new function */
    const char *function; /* the function that is called; it must not be a loop itself */
    size_t times;         /* number of calls, 1 to 2^24 */
    /* After each call, output carry[j].output becomes input carry[j].input, for j = 0..carry_count-1. The two
     * ports must have equal shapes and be both batched or both shared. The other inputs stay the same in all
     * calls. */
    const lg_carry *carry;
    size_t carry_count;
    /* Names of outputs whose values are wanted from all calls. For an output X of this list the loop has one
     * more output, X_path, of shape (times, shape of X...). Its last entry equals X. */
    const char *const *path;
    size_t path_count;
} lg_loop_spec;

/* Adds a function that calls another function of the program `times` times, one call after the other. It has
 * the inputs and outputs of the called function, then one output per path; the outputs are those of the last
 * call. In a plan and in C it is a loop; on a tape every call is recorded. On failure the program is
 * unchanged. Errors: LG_INVALID_ARGUMENT (`times` out of range, the ports do not fit, an input is carried
 * twice, or the called function is a loop), LG_NOT_FOUND (no such function, input or output), LG_SHAPE (a
 * path has more than three axes besides the batch axis, or is too large). */
LG_API lg_status lg_program_add_loop(lg_program *program, const lg_loop_spec *loop, lg_error *error);

/* ---- running ---- */

/* A plan is a function that was prepared for a fixed number of rows and a type. It contains only the
 * operations that the outputs need; values that depend on parameters alone are computed in advance, equal
 * subexpressions are computed once, and the work memory is packed. A plan does not change after its creation,
 * so several threads may use it at once, each with its own work memory. It copies what it needs, so the
 * program may be destroyed before the plan. */
typedef struct lg_plan lg_plan;

typedef struct lg_plan_options {
    size_t size;     /* sizeof(lg_plan_options) */
    size_t rows;     /* B, the number of rows, >= 1; default 1 */
    lg_dtype dtype;  /* default LG_F64; LG_F32: rounds the parameters and computes in single precision */
    bool mark_unfit; /* true: if any number of an input is not finite, all outputs become NaN */
    bool compact;    /* true: loops also for small tensors, instead of one instruction per element */
    bool packed;     /* true: less work memory, but tensors in it are not aligned to 64 bytes; slower */
    bool calls;      /* true: all calls of a function share one plan of it; false: calls are inlined */
    /* Limit in bytes on the constants, and on the work memory; beyond it LG_OUT_OF_MEMORY. lg_plan_create
     * itself needs up to four times as much. Default 1 GiB. */
    size_t max_size;
    /* Limit on the number of operations on numbers in one evaluation, and for computing the constants; beyond
     * it LG_UNSUPPORTED, with the number in the message. Default 1e13. */
    double most_work;
} lg_plan_options;

LG_API void lg_plan_options_init(lg_plan_options *options);
/* Makes a plan of a function. `options` NULL means the defaults. The program's context must outlive the plan.
 * Errors: LG_INVALID_ARGUMENT (options), LG_NOT_FOUND (no such function), LG_SHAPE (the function does not
 * work with this number of rows), LG_UNSUPPORTED (most_work). */
LG_API lg_status lg_plan_create(const lg_program *program, size_t function, const lg_plan_options *options,
                                lg_plan **out, lg_error *error);
LG_API void lg_plan_destroy(lg_plan *plan);
/* Returns the size in bytes of the work memory for lg_plan_eval. It must be aligned to 64 bytes. */
LG_API size_t lg_plan_work_size(const lg_plan *plan);
/* Return the number of elements of an input or output, for all rows; 0 for a number that is too large. */
LG_API size_t lg_plan_input_count(const lg_plan *plan, size_t input);
LG_API size_t lg_plan_output_count(const lg_plan *plan, size_t output);
/* Evaluates the function. inputs[i] and outputs[j] are arrays of the plan's type, row after row. outputs[j]
 * may be NULL if this output is not wanted. Outputs must not overlap inputs or `work`. It allocates nothing,
 * takes no lock and cannot fail. If a matrix of lg_spd_solve is not positive definite, the results of its row
 * are NaN. */
LG_API void lg_plan_eval(const lg_plan *plan, const void *const *inputs, void *const *outputs, void *work);

/* Makes a plan of a function for `rows` rows in double precision, evaluates it and destroys it: convenient
 * for single evaluations. `inputs` and `outputs` have one array per port, as in lg_plan_eval. Errors:
 * LG_NOT_FOUND (no such function), the errors of lg_plan_create. */
LG_API lg_status lg_program_eval(const lg_context *context, const lg_program *program, const char *function,
                                 size_t rows, const double *const *inputs, double *const *outputs,
                                 lg_error *error);

/* ---- C ---- */

/* Writes functions as source code that is both C99 and C++14. The code needs only libm, allocates nothing and
 * keeps no state. It has the steps of a plan of one row, which is made in double precision even if the code
 * is in single precision.
 *
 * The texts that lg_program_write_c makes are meant for three files. NAME.h has `sizes`, then `declarations`
 * in extern "C". NAME.c has #include "NAME.h", then `arrays`, then `code`. NAME_weights.c has #include
 * "NAME.h", then `arrays`, then `weights`. */
typedef struct lg_c_options {
    size_t size;             /* sizeof(lg_c_options) */
    const char *name;        /* NAME: a C identifier; all visible names of the code begin with it */
    lg_dtype dtype;          /* type of the numbers in the code; default LG_F64 */
    const size_t *functions; /* numbers of the functions to write */
    size_t function_count;   /* 0: all functions are written */
    /* The next two are only read if function_count > 0. names: the names of the functions in C; NULL, or an
     * entry NULL: the name in the program. hidden: true for a function that becomes static and is not
     * declared in `declarations`, for use by code behind `code` in the same file; NULL: none. */
    const char *const *names;
    const bool *hidden;
    bool mark_unfit; /* as in lg_plan_options; default true */
    bool compact;    /* as in lg_plan_options; default false. true: less code, but slower for small tensors */
} lg_c_options;
LG_API void lg_c_options_init(lg_c_options *options);

/* The texts, which end with a null byte, and what a caller must know about the code. */
typedef struct lg_c_source {
    const lg_context *context;
    /* The type NAME_real, and macros NAME_<function>_WORK_SIZE (numbers of work memory of a function) and
     * NAME_WORK_SIZE (the largest of them). */
    char *sizes;
    /* For each function: void NAME_<function>(const NAME_real *<input>, ..., NAME_real *<output>, ...,
     * NAME_real *work). It computes one row. An output may be NULL if it is not wanted. `work` has
     * NAME_<function>_WORK_SIZE numbers; their values do not matter before the call or after it. Outputs must
     * not overlap inputs or `work`. The name of a C parameter is the port's name; it gets a trailing _ if it
     * has no lower-case letter, is "work" or begins with NAME_. */
    char *declarations;
    char *arrays;  /* declarations of arrays: extern const ... NAME_weights[...]; "" if there are none */
    char *code;    /* macros, functions of operations, and the functions of the program */
    char *weights; /* definitions of these arrays; a number that several functions read stands there once */
    size_t functions; /* number of functions that were written; length of the next three arrays */
    /* Per written function: its number in the program; its numbers of work memory; and the length of its
     * longest chain of dependent operations, where a sum of n terms counts as log2 n + 1 operations. */
    size_t *function, *work, *depth;
    size_t work_size, most_depth; /* largest entry of `work` and of `depth` */
    size_t stack_size;  /* upper bound in bytes on the stack that a call needs (gcc and clang, -O0 to -O3) */
    size_t stack_calls; /* upper bound on the depth of nested function calls */
    size_t numbers, integers; /* elements of the arrays of numbers and of integers */
    /* For LG_F32: how many numbers other than 0 are below 1.2e-38 in magnitude, so that they lose digits or
     * become 0. The user should be warned if there are any. */
    size_t lost;
} lg_c_source;

/* Writes functions of a program as C. `options` must not be NULL. Errors: LG_INVALID_ARGUMENT (options, or a
 * name that is a word of C or is used by the code itself), LG_NOT_FOUND (no such function), LG_UNSUPPORTED
 * (an operation that cannot be written in C, or a tensor with 2^31 elements or more), LG_NOT_FINITE (a
 * constant is not finite in the type of the code), the errors of lg_plan_create. */
LG_API lg_status lg_program_write_c(const lg_program *program, const lg_c_options *options, lg_c_source **out,
                                    lg_error *error);
LG_API void lg_c_source_destroy(lg_c_source *source);

/* ---- programs as plain data ----
 *
 * An image is a function as plain data, in the form in which files hold it. It is meant for code that stores,
 * inspects or translates programs.
 *
 * An operation is identified by its name and by a revision, which increases when the meaning of the operation
 * changes. liegrad/ops.h says what each operation computes; docs/files.md ("Programs") lists names,
 * attributes and formulas, also of `input`, `parameter`, `constant` and `call`.
 *
 * An image holds everything: lg_program_add_image makes an equal function from it. */

/* A number that depends on the number of rows B: base + rows B. */
typedef struct lg_affine {
    int64_t base, rows;
} lg_affine;

#define LG_WHOLE_COUNT 4

typedef struct lg_operation {
    const char *name;
    uint32_t revision;      /* at least 1 */
    const uint32_t *inputs; /* (input_count): places of earlier operations in lg_function_image.operations */
    uint32_t input_count;
    uint32_t rank;
    lg_affine shape[LG_MAX_RANK]; /* of the output; unused axes are 0 */
    /* Attributes of the operation: whole numbers and one real number. Their meaning depends on the
     * operation. */
    lg_affine whole[LG_WHOLE_COUNT];
    double real;
    lg_affine reciprocal; /* if not 0, the real attribute is 1/reciprocal (for a mean over the batch) */
    const double *reals;  /* (real_count): the numbers of a constant, or the coefficients of an operation */
    uint32_t real_count;
    const uint32_t *indices; /* (index_count): the indices of a gather or scatter */
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
    const uint32_t *results; /* (output_count): for each output, the place of its operation */
    /* If times > 0, the function is a loop and has no operations: it calls function number `callee` of the
     * program `times` times. After each call, output carry[i] becomes input i; if carry[i] is LG_CARRY_NONE,
     * input i stays the same. */
    uint32_t times, callee;
    const uint32_t *carry; /* (input_count) */
    /* The loop's last path_count outputs hold output path[k] of the callee from all calls,
     * (times, shape...). */
    const uint32_t *path;
    size_t path_count;
} lg_function_image;
#define LG_CARRY_NONE UINT32_MAX

/* Makes the image of a function. The image owns the array `operations`; everything else is borrowed from the
 * program, which must outlive the image. Errors: LG_NOT_FOUND (no such function). */
LG_API lg_status lg_function_image_create(const lg_program *program, size_t function,
                                          lg_function_image **out);
LG_API void lg_function_image_destroy(lg_function_image *image);

/* Makes a program that has parameters and a description, but no functions: these are added by
 * lg_program_add_image. spec->function_count must be 0. Errors: LG_INVALID_ARGUMENT, LG_NOT_FINITE (a
 * parameter). */
LG_API lg_status lg_program_begin(const lg_context *context, const lg_program_spec *spec, lg_program **out,
                                  lg_error *error);

/* Adds a copy of the function to the program. Everything is checked: names, the order of operations, numbers
 * of inputs, shapes, attributes, coefficients and indices, and that numbers are finite. On failure the
 * program is unchanged. Errors: LG_INVALID_ARGUMENT (names or numbers of ports), LG_SHAPE (ports), LG_FORMAT
 * (operations), LG_VERSION (a revision that this library does not know yet), LG_NOT_FINITE. */
LG_API lg_status lg_program_add_image(lg_program *program, const lg_function_image *image, lg_error *error);

/* ---- functions as bytes ----
 *
 * The bytes of a function, as they stand in the data set /functions/NAME of a file; docs/files.md
 * ("Programs") has the format. NAME is not among the bytes. */

/* Writes the bytes of a function to `bytes`, which has room for *size bytes. *size becomes the number of
 * bytes written. If `bytes` is NULL, nothing is written and *size becomes the number of bytes needed. Errors:
 * LG_INVALID_ARGUMENT (not enough room, or names, counts or numbers that the format cannot hold). */
LG_API lg_status lg_function_pack(const lg_function_image *image, void *bytes, size_t *size, lg_error *error);

/* Makes an image from `size` bytes. The bytes may come from an untrusted source. Only the format is checked
 * here; lg_program_add_image checks the meaning. The image owns all its memory: at most *memory bytes, and
 * *memory is reduced by the bytes that it takes. The message of an error names function, operation and field.
 * On failure *out and *memory are unchanged. Errors: LG_FORMAT (too few or too many bytes, counts that are
 * larger than the bytes or *memory allow, bad texts), LG_VERSION. */
LG_API lg_status lg_function_unpack(const lg_context *context, const char *name, const void *bytes,
                                    size_t size, size_t *memory, lg_function_image **out, lg_error *error);

/* ---- files of programs (library liegrad_io) ---- */

/* Saves a program as a file of kind "program": parameters, and functions with the operations as they were
 * recorded. No bit of a number is lost. docs/files.md describes the layout. A program that is loaded from the
 * file makes plans, derivatives and C code that are equal to the last bit, and the same file when it is saved
 * again. `provenance` (liegrad/files.h) may be NULL. */
LG_API lg_status lg_program_save(const lg_context *context, const char *path, const lg_program *program,
                                 const lg_provenance *provenance, lg_error *error);
/* Loads the program from a file of kind "program", or the program that is part of a model file. The context
 * must outlive the program. Everything is checked as by lg_program_add_image, so a program that loads can be
 * used without further checks. All arrays together must fit into options->max_size (liegrad/files.h);
 * `options` NULL means the defaults. Errors: LG_NOT_FOUND or LG_FILE (the file), LG_FORMAT (also an unknown
 * operation), LG_VERSION (also an operation of a later revision). */
LG_API lg_status lg_program_load(const lg_context *context, const char *path, const lg_read_options *options,
                                 lg_program **out, lg_error *error);

LG_END_DECLS

#endif
