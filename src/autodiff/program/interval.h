/* Internals of interval evaluation: scalar code of functions of one row, run on intervals. */
#ifndef LG_PROGRAM_INTERVAL_H
#define LG_PROGRAM_INTERVAL_H

#include "autodiff/program/program_call.h"
#include "autodiff/program/scalars.h"
#include "liegrad/interval.h"

/* The scalar code of several functions with the same inputs. Inputs of the code are the elements of the
 * functions' inputs, in order. */
typedef struct lg_expansion {
    lg_scalars s; /* exact */
    lg_heap heap;
    lg_scalar *result; /* the elements of all outputs of all functions */
    size_t inputs, results;
} lg_expansion;

/* On failure too, lg_expansion_destroy must be called. */
lg_status lg_expand(const lg_program *program, const size_t *functions, size_t count, lg_expansion *out,
                    lg_error *error);
void lg_expansion_destroy(lg_expansion *expansion);

/* interval_taylor.c: replaces the result, the rate of the first `states` inputs, by Taylor coefficients. */
lg_status lg_expansion_taylor(lg_expansion *expansion, size_t states, const lg_interval_taylor_spec *what,
                              lg_error *error);

/* For each element of all outputs: 1 (even in all inputs together), -1 (odd) or 0 (neither is known). */
lg_status lg_expansion_parity(lg_expansion *expansion, int8_t *parity);

struct lg_interval {
    const lg_context *context;
    const lg_kernels *k;
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

/* interval_code.c: chooses instructions and registers. */
lg_status lg_interval_choose(const lg_expansion *expansion, bool widen, lg_interval *out);

#endif
