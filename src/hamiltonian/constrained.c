/* Family "constrained": H = 1/2 p.v + V(q) on T*Q, Q = {q: g(q) = 0} in R^n with g from the user's program;
 * liegrad/constraint.h has the formulas. Without a constraint v = M^-1 p. The parts q and p are (B, n). */
#include "hamiltonian/constraint.h"
#include "hamiltonian/internal.h"

enum { W }; /* vars->kinetic[W]: M^-1 (1, n, n) */

/* The unit of q: q times it is in the units of the program. */
static double unit_of(const lg_hamiltonian *model) {
    return model->scales.part[0];
}

static lg_var energy(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y) {
    const lg_hamiltonian *model = vars->model;
    const lg_var v =
        lg_constraint_record_velocity(tape, model->constraint, unit_of(model), vars->kinetic[W], y[0], y[1]);
    const lg_var twice = lg_rowdot(tape, y[1], v);
    return lg_add(tape, lg_scale(tape, twice, 0.5), lg_hamiltonian_potential(tape, vars, y[0]));
}

static void gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    const lg_hamiltonian *model = vars->model;
    const lg_var slope = lg_hamiltonian_potential_gradient(tape, vars, y[0]);
    lg_constraint_record_gradient(tape, model->constraint, unit_of(model), vars->kinetic[W], y[0], y[1],
                                  slope, out);
}

const lg_hamiltonian_family lg_hamiltonian_constrained = {
    .name = "constrained",
    .description = "learned Hamiltonian under constraints of the user",
    .copy = "coordinate",
    .factor = {LG_SPACE_RN, LG_SPACE_RN},
    .factors = 2,
    .scaled = {true, true},
    .inputs = 1,
    .forces = 1,
    .layout = {"q", "p"},
    .state_units = "q: 1, p: 1",
    .energy_unit = "1",
    .formula = "1/2 p.M(q)^-1 p + V(q) on g(q) = 0",
    .input_meaning = "forces: p' = ... + P input",
    .field_meaning = "q', then p'",
    .scheme = "rk4",
    .accurate = "dp54",
    .arrays = {{"mass/gamma", 2, 1}, {"mass/b", 1, 1}},
    .usable = lg_hamiltonian_usable_mass,
    .bind = lg_hamiltonian_bind_mass,
    .energy = energy,
    .gradient = gradient,
    .constrained = true,
};
