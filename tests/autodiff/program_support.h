/* Programs that the running test owns. */
#ifndef LG_PROGRAM_SUPPORT_H
#define LG_PROGRAM_SUPPORT_H

#include "support/fixtures.h"

#include "liegrad/program.h"

/* RECORDING(name) { ... } defines a recording: it computes `y` on the tape from `theta` and `x`, with
 * `user`. */
#define RECORDING(name)                                                                                      \
    static void name##_on_tape(void *, lg_tape *, const lg_var *, const lg_var *, lg_var *);                 \
    static lg_status name(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {      \
        name##_on_tape(user, tape, theta, x, y);                                                             \
        return lg_tape_status(tape);                                                                         \
    }                                                                                                        \
    static void name##_on_tape(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y)

RELEASES(release_program, lg_program_destroy)

static inline lg_program_spec spec_of(const lg_parameter_spec *parameters, size_t parameter_count,
                                      const lg_function_spec *functions, size_t function_count) {
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = parameter_count;
    spec.functions = functions;
    spec.function_count = function_count;
    return spec;
}

static inline lg_program *test_program(const lg_program_spec *spec) {
    lg_program *program = NULL;
    assert_told(lg_program_build(NULL, spec, &program, &told));
    lg_test_owns(program, release_program);
    return program;
}

/* Adds the derivative and returns its function number. */
static inline size_t derived(lg_program *program, lg_derivative_kind kind, const char *function) {
    lg_derivative what;
    lg_error error;
    lg_derivative_init(&what);
    what.kind = kind;
    what.function = function;
    if (lg_program_derive(program, &what, &error) != LG_OK) fail_msg("%s: %s", function, error.message);
    return lg_program_functions(program) - 1;
}

#endif
