/* Family "chain": pendulum chains on (T*S^2)^n; liegrad/hamiltonian.h has the formulas. The parts q and p,
 * and v = dH/dp and g = dH/dq, have the shape (B, n, 3). */
#include "hamiltonian/internal.h"

enum {
    W,
    INVERSE_MII,
    M
}; /* vars->kinetic: m^-1 (1, n, n), NaN unless m is positive definite; 1/m_ii (1, n, 1); m (1, n, n) */

lg_status lg_hamiltonian_mass(const lg_hamiltonian *model, const double *theta, double *m) {
    LG_NEEDS(NULL, model, theta, m);
    if (model->family->bind != lg_hamiltonian_bind_mass) return LG_UNSUPPORTED;
    const size_t n = model->n;
    const lg_hamiltonian_scales *scales = &model->scales;
    const double place = model->family->factors > 1 ? scales->part[0] : 1.0;
    const double unit = scales->part[1] * scales->time / place; /* unit of p / unit of q' */
    lg_hamiltonian_gram(n, theta + lg_hamiltonian_array_offset(model, 0), m);
    for (size_t i = 0; i < n * n; i++) m[i] *= unit;
    return LG_OK;
}

/* ---- energy and gradient ---- */

void lg_hamiltonian_bind_mass(lg_tape *tape, const lg_var *arrays, lg_hamiltonian_vars *vars) {
    const uint32_t n = vars->model->n;
    lg_var unit = lg_unit_matrix(tape, n);
    lg_var m = lg_hamiltonian_record_gram(tape, n, arrays[0], arrays[1]);
    vars->kinetic[M] = m;
    vars->kinetic[W] = lg_spd_solve(tape, m, unit);
    lg_var mii = lg_sum_axis(tape, lg_mul(tape, m, unit), -1, true);
    vars->kinetic[INVERSE_MII] = lg_div(tape, lg_full(tape, lg_shape3(1, n, 1), 1.0), mii);
}

/* v = dT/dp and the multipliers lambda (B, n, 1). For one link W cancels: lambda = (q.p)/(q.q). */
static lg_var link_velocity(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var p,
                            lg_var *lambda) {
    const lg_var w = vars->kinetic[W];
    if (vars->model->n == 1) {
        *lambda = lg_div(tape, lg_rowdot(tape, q, p), lg_rownorm2(tape, q));
        return lg_mul(tape, lg_sub(tape, p, lg_mul(tape, q, *lambda)), w);
    }
    lg_var u = lg_rowdot(tape, q, lg_matmul(tape, w, p));
    *lambda = lg_spd_solve(tape, lg_mul(tape, lg_matmul_nt(tape, q, q), w), u);
    return lg_matmul(tape, w, lg_sub(tape, p, lg_mul(tape, q, *lambda)));
}

static lg_var energy(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    lg_var lambda, v = link_velocity(tape, vars, y[0], y[1], &lambda);
    lg_var twice = lg_sum_axis(tape, lg_rowdot(tape, y[1], v), 1, false);
    return lg_add(tape, lg_scale(tape, twice, 0.5), lg_hamiltonian_potential(tape, vars, y[0]));
}

static void gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    lg_var lambda, potential = lg_hamiltonian_potential_gradient(tape, vars, y[0]);
    lg_var v = link_velocity(tape, vars, y[0], y[1], &lambda);
    out[0] = lg_sub(tape, potential, lg_mul(tape, v, lambda));
    out[1] = v;
}

/* For one link with q.p = 0 the multiplier is 0: T = |p|^2/(2 m). */
static void gradient_on_manifold(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y,
                                 lg_var *out) {
    if (vars->model->n > 1) {
        gradient(tape, vars, y, out);
        return;
    }
    lg_var potential = lg_hamiltonian_potential_gradient(tape, vars, y[0]);
    out[1] = lg_mul(tape, y[1], vars->kinetic[W]);
    out[0] = potential;
}

/* The velocities q' and the mass m_ij I of the ambient positions, for variational steps. */
static void ambient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *K,
                    lg_var *rate) {
    const uint32_t n = vars->model->n;
    lg_var lambda, v = link_velocity(tape, vars, y[0], y[1], &lambda);
    *rate = lg_reshape(tape, v, lg_shape2(lg_rows_of(tape, v), 3 * n));
    *K =
        lg_reshape(tape, lg_hamiltonian_record_blocks(tape, n, vars->kinetic[M]), lg_shape3(1, 3 * n, 3 * n));
}

/* ---- fields ---- */

/* The extension of T off the manifold, 1/2 p^T W p + 1/2 u^T S^-1 r, summed over the batch. */
static lg_var extended_kinetic(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var q, lg_var p) {
    const lg_var w = vars->kinetic[W], inverse_mii = vars->kinetic[INVERSE_MII];
    const lg_var unit = lg_unit_matrix(tape, vars->model->n);
    lg_var wp = lg_matmul(tape, w, p);
    lg_var u = lg_rowdot(tape, q, wp);
    lg_var gap = lg_add_scalar(tape, lg_neg(tape, lg_rownorm2(tape, q)), 1.0);
    lg_var diagonal = lg_mul(tape, unit, lg_mul(tape, gap, inverse_mii));
    lg_var S = lg_add(tape, diagonal, lg_mul(tape, lg_matmul_nt(tape, q, q), w));
    lg_var r = lg_sub(tape, lg_mul(tape, lg_rowdot(tape, q, p), inverse_mii), u);
    lg_var free = lg_sum(tape, lg_rowdot(tape, p, wp));
    lg_var tied = lg_sum(tape, lg_mul(tape, u, lg_spd_solve(tape, S, r)));
    return lg_scale(tape, lg_add(tape, free, tied), 0.5);
}

static void extended_gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    if (vars->model->n == 1) {
        gradient_on_manifold(tape, vars, y, out);
        return;
    }
    lg_var kinetic[2] = {LG_NONE, LG_NONE};
    const lg_var wrt[2] = {y[1], y[0]};
    if (lg_grad(tape, extended_kinetic(tape, vars, y[0], y[1]), wrt, 2, kinetic) != LG_OK) return;
    out[0] = lg_add(tape, kinetic[1], lg_hamiltonian_potential_gradient(tape, vars, y[0]));
    out[1] = kinetic[0];
}

/* q' = v - q (q.v), p' = -g + q (q.g) + p (q.v) - q (p.v) */
static void velocity(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    const lg_var q = y[0], p = y[1];
    lg_var dH[2] = {LG_NONE, LG_NONE};
    extended_gradient(tape, vars, y, dH);
    const lg_var g = dH[0], v = dH[1];
    lg_var qv = lg_rowdot(tape, q, v), qg = lg_rowdot(tape, q, g), pv = lg_rowdot(tape, p, v);
    lg_var to_q = lg_sub(tape, v, lg_mul(tape, q, qv));
    lg_var along_q = lg_mul(tape, q, lg_sub(tape, qg, pv));
    out[1] = lg_add(tape, lg_sub(tape, along_q, g), lg_mul(tape, p, qv));
    out[0] = to_q;
}

const lg_hamiltonian_family lg_hamiltonian_chain = {
    .name = "chain",
    .description = "learned Hamiltonian of a chain",
    .copy = "link",
    .factor = {LG_SPACE_TS2},
    .factors = 1,
    .scaled = {false, true},
    .many = 3,
    .stretch = 6.0,
    .inputs = 3,
    .forces = 3,
    .layout = {"q", "p"},
    .numbered = true,
    .state_units = "q: 1, p: kg m^2/s",
    .energy_unit = "J",
    .formula = "1/2 p.M(q)^-1 p + V(q) on T*S^2",
    .input_meaning = "a spatial torque about each link's own joint, conjugate to its angular velocity",
    .field_meaning =
        "(xi, eta) of each link in se(3): q' = xi x q, p' = xi x p + eta x q; xi is the angular velocity",
    .scheme = "cf4",
    .accurate = "rkmk54",
    .arrays = {{"mass/gamma", 2, 1}, {"mass/b", 1, 1}},
    .usable = lg_hamiltonian_usable_mass,
    .bind = lg_hamiltonian_bind_mass,
    .energy = energy,
    .gradient = gradient,
    .gradient_on_manifold = gradient_on_manifold,
    .ambient = ambient,
    .velocity = velocity,
    .manifold = "|q| = 1 and q.p = 0",
};
