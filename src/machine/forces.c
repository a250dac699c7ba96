/* Machines: damping, input maps and residuals. Learned damping coefficients are squares of parameters,
 * learned matrices D are L L^T, so that v.f <= 0. */
#include <stdio.h>

#include "liegrad/ops.h"
#include "machine/internal.h"

/* Initial value of the parameters of learned damping. The coefficients, or the diagonal of D, are then
 * START^2. */
static const double START = 0.1;

static size_t one_each(const lg_machine *machine, const lg_machine_term *term) {
    return machine->velocities;
}

/* ---- scales: a force in the log's units is the scaled force times E/L ---- */

static void left_scales(const lg_machine *machine, double *left) {
    for (uint32_t i = 0; i < machine->velocities; i++)
        left[i] = machine->scales.velocity[i] / machine->scales.energy;
}

/* ---- damping ---- */

static lg_var drag(lg_tape *tape, lg_var coefficient, lg_var v) {
    return lg_neg(tape, lg_mul(tape, coefficient, v));
}

static lg_var known_damping(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                            const lg_machine_seen *seen) {
    const lg_machine *machine = vars->machine;
    const uint32_t n = machine->velocities;
    const bool line = machine->terms[term].value_count == n;
    uint32_t index[LG_MACHINE_VALUES];
    double left[LG_MACHINE_VELOCITIES], factor[LG_MACHINE_VALUES];
    left_scales(machine, left);
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < n; j++) {
            index[i * n + j] = !line ? i * n + j : i == j ? i : UINT32_MAX;
            factor[i * n + j] = left[i] * (machine->scales.velocity[j] / machine->scales.time);
        }
    const lg_var D = lg_machine_record_entries(tape, vars, term, n * n, index, factor);
    return lg_neg(tape, lg_matmul_nt(tape, seen->v, lg_reshape(tape, D, lg_shape2(n, n))));
}

static lg_var diagonal(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                       const lg_machine_seen *seen) {
    return drag(tape, lg_machine_record_drag(tape, vars, term, 1), seen->v);
}

/* Number of parameters: the packed triangle L of D = L L^T. */
static size_t triangle(const lg_machine *machine, const lg_machine_term *term) {
    return lg_triangle(machine->velocities);
}

static void start_triangle(const lg_machine *machine, const lg_machine_term *term, double *theta) {
    for (uint32_t i = 0; i < machine->velocities; i++) theta[i] = START;
}

static lg_var constant(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                       const lg_machine_seen *seen) {
    const uint32_t n = vars->machine->velocities;
    const lg_var packed = lg_reshape(tape, vars->theta[term], lg_shape2(1, lg_triangle(n)));
    const lg_var L = lg_reshape(tape, lg_machine_record_triangle(tape, packed, n, false), lg_shape2(n, n));
    return lg_neg(tape, lg_matmul_nt(tape, lg_matmul(tape, seen->v, L), L));
}

static uint32_t triangle_outputs(const lg_machine *machine) {
    return lg_triangle(machine->velocities);
}

static lg_var damping_network(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                              const lg_machine_seen *seen) {
    const uint32_t n = vars->machine->velocities, rows = seen->rows;
    const lg_var L =
        lg_machine_record_triangle(tape, lg_machine_record_network(tape, vars, term, seen), n, false);
    const lg_var v = lg_reshape(tape, seen->v, lg_shape3(rows, n, 1));
    const lg_var f = lg_matmul(tape, L, lg_matmul_tn(tape, L, v));
    return lg_neg(tape, lg_reshape(tape, f, lg_shape2(rows, n)));
}

static void drag_entry(const lg_machine *machine, const char *what, int power, uint32_t index,
                       lg_entry_about *out) {
    char name[48];
    *out = (lg_entry_about){.unit = lg_machine_drag_unit(machine, index, index, power),
                            .start = START * START,
                            .positive = true,
                            .single = true};
    lg_machine_velocity_name(machine, index, name, sizeof name);
    (void)snprintf(out->name, sizeof out->name, "%s.%s", what, name);
}

/* A value of a known damping. */
static void damping_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                          lg_entry_about *out) {
    const uint32_t n = machine->velocities;
    const bool line = term->value_count != n * n;
    const uint32_t i = line ? index : index / n, j = line ? index : index % n;
    drag_entry(machine, "damping", 1, i, out);
    out->unit = lg_machine_drag_unit(machine, i, j, 1);
    out->single = i == j;
}

#define DRAG_ENTRY(name, power)                                                                              \
    static void name##_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,         \
                             lg_entry_about *out) {                                                          \
        drag_entry(machine, #name, power, index, out);                                                       \
    }
DRAG_ENTRY(coulomb, 0)
DRAG_ENTRY(quadratic, 2)
DRAG_ENTRY(cubic, 3)

static lg_var coulomb_limit(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                            const lg_machine_seen *seen) {
    return lg_machine_record_drag(tape, vars, term, 0);
}

/* The force -c |v| v. */
static lg_var quadratic(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                        const lg_machine_seen *seen) {
    const lg_var vv = lg_mul(tape, lg_abs(tape, seen->v), seen->v);
    return drag(tape, lg_machine_record_drag(tape, vars, term, 2), vv);
}

/* The force -c v^3. */
static lg_var cubic(lg_tape *tape, const lg_machine_vars *vars, uint32_t term, const lg_machine_seen *seen) {
    const lg_var vvv = lg_mul(tape, lg_square(tape, seen->v), seen->v);
    return drag(tape, lg_machine_record_drag(tape, vars, term, 3), vvv);
}

/* ---- direction of scale ---- */

/* Of forces that are quadratic in the parameters. */
static void scale_squares(const lg_machine *machine, const lg_machine_term *term, const double *theta,
                          double *direction) {
    for (size_t i = 0; i < term->parameters; i++) direction[i] = theta[i] / 2.0;
    lg_machine_scale_entries(machine, term, theta, direction);
}

/* The network's outputs are L of D = L L^T: its last layer is scaled. */
static void scale_network(const lg_machine *machine, const lg_machine_term *term, const double *theta,
                          double *direction) {
    const size_t last = lg_mlp_weight_offset(&term->net, term->net.layers - 1);
    for (size_t i = 0; i < term->parameters; i++) direction[i] = i < last ? 0.0 : theta[i] / 2.0;
}

/* ---- input maps ---- */

static lg_var known_map(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                        const lg_machine_seen *seen) {
    const lg_machine *machine = vars->machine;
    const uint32_t n = machine->velocities, m = machine->input_count;
    double left[LG_MACHINE_VELOCITIES], factor[LG_MACHINE_VALUES];
    left_scales(machine, left);
    for (uint32_t i = 0; i < n * m; i++) factor[i] = left[i / m] * machine->scales.input[i % m];
    const lg_var B = lg_machine_record_entries(tape, vars, term, n * m, NULL, factor);
    return lg_matmul_nt(tape, seen->u, lg_reshape(tape, B, lg_shape2(n, m)));
}

/* Initially input j drives velocity j. */
static void map_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                      lg_entry_about *out) {
    const uint32_t i = index / machine->input_count, j = index % machine->input_count;
    *out = (lg_entry_about){.unit = lg_machine_drag_unit(machine, i, i, 0) / machine->scales.input[j],
                            .start = i == j ? 1.0 : 0.0,
                            .single = true};
    (void)snprintf(out->name, sizeof out->name, "input_map.%u.%u", i + 1, j + 1);
}

static uint32_t map_outputs(const lg_machine *machine) {
    return machine->velocities * machine->input_count;
}

static size_t map_parameters(const lg_machine *machine, const lg_machine_term *term) {
    return map_outputs(machine);
}

static lg_var constant_map(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                           const lg_machine_seen *seen) {
    const lg_machine *machine = vars->machine;
    const lg_var B =
        lg_reshape(tape, vars->theta[term], lg_shape2(machine->velocities, machine->input_count));
    return lg_matmul_nt(tape, seen->u, B);
}

static lg_var map_network(lg_tape *tape, const lg_machine_vars *vars, uint32_t term,
                          const lg_machine_seen *seen) {
    const uint32_t n = vars->machine->velocities, m = vars->machine->input_count, rows = seen->rows;
    const lg_var B =
        lg_reshape(tape, lg_machine_record_network(tape, vars, term, seen), lg_shape3(rows, n, m));
    const lg_var u = lg_reshape(tape, seen->u, lg_shape3(rows, m, 1));
    return lg_reshape(tape, lg_matmul(tape, B, u), lg_shape2(rows, n));
}

/* ---- residuals ---- */

static uint32_t velocity_outputs(const lg_machine *machine) {
    return machine->velocities;
}

/* ---- the table ---- */

#define ANY (LG_TERM_OF | LG_TERM_MOVING)
/* Damping whose numbers are squares of one parameter for each velocity. */
#define SQUARES                                                                                              \
    .part = LG_MACHINE_DAMPING, .each = LG_PARAMETER_SQUARED, .parameters = one_each, .scaling = scale_squares
const lg_term_kind lg_machine_force_kinds[] = {
    {.name = "known",
     .part = LG_MACHINE_DAMPING,
     .options = LG_TERM_VALUES | LG_TERM_KNOWN,
     .values = lg_machine_square_values,
     .entry = damping_entry,
     .scaling = lg_machine_scale_entries,
     .record = known_damping},
    {.name = "diagonal", .options = LG_TERM_VALUES, .entry = damping_entry, .record = diagonal, SQUARES},
    {.name = "constant",
     .part = LG_MACHINE_DAMPING,
     .numbers = lg_numbers_constant_damping,
     .parameters = triangle,
     .initialise = start_triangle,
     .scaling = scale_squares,
     .record = constant},
    {.name = "network",
     .part = LG_MACHINE_DAMPING,
     .options = ANY | LG_TERM_HIDDEN,
     .outputs = triangle_outputs,
     .scaling = scale_network,
     .record = damping_network},
    {.name = "coulomb",
     .options = LG_TERM_WIDTH | LG_TERM_VALUES,
     .entry = coulomb_entry,
     .limit = coulomb_limit,
     .record = lg_machine_record_rubbing,
     SQUARES},
    {.name = "quadratic", .options = LG_TERM_VALUES, .entry = quadratic_entry, .record = quadratic, SQUARES},
    {.name = "cubic", .options = LG_TERM_VALUES, .entry = cubic_entry, .record = cubic, SQUARES},
    {.name = "known",
     .part = LG_MACHINE_INPUT_MAP,
     .options = LG_TERM_VALUES | LG_TERM_KNOWN,
     .parameters = map_parameters,
     .entry = map_entry,
     .record = known_map},
    {.name = "constant",
     .part = LG_MACHINE_INPUT_MAP,
     .each = LG_PARAMETER_ITSELF,
     .parameters = map_parameters,
     .entry = map_entry,
     .record = constant_map},
    {.name = "network",
     .part = LG_MACHINE_INPUT_MAP,
     .options = LG_TERM_OF | LG_TERM_HIDDEN,
     .outputs = map_outputs,
     .record = map_network},
    {.name = "polynomial",
     .part = LG_MACHINE_RESIDUAL,
     .options = ANY | LG_TERM_DEGREE,
     .least = 1,
     .parameters = lg_machine_polynomial_parameters,
     .record = lg_machine_record_polynomial},
    {.name = "network",
     .part = LG_MACHINE_RESIDUAL,
     .options = ANY | LG_TERM_HIDDEN,
     .outputs = velocity_outputs,
     .record = lg_machine_record_network},
    {.name = NULL}};
