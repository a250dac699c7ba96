/* Internals of interval evaluation: scalar code of functions of one row, run on intervals. */
#ifndef LG_CERTIFY_INTERVAL_H
#define LG_CERTIFY_INTERVAL_H

#include "autodiff/program/program_call.h"
#include "autodiff/program/scalars.h"
#include "core/clean.h"
#include "core/portions.h"
#include "kernels/kernels.h"
#include "liegrad/interval.h"

LG_AT(lg_interval_destroy, lg_interval)

/* Scalar code on intervals: y = op(x[0], x[1], x[2]), where y must not be one of the x. n and p are the
 * operand of the operation that is no instruction. A register is LG_INTERVAL_BLOCK lower bounds, then as
 * many upper bounds. */
enum {
    LG_INTERVAL_BLOCK = 32,
    LG_INTERVAL_SCALE = LG_SCALAR_OPS /* y = p x */,
    LG_INTERVAL_SHIFT /* y = x + p */
};
typedef struct lg_interval_code {
    uint32_t op, n, y, x[3];
    double p;
} lg_interval_code;

/* Runs the code (interval_kernel.c). No bound of a register
 * may be NaN. flags: for each register LG_INTERVAL_BLOCK levels (lg_interval_flag), which say what holds on
 * all of the box; NULL: they are not needed. */
typedef void lg_interval_run(size_t count, const lg_interval_code *code, double *registers, uint8_t *flags);
lg_interval_run *lg_interval_kernel(lg_isa isa); /* NULL: this machine has not the instruction set */

/* Fails unless the calling thread rounds to nearest, as all bounds need. */
lg_status lg_interval_nearest(lg_error *error);

/* What the operation makes of bounds and levels of its operands. `alike`: equal operands are one number. */
typedef struct lg_interval_value {
    double low, high;
    uint8_t level;
} lg_interval_value;
lg_interval_value lg_interval_one(const lg_scalar_code *code, bool alike, const lg_interval_value operand[3]);

/* The scalar code of several functions with the same inputs. Inputs of the code are the elements of the
 * functions' inputs, in order. */
typedef struct lg_expansion {
    lg_scalars s; /* exact */
    lg_heap heap;
    lg_scalar *result; /* the elements of all outputs of all functions */
    size_t inputs, results;
} lg_expansion;

/* The level_of of exact code. */
uint8_t lg_interval_level(const lg_scalars *s, const lg_scalar_code *c);
/* On failure too, lg_expansion_destroy must be called. */
lg_status lg_expand(const lg_program *program, const size_t *functions, size_t count, lg_expansion *out,
                    lg_error *error);
void lg_expansion_destroy(lg_expansion *expansion);

/* interval_taylor.c: replaces the result, the rate of the first `states` inputs, by Taylor coefficients. */
lg_status lg_expansion_taylor(lg_expansion *expansion, size_t states, const lg_interval_taylor_spec *what,
                              lg_error *error);

/* For each element of all outputs: 1 (even in all inputs together), -1 (odd) or 0 (neither is known). */
lg_status lg_expansion_parity(lg_expansion *expansion, int8_t *parity);

/* rounding.c: lg_interval_rounding for each result. */
lg_status lg_expansion_rounding(lg_expansion *expansion, const double *low, const double *high, double unit,
                                double *bound);

struct lg_interval {
    const lg_context *context;
    lg_interval_run *run;
    size_t inputs, outputs, functions;
    /* Registers: constants, then inputs, then results of instructions, which are used again. */
    size_t constants, registers;
    double *constant; /* (constants, 2) */
    uint8_t *constant_flag;
    lg_interval_code *code;
    size_t count;
    uint32_t *stored; /* for each output: its register */
    int8_t *parity;   /* for each output */
};

/* Bounds for each box, (boxes, width) */
typedef struct lg_bounds {
    double *low, *high;
    size_t width;
} lg_bounds;
static inline lg_bounds lg_bounds_take(lg_portions *from, size_t boxes, size_t width) {
    double *low = lg_portion(from, boxes * width, sizeof *low);
    return (lg_bounds){low, lg_portion(from, boxes * width, sizeof *low), width};
}
/* lg_interval_eval with inputs and outputs in parts, one after the other; outputs behind the last part are
 * not stored. Where a number of an input has no finite bounds, it counts as 0, and its box becomes
 * `unbounded`. */
void lg_interval_bound(const lg_interval *f, size_t boxes, const lg_bounds *const *in, size_t ins,
                       const lg_bounds *const *out, size_t outs, uint8_t *flags, bool *unbounded, void *work);
#define LG_INTERVAL_BOUND(f, boxes, in, out, ...)                                                            \
    lg_interval_bound(f, boxes, in, LG_COUNT(in), out, LG_COUNT(out), __VA_ARGS__)

/* interval_code.c: chooses instructions and registers. */
lg_status lg_interval_choose(const lg_expansion *expansion, bool widen, lg_interval *out);

#endif
