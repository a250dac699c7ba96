/* A learned Hamiltonian as a program, a set of named functions. */
#include "autodiff/program/program.h"
#include "hamiltonian/internal.h"

typedef struct recording {
    const lg_hamiltonian *model;
    const lg_scheme *scheme;
} recording;

/* Functions of x and the numbers of the model alone. */
#define OF_MODEL(name, recorded)                                                                             \
    static lg_status name(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {      \
        lg_hamiltonian_vars vars;                                                                            \
        LG_TRY(lg_hamiltonian_bind(tape, ((const recording *)user)->model, theta[0], &vars));                \
        recorded;                                                                                            \
        return lg_tape_status(tape);                                                                         \
    }
OF_MODEL(value, y[0] = lg_hamiltonian_record_value(tape, &vars, x[0]))
OF_MODEL(gradient, y[0] = lg_hamiltonian_record_value(tape, &vars, x[0]);
         y[1] = lg_hamiltonian_record_gradient(tape, &vars, x[0]))
OF_MODEL(force, y[0] = lg_hamiltonian_record_force(tape, &vars, x[0], x[1]))
OF_MODEL(drift, y[0] = lg_hamiltonian_record_drift(tape, &vars, x[0]))

/* The field uses only the output dH/dx of grad; a plan then leaves out the computation of the value. */
static lg_status field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const recording *r = user;
    const lg_space space = lg_hamiltonian_model_space(r->model);
    lg_var state[LG_HAMILTONIAN_MAX_PARTS], dH[LG_HAMILTONIAN_MAX_PARTS], out[LG_HAMILTONIAN_MAX_PARTS];
    LG_TRY(lg_taped_split(tape, &space, x[0], state));
    LG_TRY(lg_taped_split(tape, &space, lg_program_call(tape, "grad", 1, x), dH));
    const lg_var u = lg_hamiltonian_input_dim(r->model) > 0 ? x[1] : LG_NONE;
    lg_hamiltonian_record_algebra(tape, r->model, 1.0, state, dH, u, out);
    y[0] = lg_taped_join_algebra(tape, &space, out);
    return lg_tape_status(tape);
}

/* Moves the parts by the input over half a step. */
static lg_status push(const recording *r, lg_tape *tape, const lg_space *space, const lg_taped_span *over,
                      lg_var u, lg_var *parts) {
    lg_var none[LG_HAMILTONIAN_MAX_PARTS], change[LG_HAMILTONIAN_MAX_PARTS];
    if (lg_is_none(u)) return LG_OK;
    const size_t count = lg_taped_parts(space);
    for (size_t i = 0; i < count; i++) none[i] = lg_scale(tape, parts[i], 0.0);
    lg_hamiltonian_record_algebra(tape, r->model, 1.0, parts, none, u, change);
    for (size_t i = 0; i < count; i++)
        change[i] = lg_taped_by_rows(tape, over, lg_scale(tape, change[i], 0.5));
    return lg_taped_act(tape, space, change, parts, parts);
}

static lg_status variational_step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                  lg_var *y) {
    const recording *r = user;
    const lg_space space = lg_hamiltonian_model_space(r->model);
    const bool driven = lg_hamiltonian_input_dim(r->model) > 0;
    const lg_var u = driven ? x[1] : LG_NONE, h = x[driven ? 2 : 1];
    const lg_shape tall = lg_shape3(lg_rows_of(tape, h), 1, 1);
    lg_taped_span over = {.h = 1.0, .rows = h, .tall = lg_reshape(tape, h, tall)};
    lg_hamiltonian_vars vars;
    lg_var parts[LG_HAMILTONIAN_MAX_PARTS];
    LG_TRY(lg_hamiltonian_bind(tape, r->model, theta[0], &vars));
    LG_TRY(lg_taped_split(tape, &space, x[0], parts));
    LG_TRY(push(r, tape, &space, &over, u, parts));
    lg_hamiltonian_over_scales(tape, r->model, 1.0, parts, parts);
    over.h = 1.0 / r->model->scales.time;
    LG_TRY(lg_hamiltonian_variational_step(tape, &vars, &over, parts, parts));
    lg_hamiltonian_by_scales(tape, r->model, parts, parts);
    over.h = 1.0;
    LG_TRY(push(r, tape, &space, &over, u, parts));
    y[0] = lg_taped_join(tape, &space, parts);
    return lg_tape_status(tape);
}

/* The functions of liegrad/constraint.h, of the learned system. */

static lg_status constraint(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_program *own = lg_constraint_program(((const recording *)user)->model->constraint);
    size_t function;
    LG_TRY(lg_program_find(own, "constraint", &function, NULL));
    return lg_program_record(tape, own, function, NULL, x, y);
}

static lg_var potential_of(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q) {
    const lg_hamiltonian *model = vars->model;
    q = lg_hamiltonian_scaled(tape, q, 1.0 / model->scales.part[0]);
    return lg_hamiltonian_scaled(tape, lg_hamiltonian_potential(tape, vars, q),
                                 lg_hamiltonian_energy_scale(model));
}

static lg_var mass_of(lg_tape *tape, const lg_hamiltonian_vars *vars) {
    const lg_hamiltonian_scales *scales = &vars->model->scales;
    const uint32_t n = vars->model->n;
    const lg_var M = lg_spd_solve(tape, vars->kinetic[0], lg_unit_matrix(tape, n));
    return lg_hamiltonian_scaled(tape, lg_reshape(tape, M, lg_shape2(n, n)),
                                 scales->part[1] * scales->time / scales->part[0]);
}

OF_MODEL(potential, y[0] = potential_of(tape, &vars, x[0]))
OF_MODEL(mass, y[0] = mass_of(tape, &vars))

enum { MOST_FUNCTIONS = 8 };

static lg_status build(const lg_context *context, recording *r, const double *theta, lg_program **out,
                       lg_error *error) {
    const lg_hamiltonian *model = r->model;
    const uint32_t d = lg_hamiltonian_state_dim(model), m = lg_hamiltonian_input_dim(model);
    const size_t inputs = m > 0 ? 2 : 1;
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(d)}, {.name = "u", .shape = lg_shape1(m)}};
    const lg_port half[] = {{.name = "x", .shape = lg_shape1(d / 2)}, {.name = "u", .shape = lg_shape1(m)}};
    const lg_port energy[] = {{.name = "y"}, {.name = "g"}}, rate = {.name = "f"};
    lg_function_spec functions[MOST_FUNCTIONS] = {{"value", in, 1, energy, 1, value, r},
                                                  {"grad", in, 1, energy, 2, gradient, r},
                                                  {"field", in, inputs, &rate, 1, field, r}};
    size_t count = 3;
    if (model->family->drift != NULL) {
        functions[count++] = (lg_function_spec){"force", half, 2, &rate, 1, force, r};
        functions[count++] = (lg_function_spec){"drift", half, 1, &rate, 1, drift, r};
    }
    const lg_port q = {.name = "q", .shape = lg_shape1(d / 2)};
    const lg_port of_q[] = {{.name = "g"}, {.name = "V"}, {.name = "M"}};
    if (model->constraint != NULL) {
        functions[count++] = (lg_function_spec){"constraint", &q, 1, &of_q[0], 1, constraint, r};
        functions[count++] = (lg_function_spec){"potential", &q, 1, &of_q[1], 1, potential, r};
        functions[count++] = (lg_function_spec){"mass", &q, 1, &of_q[2], 1, mass, r};
    }
    const lg_parameter_spec weights = {"theta", lg_shape1((uint32_t)lg_hamiltonian_parameters(model)), theta};
    const lg_program_spec spec = {.size = sizeof spec,
                                  .parameters = &weights,
                                  .parameter_count = 1,
                                  .functions = functions,
                                  .function_count = count,
                                  .description = model->family->description};
    return lg_program_build(context, &spec, out, error);
}

/* Adds the step and the Jacobian of `velocity`, then gives the program its parameters. */
static lg_status finish(const recording *r, lg_program *program, const double *theta, lg_error *error) {
    const lg_space space = lg_hamiltonian_model_space(r->model);
    LG_TRY(r->scheme->kind != LG_SCHEME_VARIATIONAL || r->model->family->ambient == NULL
               ? lg_program_add_step(program, &space, r->scheme, 0.001, 0.05, error)
               : lg_program_put_step(program, 0.001, 0.05, variational_step, (void *)(uintptr_t)r, error));
    LG_TRY(lg_program_add_velocity(program, &space, error));
    const lg_status status = lg_program_set_parameter(program, 0, theta);
    return status == LG_OK ? LG_OK : lg_fail(error, status, "a parameter is not finite");
}

/* The functions are recorded and checked with initial parameters, because the given ones may have a singular
 * mass matrix, which makes all values NaN. */
lg_status lg_hamiltonian_program(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                                 const lg_scheme *scheme, lg_program **out, lg_error *error) {
    LG_NEEDS(error, model, theta, out);
    recording r = {model, scheme != NULL ? scheme : lg_scheme_find(model->family->scheme)};
    LG_CLEAN(lg_program_destroy_at) lg_program *made = NULL;
    lg_rng rng;
    LG_TRY_SCRATCH(double, initial, context, lg_hamiltonian_parameters(model),
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a model"));
    lg_rng_seed(&rng, 1, 0);
    lg_hamiltonian_initialise(model, &rng, initial);
    LG_TRY(build(context, &r, initial, &made, error));
    LG_TRY(finish(&r, made, theta, error));
    return LG_MOVE(out, made);
}
