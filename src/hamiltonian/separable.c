/* Families on R^2n, with parts q and p (B, n).
 *   "separable"    H = 1/2 |A p|^2 + V(q)
 *   "constrained"  H = 1/2 p.v + V(q) on T*Q, Q = {q: g(q) = 0} with g from the user's program;
 *                  liegrad/constraint.h has the formulas. Without a constraint v = M^-1 p. */
#include "hamiltonian/constraint.h"
#include "hamiltonian/internal.h"

/* vars->kinetic[K]: A^T A (n, n), or its mean over rotations; of constrained systems M^-1 (1, n, n). */
enum { K };

/* H with the velocities v. */
static lg_var energy_of(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var v) {
    lg_var twice = lg_rowdot(tape, y[1], v);
    return lg_add(tape, lg_scale(tape, twice, 0.5), lg_hamiltonian_potential(tape, vars, y[0]));
}

#define COORDINATES                                                                                          \
    .copy = "coordinate", .factor = {LG_SPACE_RN, LG_SPACE_RN}, .factors = 2, .scaled = {true, true},        \
    .inputs = 1, .forces = 1, .layout = {"q", "p"}, .state_units = "q: 1, p: 1", .energy_unit = "1",         \
    .field_meaning = "q', then p'", .accurate = "dp54"

/* ---- separable ---- */

/* If V does not change under rotations, K is the mean of R^T A^T A R over all rotations R, which is |A|^2/n
 * times the unit matrix: so H does not change either. */
static void bind(lg_tape *tape, const lg_var *arrays, lg_hamiltonian_vars *vars) {
    const uint32_t n = vars->model->n;
    if (!lg_symmetry_row_of(vars->model->symmetry)->isotropic) {
        vars->kinetic[K] = lg_matmul_tn(tape, arrays[0], arrays[0]);
        return;
    }
    double unit[LG_HAMILTONIAN_MAX_COPIES * LG_HAMILTONIAN_MAX_COPIES] = {0.0};
    for (uint32_t i = 0; i < n; i++) unit[i * n + i] = 1.0 / n;
    vars->kinetic[K] =
        lg_mul(tape, lg_input_f64(tape, lg_shape2(n, n), unit), lg_sum(tape, lg_square(tape, arrays[0])));
}

static lg_var drift(lg_tape *tape, const lg_hamiltonian_vars *vars, lg_var p) {
    return lg_matmul(tape, p, vars->kinetic[K]);
}

static lg_var energy(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    return energy_of(tape, vars, y, drift(tape, vars, y[1]));
}

static void gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    out[0] = lg_hamiltonian_potential_gradient(tape, vars, y[0]);
    out[1] = drift(tape, vars, y[1]);
}

const lg_hamiltonian_family lg_hamiltonian_separable = {
    COORDINATES,
    .name = "separable",
    .description = "learned separable Hamiltonian",
    .formula = "1/2 |A p|^2 + V(q) on R^2n",
    .input_meaning = "forces: p' = -dV/dq + input",
    .scheme = "stormer-verlet",
    .arrays = {{"kinetic/A", 2, 1}},
    .bind = bind,
    .energy = energy,
    .gradient = gradient,
    .drift = drift,
};

/* ---- constrained; scales.part[0] times q is in the units of the program ---- */

static lg_var energy_constrained(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    const lg_hamiltonian *model = vars->model;
    return energy_of(tape, vars, y,
                     lg_constraint_record_velocity(tape, model->constraint, model->scales.part[0],
                                                   vars->kinetic[K], y[0], y[1]));
}

static void gradient_constrained(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y,
                                 lg_var *out) {
    const lg_hamiltonian *model = vars->model;
    const lg_var slope = lg_hamiltonian_potential_gradient(tape, vars, y[0]);
    lg_constraint_record_gradient(tape, model->constraint, model->scales.part[0], vars->kinetic[K], y[0],
                                  y[1], slope, out);
}

const lg_hamiltonian_family lg_hamiltonian_constrained = {
    COORDINATES,
    .name = "constrained",
    .description = "learned Hamiltonian under constraints of the user",
    .formula = "1/2 p.M(q)^-1 p + V(q) on g(q) = 0",
    .input_meaning = "forces: p' = ... + P input",
    .scheme = "rk4",
    .arrays = {{"mass/gamma", 2, 1}, {"mass/b", 1, 1}},
    .usable = lg_hamiltonian_usable_mass,
    .bind = lg_hamiltonian_bind_mass,
    .energy = energy_constrained,
    .gradient = gradient_constrained,
    .constrained = true,
};
