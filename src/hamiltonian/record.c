/* Learned Hamiltonians on a tape, for every family: parameters, functions of states, equations of motion. */
#include <math.h>

#include "autodiff/tape/tape_internal.h"
#include "hamiltonian/constraint.h"
#include "hamiltonian/internal.h"

/* ---- scales ---- */

double lg_hamiltonian_energy_scale(const lg_hamiltonian *model) {
    return model->scales.part[0] * model->scales.part[1] / model->scales.time;
}

void lg_hamiltonian_number_scales(const lg_hamiltonian *model, double *out) {
    uint8_t part[LG_HAMILTONIAN_LARGEST];
    const lg_space space = lg_hamiltonian_model_space(model);
    lg_taped_number_parts(&space, part);
    for (size_t i = 0; i < space.dim; i++) out[i] = model->scales.part[part[i]];
}

/* ---- the parts of a state: pairs of positions and momenta ---- */

uint32_t lg_hamiltonian_width(lg_tape *tape, lg_var part) {
    const lg_shape shape = lg_var_shape(tape, part);
    return (uint32_t)(lg_shape_count(shape) / (shape.dims[0] > 0 ? shape.dims[0] : 1));
}

lg_var lg_hamiltonian_joined(lg_tape *tape, const lg_hamiltonian_family *family, const lg_var *y,
                             size_t odd) {
    lg_var flat[LG_HAMILTONIAN_MAX_PARTS / 2];
    size_t pairs = 0;
    for (const char *const *name = family->layout; *name != NULL; name += 2, pairs++) {
        const lg_var part = y[2 * pairs + odd];
        flat[pairs] =
            lg_reshape(tape, part, lg_shape2(lg_rows_of(tape, part), lg_hamiltonian_width(tape, part)));
    }
    return lg_joined(tape, flat, pairs);
}

void lg_hamiltonian_cut(lg_tape *tape, const lg_hamiltonian_family *family, const lg_var *y, lg_var x,
                        size_t odd, lg_var *out) {
    uint32_t from = 0;
    for (size_t i = odd; i < LG_HAMILTONIAN_MAX_PARTS && family->layout[i] != NULL; i += 2) {
        const uint32_t width = lg_hamiltonian_width(tape, y[i]);
        out[i] = lg_reshape(tape, lg_slice(tape, x, 1, from, width), lg_var_shape(tape, y[i]));
        from += width;
    }
}

void lg_hamiltonian_over_scales(lg_tape *tape, const lg_hamiltonian *model, double factor, const lg_var *y,
                                lg_var *out) {
    for (size_t i = 0; model->family->layout[i] != NULL; i++)
        out[i] = lg_hamiltonian_scaled(tape, y[i], factor / model->scales.part[i]);
}

void lg_hamiltonian_by_scales(lg_tape *tape, const lg_hamiltonian *model, const lg_var *y, lg_var *out) {
    for (size_t i = 0; model->family->layout[i] != NULL; i++)
        out[i] = lg_hamiltonian_scaled(tape, y[i], model->scales.part[i]);
}

/* ---- variables that depend on theta only ---- */

static lg_var array_of(lg_tape *tape, const lg_hamiltonian *model, lg_var theta, size_t index) {
    const uint32_t m = lg_hamiltonian_array_length(model, index), rank = model->family->arrays[index].rank;
    const uint32_t from = (uint32_t)lg_hamiltonian_array_offset(model, index);
    lg_var slice = lg_slice(tape, theta, 0, from, rank == 1 ? m : m * m);
    return rank == 1 ? slice : lg_reshape(tape, slice, lg_shape2(m, m));
}

lg_status lg_hamiltonian_bind(lg_tape *tape, const lg_hamiltonian *model, lg_var theta,
                              lg_hamiltonian_vars *vars) {
    LG_TRY(lg_tape_needs(tape, "hamiltonian", model != NULL && vars != NULL));
    const lg_hamiltonian_family *family = model->family;
    lg_hamiltonian_vars made = {.model = model};
    lg_var arrays[LG_HAMILTONIAN_MAX_ARRAYS];
    const lg_shape shape = lg_var_shape(tape, theta);
    if (!lg_is_none(theta) && (shape.rank != 1 || shape.dims[0] != lg_hamiltonian_parameters(model)))
        (void)lg_tape_fail(tape, LG_SHAPE, "hamiltonian",
                           "theta must be a vector with one number for each parameter of the model");
    LG_TRY(lg_mlp_bind(tape, &model->net, theta, 0, &made.net));
    for (size_t i = 0; family->arrays[i].rank > 0; i++) arrays[i] = array_of(tape, model, theta, i);
    if (family->bind != NULL) family->bind(tape, arrays, &made);
    LG_TRY(lg_tape_status(tape));
    *vars = made;
    return LG_OK;
}

/* ---- the potential, for rows of x ---- */

static lg_var flat_inputs(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x) {
    const lg_hamiltonian *model = vars->model;
    return lg_reshape(tape, x, lg_shape2(lg_rows_of(tape, x), model->family->inputs * model->n));
}

/* The functions of x (B, d) that the network takes: invariants of the symmetry, and functions of these. */
static lg_var features(lg_tape *tape, const lg_hamiltonian *model, lg_var x) {
    const lg_symmetry_row *symmetry = lg_symmetry_row_of(model->symmetry);
    const lg_potential_row *potential = lg_potential_row_of(model->potential);
    double unit = model->scales.part[0];
    if (symmetry->record != NULL) {
        x = symmetry->record(tape, model, x);
        unit = pow(unit, symmetry->degree);
    }
    return potential->record == NULL ? x : potential->record(tape, x, unit);
}

/* N (B, 1) at x (B, d); the function below gives dN/dx (B, d). */
static lg_var network(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x) {
    return lg_mlp_record_bound(tape, &vars->model->net, &vars->net, features(tape, vars->model, x));
}

static lg_var network_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x) {
    const lg_hamiltonian *model = vars->model;
    const bool plain = lg_symmetry_row_of(model->symmetry)->record == NULL &&
                       lg_potential_row_of(model->potential)->record == NULL;
    if (plain) return lg_mlp_record_gradient(tape, &model->net, &vars->net, x);
    lg_var out = LG_NONE, inputs = features(tape, model, x);
    const lg_var slopes = lg_mlp_record_gradient(tape, &model->net, &vars->net, inputs);
    (void)lg_vjp(tape, &inputs, &slopes, 1, &x, 1, &out);
    return out;
}

static double sign_of(const lg_hamiltonian_vars *vars) {
    return lg_symmetry_row_of(vars->model->symmetry)->sign;
}

typedef lg_var (*of_inputs)(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x);

/* (f(x) + sign f(-x))/2; for sign 0 it is f(x). */
static lg_var symmetric(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x, of_inputs f, double sign) {
    lg_var at = f(tape, vars, x);
    if (sign == 0.0) return at;
    const lg_var both[2] = {at, f(tape, vars, lg_neg(tape, x))};
    const double weights[2] = {0.5, 0.5 * sign};
    return lg_linear_combination(tape, both, weights, 2);
}

lg_var lg_hamiltonian_potential(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x) {
    return symmetric(tape, vars, flat_inputs(tape, vars, x), network, sign_of(vars));
}

lg_var lg_hamiltonian_potential_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var x) {
    lg_var gradient = symmetric(tape, vars, flat_inputs(tape, vars, x), network_gradient, -sign_of(vars));
    return lg_reshape(tape, gradient, lg_var_shape(tape, x));
}

/* The input in the shape of `part`. Its shape is checked here, because a wrong width could broadcast. */
static lg_var input_like(lg_tape *tape, lg_var input, lg_var part) {
    const lg_shape shape = lg_var_shape(tape, part), given = lg_var_shape(tape, input);
    if (given.rank != 2 || given.dims[0] != shape.dims[0] ||
        given.dims[1] != lg_hamiltonian_width(tape, part))
        return lg_tape_fail(tape, LG_SHAPE, "hamiltonian",
                            "the input must have one row of forces for each row of states");
    return lg_reshape(tape, input, shape);
}

static lg_var pushed(lg_tape *tape, lg_var force, lg_var input) {
    return lg_is_none(input) ? force : lg_add(tape, force, input_like(tape, input, force));
}

static lg_var force_inside(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var input) {
    return pushed(tape, lg_neg(tape, lg_hamiltonian_potential_gradient(tape, vars, q)), input);
}

/* ---- functions of the parts of a state ---- */

static void gradient_inside(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    const lg_hamiltonian_family *family = vars->model->family;
    if (family->gradient != NULL) {
        family->gradient(tape, vars, y, out);
        return;
    }
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++) out[i] = LG_NONE;
    const lg_space space = lg_hamiltonian_model_space(vars->model);
    (void)lg_grad(tape, lg_sum(tape, family->energy(tape, vars, y)), y, lg_taped_parts(&space), out);
}

/* dH/dy of the parts y, all in the units of the data. */
static void gradient_parts(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    const lg_hamiltonian *model = vars->model;
    lg_var scaled[LG_HAMILTONIAN_MAX_PARTS];
    lg_hamiltonian_over_scales(tape, model, 1.0, y, scaled);
    gradient_inside(tape, vars, scaled, out);
    lg_hamiltonian_over_scales(tape, model, lg_hamiltonian_energy_scale(model), out, out);
}

/* Without a constraint: the brackets of all pairs of parts, with the numbers of the input that belong to
 * each. The operations stand in the order in which saved models have them. */
void lg_hamiltonian_record_algebra(lg_tape *tape, const lg_hamiltonian *model, double unit, const lg_var *y,
                                   const lg_var *dH, lg_var input, lg_var *out) {
    const lg_hamiltonian_family *family = model->family;
    const bool driven = !lg_is_none(input), bodies = family->bodies.rotations + family->bodies.directions > 0;
    uint32_t from = 0;
    if (model->constraint != NULL) {
        const lg_var force = driven ? input_like(tape, input, y[1]) : input;
        lg_constraint_record_field(tape, model->constraint, unit, y, dH, force, out);
        return;
    }
    if (bodies && driven) input = input_like(tape, input, lg_hamiltonian_joined(tape, family, y, 1));
    for (size_t i = 0; family->layout[i] != NULL; i += 2) {
        if (!bodies) out[i] = lg_bracket_rate(tape, y + i, dH + i);
        const lg_var change = lg_bracket_change(tape, y + i, dH + i);
        if (bodies) out[i] = lg_bracket_rate(tape, y + i, dH + i);
        const uint32_t width = lg_hamiltonian_width(tape, change);
        out[i + 1] = pushed(tape, change, bodies && driven ? lg_slice(tape, input, 1, from, width) : input);
        from += width;
    }
}

/* gradient_inside, gradient_parts, or a family's gradient_on_manifold. */
typedef void (*gradient_of)(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out);

static void field_parts(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var input,
                        gradient_of gradient, lg_var *out) {
    lg_var dH[LG_HAMILTONIAN_MAX_PARTS];
    gradient(tape, vars, y, dH);
    lg_hamiltonian_record_algebra(
        tape, vars->model, gradient == gradient_parts ? 1.0 : vars->model->scales.part[0], y, dH, input, out);
}

static lg_status velocity_parts(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var input,
                                gradient_of gradient, lg_var *out) {
    const lg_space space = lg_hamiltonian_model_space(vars->model);
    lg_var algebra[LG_HAMILTONIAN_MAX_PARTS];
    field_parts(tape, vars, y, input, gradient, algebra);
    return lg_taped_generator(tape, &space, algebra, y, out);
}

lg_var lg_hamiltonian_record_force(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var input) {
    const lg_hamiltonian *model = vars->model;
    const double unit = lg_hamiltonian_energy_scale(model) / model->scales.part[0];
    if (!lg_is_none(input)) input = lg_hamiltonian_scaled(tape, input, 1.0 / unit);
    q = lg_hamiltonian_scaled(tape, q, 1.0 / model->scales.part[0]);
    return lg_hamiltonian_scaled(tape, force_inside(tape, vars, q, input), unit);
}

lg_var lg_hamiltonian_record_drift(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var p) {
    const lg_hamiltonian *model = vars->model;
    const double scale = model->scales.part[1];
    const lg_var scaled = lg_hamiltonian_scaled(tape, p, 1.0 / scale);
    return lg_hamiltonian_scaled(tape, model->family->drift(tape, vars, scaled),
                                 lg_hamiltonian_energy_scale(model) / scale);
}

/* ---- functions of states (B, d) ---- */

/* Sets the space and splits the state into parts. Returns false if the tape has an error. */
static bool parts_of(lg_tape *tape, const lg_hamiltonian *model, lg_var state, lg_space *space, lg_var *y) {
    *space = lg_hamiltonian_model_space(model);
    return lg_taped_split(tape, space, state, y) == LG_OK;
}

lg_var lg_hamiltonian_record_value(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state) {
    lg_space space;
    lg_var y[LG_HAMILTONIAN_MAX_PARTS];
    if (!parts_of(tape, vars->model, state, &space, y)) return LG_NONE;
    lg_hamiltonian_over_scales(tape, vars->model, 1.0, y, y);
    return lg_hamiltonian_scaled(tape, vars->model->family->energy(tape, vars, y),
                                 lg_hamiltonian_energy_scale(vars->model));
}

lg_var lg_hamiltonian_record_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state) {
    lg_space space;
    lg_var y[LG_HAMILTONIAN_MAX_PARTS], out[LG_HAMILTONIAN_MAX_PARTS];
    if (!parts_of(tape, vars->model, state, &space, y)) return LG_NONE;
    gradient_parts(tape, vars, y, out);
    return lg_taped_join(tape, &space, out);
}

lg_var lg_hamiltonian_record_field(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                   lg_var input) {
    lg_space space;
    lg_var y[LG_HAMILTONIAN_MAX_PARTS], out[LG_HAMILTONIAN_MAX_PARTS];
    if (!parts_of(tape, vars->model, state, &space, y)) return LG_NONE;
    field_parts(tape, vars, y, input, gradient_parts, out);
    return lg_taped_join_algebra(tape, &space, out);
}

lg_var lg_hamiltonian_record_velocity(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                      lg_var input) {
    lg_space space;
    lg_var y[LG_HAMILTONIAN_MAX_PARTS], out[LG_HAMILTONIAN_MAX_PARTS];
    if (!parts_of(tape, vars->model, state, &space, y)) return LG_NONE;
    if (velocity_parts(tape, vars, y, input, gradient_parts, out) != LG_OK) return LG_NONE;
    return lg_taped_join(tape, &space, out);
}

/* ---- equations for training: divided by the model's scales ---- */

static lg_status inner_field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                             lg_var *algebra) {
    const lg_hamiltonian_vars *vars = user;
    const gradient_of on_manifold = vars->model->family->gradient_on_manifold;
    field_parts(tape, vars, y, input, on_manifold != NULL ? on_manifold : gradient_inside, algebra);
    return lg_tape_status(tape);
}

static lg_status inner_force(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input,
                             lg_var *out) {
    const lg_hamiltonian_vars *vars = user;
    *out = force_inside(tape, vars, q, input);
    return lg_tape_status(tape);
}

static lg_status inner_drift(void *user, lg_tape *tape, lg_taped_time t, lg_var p, lg_var input,
                             lg_var *out) {
    const lg_hamiltonian_vars *vars = user;
    *out = vars->model->family->drift(tape, vars, p);
    return lg_tape_status(tape);
}

static lg_status ambient_field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                               lg_var *out) {
    const lg_hamiltonian_vars *vars = user;
    if (vars->model->family->velocity == NULL)
        return velocity_parts(tape, vars, y, input, gradient_inside, out);
    vars->model->family->velocity(tape, vars, y, out);
    return lg_tape_status(tape);
}

lg_status lg_hamiltonian_training_ode(lg_tape *tape, lg_hamiltonian_vars *vars, const lg_scheme *scheme,
                                      const lg_var *start, lg_taped_ode *ode) {
    lg_space_factor factors[LG_HAMILTONIAN_MAX_PARTS];
    *ode =
        (lg_taped_ode){.field = inner_field, .user = vars, .space = lg_hamiltonian_model_space(vars->model)};
    if (vars->model->family->drift != NULL) ode->force = inner_force, ode->velocity = inner_drift;
    if (lg_space_is_abelian(&ode->space) || !scheme->ambient) return LG_OK;
    const size_t parts = lg_taped_parts(&ode->space);
    for (size_t i = 0; i < parts; i++)
        factors[i] = (lg_space_factor){LG_SPACE_RN, lg_hamiltonian_width(tape, start[i])};
    ode->field = ambient_field;
    return lg_space_init(&ode->space, factors, parts);
}
