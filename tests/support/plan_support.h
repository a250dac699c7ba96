/* Plans of a program's functions with their work memory. The running test owns all of it. */
#ifndef LG_PLAN_SUPPORT_H
#define LG_PLAN_SUPPORT_H

#include "support/fixtures.h"

#include "liegrad/program.h"

typedef struct ready {
    lg_plan *plan;
    void *work;
    size_t bytes;
} ready;

RELEASES(release_plan, lg_plan_destroy)
RELEASES(release_program, lg_program_destroy)

/* A plan of the function `name`; inputs that are not finite make its results NaN. */
static inline ready make_ready(const lg_program *program, const char *name, size_t rows, lg_dtype dtype) {
    ready r;
    lg_plan_options options;
    size_t function;
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = dtype;
    options.mark_unfit = true;
    assert_ok(lg_program_find(program, name, &function, NULL));
    assert_told(lg_plan_create(program, function, &options, &r.plan, &told));
    lg_test_owns(r.plan, release_plan);
    r.bytes = lg_plan_work_size(r.plan);
    r.work = test_work(r.bytes);
    return r;
}

static inline void run_value(const void *of, const double *x, double *y) {
    const ready *r = of;
    lg_plan_eval(r->plan, (const void *const[]){x}, (void *const[]){y}, r->work);
}

/* Computes value and Jacobian; y may be NULL. */
static inline void run_gradient(const ready *r, const double *x, double *y, double *jacobian) {
    lg_plan_eval(r->plan, (const void *const[]){x}, (void *const[]){y, jacobian}, r->work);
}

/* Computes value and Jacobian in work memory full of NaN. The Jacobian must not write beyond its end (the
 * caller's array has one more number) and must be the same without the value; the value must agree with the
 * plan that computes only values. */
static inline void check_gradient(const ready *value, const ready *gradient, const double *x, double *y,
                                  double *jacobian) {
    const size_t outputs = lg_plan_output_count(gradient->plan, 0);
    const size_t count = lg_plan_output_count(gradient->plan, 1);
    double *again = TEST_ARRAY(double, count), *plain = TEST_ARRAY(double, outputs);
    jacobian[count] = 55.0;
    memset(gradient->work, 0xff, gradient->bytes);
    run_gradient(gradient, x, y, jacobian);
    assert_close(jacobian[count], 55.0, 0, 0);
    run_gradient(gradient, x, NULL, again);
    assert_memory_equal(jacobian, again, count * sizeof *again);
    memset(value->work, 0xff, value->bytes);
    run_value(value, x, plain);
    for (size_t o = 0; o < outputs; o++) assert_close(y[o], plain[o], 1e-14, 1e-14);
}

#endif
