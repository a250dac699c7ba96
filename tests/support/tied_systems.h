/* Systems in which directions are beside other coordinates, or whose mass depends on directions. */
#ifndef LG_TIED_SYSTEMS_H
#define LG_TIED_SYSTEMS_H

#include "support/machine_support.h"

#include "liegrad/ops.h"

/* A constant matrix (1, n, n) that is 0 except for these entries. */
static inline lg_var matrix_of(lg_tape *tape, uint32_t n, size_t count, const uint32_t (*at)[2],
                               const double *values) {
    double M[LG_MACHINE_VALUES] = {0};
    for (size_t i = 0; i < count; i++) M[at[i][0] * n + at[i][1]] = values[i];
    return lg_input_f64(tape, lg_shape3(1, n, n), M);
}

/* ---- a load that hangs from a cart on a spring, q on S^2 from the cart to the load ---- */

static const double tied_one = 1.0, tied_gravity = 9.81;
static const lg_parameter_entry crane_parameters[] = {
    {"cart", "M", 1, LG_PARAMETER_POSITIVE, &tied_one, "mass of the cart"},
    {"load", "m", 1, LG_PARAMETER_POSITIVE, &tied_one, "mass of the load"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &tied_one, "length of the rope"},
    {"stiffness", "k", 1, LG_PARAMETER_POSITIVE, &tied_one, "stiffness of the spring"},
    {"gravity", "g", 1, LG_PARAMETER_FINITE, &tied_gravity, "acceleration along -e3"},
    {.key = NULL}};

/* v = (q', x'): T = (M + m) x'^2/2 + m L x' e1.q' + m L^2 |q'|^2/2. */
static lg_var crane_mass(lg_tape *tape, const lg_at *at) {
    static const uint32_t swing[3][2] = {{0, 0}, {1, 1}, {2, 2}}, both[2][2] = {{0, 3}, {3, 0}},
                          cart[1][2] = {{3, 3}};
    static const double ones[3] = {1, 1, 1};
    const lg_var M = lg_row_number(tape, at, 0), m = lg_row_number(tape, at, 1),
                 mL = lg_mul(tape, m, lg_row_number(tape, at, 2)),
                 turning = lg_mul(tape, lg_mul(tape, mL, lg_row_number(tape, at, 2)),
                                  matrix_of(tape, 4, 3, swing, ones)),
                 coupling = lg_mul(tape, mL, matrix_of(tape, 4, 2, both, ones));
    return lg_add(tape, lg_add(tape, turning, coupling),
                  lg_mul(tape, lg_add(tape, M, m), matrix_of(tape, 4, 1, cart, ones)));
}

/* k x^2/2 + m g L q_3. */
static lg_var crane_potential(lg_tape *tape, const lg_at *at) {
    const lg_var height = lg_reshape(tape, lg_slice(tape, at->state[1], 2, 2, 1), lg_shape2(at->rows, 1)),
                 mL = lg_mul(tape, lg_row_number(tape, at, 1), lg_row_number(tape, at, 2)),
                 spring = lg_mul(tape, lg_square(tape, at->state[0]), lg_row_number(tape, at, 3));
    return lg_add(tape, lg_mul(tape, height, lg_mul(tape, mL, lg_row_number(tape, at, 4))),
                  lg_scale(tape, spring, 0.5));
}

static const lg_energy_row crane_row = {"crane",         crane_parameters,        crane_mass,
                                        crane_potential, LG_TWO(DIRECTION, LINE), .seen = 3};

/* ---- every kind of factor; M = diag + c c^T, where c depends on all positions ---- */

static const double tied_moments[8] = {0.7, 1.1, 0.9, 0.8, 1.3, 0.6, 1.2, 1.4};
static const lg_parameter_entry full_parameters[] = {
    {"moments", "a", 8, LG_PARAMETER_POSITIVE, tied_moments, "diagonal of M"},
    {"coupling", "b", 1, LG_PARAMETER_POSITIVE, &tied_one, "factor of c c^T"},
    {"weight", "w", 1, LG_PARAMETER_POSITIVE, &tied_one, "factor of V"},
    {.key = NULL}};

/* (B, 8): the last row of R, q, the line and the sine of the angle. */
static lg_var full_positions(lg_tape *tape, const lg_at *at) {
    const uint32_t rows = at->rows;
    const lg_var x = at->state[0], R = lg_reshape(tape, at->state[2], lg_shape2(rows, 9)),
                 all[] = {lg_slice(tape, R, 1, 6, 3), lg_reshape(tape, at->state[1], lg_shape2(rows, 3)),
                          lg_slice(tape, x, 1, 0, 1), lg_sin(tape, lg_slice(tape, x, 1, 1, 1))};
    return lg_concat(tape, all, 4, 1);
}

static lg_var full_mass(lg_tape *tape, const lg_at *at) {
    const lg_var c = lg_reshape(tape, full_positions(tape, at), lg_shape3(at->rows, 8, 1));
    return lg_add(tape, lg_row_diagonal(tape, at),
                  lg_mul(tape, lg_matmul_nt(tape, c, c), lg_row_number(tape, at, 8)));
}

/* w (sum_i i c_i)^2/2. */
static lg_var full_potential(lg_tape *tape, const lg_at *at) {
    static const double weights[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    const lg_var sum =
        lg_matmul(tape, full_positions(tape, at), lg_input_f64(tape, lg_shape2(8, 1), weights));
    return lg_scale(tape, lg_mul(tape, lg_square(tape, sum), lg_row_number(tape, at, 9)), 0.05);
}

static const lg_energy_row full_row = {
    "full",     full_parameters,
    full_mass,  full_potential,
    4,          {LG_COORDINATE_ROTATION, LG_COORDINATE_DIRECTION, LG_COORDINATE_LINE, LG_COORDINATE_ANGLE},
    .seen = 15, .moving = true};

/* ---- two directions with a constant mass, one direction with a mass that moves ---- */

static const lg_parameter_entry rods_parameters[] = {
    {"moments", "a", 6, LG_PARAMETER_POSITIVE, tied_moments, "diagonal of M"},
    {"coupling", "b", 1, LG_PARAMETER_POSITIVE, &tied_one, "factor of the coupling"},
    {.key = NULL}};

static lg_var rods_mass(lg_tape *tape, const lg_at *at) {
    static const uint32_t places[6][2] = {{0, 1}, {1, 0}, {0, 4}, {4, 0}, {2, 5}, {5, 2}};
    static const double values[6] = {0.2, 0.2, 0.3, 0.3, -0.25, -0.25};
    return lg_add(tape, lg_row_diagonal(tape, at),
                  lg_mul(tape, matrix_of(tape, 6, 6, places, values), lg_row_number(tape, at, 6)));
}

static const lg_energy_row rods_row = {
    "rods", rods_parameters, rods_mass, NULL, LG_TWO(DIRECTION, DIRECTION), .seen = 0};
static const lg_parameter_entry rod_parameters[] = {
    {"moments", "a", 3, LG_PARAMETER_POSITIVE, tied_moments, "diagonal of M"}, {.key = NULL}};

/* diag + q q^T/2 + q_1^2 e3 e3^T/2; the tie q.q' = 0 makes the second part vanish. */
static lg_var rod_mass(lg_tape *tape, const lg_at *at) {
    static const uint32_t last[1][2] = {{2, 2}};
    static const double half = 0.5;
    const lg_var q = lg_reshape(tape, at->state[0], lg_shape3(at->rows, 3, 1)),
                 square = lg_scale(tape, lg_matmul_nt(tape, q, q), 0.5),
                 part = lg_mul(tape, lg_square(tape, lg_slice(tape, q, 1, 0, 1)),
                               matrix_of(tape, 3, 1, last, &half));
    return lg_add(tape, lg_add(tape, lg_row_diagonal(tape, at), square), part);
}

static const lg_energy_row rod_row = {"rod",     rod_parameters, rod_mass, NULL, 1, {LG_COORDINATE_DIRECTION},
                                      .seen = 1, .moving = true};

/* ---- two directions between a rotation and a line, with a mass that moves as that of `full` ---- */

static const double swings_moments[10] = {0.7, 1.1, 0.9, 0.8, 1.3, 0.6, 1.2, 1.4, 0.5, 1.6};
static const lg_parameter_entry swings_parameters[] = {
    {"moments", "a", 10, LG_PARAMETER_POSITIVE, swings_moments, "diagonal of M"},
    {"coupling", "b", 1, LG_PARAMETER_POSITIVE, &tied_one, "factor of c c^T"},
    {.key = NULL}};

/* (B, 10): the last row of R, both directions, the line. */
static lg_var swings_mass(lg_tape *tape, const lg_at *at) {
    const uint32_t rows = at->rows;
    const lg_var R = lg_reshape(tape, at->state[2], lg_shape2(rows, 9)),
                 all[] = {lg_slice(tape, R, 1, 6, 3), lg_reshape(tape, at->state[1], lg_shape2(rows, 6)),
                          at->state[0]},
                 c = lg_reshape(tape, lg_concat(tape, all, 3, 1), lg_shape3(rows, 10, 1));
    return lg_add(tape, lg_row_diagonal(tape, at),
                  lg_mul(tape, lg_matmul_nt(tape, c, c), lg_row_number(tape, at, 10)));
}

static const lg_energy_row swings_row = {
    "swings",
    swings_parameters,
    swings_mass,
    NULL,
    4,
    {LG_COORDINATE_ROTATION, LG_COORDINATE_DIRECTION, LG_COORDINATE_DIRECTION, LG_COORDINATE_LINE},
    .seen = 15,
    .moving = true};

static const lg_energy_row *const tied_rows[] = {&crane_row, &full_row, &rods_row, &rod_row, &swings_row};

/* A machine of the system whose parameters are all unknown; without its other terms. */
static inline lg_machine tied_system(const lg_energy_row *row) {
    lg_machine machine = empty_machine();
    for (uint32_t i = 0; i < row->count; i++)
        add_coordinate(&machine, (const char[]){(char)('a' + i), '\0'}, row->coordinates[i]);
    assert_told(lg_grey_use(&machine, row, &told));
    for (const lg_parameter_entry *p = row->parameters; p->key != NULL; p++)
        assert_told(lg_machine_set_parameter(&machine, p->key, 0, NULL, (const bool[]){true}, &told));
    return machine;
}

/* The same with an input, further masses of every kind, a further potential and damping. */
static inline lg_machine tied_machine(const lg_energy_row *row) {
    lg_machine machine = tied_system(row);
    add_input(&machine, "u");
    odd_scales(&machine);
    const lg_machine_offsets all = lg_machine_offsets_of(&machine, machine.coordinate_count);
    double *known = some_values(all.velocity);
    same_mass_of_directions(&machine, known);
    add_values(add_term(&machine, LG_MACHINE_MASS, "known"), all.velocity, known);
    add_term(&machine, LG_MACHINE_MASS, "diagonal");
    add_term(&machine, LG_MACHINE_MASS, "constant");
    if (row == &full_row)
        see_everything(&machine, add_term(&machine, LG_MACHINE_MASS, "network"), false, false);
    see_everything(&machine, add_term(&machine, LG_MACHINE_POTENTIAL, "network"), false, false);
    add_term(&machine, LG_MACHINE_DAMPING, "constant");
    add_term(&machine, LG_MACHINE_INPUT_MAP, "constant");
    assert_machine(&machine);
    return machine;
}

#endif
