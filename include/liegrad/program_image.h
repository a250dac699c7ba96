/* Functions of a program as plain data: what files hold, for those who store, inspect or translate programs.
 *
 * An operation is known by its name and the revision of its meaning. What each one computes: liegrad/ops.h;
 * names, attributes and formulas: docs/files.md. Three operations are leaves, which take nothing:
 *   `input`      whole[0].base is the number of the input
 *   `parameter`  whole[0].base is the number of the parameter
 *   `constant`   element j is reals[j % real_count]
 * `call` is output whole[1].base of the earlier function number whole[0].base, whose inputs it takes.
 *
 * Written and read without loss: lg_program_add_image of an image makes an equal function.
 */
#ifndef LIEGRAD_PROGRAM_IMAGE_H
#define LIEGRAD_PROGRAM_IMAGE_H

#include "liegrad/program.h"

LG_BEGIN_DECLS

/* base + rows B, B the number of rows of the batch. */
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
    lg_affine shape[LG_MAX_RANK]; /* of the output; beyond the rank 0 */
    lg_affine whole[LG_WHOLE_COUNT];
    double real;
    lg_affine reciprocal; /* not 0: instead of `real` stands 1/reciprocal */
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
    /* A loop instead, where times > 0: calls function `callee`, by its number in the program, so often.
     * carry[i]: the output that takes the place of input i after a call, LG_CARRY_NONE: none. No operations
     * then. */
    uint32_t times, callee;
    const uint32_t *carry; /* (input_count) */
} lg_function_image;
#define LG_CARRY_NONE UINT32_MAX

/* Memory is that of the context the program was made with; all but `operations` is borrowed from the program,
 * which must outlive the image. LG_NOT_FOUND: no such function; LG_OUT_OF_MEMORY. */
LG_API lg_status lg_function_image_create(const lg_program *program, size_t function,
                                          lg_function_image **out);
LG_API void lg_function_image_destroy(lg_function_image *image); /* NULL is fine */

/* Adds the function; everything is copied, and nothing in it is trusted: names, order, numbers of inputs,
 * shapes, attributes, payloads, numbers that are not finite. With lg_program_build of no functions, which
 * holds the parameters, it makes a program from plain data. Errors, with a sentence: LG_INVALID_ARGUMENT
 * (names), LG_SHAPE (ports), LG_FORMAT (operations), LG_VERSION (an operation of a later revision),
 * LG_NOT_FINITE, LG_OUT_OF_MEMORY. On failure the program is as before. */
LG_API lg_status lg_program_add_image(lg_program *program, const lg_function_image *image, lg_error *error);

LG_END_DECLS

#endif
