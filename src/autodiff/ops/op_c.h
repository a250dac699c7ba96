/* C code of operations: how a row of lg_ops states the C that programs are written as (program_c.c).
 *
 * An operation has either `element`, an expression that the writer puts into a loop, or `write_c`, which
 * states the function calls of one evaluation. The functions come from fragments; sizes are passed as whole
 * numbers.
 *
 * A fragment is a file in a folder code/ with the name of the function that it defines. A table in
 * program_c_text.c lists the fragments that it needs. It is valid C99 and C++14, compiles without warnings
 * (-Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow -pedantic) and needs only libm. Its functions and
 * constant tables are static, and it has no static variables. The number type is `real`; numbers are written
 * REAL(0.5), with a point; mathematical functions are the macros of the prelude (EXP, SIN, SQRT, ...); sizes
 * and indices are int; RESTRICT stands for restrict. Arrays of more than a few numbers are in memory that the
 * caller passes. There is no recursion and no function pointer. The writer prints each fragment once, however
 * many functions use it. NAME_ at the beginning of a word is replaced by the program's name and _. */
#ifndef LG_OP_C_H
#define LG_OP_C_H

#include "autodiff/ops/op.h"
#include "core/text.h"

/* All fragments: the files of ops/code/, program/code/ and kernels/code/, by their names without .c. A row of
 * NULL ends the list. */
extern const lg_named_text lg_c_texts[];

/* The writer of C, as write_c sees it. The first failure sticks to it. */
typedef struct lg_c lg_c;

/* Writes one statement, and the fragments whose functions it calls. In the format, $0, $1, ... stand for the
 * memory of the inputs, $y for the output, $s for scratch (lg_c_scratch), and $i for the table of
 * lg_c_indices. Sizes are printed with %zu or %u and must be below 2^31. */
void lg_c_call(lg_c *c, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Whether the output of the operation overwrites input k. */
bool lg_c_lies_over(const lg_c *c, uint32_t input);
/* Reserves `count` numbers of scratch memory for $s; at most as many as lg_op.scratch allows. */
void lg_c_scratch(lg_c *c, size_t count);
/* Adds a table of whole numbers below 2^31, for $i. Equal tables are written once. */
void lg_c_indices(lg_c *c, const uint32_t *values, size_t count);
/* Writes operation `op`, which must have `element`, as a C function over n elements and returns its name. Its
 * arguments are (n, in 0, ..., in k - 1, out), with n elements each. An input that is not read (lg_op.unread)
 * is left out of the arguments, and so is input k if the output overwrites it (bit k of `over`). The name is
 * valid until the next call. */
const char *lg_c_map(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs, uint64_t over);

#endif
