/* C of operations: what a row of lg_ops says so that programs can be written as C (program_c.c).
 *
 * An operation has either `element`, an expression around which the writer makes the loop, or `write_c`,
 * which says for one evaluation what is called: functions of fragments, with whole numbers for sizes.
 *
 * Fragments are C99 and C++14 without warnings (-Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow
 * -pedantic), need libm alone, and follow these rules: functions static, no static variables but constant
 * tables; `real` is the type; numbers are REAL(0.5), with a point; mathematics by macros of the prelude (EXP,
 * SIN, SQRT, ...); sizes and indices int; RESTRICT for restrict; arrays of more than a few numbers in memory
 * that is handed over; no recursion, no function pointers. Each is written once, however many functions use
 * it. The letters NAME_ at the beginning of a word become the program's name and _.
 */
#ifndef LG_OP_C_H
#define LG_OP_C_H

#include "autodiff/ops/op.h"

/* C tokens as text. The writer breaks lines and indents. */
#define LG_C(...) #__VA_ARGS__

#define LG_C_NEEDS 4

typedef struct lg_c_fragment {
    const char *comment;                           /* above it; NULL: none */
    const char *text;                              /* LG_C(...), or NULL: `file` */
    const char *file[2];                           /* a file of code/ without its ending, for f64 and f32 */
    const struct lg_c_fragment *needs[LG_C_NEEDS]; /* what comes before it */
} lg_c_fragment;

/* The files of code/ as text; a row of NULL ends them. */
typedef struct lg_c_text {
    const char *name, *text;
} lg_c_text;
extern const lg_c_text lg_c_texts[];
/* `#error` for a name that is none. */
const char *lg_c_text_of(const char *name);

/* What several operations need. */
extern const lg_c_fragment lg_c_noinline;      /* NOINLINE */
extern const lg_c_fragment lg_c_dot;           /* dot(n, a, b) */
extern const lg_c_fragment lg_c_dense_add;     /* dense_add(in, out, w, x, y): y += x w */
extern const lg_c_fragment lg_c_first_maximum; /* first_maximum(n, apart, x) */
extern const lg_c_fragment lg_c_stumpff;       /* inverse_factorial, stumpff_row: c_k and their derivatives */
extern const lg_c_fragment lg_c_dexpinv;       /* dexpinv_coef: g2 and its derivatives */

/* The writer, as write_c sees it. Failures stick to it. */
typedef struct lg_c lg_c;

/* One statement that calls a function of `fragment` (NULL: of one that was there before). In the format, $0,
 * $1, ... stand for the inputs' memory, $y for the output's, $s for scratch (lg_c_scratch),
 * $i for the table of lg_c_indices. Sizes: %zu or %u; they are below 2^31. */
void lg_c_call(lg_c *c, const lg_c_fragment *fragment, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* How many numbers there are for $s, at most what lg_op.scratch says. */
void lg_c_scratch(lg_c *c, size_t count);
/* A table of whole numbers below 2^31, for $i. Equal tables are one. */
void lg_c_indices(lg_c *c, const uint32_t *values, size_t count);
/* Operation `op`, which has `element`, as a function of a number of elements: its name, for
 * NAME(n, in 0, ..., in k - 1, out), all of n elements. Inputs that are not read (lg_op.unread) are no
 * arguments, nor is input k where the output overwrites it: bit k of `over`. Valid until the next call. */
const char *lg_c_map(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs, uint64_t over);

#endif
