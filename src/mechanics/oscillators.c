/* Separable systems on R^2n, y = (q, p), without parameters: the harmonic oscillator; two quartic oscillators
 * that are coupled through the kinetic energy (quartic); and two uncoupled oscillators, the first of them
 * harmonic, whose energy G is a further first integral (coupled-oscillators, for the experiment with noise).
 */
#include "mechanics/engine.h"
#include "mechanics/system.h"

static const lg_parameter_entry no_parameters[] = {{.key = NULL}};
static const lg_state_entry one_degree[] = {
    {.key = "q", .outer = 1, .rows = 1, .columns = 1, .first = 0, .stride = 1},
    {.key = "p", .outer = 1, .rows = 1, .columns = 1, .first = 1, .stride = 1},
    {.key = NULL}};
static const lg_state_entry two_degrees[] = {
    {.key = "q", .outer = 1, .rows = 1, .columns = 2, .first = 0, .stride = 2},
    {.key = "p", .outer = 1, .rows = 1, .columns = 2, .first = 2, .stride = 2},
    {.key = NULL}};
static const char *const energy_only[] = {"energy", NULL};

/* ---- H = (p^2 + q^2)/2 ---- */

static double oscillator_energy(const lg_system *system, size_t index, const double *y, double *work) {
    return 0.5 * (y[0] * y[0] + y[1] * y[1]);
}

/* The midpoint rule: L_d(q0, q1) = h ((q1 - q0)^2/h^2 - (q0 + q1)^2/4)/2, p0 = -D_1 L_d, p1 = D_2 L_d. */
static lg_status oscillator_step(void *user, double t, double h, double *y) {
    const double a = 0.25 * h * h, s = 1.0 / (1.0 + a), q = y[0], p = y[1];
    y[0] = ((1.0 - a) * q + h * p) * s;
    y[1] = ((1.0 - a) * p - h * q) * s;
    return LG_OK;
}

static lg_var oscillator_taped_force(lg_tape *tape, lg_var q, lg_var parameters) {
    return lg_neg(tape, q);
}

static lg_var identity_velocity(lg_tape *tape, lg_var p, lg_var parameters) {
    return p;
}

#define SEPARABLE                                                                                            \
    .parameters = no_parameters, .structure = LG_STRUCTURE_HAMILTONIAN, .force = lg_recorded_force,          \
    .velocity = lg_recorded_velocity
const lg_system_row lg_system_row_oscillator = {
    .name = "oscillator",
    .state = one_degree,
    .factor = {{LG_SPACE_RN, 2}},
    .invariants = energy_only,
    .invariant = oscillator_energy,
    .step = oscillator_step,
    .taped_force = oscillator_taped_force,
    .taped_velocity = identity_velocity,
    SEPARABLE,
};

/* ---- H = 1/2 p^T [5 -1; -1 5] p + (q_1^4 + q_2^4)/4 + (q_1^2 + q_2^2)/2 ---- */

static double quartic_energy(const lg_system *system, size_t index, const double *y, double *work) {
    const double a = y[0] * y[0], b = y[1] * y[1];
    return 0.5 * (5.0 * y[2] * y[2] - 2.0 * y[2] * y[3] + 5.0 * y[3] * y[3]) + 0.25 * (a * a + b * b) +
           0.5 * (a + b);
}

static lg_var quartic_taped_force(lg_tape *tape, lg_var q, lg_var parameters) {
    return lg_neg(tape, lg_mul(tape, q, lg_add_scalar(tape, lg_square(tape, q), 1.0)));
}

static lg_var quartic_taped_velocity(lg_tape *tape, lg_var p, lg_var parameters) {
    static const double inverse_mass[4] = {5.0, -1.0, -1.0, 5.0};
    return lg_matmul(tape, p, lg_input_f64(tape, lg_shape2(2, 2), inverse_mass));
}

const lg_system_row lg_system_row_quartic = {
    .name = "quartic",
    .state = two_degrees,
    .factor = {{LG_SPACE_RN, 4}},
    .invariants = energy_only,
    .invariant = quartic_energy,
    .taped_force = quartic_taped_force,
    .taped_velocity = quartic_taped_velocity,
    SEPARABLE,
};

/* ---- H = (q_1^2 + p_1^2)/2 + p_2^2/2 + q_2^2/2 + q_2^4/4, G = (q_1^2 + p_1^2)/2 ---- */

static double coupled_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const double first = 0.5 * (y[0] * y[0] + y[2] * y[2]), b = y[1] * y[1];
    return index == 0 ? first + 0.5 * (y[3] * y[3] + b) + 0.25 * b * b : first;
}

static lg_var coupled_taped_force(lg_tape *tape, lg_var q, lg_var parameters) {
    static const double second[2] = {0.0, 1.0};
    lg_var cubic = lg_mul(tape, lg_input_f64(tape, lg_shape1(2), second), lg_square(tape, q));
    return lg_neg(tape, lg_mul(tape, q, lg_add_scalar(tape, cubic, 1.0)));
}

static const char *const coupled_invariants[] = {"energy", "G", NULL};

const lg_system_row lg_system_row_coupled = {
    .name = "coupled-oscillators",
    .state = two_degrees,
    .factor = {{LG_SPACE_RN, 4}},
    .invariants = coupled_invariants,
    .invariant = coupled_invariant,
    .taped_force = coupled_taped_force,
    .taped_velocity = identity_velocity,
    SEPARABLE,
};

/* ---- rows of M and V, whose numbers are parameters ---- */

/* sum_i c_i x_i^power / power, (B, 1), for power 2 or 4 and x (B, n). c has n numbers, or one for all x_i. */
static lg_var springs(lg_tape *tape, lg_var c, lg_var x, double power) {
    const lg_var all =
        lg_mul(tape, power == 2.0 ? lg_square(tape, x) : lg_square(tape, lg_square(tape, x)), c);
    return lg_scale(tape, lg_sum_axis(tape, all, 1, true), 1.0 / power);
}

static const double one = 1.0, ones[2] = {1.0, 1.0};
#define STIFFNESS(n, fallback)                                                                               \
    { "stiffness", "k", n, LG_PARAMETER_POSITIVE, fallback, "of the spring, N/m" }
#define CUBIC(n, fallback)                                                                                   \
    { "cubic", "c", n, LG_PARAMETER_FINITE, fallback, "c q^4/4 in V, N/m^3" }

/* ---- oscillator: 1/2 m q'^2 + 1/2 k q^2 ---- */

static const lg_parameter_entry oscillator_parameters[] = {
    {"mass", "m", 1, LG_PARAMETER_POSITIVE, &one, "mass, kg"}, STIFFNESS(1, &one), {.key = NULL}};

static lg_var oscillator_potential(lg_tape *tape, const lg_at *at) {
    return springs(tape, lg_row_number(tape, at, 1), at->state[0], 2.0);
}

const lg_energy_row lg_energy_oscillator = {
    "oscillator", oscillator_parameters, lg_row_diagonal, oscillator_potential, 1, {LG_COORDINATE_LINE},
    .seen = 1};

/* ---- quartic: M = [5 1; 1 5]/24, V = sum_i k_i q_i^2/2 + c_i q_i^4/4 ---- */

static const lg_parameter_entry quartic_parameters[] = {
    {"mass", "m", 1, LG_PARAMETER_POSITIVE, &one, "factor of the mass matrix, kg"},
    STIFFNESS(2, ones),
    CUBIC(2, ones),
    {.key = NULL}};

static lg_var quartic_mass(lg_tape *tape, const lg_at *at) {
    return lg_row_times_matrix(tape, lg_row_number(tape, at, 0), 5.0 / 24.0, 1.0 / 24.0, 5.0 / 24.0);
}

static lg_var quartic_potential(lg_tape *tape, const lg_at *at) {
    return lg_add(tape, springs(tape, lg_row_numbers(tape, at, 1, 2), at->state[0], 2.0),
                  springs(tape, lg_row_numbers(tape, at, 3, 2), at->state[0], 4.0));
}

const lg_energy_row lg_energy_quartic = {"quartic",         quartic_parameters, quartic_mass,
                                         quartic_potential, LG_TWO(LINE, LINE), .seen = 3};

/* ---- coupled-oscillators: M = diag(m), V = sum_i k_i q_i^2/2 + c q_2^4/4 ---- */

static const lg_parameter_entry coupled_parameters[] = {
    {"masses", "m", 2, LG_PARAMETER_POSITIVE, ones, "masses, kg"},
    STIFFNESS(2, ones),
    CUBIC(1, &one),
    {.key = NULL}};

static lg_var coupled_potential(lg_tape *tape, const lg_at *at) {
    const lg_var second = lg_slice(tape, at->state[0], 1, 1, 1);
    return lg_add(tape, springs(tape, lg_row_numbers(tape, at, 2, 2), at->state[0], 2.0),
                  springs(tape, lg_row_number(tape, at, 4), second, 4.0));
}

const lg_energy_row lg_energy_coupled = {"coupled-oscillators", coupled_parameters, lg_row_diagonal,
                                         coupled_potential,     LG_TWO(LINE, LINE), .seen = 3};
