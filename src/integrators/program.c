/* Steps and velocities as functions of a program. They call functions of the same program. */
#include <math.h>

#include "autodiff/program/program.h"
#include "core/core.h"
#include "integrators/taped_internal.h"
#include "liegrad/program.h"

typedef struct recording {
    const lg_space *space;
    const lg_scheme *scheme;
    size_t inputs;  /* number of inputs of the field: x, u or x only */
    bool separable; /* the program has force and drift */
} recording;

static lg_status call_field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                            lg_var *algebra) {
    const recording *r = user;
    const lg_var in[2] = {lg_taped_join(tape, r->space, y), input};
    return lg_taped_split_algebra(tape, r->space, lg_program_call(tape, "field", 0, in), algebra);
}

static lg_status call_force(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input, lg_var *out) {
    const lg_var in[2] = {q, input};
    *out = lg_program_call(tape, "force", 0, in);
    return lg_tape_status(tape);
}

static lg_status call_drift(void *user, lg_tape *tape, lg_taped_time t, lg_var p, lg_var input, lg_var *out) {
    *out = lg_program_call(tape, "drift", 0, &p);
    return lg_tape_status(tape);
}

static lg_status step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    const lg_taped_ode ode = {.space = *r->space,
                              .field = call_field,
                              .force = r->separable ? call_force : NULL,
                              .velocity = r->separable ? call_drift : NULL,
                              .user = user};
    const lg_taped_interval over = {.h_rows = x[r->inputs], .input = r->inputs > 1 ? x[1] : LG_NONE};
    lg_var parts[LG_TAPED_MAX_PARTS];
    LG_TRY(lg_taped_split(tape, r->space, x[0], parts));
    LG_TRY(lg_taped_step(tape, r->scheme, &ode, &over, parts, parts));
    y[0] = lg_taped_join(tape, r->space, parts);
    return lg_tape_status(tape);
}

lg_status lg_program_put_step(lg_program *program, double h_low, double h_high, lg_record_function record,
                              void *user, lg_error *error) {
    size_t field, count;
    LG_TRY(lg_program_find(program, "field", &field, error));
    const lg_port *of_field = lg_program_inputs(program, field, &count),
                  h = {.name = "h", .shape = lg_shape1(1), .low = h_low, .high = h_high},
                  next = {.name = "next"}, in[3] = {of_field[0], count > 1 ? of_field[1] : h, h};
    const lg_function_spec spec = {"step", in, count + 1, &next, 1, record, user};
    return lg_program_add_function(program, &spec, error);
}

lg_status lg_program_add_step(lg_program *program, const lg_space *space, const lg_scheme *scheme,
                              double h_low, double h_high, lg_error *error) {
    size_t field, other, count;
    LG_NEEDS(error, program, space);
    if (scheme == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the scheme is NULL, which lg_scheme_find returns for a name that it does not know");
    if (!isfinite(h_low) || !isfinite(h_high) || h_low > h_high)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "step sizes from %g to %g: expected finite numbers, low <= high", h_low, h_high);
    LG_TRY(lg_program_find(program, "field", &field, error));
    const lg_port *of_field = lg_program_inputs(program, field, &count);
    if (count > 2 || of_field[0].shared || lg_shape_count(of_field[0].shape) != space->dim)
        return lg_fail(
            error, LG_SHAPE,
            "'field' must have the inputs x, with the %zu numbers of a state, and at most one more: "
            "the input of the step",
            space->dim);
    recording r = {.space = space,
                   .scheme = scheme,
                   .inputs = count,
                   .separable = lg_program_find(program, "force", &other, NULL) == LG_OK &&
                                lg_program_find(program, "drift", &other, NULL) == LG_OK};
    return lg_program_put_step(program, h_low, h_high, step, &r, error);
}

static lg_status velocity(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_space *space = user;
    lg_var state[LG_TAPED_MAX_PARTS], algebra[LG_TAPED_MAX_PARTS], rate[LG_TAPED_MAX_PARTS];
    LG_TRY(lg_taped_split(tape, space, x[0], state));
    LG_TRY(lg_taped_split_algebra(tape, space, lg_program_call(tape, "field", 0, x), algebra));
    LG_TRY(lg_taped_generator(tape, space, algebra, state, rate));
    y[0] = lg_taped_join(tape, space, rate);
    return lg_tape_status(tape);
}

lg_status lg_program_add_velocity(lg_program *program, const lg_space *space, lg_error *error) {
    size_t at, count;
    const lg_port out = {.name = "f"};
    if (lg_program_find(program, "jac_velocity", &at, NULL) == LG_OK) return LG_OK;
    if (lg_program_find(program, "velocity", &at, NULL) != LG_OK) {
        LG_TRY(lg_program_find(program, "field", &at, error));
        const lg_port *in = lg_program_inputs(program, at, &count);
        const lg_function_spec spec = {"velocity", in, count, &out, 1, velocity, (void *)(uintptr_t)space};
        LG_TRY(lg_program_add_function(program, &spec, error));
    }
    return lg_program_jacobian(program, "velocity", error);
}
