/* C code of operations: how a row of lg_ops states the C that programs are written as (program_c.c).
 *
 * An operation has either `element`, an expression that the writer puts into a loop, or `write_c`, which
 * states the function calls of one evaluation. The functions come from fragments; sizes are passed as whole
 * numbers.
 *
 * A fragment is C99 and C++14 that compiles without warnings (-Wall -Wextra -Wconversion -Wdouble-promotion
 * -Wshadow -pedantic) and needs only libm. Its functions are static. It has no static variables except
 * constant tables. The number type is `real`; numbers are written REAL(0.5), with a point; mathematical
 * functions are the macros of the prelude (EXP, SIN, SQRT, ...); sizes and indices are int; RESTRICT stands
 * for restrict. Arrays of more than a few numbers are in memory that the caller passes. There is no recursion
 * and no function pointer. The writer prints each fragment once, however many functions use it. NAME_ at the
 * beginning of a word is replaced by the program's name and an underscore. */
#ifndef LG_OP_C_H
#define LG_OP_C_H

#include "autodiff/ops/op.h"

/* C tokens as a string. The writer adds line breaks and indentation. */
#define LG_C(...) #__VA_ARGS__

#define LG_C_NEEDS 4

typedef struct lg_c_fragment {
    const char *comment; /* printed above the code; NULL: no comment */
    const char *text;    /* LG_C(...); NULL: the code is in `file` */
    /* Names of files in program/code/ or kernels/code/, without .c, for f64 and f32. */
    const char *file[2];
    const struct lg_c_fragment *needs[LG_C_NEEDS]; /* fragments that must be printed before this one */
} lg_c_fragment;

/* The files of the folders code/ as strings; a row of NULL ends the list. */
typedef struct lg_c_text {
    const char *name, *text;
} lg_c_text;
extern const lg_c_text lg_c_texts[];
/* Returns an `#error` line for an unknown name. */
const char *lg_c_text_of(const char *name);

/* Fragments that several operations need; the comments list what they define. */
extern const lg_c_fragment lg_c_dot;           /* dot(n, a, b) */
extern const lg_c_fragment lg_c_dense_add;     /* dense_add(in, out, w, x, y): y += x w */
extern const lg_c_fragment lg_c_first_maximum; /* first_maximum(n, apart, x): index of the largest number */
extern const lg_c_fragment lg_c_stumpff;       /* inverse_factorial, stumpff_row: c_k and derivatives */
extern const lg_c_fragment lg_c_dexpinv;       /* dexpinv_coef: g_2 of lg_so3_dexpinv and its derivatives */

/* The writer of C, as write_c sees it. The first failure sticks to it. */
typedef struct lg_c lg_c;

/* Writes one statement that calls a function of `fragment` (NULL: of a fragment that an earlier call named).
 * In the format, $0, $1, ... stand for the memory of the inputs, $y for the output, $s for scratch
 * (lg_c_scratch), and $i for the table of lg_c_indices. Sizes are printed with %zu or %u and must be below
 * 2^31. */
void lg_c_call(lg_c *c, const lg_c_fragment *fragment, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
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
