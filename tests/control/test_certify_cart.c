/* The cart-pole with a saturated regulator, |u| <= 30: a volume of at least 180 in the box 3.6, 1.5, 12, 12.
 * ctest-labels: slow src/control src/autodiff */
#include "certify_support.h"

#include "liegrad/control.h"

/* States x, theta (0: upright), x', theta'. m_c 1, m_p .1, l 1, g 9.81; u = -sat(K x). */
typedef struct cart {
    double K[4], limit;
} cart;

RECORDING(cart_pole) {
    const cart *c = user;
    const double mc = 1, mp = 0.1, l = 1, g = 9.81;
    const lg_var tilt = column(tape, x[0], 1), v = column(tape, x[0], 2), w = column(tape, x[0], 3);
    const lg_var K = lg_input_f64(tape, lg_shape2(4, 1), c->K);
    const lg_var u = saturated(tape, lg_neg(tape, lg_matmul(tape, x[0], K)), c->limit);
    const lg_var s = lg_sin(tape, tilt), co = lg_cos(tape, tilt);
    const lg_var mass = lg_add_scalar(tape, lg_scale(tape, lg_square(tape, s), mp), mc);
    const lg_var swing = lg_scale(tape, lg_mul(tape, s, lg_square(tape, w)), mp * l);
    /* x'' = (u + m_p l theta'^2 s - m_p g s c)/(m_c + m_p s^2), theta'' = (g s - x'' c)/l */
    const lg_var force = lg_sub(tape, lg_add(tape, u, swing), lg_scale(tape, lg_mul(tape, s, co), mp * g));
    const lg_var a = lg_div(tape, force, mass);
    const lg_var alpha = lg_scale(tape, lg_sub(tape, lg_scale(tape, s, g), lg_mul(tape, a, co)), 1 / l);
    const lg_var parts[4] = {v, w, a, alpha};
    y[0] = lg_concat(tape, parts, 4, 1);
}

static void regulator(const double *Q, double R, cart *c, double *P) {
    const double A[16] = {0, 0, 1, 0, 0, 0, 0, 1, 0, -0.981, 0, 0, 0, 10.791, 0, 0}, B[4] = {0, 0, 1, -1};
    double q[16] = {0};
    for (int i = 0; i < 4; i++) q[5 * i] = Q[i];
    const lg_riccati equation = {sizeof equation, 4, 1, A, B, q, &R, NULL};
    const size_t bytes = lg_riccati_work_size(4, 1);
    assert_told(lg_care(&equation, P, c->K, NULL, NULL, lg_test_memory(bytes), bytes, &told));
}

/* Weights from a search over the weights for a large level that V' < 0 at 1500 directions suggests; the proof does
 * not depend on them. */
TEST("cart-pole, |u| <= 30: a volume of at least 180 is proved within a minute") {
    const double low[4] = {-3.6, -1.5, -12, -12}, high[4] = {3.6, 1.5, 12, 12};
    const double Q[4] = {1.865, 81.36, 0.2457, 0.6894};
    cart c = {.limit = 30};
    double P[16];
    regulator(Q, 0.056, &c, P);
    for (int i = 0; i < 4; i++) c.K[i] *= 0.8713;
    lg_certify_spec spec = spec_for(loop_program(4, cart_pole, NULL, &c), P, low, high);
    const lg_certify_result r = prove(&spec, 60);
    print_message("%.3g boxes a second\n", (double)r.boxes / r.seconds);
    assert_true(r.verified && r.converges && r.volume >= 180);
}
