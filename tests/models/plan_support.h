/* Functions of a program made ready, with work memory of their own. */
#ifndef LG_PLAN_SUPPORT_H
#define LG_PLAN_SUPPORT_H

#include "test_support.h"

#include "liegrad/program.h"

typedef struct ready {
    lg_plan *plan;
    void *work;
    size_t bytes;
} ready;

/* Function `name` that marks what is not finite. Its work holds NaN, and a piece behind it that must stay as
 * it is. */
static inline void make_ready(ready *r, const lg_program *program, const char *name, size_t rows,
                              lg_dtype dtype) {
    lg_plan_options options;
    lg_error error;
    size_t function;
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = dtype;
    options.mark_unfit = true;
    assert_ok(lg_program_find(program, name, &function));
    if (lg_plan_create(program, function, &options, &r->plan, &error) != LG_OK) fail_msg("%s", error.message);
    r->bytes = lg_plan_work_size(r->plan);
    assert_int_equal(posix_memalign(&r->work, 64, r->bytes + 64), 0);
    memset(r->work, 0xff, r->bytes + 64);
}

static inline void free_ready(ready *r) {
    for (size_t i = 0; i < 64; i++) assert_int_equal(((unsigned char *)r->work)[r->bytes + i], 0xff);
    free(r->work);
    lg_plan_destroy(r->plan);
}

static inline void run_value(const ready *r, const double *x, double *y) {
    lg_plan_eval(r->plan, (const void *const[]){x}, (void *const[]){y}, r->work);
}

/* y may be NULL. */
static inline void run_gradient(const ready *r, const double *x, double *y, double *jacobian) {
    lg_plan_eval(r->plan, (const void *const[]){x}, (void *const[]){y, jacobian}, r->work);
}

#endif
