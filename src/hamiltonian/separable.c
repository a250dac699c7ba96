/* Family "separable": H = 1/2 |A p|^2 + V(q) on R^2n. */
#include "liegrad/ops.h"
#include "hamiltonian/internal.h"

enum { K }; /* vars->kinetic[K] (n, n): A^T A, or its mean over rotations */

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
    lg_var twice = lg_rowdot(tape, y[1], drift(tape, vars, y[1]));
    return lg_add(tape, lg_scale(tape, twice, 0.5), lg_hamiltonian_potential(tape, vars, y[0]));
}

static void gradient(lg_tape *tape, const lg_hamiltonian_vars *vars, const lg_var *y, lg_var *out) {
    out[0] = lg_hamiltonian_potential_gradient(tape, vars, y[0]);
    out[1] = drift(tape, vars, y[1]);
}

static bool learns(const lg_system *system, size_t *n) {
    *n = lg_system_dim(system) / 2;
    return lg_system_separable(system);
}

const lg_hamiltonian_family lg_hamiltonian_separable = {
    .name = "separable",
    .description = "learned separable Hamiltonian",
    .copy = "coordinate",
    .factor = {LG_SPACE_RN, LG_SPACE_RN},
    .factors = 2,
    .scaled = {true, true},
    .inputs = 1,
    .forces = 1,
    .layout = {"q", "p"},
    .state_units = "q: 1, p: 1",
    .energy_unit = "1",
    .formula = "1/2 |A p|^2 + V(q) on R^2n",
    .input_meaning = "forces: p' = -dV/dq + input",
    .field_meaning = "q', then p'",
    .scheme = "stormer-verlet",
    .accurate = "dp54",
    .arrays = {{"kinetic/A", 2, 1}},
    .bind = bind,
    .energy = energy,
    .gradient = gradient,
    .drift = drift,
    .learns = learns,
};
