/* Records cases of the gradient check on tapes of the running test. */
#ifndef LG_ROW_SUPPORT_H
#define LG_ROW_SUPPORT_H

#include "support/fixtures.h"

#include "gradcheck/cases.h"
#include "autodiff/check/internal.h"

typedef struct row_on_tape {
    lg_var x[LG_GRADCHECK_MAX_INPUTS], d[LG_GRADCHECK_MAX_INPUTS], y; /* inputs, their directions, value */
} row_on_tape;

/* Records the case at its given point, or at a point drawn from its range. The same generator state gives the
 * same numbers on tapes of both types. */
static inline row_on_tape record_row(lg_tape *tape, lg_rng *rng, const lg_gradcheck_function *f) {
    row_on_tape r;
    for (uint32_t i = 0; i < f->inputs; i++) {
        const lg_gradcheck_argument *a = &f->arguments[i];
        const size_t count = lg_shape_count(a->shape);
        const bool plain = a->low == 0.0 && a->high == 0.0;
        double *x = TEST_ARRAY(double, count), *d = TEST_ARRAY(double, count);
        for (size_t j = 0; j < count; j++) {
            const double drawn = lg_rng_uniform_in(rng, plain ? -1.0 : a->low, plain ? 1.0 : a->high);
            x[j] = a->values != NULL ? a->values[j] : drawn;
            d[j] = lg_rng_uniform_in(rng, -1.0, 1.0);
        }
        r.x[i] = lg_input_f64(tape, a->shape, x);
        r.d[i] = lg_input_f64(tape, a->shape, d);
    }
    r.y = f->build(f->user, tape, r.x);
    if (lg_tape_status(tape) != LG_OK) fail_msg("%s: %s", f->name, lg_tape_message(tape));
    return r;
}

typedef void (*visit_fn)(const lg_tape *tape, const lg_node *node, const char *row);

/* Visits all nodes of all cases: of the value, of both derivatives and of the derivatives' derivatives. */
static inline void each_node(visit_fn visit) {
    const lg_gradcheck_case *row;
    lg_rng rng = test_rng(5, 1);
    for (size_t r = 0; (row = lg_gradcheck_operation(r)) != NULL; r++) {
        const lg_gradcheck_function *f = &row->function;
        lg_var back[LG_GRADCHECK_MAX_INPUTS], forward;
        lg_tape *tape = test_tape(LG_F64);
        const row_on_tape on = record_row(tape, &rng, f);
        assert_ok(lg_jvp(tape, &on.y, 1, on.x, on.d, f->inputs, &forward));
        assert_ok(lg_vjp(tape, &on.y, &forward, 1, on.x, f->inputs, back));
        if (!f->first_order_only) assert_ok(lg_vjp(tape, back, on.d, f->inputs, on.x, f->inputs, back));
        for (uint32_t i = 0; i < tape->count; i++) {
            const size_t mark = lg_test_owned();
            visit(tape, &tape->nodes[i], f->name);
            lg_test_give_back(mark);
        }
    }
}

#endif
