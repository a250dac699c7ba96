/* The table of systems. The functions of a row record M and V on a tape, in the units of the log. */
#include "liegrad/ops.h"
#include "machine/internal.h"

/* ---- building blocks of formulas ---- */

/* The system's numbers first .. first + count - 1. */
static lg_var numbers(lg_tape *tape, const lg_grey_view *at, uint32_t first, uint32_t count) {
    return lg_slice(tape, at->parameters, 0, first, count);
}

static lg_var number(lg_tape *tape, const lg_grey_view *at, uint32_t place) {
    return numbers(tape, at, place, 1);
}

/* A diagonal matrix (1, n, n), n = count, with the system's numbers from `first` on. */
static lg_var diagonal(lg_tape *tape, const lg_grey_view *at, uint32_t first, uint32_t count) {
    return lg_mul(tape, lg_reshape(tape, numbers(tape, at, first, count), lg_shape3(1, 1, count)),
                  lg_machine_unit_matrix(tape, count));
}

/* The matrix [a b; b d] times c; c is one number or (B, 1). */
static lg_var times_matrix(lg_tape *tape, lg_var c, double a, double b, double d) {
    const uint32_t rows = (uint32_t)lg_shape_count(lg_var_shape(tape, c));
    const lg_var M = lg_input_f64(tape, lg_shape3(1, 2, 2), (const double[]){a, b, b, d});
    return lg_mul(tape, lg_reshape(tape, c, lg_shape3(rows, 1, 1)), M);
}

/* sum_i c_i x_i^power / power, (B, 1), for power 2 or 4 and x (B, n). c has n numbers, or one for all x_i. */
static lg_var springs(lg_tape *tape, lg_var c, lg_var x, double power) {
    const lg_var all =
        lg_mul(tape, power == 2.0 ? lg_square(tape, x) : lg_square(tape, lg_square(tape, x)), c);
    return lg_scale(tape, lg_sum_axis(tape, all, 1, true), 1.0 / power);
}

static const double one = 1.0, ones[2] = {1.0, 1.0}, gravity_fallback = 9.81;
#define STIFFNESS(n, fallback)                                                                               \
    { "stiffness", "k", n, LG_PARAMETER_POSITIVE, fallback, "of the spring, N/m" }
#define CUBIC(n, fallback)                                                                                   \
    { "cubic", "c", n, LG_PARAMETER_FINITE, fallback, "c q^4/4 in V, N/m^3" }
#define GRAVITY                                                                                              \
    { "gravity", "g", 1, LG_PARAMETER_FINITE, &gravity_fallback, "m/s^2, downward" }

/* ---- oscillator: 1/2 m q'^2 + 1/2 k q^2 ---- */

static const lg_parameter_entry oscillator_parameters[] = {
    {"mass", "m", 1, LG_PARAMETER_POSITIVE, &one, "mass, kg"}, STIFFNESS(1, &one), {.key = NULL}};

static lg_var oscillator_mass(lg_tape *tape, const lg_grey_view *at) {
    return diagonal(tape, at, 0, 1);
}

static lg_var oscillator_potential(lg_tape *tape, const lg_grey_view *at) {
    return springs(tape, number(tape, at, 1), at->x, 2.0);
}

/* ---- quartic: M = [5 1; 1 5]/24, V = sum_i k_i q_i^2/2 + c_i q_i^4/4 ---- */

static const lg_parameter_entry quartic_parameters[] = {
    {"mass", "m", 1, LG_PARAMETER_POSITIVE, &one, "factor of the mass matrix, kg"},
    STIFFNESS(2, ones),
    CUBIC(2, ones),
    {.key = NULL}};

static lg_var quartic_mass(lg_tape *tape, const lg_grey_view *at) {
    return times_matrix(tape, number(tape, at, 0), 5.0 / 24.0, 1.0 / 24.0, 5.0 / 24.0);
}

static lg_var quartic_potential(lg_tape *tape, const lg_grey_view *at) {
    return lg_add(tape, springs(tape, numbers(tape, at, 1, 2), at->x, 2.0),
                  springs(tape, numbers(tape, at, 3, 2), at->x, 4.0));
}

/* ---- coupled-oscillators: M = diag(m), V = sum_i k_i q_i^2/2 + c q_2^4/4 ---- */

static const lg_parameter_entry coupled_parameters[] = {
    {"masses", "m", 2, LG_PARAMETER_POSITIVE, ones, "masses, kg"},
    STIFFNESS(2, ones),
    CUBIC(1, &one),
    {.key = NULL}};

static lg_var coupled_mass(lg_tape *tape, const lg_grey_view *at) {
    return diagonal(tape, at, 0, 2);
}

static lg_var coupled_potential(lg_tape *tape, const lg_grey_view *at) {
    const lg_var second = lg_machine_columns(tape, at->x, 1, 1);
    return lg_add(tape, springs(tape, numbers(tape, at, 2, 2), at->x, 2.0),
                  springs(tape, number(tape, at, 4), second, 4.0));
}

/* ---- bodies with a fixed point: M = diag(I); heavy-top also V = m L gamma0.R chi ---- */

enum { INERTIA = 0, MASS = 3, LENGTH = 4, CHI = 5, GAMMA0 = 8 };

static lg_var body_mass(lg_tape *tape, const lg_grey_view *at) {
    return diagonal(tape, at, INERTIA, 3);
}

static lg_var top_potential(lg_tape *tape, const lg_grey_view *at) {
    const lg_var R = lg_reshape(tape, at->R, lg_shape3(at->rows, 3, 3));
    const lg_var chi = lg_reshape(tape, numbers(tape, at, CHI, 3), lg_shape3(1, 3, 1)),
                 gamma0 = lg_reshape(tape, numbers(tape, at, GAMMA0, 3), lg_shape3(1, 1, 3));
    const lg_var along = lg_matmul(tape, gamma0, lg_matmul(tape, R, chi)); /* (B, 1, 1) */
    const lg_var weight = lg_mul(tape, number(tape, at, MASS), number(tape, at, LENGTH));
    return lg_mul(tape, lg_reshape(tape, along, lg_shape2(at->rows, 1)), weight);
}

/* ---- cart-pole: a point mass at the end of the pole, at height L cos(theta); theta is 0 upright ---- */

static const double small = 0.1;
static const lg_parameter_entry cart_parameters[] = {
    {"cart", "m_c", 1, LG_PARAMETER_POSITIVE, &one, "mass of the cart, kg"},
    {"pole", "m_p", 1, LG_PARAMETER_POSITIVE, &small, "mass at the end of the pole, kg"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &one, "of the pole, m"},
    GRAVITY,
    {.key = NULL}};
enum { CART, POLE, POLE_LENGTH, CART_GRAVITY };

static lg_var cart_mass(lg_tape *tape, const lg_grey_view *at) {
    const lg_var pole = number(tape, at, POLE), L = number(tape, at, POLE_LENGTH),
                 arm = lg_mul(tape, pole, L);
    const lg_var cosine = lg_cos(tape, lg_machine_columns(tape, at->x, 1, 1));
    const lg_var fixed = lg_add(tape, times_matrix(tape, lg_add(tape, number(tape, at, CART), pole), 1, 0, 0),
                                times_matrix(tape, lg_mul(tape, arm, L), 0, 0, 1));
    return lg_add(tape, fixed, times_matrix(tape, lg_mul(tape, cosine, arm), 0, 1, 0));
}

static lg_var cart_potential(lg_tape *tape, const lg_grey_view *at) {
    const lg_var weight = lg_mul(tape, number(tape, at, POLE), number(tape, at, CART_GRAVITY));
    const lg_var cosine = lg_cos(tape, lg_machine_columns(tape, at->x, 1, 1));
    return lg_mul(tape, cosine, lg_mul(tape, weight, number(tape, at, POLE_LENGTH)));
}

/* ---- rotary-pendulum (Furuta): q_1 turns the arm about the vertical, q_2 is 0 upright ---- */

static const lg_parameter_entry rotary_parameters[] = {
    {"arm", "J", 1, LG_PARAMETER_POSITIVE, NULL, "inertia of motor and arm about the vertical, kg m^2"},
    {"radius", "r", 1, LG_PARAMETER_POSITIVE, NULL, "from the vertical to the pole's hinge, m"},
    {"pole", "m", 1, LG_PARAMETER_POSITIVE, NULL, "mass of the pole, kg"},
    {"centre", "c", 1, LG_PARAMETER_POSITIVE, NULL, "from the hinge to the pole's centre of mass, m"},
    {"inertia", "I", 1, LG_PARAMETER_POSITIVE, NULL, "of the slender pole about its centre of mass, kg m^2"},
    GRAVITY,
    {.key = NULL}};
enum { ROTARY_ARM, RADIUS, ROTARY_POLE, CENTRE, ROTARY_INERTIA, ROTARY_GRAVITY };

/* M = [J + m r^2 + K sin(q_2)^2, m r c cos(q_2); ., K], K = I + m c^2 */
static lg_var rotary_mass(lg_tape *tape, const lg_grey_view *at) {
    const lg_var m = number(tape, at, ROTARY_POLE), r = number(tape, at, RADIUS),
                 c = number(tape, at, CENTRE);
    const lg_var K = lg_add(tape, number(tape, at, ROTARY_INERTIA), lg_mul(tape, m, lg_square(tape, c)));
    const lg_var arm = lg_add(tape, number(tape, at, ROTARY_ARM), lg_mul(tape, m, lg_square(tape, r)));
    const lg_var q = lg_machine_columns(tape, at->x, 1, 1);
    const lg_var lifted = lg_mul(tape, lg_square(tape, lg_sin(tape, q)), K),
                 coupling = lg_mul(tape, lg_cos(tape, q), lg_mul(tape, m, lg_mul(tape, r, c)));
    const lg_var fixed = lg_add(tape, times_matrix(tape, arm, 1, 0, 0), times_matrix(tape, K, 0, 0, 1));
    return lg_add(tape, fixed,
                  lg_add(tape, times_matrix(tape, lifted, 1, 0, 0), times_matrix(tape, coupling, 0, 1, 0)));
}

static lg_var rotary_potential(lg_tape *tape, const lg_grey_view *at) {
    const lg_var weight = lg_mul(tape, number(tape, at, ROTARY_POLE), number(tape, at, ROTARY_GRAVITY));
    const lg_var cosine = lg_cos(tape, lg_machine_columns(tape, at->x, 1, 1));
    return lg_mul(tape, cosine, lg_mul(tape, weight, number(tape, at, CENTRE)));
}

/* ---- two-link-arm: q_1 is 0 straight down, q_2 is relative to the first link ---- */

static const double half[2] = {0.5, 0.5}, rods[2] = {1.0 / 12.0, 1.0 / 12.0};
static const lg_parameter_entry arm_parameters[] = {
    {"masses", "m", 2, LG_PARAMETER_POSITIVE, ones, "masses of the links, kg"},
    {"centres", "c", 2, LG_PARAMETER_POSITIVE, half, "from each joint to the centre of mass, m"},
    {"inertia", "I", 2, LG_PARAMETER_POSITIVE, rods, "of each link about its centre of mass, kg m^2"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &one, "from joint to joint, m"},
    GRAVITY,
    {.key = NULL}};
enum { ARM_MASSES = 0, CENTRES = 2, ARM_INERTIA = 4, ARM_LENGTH = 6, ARM_GRAVITY = 7 };

/* Inertia of link i about its own joint: I_i + m_i c_i^2. */
static lg_var link_inertia(lg_tape *tape, const lg_grey_view *at, uint32_t i) {
    const lg_var square = lg_square(tape, number(tape, at, CENTRES + i));
    return lg_add(tape, number(tape, at, ARM_INERTIA + i),
                  lg_mul(tape, number(tape, at, ARM_MASSES + i), square));
}

static lg_var arm_mass(lg_tape *tape, const lg_grey_view *at) {
    const lg_var second = number(tape, at, ARM_MASSES + 1), L = number(tape, at, ARM_LENGTH);
    const lg_var first = lg_add(tape, link_inertia(tape, at, 0), lg_mul(tape, second, lg_square(tape, L)));
    const lg_var coupling = lg_mul(tape, lg_mul(tape, second, number(tape, at, CENTRES + 1)), L);
    const lg_var cosine = lg_cos(tape, lg_machine_columns(tape, at->x, 1, 1));
    const lg_var fixed = lg_add(tape, times_matrix(tape, first, 1, 0, 0),
                                times_matrix(tape, link_inertia(tape, at, 1), 1, 1, 1));
    return lg_add(tape, fixed, times_matrix(tape, lg_mul(tape, cosine, coupling), 2, 1, 0));
}

static lg_var arm_potential(lg_tape *tape, const lg_grey_view *at) {
    const lg_var q1 = lg_machine_columns(tape, at->x, 0, 1), q2 = lg_machine_columns(tape, at->x, 1, 1);
    const lg_var m1 = number(tape, at, ARM_MASSES), m2 = number(tape, at, ARM_MASSES + 1);
    const lg_var upper = lg_add(tape, lg_mul(tape, m1, number(tape, at, CENTRES)),
                                lg_mul(tape, m2, number(tape, at, ARM_LENGTH)));
    const lg_var lower = lg_mul(tape, m2, number(tape, at, CENTRES + 1));
    const lg_var below = lg_add(tape, lg_mul(tape, lg_cos(tape, q1), upper),
                                lg_mul(tape, lg_cos(tape, lg_add(tape, q1, q2)), lower));
    return lg_neg(tape, lg_mul(tape, below, number(tape, at, ARM_GRAVITY)));
}

/* ---- pendulum-chain: m_ij = mu_max(i,j) L_i L_j, V = sum_i mu_i g L_i e3.q_i, mu_i = m_i + m_{i+1} + ... */

enum { CHAIN_GRAVITY = 0, CHAIN_MASSES = 1 }; /* followed by the lengths */

/* The matrix A (1, k, k) with A_il = L_i for l >= i, else 0. M is A diag(m) A^T. */
static lg_var chain_lengths(lg_tape *tape, const lg_grey_view *at) {
    double ones_above[LG_MACHINE_VALUES] = {0.0};
    const uint32_t k = at->links;
    for (uint32_t i = 0; i < k; i++)
        for (uint32_t l = i; l < k; l++) ones_above[i * k + l] = 1.0;
    return lg_mul(tape, lg_reshape(tape, numbers(tape, at, CHAIN_MASSES + k, k), lg_shape3(1, k, 1)),
                  lg_input_f64(tape, lg_shape3(1, k, k), ones_above));
}

static lg_var chain_mass(lg_tape *tape, const lg_grey_view *at) {
    const uint32_t k = at->links;
    const lg_var A = chain_lengths(tape, at),
                 m = lg_reshape(tape, numbers(tape, at, CHAIN_MASSES, k), lg_shape3(1, 1, k));
    return lg_matmul_nt(tape, lg_mul(tape, A, m), A);
}

static lg_var chain_potential(lg_tape *tape, const lg_grey_view *at) {
    const uint32_t k = at->links;
    const lg_var m = lg_reshape(tape, numbers(tape, at, CHAIN_MASSES, k), lg_shape3(1, k, 1));
    const lg_var heights = lg_slice(tape, at->q, 2, 2, 1); /* (B, k, 1) */
    const lg_var all = lg_mul(tape, heights, lg_matmul(tape, chain_lengths(tape, at), m));
    const lg_var V = lg_sum_axis(tape, lg_reshape(tape, all, lg_shape2(at->rows, k)), 1, true);
    return lg_mul(tape, V, number(tape, at, CHAIN_GRAVITY));
}

/* ---- the table ---- */

const lg_grey_system lg_grey_systems[] = {
    {.name = "oscillator",
     .parameters = oscillator_parameters,
     .count = 1,
     .coordinates = {LG_COORDINATE_LINE},
     .seen = 1,
     .mass = oscillator_mass,
     .potential = oscillator_potential},
    {.name = "quartic",
     .parameters = quartic_parameters,
     .count = 2,
     .coordinates = {LG_COORDINATE_LINE, LG_COORDINATE_LINE},
     .seen = 3,
     .mass = quartic_mass,
     .potential = quartic_potential},
    {.name = "coupled-oscillators",
     .parameters = coupled_parameters,
     .count = 2,
     .coordinates = {LG_COORDINATE_LINE, LG_COORDINATE_LINE},
     .seen = 3,
     .mass = coupled_mass,
     .potential = coupled_potential},
    {.name = "rigid-body-attitude", .count = 1, .coordinates = {LG_COORDINATE_ROTATION}, .mass = body_mass},
    {.name = "heavy-top",
     .count = 1,
     .coordinates = {LG_COORDINATE_ROTATION},
     .seen = 1,
     .mass = body_mass,
     .potential = top_potential},
    {.name = "pendulum-chain",
     .coordinates = {LG_COORDINATE_DIRECTION},
     .seen = ~0U,
     .directions = chain_mass,
     .potential = chain_potential},
    {.name = "cart-pole",
     .parameters = cart_parameters,
     .count = 2,
     .coordinates = {LG_COORDINATE_LINE, LG_COORDINATE_ANGLE},
     .seen = 2,
     .moving = true,
     .mass = cart_mass,
     .potential = cart_potential},
    {.name = "rotary-pendulum",
     .parameters = rotary_parameters,
     .count = 2,
     .coordinates = {LG_COORDINATE_ANGLE, LG_COORDINATE_ANGLE},
     .seen = 2,
     .moving = true,
     .mass = rotary_mass,
     .potential = rotary_potential},
    {.name = "two-link-arm",
     .parameters = arm_parameters,
     .count = 2,
     .coordinates = {LG_COORDINATE_ANGLE, LG_COORDINATE_ANGLE},
     .seen = 3,
     .moving = true,
     .mass = arm_mass,
     .potential = arm_potential},
    {.name = NULL}};

const lg_grey_refused lg_grey_refusals[] = {
    {"rigid-body", "its state is the body momentum alone, and logs have positions: take "
                   "rigid-body-attitude with a coordinate of kind rotation"},
    {"quadrotors",
     "they fly by a control law of their own that depends on the time: give coordinates of kind "
     "pose with a diagonal mass, gravity and an input map"},
    {.name = NULL}};
