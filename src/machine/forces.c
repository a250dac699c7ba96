/* Machines: damping, input maps and residuals. Learned damping coefficients are squares of parameters,
 * learned matrices D are L L^T, so that v.f <= 0. */
#include <stdio.h>

#include "machine/internal.h"

/* Initial value of the parameters of learned damping. The coefficients, or the diagonal of D, are then
 * START^2. */
static const double START = 0.1;

static size_t one_each(const lg_machine *machine, const lg_machine_term *term) {
    return machine->velocities;
}

/* The values of a term as a matrix (velocities, columns) in scaled units; with `line` they are its diagonal.
 * It multiplies numbers whose scales are `right`. A force in the log's units is the scaled one times E/L. */
static lg_var known_matrix(const lg_term_at *at, uint32_t columns, bool line, const double *right) {
    const lg_machine_scales *s = &at->machine->scales;
    const uint32_t n = at->n;
    uint32_t index[LG_MACHINE_VALUES];
    double factor[LG_MACHINE_VALUES];
    for (uint32_t k = 0; k < n * columns; k++) {
        const uint32_t i = k / columns, j = k % columns;
        index[k] = !line ? k : i == j ? i : UINT32_MAX;
        factor[k] = s->velocity[i] / s->energy * right[j];
    }
    return lg_reshape(at->tape, lg_machine_record_entries(at, n * columns, index, factor),
                      lg_shape2(n, columns));
}

/* ---- damping ---- */

/* -c x, with the coefficients c of a power of v. */
static lg_var drag(const lg_term_at *at, int power, lg_var x) {
    return lg_neg(at->tape, lg_mul(at->tape, lg_machine_record_drag(at, power), x));
}

static lg_var known_damping(const lg_term_at *at) {
    const lg_machine_scales *s = &at->machine->scales;
    const uint32_t n = at->n;
    double speed[LG_MACHINE_VELOCITIES];
    for (uint32_t j = 0; j < n; j++) speed[j] = s->velocity[j] / s->time;
    const lg_var D = known_matrix(at, n, at->term->value_count == n, speed);
    return lg_neg(at->tape, lg_matmul_nt(at->tape, at->seen->v, D));
}

static lg_var diagonal(const lg_term_at *at) {
    return drag(at, 1, at->seen->v);
}

/* Number of parameters: the packed triangle L of D = L L^T. */
static size_t triangle(const lg_machine *machine, const lg_machine_term *term) {
    return lg_triangle(machine->velocities);
}

static void start_triangle(const lg_machine *machine, const lg_machine_term *term, double *theta) {
    for (uint32_t i = 0; i < machine->velocities; i++) theta[i] = START;
}

static lg_var constant(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const uint32_t n = at->n;
    const lg_var packed = lg_reshape(tape, at->theta, lg_shape2(1, lg_triangle(n)));
    const lg_var L = lg_reshape(tape, lg_machine_record_triangle(tape, packed, n, false), lg_shape2(n, n));
    return lg_neg(tape, lg_matmul_nt(tape, lg_matmul(tape, at->seen->v, L), L));
}

static uint32_t triangle_outputs(const lg_machine *machine) {
    return lg_triangle(machine->velocities);
}

static lg_var damping_network(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const uint32_t n = at->n, rows = at->seen->rows;
    const lg_var L = lg_machine_record_triangle(tape, lg_machine_record_network(at), n, false);
    const lg_var v = lg_reshape(tape, at->seen->v, lg_shape3(rows, n, 1));
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

static lg_var coulomb_limit(const lg_term_at *at) {
    return lg_machine_record_drag(at, 0);
}

/* The force -c |v| v. */
static lg_var quadratic(const lg_term_at *at) {
    return drag(at, 2, lg_mul(at->tape, lg_abs(at->tape, at->seen->v), at->seen->v));
}

/* The force -c v^3. */
static lg_var cubic(const lg_term_at *at) {
    return drag(at, 3, lg_mul(at->tape, lg_square(at->tape, at->seen->v), at->seen->v));
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

static lg_var known_map(const lg_term_at *at) {
    const lg_machine *machine = at->machine;
    return lg_matmul_nt(at->tape, at->seen->u,
                        known_matrix(at, machine->input_count, false, machine->scales.input));
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

static lg_var constant_map(const lg_term_at *at) {
    const lg_shape shape = lg_shape2(at->n, at->machine->input_count);
    return lg_matmul_nt(at->tape, at->seen->u, lg_reshape(at->tape, at->theta, shape));
}

static lg_var map_network(const lg_term_at *at) {
    lg_tape *tape = at->tape;
    const uint32_t n = at->n, m = at->machine->input_count, rows = at->seen->rows;
    const lg_var B = lg_reshape(tape, lg_machine_record_network(at), lg_shape3(rows, n, m));
    const lg_var u = lg_reshape(tape, at->seen->u, lg_shape3(rows, m, 1));
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
