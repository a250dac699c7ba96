/* The cart-pole with a saturated regulator, |u| <= 30: a volume of at least 180 in the box 3.6, 1.5, 12, 12.
 * ctest-labels: slow src/certify src/autodiff */
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

/* ---- the exact motion with a held input ---- */

static lg_status cart_rate(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    out[0] = plant(tape, in[0], in[1]);
    return lg_tape_status(tape);
}

RECORDING(cart_control) {
    y[0] = control(tape, user, x[0]);
}

static void exact_rate(const double *x, double u, double *rate) {
    const double s = sin(x[1]), c = cos(x[1]),
                 a = (u + 0.1 * x[3] * x[3] * s - 0.981 * s * c) / (1 + 0.1 * s * s);
    rate[0] = x[2], rate[1] = x[3], rate[2] = a, rate[3] = 9.81 * s - a * c;
}

/* After `time` with the input u: the classical Runge-Kutta method in steps of less than 1/500 s */
static void move(double *x, double u, double time) {
    const int steps = 1 + (int)(500 * time);
    const double h = time / steps;
    for (int k = 0; k < steps; k++) {
        double rate[4][4], at[4];
        static const double part[4] = {0, 0.5, 0.5, 1};
        for (int s = 0; s < 4; s++) {
            for (int i = 0; i < 4; i++) at[i] = x[i] + (s == 0 ? 0 : part[s] * h * rate[s - 1][i]);
            exact_rate(at, u, rate[s]);
        }
        for (int i = 0; i < 4; i++)
            x[i] += h / 6 * (rate[0][i] + 2 * rate[1][i] + 2 * rate[2][i] + rate[3][i]);
    }
}

static double quadratic(const double *P, const double *x) {
    double sum = 0;
    for (int i = 0; i < 16; i++) sum += x[i / 4] * P[i] * x[i % 4];
    return sum;
}

static double held_rise(const cart *c, const double *P, const double *x) {
    double now[4], u = 0;
    for (int i = 0; i < 4; i++) now[i] = x[i], u -= c->K[i] * x[i];
    move(now, fmax(-c->limit, fmin(c->limit, u)), c->h);
    return quadratic(P, now) - quadratic(P, x);
}

/* The smallest V at which V does not fall in a period: along random directions, then near the best of them */
static double sampled_level(const cart *c, const double *P, double most) {
    lg_rng rng = test_rng(64, 7);
    double best[4] = {0};
    for (int k = 0; k < 400000; k++) {
        double x[4], size = 0.3 * pow(0.99998, k);
        for (int i = 0; i < 4; i++)
            x[i] = k < 100000 ? lg_rng_normal(&rng) : best[i] * (1 + size * lg_rng_normal(&rng));
        if (k < 100000) {
            const double by = sqrt(most * pow(lg_rng_uniform(&rng), 0.1) / quadratic(P, x));
            for (int i = 0; i < 4; i++) x[i] *= by;
        }
        const double V = quadratic(P, x);
        if (V >= most || held_rise(c, P, x) < 0) continue;
        most = V;
        memcpy(best, x, sizeof best);
    }
    return most;
}

/* Regulators of the period h for x' = A x + B u: e^(A h) and its integral by their series. */
static void held_regulator(const double *Q, double R, cart *c, double *P) {
    double A[16], B[4] = {0}, q[16] = {0};
    for (int j = 0; j < 5; j++) {
        double x[4] = {0};
        if (j < 4) x[j] = 1e-6;
        move(x, j == 4 ? 1e-6 : 0, c->h);
        for (int i = 0; i < 4; i++) *(j < 4 ? &A[i * 4 + j] : &B[i]) = x[i] * 1e6;
    }
    for (int i = 0; i < 4; i++) q[5 * i] = Q[i];
    const lg_riccati equation = {sizeof equation, 4, 1, A, B, q, &R, NULL};
    const size_t bytes = lg_riccati_work_size(4, 1);
    assert_told(lg_dare(&equation, P, c->K, NULL, NULL, lg_test_memory(bytes), bytes, &told));
}

TEST("cart-pole, inputs held for .02 and .05 s: at least .96 of the sampled level") {
    static const double periods[2] = {0.02, 0.05}, Q[4] = {1, 1, 1, 1};
    for (int k = 0; k < 2; k++) {
        double P[16];
        cart c = {.limit = 30, .h = periods[k]};
        held_regulator(Q, 0.2, &c, P);
        const lg_port in[2] = {{.name = "x", .shape = lg_shape1(4)}, {.name = "u", .shape = lg_shape1(1)}},
                      out = {.name = "y"};
        const lg_function_spec functions[2] = {{"loop", in, 2, &out, 1, cart_rate, &c},
                                               {"control", in, 1, &out, 1, cart_control, &c}};
        const lg_program_spec program = spec_of(NULL, 0, functions, 2);
        static const double wide[4] = {100, 100, 100, 100}, lowest[4] = {-100, -100, -100, -100};
        lg_certify_spec spec = spec_for(test_program(&program), P, lowest, wide);
        spec.control = "control";
        spec.period = c.h;
        const double truth = sampled_level(&c, P, 1000);
        spec.level = 0.96 * truth;
        const lg_certify_result r = prove(&spec, 60);
        print_message("period %g: %.4g of the sampled level %.6g; between %.4g\n", c.h, r.level / truth,
                      truth, r.between / r.level);
        assert_true(r.verified && r.converges && r.between < 1.4 * r.level);
    }
}
