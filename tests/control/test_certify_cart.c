/* The cart-pole with a saturated regulator, |u| <= 30: a volume of at least 180 in the box 3.6, 1.5, 12, 12.
 * ctest-labels: slow src/control src/autodiff */
#include "certify_support.h"

#include "liegrad/control.h"

/* States x, theta (0: upright), x', theta'. m_c 1, m_p .1, l 1, g 9.81; u = -sat(K x). */
typedef struct cart {
    double K[4], limit, h;
} cart;

static lg_var plant(lg_tape *tape, lg_var x, lg_var u) {
    const double mc = 1, mp = 0.1, l = 1, g = 9.81;
    const lg_var tilt = column(tape, x, 1), v = column(tape, x, 2), w = column(tape, x, 3);
    const lg_var s = lg_sin(tape, tilt), co = lg_cos(tape, tilt);
    const lg_var mass = lg_add_scalar(tape, lg_scale(tape, lg_square(tape, s), mp), mc);
    const lg_var swing = lg_scale(tape, lg_mul(tape, s, lg_square(tape, w)), mp * l);
    /* x'' = (u + m_p l theta'^2 s - m_p g s c)/(m_c + m_p s^2), theta'' = (g s - x'' c)/l */
    const lg_var force = lg_sub(tape, lg_add(tape, u, swing), lg_scale(tape, lg_mul(tape, s, co), mp * g));
    const lg_var a = lg_div(tape, force, mass);
    const lg_var alpha = lg_scale(tape, lg_sub(tape, lg_scale(tape, s, g), lg_mul(tape, a, co)), 1 / l);
    const lg_var parts[4] = {v, w, a, alpha};
    return lg_concat(tape, parts, 4, 1);
}

static lg_var control(lg_tape *tape, const cart *c, lg_var x) {
    const lg_var K = lg_input_f64(tape, lg_shape2(4, 1), c->K);
    return saturated(tape, lg_neg(tape, lg_matmul(tape, x, K)), c->limit);
}

RECORDING(cart_pole) {
    y[0] = plant(tape, x[0], control(tape, user, x[0]));
}

/* A step of Heun's method of c->h seconds with the input held */
RECORDING(cart_step) {
    const cart *c = user;
    const lg_var u = control(tape, c, x[0]), first = plant(tape, x[0], u);
    const lg_var second = plant(tape, lg_add(tape, x[0], lg_scale(tape, first, c->h)), u);
    y[0] = lg_add(tape, x[0], lg_scale(tape, lg_add(tape, first, second), 0.5 * c->h));
}

static void regulator(const double *Q, double R, cart *c, double *P) {
    const double A[16] = {0, 0, 1, 0, 0, 0, 0, 1, 0, -0.981, 0, 0, 0, 10.791, 0, 0}, B[4] = {0, 0, 1, -1};
    double q[16] = {0};
    for (int i = 0; i < 4; i++) q[5 * i] = Q[i];
    const lg_riccati equation = {sizeof equation, 4, 1, A, B, q, &R, NULL};
    const size_t bytes = lg_riccati_work_size(4, 1);
    assert_told(lg_care(&equation, P, c->K, NULL, NULL, lg_test_memory(bytes), bytes, &told));
}

static const double low[4] = {-3.6, -1.5, -12, -12}, high[4] = {3.6, 1.5, 12, 12};

/* Weights from a search over the weights for a large level that V' < 0 at 1500 directions suggests; the
 * proof does not depend on them. */
static cart chosen(double *P) {
    const double Q[4] = {1.865, 81.36, 0.2457, 0.6894};
    cart c = {.limit = 30, .h = 0.01};
    regulator(Q, 0.056, &c, P);
    for (int i = 0; i < 4; i++) c.K[i] *= 0.8713;
    return c;
}

TEST("cart-pole, |u| <= 30: a volume of at least 180 is proved within a minute") {
    double P[16];
    cart c = chosen(P);
    lg_certify_spec spec = spec_for(loop_program(4, cart_pole, NULL, &c), P, low, high);
    const lg_certify_result r = prove(&spec, 60);
    print_message("%.3g boxes a second\n", (double)r.boxes / r.seconds);
    assert_true(r.verified && r.converges && r.volume >= 180);
}

TEST("cart-pole, an error of the model of .05 in both accelerations") {
    const double error[4] = {0, 0, 0.05, 0.05};
    double P[16];
    cart c = chosen(P);
    lg_certify_spec spec = spec_for(loop_program(4, cart_pole, NULL, &c), P, low, high);
    spec.model_error = error;
    const lg_certify_result r = prove(&spec, 60);
    assert_true(r.verified && !r.converges && r.volume >= 100 && r.eps < 3);
}

TEST("cart-pole, inputs held for .01 s") {
    double P[16];
    cart c = chosen(P);
    lg_certify_spec spec = spec_for(loop_program(4, cart_step, NULL, &c), P, low, high);
    spec.step = true;
    const lg_certify_result r = prove(&spec, 60);
    assert_true(r.verified && r.converges && r.volume >= 100);
}
