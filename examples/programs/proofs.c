/* Bounds and proofs: a program's values over a box, and a certificate of an attitude controller. */
#include "programs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <liegrad/certify.h>
#include <liegrad/interval.h>
#include <liegrad/ops.h>

/* y = sin(a) b + b^2 */
static lg_status product(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var a = lg_slice(tape, x[0], 1, 0, 1), b = lg_slice(tape, x[0], 1, 1, 1);
    (void)user, (void)theta;
    y[0] = lg_add(tape, lg_mul(tape, lg_sin(tape, a), b), lg_square(tape, b));
    return lg_tape_status(tape);
}

static lg_status build(lg_program **out, lg_error *error) {
    const lg_port in = {.name = "x", .shape = lg_shape1(2)}, result = {.name = "y"};
    const lg_function_spec function = {"product", &in, 1, &result, 1, product, NULL};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.functions = &function, spec.function_count = 1;
    return lg_program_build(NULL, &spec, out, error);
}

/* Bounds over 1 <= a <= 1.1, 2 <= b <= 2.1; constants may be decimals that were rounded (widen). */
static lg_status bound(const lg_program *program, lg_error *error) {
    const double low[2] = {1.0, 2.0}, high[2] = {1.1, 2.1};
    const size_t first = 0;
    double from = 0, to = 0;
    lg_interval_options options;
    lg_interval *f;
    lg_interval_options_init(&options);
    options.widen = true;
    lg_status status = lg_interval_create(program, &first, 1, &options, &f, error);
    if (status != LG_OK) return status;
    void *work = aligned_alloc(64, (lg_interval_work_size(f) + 63) / 64 * 64);
    status =
        work != NULL ? lg_interval_eval(f, 1, low, high, &from, &to, NULL, work, error) : LG_OUT_OF_MEMORY;
    (void)printf("proofs: %zu numbers, %zu operations on intervals: %.6g <= y <= %.6g\n",
                 lg_interval_inputs(f), lg_interval_operations(f), from, to);
    if (status == LG_OK && !(from <= sin(1.0) * 2.0 + 4.0 && sin(1.1) * 2.1 + 4.41 <= to))
        status = LG_CHECK_FAILED;
    free(work);
    lg_interval_destroy(f);
    return status;
}

int proofs(void) {
    static const double A[9] = {1, 0, 0, 0, 1.5, 0, 0, 0, 2};
    lg_certify_attitude_result attitude = {.verified = false};
    lg_program *program = NULL;
    lg_error error = {LG_OK, ""};
    lg_status status = build(&program, &error);
    if (status == LG_OK) status = bound(program, &error);
    if (status == LG_OK) status = lg_certify_attitude(A, 0.1, &attitude, &error);
    if (status == LG_OK) (void)printf("  %s\n", attitude.claim);
    if (status != LG_OK) (void)fprintf(stderr, "proofs: %s\n", error.message);
    lg_program_destroy(program);
    return status == LG_OK && attitude.verified;
}
