/* Functions of a program as plain data, as files hold them. For code that stores, inspects or translates
 * programs.
 *
 * An operation is identified by its name and the revision of its meaning. liegrad/ops.h says what each one
 * computes; docs/files.md has names, attributes and formulas. Three operations are leaves without inputs:
 *   `input`      whole[0].base is the number of the input
 *   `parameter`  whole[0].base is the number of the parameter
 *   `constant`   element j is reals[j % real_count]
 * `call` takes the inputs of the earlier function number whole[0].base and gives its output whole[1].base.
 *
 * Nothing is lost: lg_program_add_image of an image makes an equal function.
 */
#ifndef LIEGRAD_PROGRAM_IMAGE_H
#define LIEGRAD_PROGRAM_IMAGE_H

#include "liegrad/program.h"

LG_BEGIN_DECLS

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

LG_END_DECLS

#endif
