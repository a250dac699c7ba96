/* Functions that bench/hard measures. Each computes numbers from the numbers of a row of cases.txt. */
#ifndef LG_BENCH_HARD_H
#define LG_BENCH_HARD_H

#include <stddef.h>

#include "liegrad/ops.h"
#include "liegrad/status.h"

/* How a recorded function is evaluated. */
typedef enum hard_way {
    HARD_TAPE,
    HARD_GRADIENT, /* of the sum of its values, on the tape */
    HARD_PLAN,     /* a row of n numbers */
    HARD_ROWS      /* n rows of one number */
} hard_way;

/* One of three: `measure` computes m numbers from n numbers; `record` is evaluated at a vector x (1, n), in
 * one of the ways; a run of `system` computes its state. */
typedef struct hard_function {
    const char *name; /* as in cases.txt */
    lg_status (*measure)(const double *in, size_t n, double *out, size_t m);
    lg_var (*record)(lg_tape *tape, lg_var x);
    hard_way way;
    lg_dtype dtype;
    const char *system, *form, *scheme;
    size_t links;
} hard_function;

/* Ended by a name NULL. */
extern const hard_function hard_maths[], hard_motion[], hard_methods[];

/* Inputs: t0; T; the tolerance, or minus the number of steps; all parameters; the start. Outputs:
 * the first m numbers of the state at t0 + T. */
lg_status hard_run(const hard_function *f, const double *in, double *out, size_t m);

#endif
