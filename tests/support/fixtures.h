/* Objects of the running test: it gives them back when it ends. */
#ifndef LG_FIXTURES_H
#define LG_FIXTURES_H

#include "test_support.h"

#include "liegrad/integrators.h"
#include "liegrad/ops.h"
#include "support/fail_alloc.h"

static inline void release_tape(void *tape) {
    lg_tape_destroy(tape);
}

static inline lg_tape *test_tape(lg_dtype dtype) {
    lg_tape_options options;
    lg_tape *tape = NULL;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    lg_test_owns(tape, release_tape);
    return tape;
}

static inline void release_stepper(void *stepper) {
    lg_stepper_destroy(NULL, stepper);
}

static inline lg_stepper *test_stepper(const lg_scheme *scheme, const lg_ode *ode) {
    lg_stepper *stepper = NULL;
    assert_ok(lg_stepper_create(NULL, scheme, ode, &stepper));
    lg_test_owns(stepper, release_stepper);
    return stepper;
}

/* Makes every allocation of `attempt` fail in turn: it returns LG_OUT_OF_MEMORY each time, nothing leaks, and at least
 * `least` have failed before it passes. It gives back all that it takes. */
static inline void every_allocation_fails(lg_status (*attempt)(const lg_context *context, void *user),
                                          void *user, long least) {
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    long failures = 0;
    assert_non_null(context);
    for (;; failures++) {
        lg_fail_alloc_arm(&memory, failures + 1);
        const lg_status status = attempt(context, user);
        assert_int_equal(lg_fail_alloc_live(&memory), 0);
        assert_status(status, lg_fail_alloc_hit(&memory) ? LG_OUT_OF_MEMORY : LG_OK);
        if (!lg_fail_alloc_hit(&memory)) break;
    }
    assert_true(failures >= least);
    lg_fail_alloc_arm(&memory, 0);
    lg_context_destroy(context);
}

#endif
