/* tests/consumer/stranger adds this system: a rigid body turns freely, and a cart on a spring moves along e1
 * and carries a pendulum on S^2. M couples a direction and a line. */
#include "mechanics/engine.h"
#include "mechanics/system.h"

static const double one = 1.0, moments[3] = {1.0, 2.0, 3.0}, gravity = 9.81;
static const lg_parameter_entry parameters[] = {
    {"inertia", "J", 3, LG_PARAMETER_POSITIVE, moments, "principal moments of the body, kg m^2"},
    {"cart", "M", 1, LG_PARAMETER_POSITIVE, &one, "mass of the cart, kg"},
    {"pole", "m", 1, LG_PARAMETER_POSITIVE, &one, "mass at the end of the pendulum, kg"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &one, "of the pendulum, m"},
    {"stiffness", "k", 1, LG_PARAMETER_FINITE, &one, "stiffness of the spring, N/m"},
    {"gravity", "g", 1, LG_PARAMETER_FINITE, &gravity, "acceleration of gravity, m/s^2"},
    {.key = NULL}};
enum { CART = 3, POLE, LENGTH, STIFFNESS, GRAVITY };

static lg_var times(lg_tape *tape, lg_var number, const double *matrix) {
    return lg_mul(tape, number, lg_input_f64(tape, lg_shape3(1, 7, 7), matrix));
}

/* v = (body rates, q', x'): M = diag(J, m L^2 I_3, M + m), with m L at (q_1, x). */
static lg_var mass(lg_tape *tape, const lg_at *at) {
    static const double direction[49] = {[24] = 1.0, [32] = 1.0, [40] = 1.0}, line[49] = {[48] = 1.0},
                        both[49] = {[27] = 1.0, [45] = 1.0};
    const lg_var m = lg_row_number(tape, at, POLE), L = lg_row_number(tape, at, LENGTH),
                 arm = lg_mul(tape, m, L);
    const lg_var J = lg_mul(tape, lg_reshape(tape, lg_row_numbers(tape, at, 0, 3), lg_shape3(1, 1, 3)),
                            lg_unit_matrix(tape, 3));
    const lg_var cart = lg_add(tape, lg_row_number(tape, at, CART), m);
    lg_var M = lg_pad(tape, lg_pad(tape, J, 1, 0, 4), 2, 0, 4);
    M = lg_add(tape, M, times(tape, lg_mul(tape, arm, L), direction));
    return lg_add(tape, M, lg_add(tape, times(tape, cart, line), times(tape, arm, both)));
}

/* m g L q_3 + k x^2/2 */
static lg_var potential(lg_tape *tape, const lg_at *at) {
    const lg_var weight = lg_mul(tape, lg_row_number(tape, at, POLE), lg_row_number(tape, at, GRAVITY));
    const lg_var q = lg_reshape(tape, lg_slice(tape, at->state[1], 2, 2, 1), lg_shape2(at->rows, 1));
    const lg_var height = lg_mul(tape, q, lg_mul(tape, weight, lg_row_number(tape, at, LENGTH)));
    const lg_var square = lg_mul(tape, lg_square(tape, at->state[0]), lg_row_number(tape, at, STIFFNESS));
    return lg_add(tape, height, lg_scale(tape, square, 0.5));
}

const lg_energy_row lg_energy_swing = {
    "swing",   parameters, mass,
    potential, 3,          {LG_COORDINATE_ROTATION, LG_COORDINATE_DIRECTION, LG_COORDINATE_LINE},
    .seen = 6};
