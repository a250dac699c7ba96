/* The functions that bench/hard measures. Each computes numbers from the input numbers of a row of
 * cases.txt. */
#ifndef LG_BENCH_HARD_H
#define LG_BENCH_HARD_H

#include <stddef.h>

#include "liegrad/core.h"
#include "liegrad/tape.h"

/* How a recorded function is evaluated. */
typedef enum hard_way {
    HARD_TAPE,
    HARD_GRADIENT, /* gradient of the sum of its values, on the tape */
    HARD_PLAN,     /* plan, at a single row of n numbers */
    HARD_ROWS      /* plan, at n rows of one number each */
} hard_way;

/* One of three kinds. `measure` computes m numbers from n numbers. `record` records a function of a vector x
 * (1, n), which is evaluated as `way` says. `system` names a mechanical system, whose state after a run is
 * the result. */
typedef struct hard_function {
    const char *name; /* name in cases.txt */
    lg_status (*measure)(const double *in, size_t n, double *out, size_t m);
    lg_var (*record)(lg_tape *tape, lg_var x);
    hard_way way;
    lg_dtype dtype;
    const char *system, *form, *scheme;
    size_t links;
} hard_function;

/* The tables end with a row whose name is NULL. */
extern const hard_function hard_maths[], hard_motion[], hard_methods[];

/* Runs f->system. Inputs: t0; T; the tolerance, or minus the number of steps; all parameters; the start.
 * Outputs: the first m numbers of the state at t0 + T. */
lg_status hard_run(const hard_function *f, const double *in, double *out, size_t m);

#endif
