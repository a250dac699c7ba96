/* Learned Hamiltonians on a tape: value, gradient, field, equation for the taped integrators. */
#include "core/core.h"
#include "liegrad/ops.h"
#include "models/hamiltonian_internal.h"

/* ---- what theta gives ---- */

static lg_var slice_of(lg_tape *tape, lg_var theta, size_t at, uint32_t count, lg_shape shape) {
    return lg_reshape(tape, lg_slice(tape, theta, 0, (uint32_t)at, count), shape);
}

lg_var lg_hamiltonian_unit_matrix(lg_tape *tape, uint32_t k) {
    double unit[LG_HAMILTONIAN_MAX_LINKS * LG_HAMILTONIAN_MAX_LINKS] = {0.0};
    for (uint32_t i = 0; i < k; i++) unit[i * k + i] = 1.0;
    return lg_input_f64(tape, lg_shape3(1, k, k), unit);
}

/* m = Gamma^T Gamma + diag(max(0, b)), W = m^-1; inverse_mii NULL: not asked for */
static void bind_chain(lg_tape *tape, lg_var theta, lg_hamiltonian_vars *vars, lg_var *inverse_mii) {
    const uint32_t k = vars->model->links;
    const size_t at = lg_hamiltonian_kinetic_offset(vars->model);
    lg_var gamma = slice_of(tape, theta, at, k * k, lg_shape2(k, k));
    lg_var diagonal = slice_of(tape, theta, at + (size_t)k * k, k, lg_shape3(1, 1, k));
    lg_var unit = lg_hamiltonian_unit_matrix(tape, k);
    lg_var gram = lg_reshape(tape, lg_matmul_tn(tape, gamma, gamma), lg_shape3(1, k, k));
    lg_var m = lg_add(tape, gram, lg_mul(tape, unit, lg_act(tape, diagonal, LG_RELU)));
    vars->W = lg_spd_solve(tape, m, unit);
    if (inverse_mii == NULL) return;
    lg_var mii = lg_sum_axis(tape, lg_mul(tape, m, unit), -1, true);
    *inverse_mii = lg_div(tape, lg_full(tape, lg_shape3(1, k, 1), 1.0), mii);
}

lg_status lg_hamiltonian_bind_extended(lg_tape *tape, const lg_hamiltonian *model, lg_var theta,
                                       lg_hamiltonian_vars *vars, lg_var *inverse_mii) {
    lg_hamiltonian_vars made = {.model = model};
    const lg_shape shape = lg_var_shape(tape, theta);
    if (!lg_is_none(theta) && (shape.rank != 1 || shape.dims[0] != lg_hamiltonian_parameters(model)))
        (void)lg_tape_fail(tape, LG_SHAPE, "hamiltonian", "theta is not as long as the model's parameters");
    LG_TRY(lg_mlp_bind(tape, &model->net, theta, 0, &made.net));
    if (model->family == LG_HAMILTONIAN_CHAIN) {
        bind_chain(tape, theta, &made, inverse_mii);
    } else {
        const uint32_t n = model->links;
        lg_var a = slice_of(tape, theta, lg_hamiltonian_kinetic_offset(model), n * n, lg_shape2(n, n));
        made.K = lg_matmul_tn(tape, a, a);
    }
    LG_TRY(lg_tape_status(tape));
    *vars = made;
    return LG_OK;
}

lg_status lg_hamiltonian_bind(lg_tape *tape, const lg_hamiltonian *model, lg_var theta,
                              lg_hamiltonian_vars *vars) {
    return lg_hamiltonian_bind_extended(tape, model, theta, vars, NULL);
}

/* ---- parts: q and p of (B, k, 3), or of (B, n) ---- */

static lg_status space_of(const lg_hamiltonian *model, lg_space *space) {
    const size_t n = model->links;
    if (model->family == LG_HAMILTONIAN_CHAIN)
        return lg_space_init(space, (lg_space_factor[]){{LG_SPACE_TS2, n}}, 1);
    return lg_space_init(space, (lg_space_factor[]){{LG_SPACE_RN, n}, {LG_SPACE_RN, n}}, 2);
}

/* Positions as the network takes them, (B, 3k) or (B, n). */
static lg_var flat_positions(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q) {
    return lg_reshape(tape, q, lg_shape2(lg_var_shape(tape, q).dims[0], vars->model->net.width[0]));
}

lg_var lg_hamiltonian_potential_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q) {
    lg_var flat = flat_positions(tape, vars, q);
    return lg_reshape(tape, lg_mlp_record_gradient(tape, &vars->model->net, &vars->net, flat),
                      lg_var_shape(tape, q));
}

/* v = dT/dp (B, k, 3) and lambda (B, k, 1). For one link W leaves lambda = (q.p)/(q.q). */
static lg_var chain_velocity(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var p,
                             lg_var *lambda) {
    const lg_var W = vars->W;
    if (vars->model->links == 1) {
        *lambda = lg_div(tape, lg_rowdot(tape, q, p), lg_rownorm2(tape, q));
        return lg_mul(tape, lg_sub(tape, p, lg_mul(tape, q, *lambda)), W);
    }
    lg_var u = lg_rowdot(tape, q, lg_matmul(tape, W, p));
    lg_var S = lg_mul(tape, lg_matmul_nt(tape, q, q), W);
    *lambda = lg_spd_solve(tape, S, u);
    return lg_matmul(tape, W, lg_sub(tape, p, lg_mul(tape, q, *lambda)));
}

void lg_hamiltonian_chain_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var p,
                                   lg_var *v, lg_var *g) {
    lg_var lambda, potential = lg_hamiltonian_potential_gradient(tape, vars, q);
    *v = chain_velocity(tape, vars, q, p, &lambda);
    *g = lg_sub(tape, potential, lg_mul(tape, *v, lambda));
}

/* The input as the part that it is added to; its rows are checked here, where a wrong width could broadcast.
 */
static lg_var input_like(lg_tape *tape, lg_var input, lg_var part) {
    const lg_shape shape = lg_var_shape(tape, part), given = lg_var_shape(tape, input);
    const size_t rows = shape.dims[0], width = lg_shape_count(shape) / (rows > 0 ? rows : 1);
    if (given.rank != 2 || given.dims[0] != rows || given.dims[1] != width)
        return lg_tape_fail(tape, LG_SHAPE, "hamiltonian", "the input is not (B, 3k) or (B, n)");
    return lg_reshape(tape, input, shape);
}

lg_status lg_hamiltonian_chain_lift(lg_tape *tape, const lg_var *y, lg_var v, lg_var g, lg_var input,
                                    lg_var *algebra) {
    lg_var xi = lg_cross(tape, y[0], v);
    lg_var eta = lg_add(tape, lg_cross(tape, g, y[0]), lg_cross(tape, v, y[1]));
    if (!lg_is_none(input)) eta = lg_add(tape, eta, input_like(tape, input, eta));
    algebra[0] = xi;
    algebra[1] = eta;
    return lg_tape_status(tape);
}

/* ---- fields of parts ---- */

static lg_var force_of(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var input) {
    lg_var force = lg_neg(tape, lg_hamiltonian_potential_gradient(tape, vars, q));
    return lg_is_none(input) ? force : lg_add(tape, force, input_like(tape, input, force));
}

static lg_status field_of(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var input,
                          lg_var *out) {
    lg_var v, g;
    if (vars->model->family == LG_HAMILTONIAN_CHAIN) {
        lg_hamiltonian_chain_gradient(tape, vars, y[0], y[1], &v, &g);
        return lg_hamiltonian_chain_lift(tape, y, v, g, input, out);
    }
    v = lg_matmul(tape, y[1], vars->K);
    out[1] = force_of(tape, vars, y[0], input);
    out[0] = v;
    return lg_tape_status(tape);
}

static lg_status field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var *algebra) {
    (void)t;
    return field_of(tape, user, y, input, algebra);
}

static lg_status separable_force(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input,
                                 lg_var *out) {
    (void)t;
    *out = force_of(tape, user, q, input);
    return lg_tape_status(tape);
}

static lg_status separable_velocity(void *user, lg_tape *tape, lg_taped_time t, lg_var p, lg_var input,
                                    lg_var *out) {
    const lg_hamiltonian_vars *vars = user;
    (void)t, (void)input;
    *out = lg_matmul(tape, p, vars->K);
    return lg_tape_status(tape);
}

lg_status lg_hamiltonian_taped_ode(lg_hamiltonian_vars *vars, lg_taped_ode *ode) {
    lg_taped_ode made = {.field = field, .user = vars};
    LG_TRY(space_of(vars->model, &made.space));
    if (vars->model->family == LG_HAMILTONIAN_SEPARABLE) {
        made.force = separable_force;
        made.velocity = separable_velocity;
    }
    *ode = made;
    return LG_OK;
}

/* ---- functions of states (B, d) ---- */

/* Parts of the state; false with the tape's error. */
static bool parts_of(lg_tape *tape, const lg_hamiltonian *model, lg_var state, lg_space *space, lg_var *y) {
    return space_of(model, space) == LG_OK && lg_taped_split(tape, space, state, y) == LG_OK;
}

lg_var lg_hamiltonian_record_value(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state) {
    lg_space space;
    lg_var y[2], lambda;
    if (!parts_of(tape, vars->model, state, &space, y)) return LG_NONE;
    const bool chain = vars->model->family == LG_HAMILTONIAN_CHAIN;
    lg_var v = chain ? chain_velocity(tape, vars, y[0], y[1], &lambda) : lg_matmul(tape, y[1], vars->K);
    lg_var twice = lg_rowdot(tape, y[1], v);
    if (chain) twice = lg_sum_axis(tape, twice, 1, false);
    lg_var flat = flat_positions(tape, vars, y[0]);
    lg_var potential = lg_mlp_record_bound(tape, &vars->model->net, &vars->net, flat);
    return lg_add(tape, lg_scale(tape, twice, 0.5), potential);
}

lg_var lg_hamiltonian_record_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state) {
    lg_space space;
    lg_var y[2], out[2];
    if (!parts_of(tape, vars->model, state, &space, y)) return LG_NONE;
    if (vars->model->family == LG_HAMILTONIAN_CHAIN) {
        lg_hamiltonian_chain_gradient(tape, vars, y[0], y[1], &out[1], &out[0]);
    } else {
        out[0] = lg_hamiltonian_potential_gradient(tape, vars, y[0]);
        out[1] = lg_matmul(tape, y[1], vars->K);
    }
    return lg_taped_join(tape, &space, out);
}

lg_var lg_hamiltonian_record_field(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var state,
                                   lg_var input) {
    lg_space space;
    lg_var y[2], out[2];
    if (!parts_of(tape, vars->model, state, &space, y)) return LG_NONE;
    if (field_of(tape, vars, y, input, out) != LG_OK) return LG_NONE;
    return lg_taped_join(tape, &space, out); /* algebra elements have the state's layout */
}
