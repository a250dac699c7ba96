/* A learned Hamiltonian as a program. */
#include "core/core.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"

typedef struct recording {
    const lg_hamiltonian *model;
    const lg_scheme *scheme;
} recording;

static lg_status value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_hamiltonian_vars vars;
    LG_TRY(lg_hamiltonian_bind(tape, r->model, theta[0], &vars));
    y[0] = lg_hamiltonian_record_value(tape, &vars, x[0]);
    return lg_tape_status(tape);
}

static lg_status gradient(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_hamiltonian_vars vars;
    LG_TRY(lg_hamiltonian_bind(tape, r->model, theta[0], &vars));
    y[0] = lg_hamiltonian_record_value(tape, &vars, x[0]);
    y[1] = lg_hamiltonian_record_gradient(tape, &vars, x[0]);
    return lg_tape_status(tape);
}

static lg_status field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_hamiltonian_vars vars;
    LG_TRY(lg_hamiltonian_bind(tape, r->model, theta[0], &vars));
    y[0] = lg_hamiltonian_record_field(tape, &vars, x[0], x[1]);
    return lg_tape_status(tape);
}

static lg_status step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    lg_hamiltonian_vars vars;
    lg_taped_ode ode;
    lg_var parts[2];
    LG_TRY(lg_hamiltonian_bind(tape, r->model, theta[0], &vars));
    LG_TRY(lg_hamiltonian_taped_ode(&vars, &ode));
    LG_TRY(lg_taped_split(tape, &ode.space, x[0], parts));
    const lg_taped_interval over = {.h_rows = x[2], .input = x[1]};
    LG_TRY(lg_taped_step_over(tape, r->scheme, &ode, &over, parts, parts));
    y[0] = lg_taped_join(tape, &ode.space, parts);
    return lg_tape_status(tape);
}

lg_status lg_hamiltonian_program(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                                 const lg_scheme *scheme, lg_program **out, lg_error *error) {
    const bool chain = model->family == LG_HAMILTONIAN_CHAIN;
    recording r = {model, scheme != NULL ? scheme : lg_scheme_find(chain ? "cf4" : "stormer-verlet")};
    const uint32_t d = (uint32_t)lg_hamiltonian_state_size(model), m = model->links * (chain ? 3 : 1);
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(d)},
                          {.name = "u", .shape = lg_shape1(m)},
                          {.name = "h", .shape = lg_shape1(1), .low = 0.001, .high = 0.05}};
    const lg_port energy[] = {{.name = "y"}, {.name = "g"}}, rate = {.name = "f"}, next = {.name = "next"};
    const lg_function_spec functions[] = {{"value", in, 1, energy, 1, value, &r},
                                          {"grad", in, 1, energy, 2, gradient, &r},
                                          {"field", in, 2, &rate, 1, field, &r},
                                          {"step", in, 3, &next, 1, step, &r}};
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_hamiltonian_parameters(model)), theta};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = &weights;
    spec.parameter_count = 1;
    spec.functions = functions;
    spec.function_count = LG_COUNT(functions);
    spec.description = chain ? "learned Hamiltonian of a chain" : "learned separable Hamiltonian";
    return lg_program_build(context, &spec, out, error);
}
