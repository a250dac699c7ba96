/* Closed loops for tests of certificates. */
#ifndef LG_CERTIFY_TEST_SUPPORT_H
#define LG_CERTIFY_TEST_SUPPORT_H

#include "autodiff/program_support.h"
#include "support/fixtures.h"

#include "liegrad/certify.h"
#include "liegrad/ops.h"

/* -limit <= x <= limit */
static inline lg_var saturated(lg_tape *tape, lg_var x, double limit) {
    const lg_var bound = lg_full(tape, lg_shape0(), -limit);
    return lg_max(tape, lg_neg(tape, lg_max(tape, lg_neg(tape, x), bound)), bound);
}

static inline lg_var column(lg_tape *tape, lg_var x, uint32_t i) {
    return lg_slice(tape, x, 1, i, 1);
}

RELEASES(release_certify, lg_certify_destroy)

static inline lg_certify *test_certify(const lg_certify_spec *spec) {
    lg_certify *certify = NULL;
    assert_told(lg_certify_create(NULL, spec, &certify, &told));
    lg_test_owns(certify, release_certify);
    return certify;
}

/* A program with the function `loop` of n states, and a function `v` unless it is NULL. */
static inline lg_program *loop_program(size_t n, lg_record_function loop, lg_record_function v, void *user) {
    const lg_port in = {.name = "x", .shape = lg_shape1((uint32_t)n)}, out = {.name = "y"};
    const lg_function_spec functions[2] = {{"loop", &in, 1, &out, 1, loop, user},
                                           {"v", &in, 1, &out, 1, v, user}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, v != NULL ? 2 : 1);
    return test_program(&spec);
}

static inline lg_certify_spec spec_for(const lg_program *program, const double *P, const double *low,
                                       const double *high) {
    lg_certify_spec spec;
    lg_certify_spec_init(&spec);
    spec.program = program;
    spec.rate = "loop";
    spec.P = P;
    spec.low = low;
    spec.high = high;
    return spec;
}

static inline lg_certify_result prove(const lg_certify_spec *spec, double seconds) {
    lg_certify_result result;
    assert_told(lg_certify_run(test_certify(spec), SIZE_MAX, seconds, &result, &told));
    print_message("%s\n  %s volume %.4g (%.3g of the box), %zu boxes, %.3f s\n", result.claim, result.reason,
                  result.volume, result.fraction, result.boxes, result.seconds);
    return result;
}

#endif
