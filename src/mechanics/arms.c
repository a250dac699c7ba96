/* Carts, pendulums and arms of lines and angles: rows of M and V, of which derived.c makes their fields. */
#include "mechanics/engine.h"
#include "mechanics/system.h"

static const double one = 1.0, ones[2] = {1.0, 1.0}, small = 0.1, gravity_fallback = 9.81;
#define GRAVITY                                                                                              \
    { "gravity", "g", 1, LG_PARAMETER_FINITE, &gravity_fallback, "acceleration of gravity, m/s^2" }

/* m g L cos(q_2), from the indices of these parameters. */
static lg_var pole_potential(lg_tape *tape, const lg_at *at, uint32_t mass, uint32_t gravity,
                             uint32_t length) {
    const lg_var weight = lg_mul(tape, lg_row_number(tape, at, mass), lg_row_number(tape, at, gravity));
    const lg_var cosine = lg_cos(tape, lg_slice(tape, at->state[0], 1, 1, 1));
    return lg_mul(tape, cosine, lg_mul(tape, weight, lg_row_number(tape, at, length)));
}

/* ---- cart-pole: a point mass at the end of the pole, at height L cos(theta); theta is 0 upright ---- */

static const lg_parameter_entry cart_parameters[] = {
    {"cart", "m_c", 1, LG_PARAMETER_POSITIVE, &one, "mass of the cart, kg"},
    {"pole", "m_p", 1, LG_PARAMETER_POSITIVE, &small, "mass at the end of the pole, kg"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &one, "of the pole, m"},
    GRAVITY,
    {.key = NULL}};
enum { CART, POLE, POLE_LENGTH, CART_GRAVITY };

static lg_var cart_mass(lg_tape *tape, const lg_at *at) {
    const lg_var pole = lg_row_number(tape, at, POLE), L = lg_row_number(tape, at, POLE_LENGTH),
                 arm = lg_mul(tape, pole, L);
    const lg_var cosine = lg_cos(tape, lg_slice(tape, at->state[0], 1, 1, 1));
    const lg_var fixed =
        lg_add(tape, lg_row_times_matrix(tape, lg_add(tape, lg_row_number(tape, at, CART), pole), 1, 0, 0),
               lg_row_times_matrix(tape, lg_mul(tape, arm, L), 0, 0, 1));
    return lg_add(tape, fixed, lg_row_times_matrix(tape, lg_mul(tape, cosine, arm), 0, 1, 0));
}

static lg_var cart_potential(lg_tape *tape, const lg_at *at) {
    return pole_potential(tape, at, POLE, CART_GRAVITY, POLE_LENGTH);
}

const lg_energy_row lg_energy_cart_pole = {
    "cart-pole", cart_parameters, cart_mass, cart_potential, LG_TWO(LINE, ANGLE), .seen = 2, .moving = true};

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
static lg_var rotary_mass(lg_tape *tape, const lg_at *at) {
    const lg_var m = lg_row_number(tape, at, ROTARY_POLE), r = lg_row_number(tape, at, RADIUS),
                 c = lg_row_number(tape, at, CENTRE);
    const lg_var K =
        lg_add(tape, lg_row_number(tape, at, ROTARY_INERTIA), lg_mul(tape, m, lg_square(tape, c)));
    const lg_var arm = lg_add(tape, lg_row_number(tape, at, ROTARY_ARM), lg_mul(tape, m, lg_square(tape, r)));
    const lg_var q = lg_slice(tape, at->state[0], 1, 1, 1);
    const lg_var lifted = lg_mul(tape, lg_square(tape, lg_sin(tape, q)), K),
                 coupling = lg_mul(tape, lg_cos(tape, q), lg_mul(tape, m, lg_mul(tape, r, c)));
    const lg_var fixed =
        lg_add(tape, lg_row_times_matrix(tape, arm, 1, 0, 0), lg_row_times_matrix(tape, K, 0, 0, 1));
    return lg_add(tape, fixed,
                  lg_add(tape, lg_row_times_matrix(tape, lifted, 1, 0, 0),
                         lg_row_times_matrix(tape, coupling, 0, 1, 0)));
}

static lg_var rotary_potential(lg_tape *tape, const lg_at *at) {
    return pole_potential(tape, at, ROTARY_POLE, ROTARY_GRAVITY, CENTRE);
}

const lg_energy_row lg_energy_rotary = {"rotary-pendulum", rotary_parameters,    rotary_mass,
                                        rotary_potential,  LG_TWO(ANGLE, ANGLE), .seen = 2,
                                        .moving = true};

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
static lg_var link_inertia(lg_tape *tape, const lg_at *at, uint32_t i) {
    const lg_var square = lg_square(tape, lg_row_number(tape, at, CENTRES + i));
    return lg_add(tape, lg_row_number(tape, at, ARM_INERTIA + i),
                  lg_mul(tape, lg_row_number(tape, at, ARM_MASSES + i), square));
}

static lg_var arm_mass(lg_tape *tape, const lg_at *at) {
    const lg_var second = lg_row_number(tape, at, ARM_MASSES + 1), L = lg_row_number(tape, at, ARM_LENGTH);
    const lg_var first = lg_add(tape, link_inertia(tape, at, 0), lg_mul(tape, second, lg_square(tape, L)));
    const lg_var coupling = lg_mul(tape, lg_mul(tape, second, lg_row_number(tape, at, CENTRES + 1)), L);
    const lg_var cosine = lg_cos(tape, lg_slice(tape, at->state[0], 1, 1, 1));
    const lg_var fixed = lg_add(tape, lg_row_times_matrix(tape, first, 1, 0, 0),
                                lg_row_times_matrix(tape, link_inertia(tape, at, 1), 1, 1, 1));
    return lg_add(tape, fixed, lg_row_times_matrix(tape, lg_mul(tape, cosine, coupling), 2, 1, 0));
}

static lg_var arm_potential(lg_tape *tape, const lg_at *at) {
    const lg_var q1 = lg_slice(tape, at->state[0], 1, 0, 1), q2 = lg_slice(tape, at->state[0], 1, 1, 1);
    const lg_var m1 = lg_row_number(tape, at, ARM_MASSES), m2 = lg_row_number(tape, at, ARM_MASSES + 1);
    const lg_var upper = lg_add(tape, lg_mul(tape, m1, lg_row_number(tape, at, CENTRES)),
                                lg_mul(tape, m2, lg_row_number(tape, at, ARM_LENGTH)));
    const lg_var lower = lg_mul(tape, m2, lg_row_number(tape, at, CENTRES + 1));
    const lg_var below = lg_add(tape, lg_mul(tape, lg_cos(tape, q1), upper),
                                lg_mul(tape, lg_cos(tape, lg_add(tape, q1, q2)), lower));
    return lg_neg(tape, lg_mul(tape, below, lg_row_number(tape, at, ARM_GRAVITY)));
}

const lg_energy_row lg_energy_arm = {"two-link-arm",       arm_parameters, arm_mass,      arm_potential,
                                     LG_TWO(ANGLE, ANGLE), .seen = 3,      .moving = true};
