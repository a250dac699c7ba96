/* Torque-limited pendulums: m .15, l .5, b .1, g 9.81; attitudes.
 * ctest-labels: src/certify */
#include "certify_support.h"

#include "core/core.h"

typedef struct pendulum {
    double mass, limit, gain;
} pendulum;

/* g(q) = sat(k q) - m g l sin q */
RECORDING(pendulum_slope) {
    const pendulum *p = user;
    const lg_var held = saturated(tape, lg_scale(tape, x[0], p->gain), p->limit);
    y[0] = lg_sub(tape, held, lg_scale(tape, lg_sin(tape, x[0]), p->mass * 9.81 * 0.5));
}

static lg_certify_energy_spec energy_spec(pendulum *p, double gain_of_velocity) {
    lg_certify_energy_spec spec;
    lg_certify_energy_spec_init(&spec);
    spec.program = loop_program(1, pendulum_slope, NULL, p);
    spec.slope = "loop";
    spec.damping = 0.1;
    spec.gain = gain_of_velocity;
    spec.saturated = p->limit / p->gain;
    return spec;
}

static lg_certify_energy_result prove_pendulum(pendulum p) {
    lg_certify_energy_result r;
    const lg_certify_energy_spec spec = energy_spec(&p, 0.06);
    const double start = lg_seconds();
    assert_told(lg_certify_energy(NULL, &spec, &r, &told));
    print_message("%s\n  %s [%g, %g] margin %.6g, near %.3g, %zu boxes, %.4f s\n", r.claim, r.reason,
                  r.failed_low, r.failed_high, r.margin, r.near, r.boxes, lg_seconds() - start);
    return r;
}

TEST("both pendulums converge from every state, with the margins of the torque") {
    const lg_certify_energy_result strong = prove_pendulum((pendulum){0.15, 6, 3});
    const lg_certify_energy_result weak = prove_pendulum((pendulum){0.15, 0.75, 1.6});
    assert_true(strong.verified && weak.verified);
    assert_close(strong.margin, 6 - 0.73575, 2e-3, 0);
    assert_close(weak.margin, 0.75 - 0.73575, 2e-3, 0);
    assert_true(weak.margin <= 0.75 - 0.73575 && strong.margin <= 6 - 0.73575);
}

TEST("with 2 % more mass the second pendulum is refused, with the angle") {
    const lg_certify_energy_result r = prove_pendulum((pendulum){0.153, 0.75, 1.6});
    assert_true(!r.verified && r.margin == 0);
    assert_true(fabs(cos(r.failed_low)) < 0.1 && sin(r.failed_low) > 0.9);
    assert_non_null(strstr(r.reason, "does not exceed the potential's"));
}

TEST("a gain that is too small is refused") {
    const lg_certify_energy_result weak = prove_pendulum((pendulum){0.15, 6, 0.6});
    assert_true(!weak.verified && strstr(weak.reason, "not stiff enough") != NULL);
}

TEST("damping of 0 is refused") {
    pendulum p = {0.15, 6, 3};
    lg_certify_energy_spec spec = energy_spec(&p, 0.3);
    lg_certify_energy_result r;
    lg_error error;
    spec.damping = 0;
    assert_int_equal(lg_certify_energy(NULL, &spec, &r, &error), LG_INVALID_ARGUMENT);
}

RECORDING(jumping_slope) {
    const lg_var side = lg_sign(tape, lg_add_scalar(tape, x[0], -0.01));
    y[0] = lg_add(tape, x[0], lg_add_scalar(tape, side, 1));
}

RECORDING(shifted_slope) {
    y[0] = lg_add_scalar(tape, x[0], 0.1);
}

RECORDING(two_slopes) {
    y[0] = y[1] = lg_scale(tape, x[0], 2);
}

RECORDING(wide_slope) {
    y[0] = lg_concat(tape, (const lg_var[]){x[0], x[0]}, 2, 1);
}

RECORDING(steeper_upward) {
    y[0] = lg_add(tape, x[0], lg_scale(tape, lg_square(tape, x[0]), 2));
}

/* x (x - 1)(x - 2) */
RECORDING(dipping) {
    const lg_var a = lg_add_scalar(tape, x[0], -1), b = lg_add_scalar(tape, x[0], -2);
    y[0] = lg_mul(tape, x[0], lg_mul(tape, a, b));
}

TEST(
    "a torque that is too small on one side, or between the goal and saturation, is refused with the angle") {
    static const struct {
        lg_record_function slope;
        double saturated, from, to; /* where it is refused */
    } rows[] = {{steeper_upward, 0.3, -1.31, -0.5}, {dipping, 3, 1, 2}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        pendulum p = {0.15, 6, 3};
        lg_certify_energy_spec spec = energy_spec(&p, 0.3);
        lg_certify_energy_result r;
        spec.program = loop_program(1, rows[i].slope, NULL, NULL);
        spec.saturated = rows[i].saturated, spec.period = 1;
        assert_told(lg_certify_energy(NULL, &spec, &r, &told));
        assert_true(!r.verified && r.failed_low >= rows[i].from && r.failed_high <= rows[i].to);
    }
}

TEST("numbers out of range, other functions, jumps and a goal that is no equilibrium are refused") {
    pendulum p = {0.15, 6, 3};
    const lg_certify_energy_spec good = energy_spec(&p, 0.3);
    lg_certify_energy_spec bad[7] = {good, good, good, good, good, good, good};
    lg_certify_energy_result r;
    lg_error error;
    bad[0].size = 3, bad[1].gain = -1, bad[2].gain = INFINITY, bad[3].saturated = 0,
    bad[4].saturated = INFINITY;
    bad[5].period = 0, bad[6].damping = INFINITY;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_int_equal(lg_certify_energy(NULL, &bad[i], &r, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "must be positive, the gain at least 0");
    }
    lg_certify_energy_spec other = good;
    other.program = loop_program(2, jumping_slope, NULL, NULL);
    assert_int_equal(lg_certify_energy(NULL, &other, &r, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "needs one number in and one out");
    const lg_port number = {.name = "x", .shape = lg_shape1(1)}, y[2] = {{.name = "y"}, {.name = "z"}};
    const lg_port pair[2] = {number, {.name = "w", .shape = lg_shape1(1)}};
    const lg_function_spec wrong[] = {{"loop", pair, 2, y, 1, shifted_slope, NULL},
                                      {"loop", &number, 1, y, 2, two_slopes, NULL},
                                      {"loop", &number, 1, y, 1, wide_slope, NULL}};
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        const lg_program_spec of = spec_of(NULL, 0, &wrong[i], 1);
        other.program = test_program(&of);
        assert_int_equal(lg_certify_energy(NULL, &other, &r, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "needs one number in and one out");
    }
    other.program = loop_program(1, jumping_slope, NULL, NULL);
    assert_ok(lg_certify_energy(NULL, &other, &r, &error));
    assert_false(r.verified);
    assert_says(r.reason, "may jump");
    other.program = loop_program(1, shifted_slope, NULL, NULL);
    assert_ok(lg_certify_energy(NULL, &other, &r, &error));
    assert_true(!r.verified && strstr(r.reason, "no exact equilibrium") != NULL);
    lg_certify_energy_spec_init(NULL);
}

/* ---- rotation ---- */

static lg_certify_rotation_spec rotation_spec(void) {
    lg_certify_rotation_spec s;
    lg_certify_rotation_spec_init(&s);
    s.J[0] = s.J[4] = s.J[8] = s.stiffness = s.damping = s.limit[0] = 1, s.inputs = 1;
    return s;
}

TEST("rotations: matrices, gains and limits that do not fit are refused; so are loops with too little "
     "stiffness") {
    lg_certify_rotation_result r;
    lg_error error;
#define REFUSED(word, ...)                                                                                   \
    do {                                                                                                     \
        lg_certify_rotation_spec s = rotation_spec();                                                        \
        __VA_ARGS__;                                                                                         \
        assert_true(lg_certify_rotation(&s, &r, &error) != LG_OK);                                           \
        assert_says(error.message, word);                                                                    \
    } while (0)
    REFUSED("inputs are not 1 to", s.size = 3);
    REFUSED("inputs are not 1 to", s.inputs = 0);
    REFUSED("inputs are not 1 to", s.inputs = 1000);
    REFUSED("J is not finite", s.J[4] = NAN);
    REFUSED("J is not symmetric", s.J[1] = 0.5);
    REFUSED("J is not positive definite", s.J[8] = -1);
    REFUSED("gains must not be negative", s.gains[0] = -1);
    REFUSED("gains must not be negative", s.gains[1] = -1);
    REFUSED("gains must not be negative", s.stiffness = INFINITY);
    REFUSED("the limit must be above 0", s.limit[0] = 0);
    REFUSED("the limit must be above 0", s.gains[0] = INFINITY);
#undef REFUSED
    for (int i = 0; i < 2; i++) {
        lg_certify_rotation_spec s = rotation_spec();
        *(i == 0 ? &s.stiffness : &s.damping) = -1;
        assert_ok(lg_certify_rotation(&s, &r, &error));
        assert_true(!r.verified && r.level == 0);
        assert_string_equal(r.reason,
                            i == 0 ? "the stiffness is not positive" : "the damping is not positive");
    }
    lg_certify_rotation_spec_init(NULL);
}

/* The feedback of a policy about one axis: a'' = -k sin a/sqrt((1 + cos a)/2 + 1e-6) - d a', J = k = 1 */
static double turning_rate(double a, double w) {
    return -sin(a) / sqrt(0.5 + 0.5 * cos(a) + 1e-6) - 2 * w;
}

/* Whether the motion goes to the goal; it may also pass the angle pi. */
static bool returns(double a, double w) {
    const double h = 1e-3;
    for (int i = 0; i < 100000 && a < 3.2 && fabs(a) + fabs(w) > 0.1; i++) {
        const double wm = w + 0.5 * h * turning_rate(a, w), am = a + 0.5 * h * w; /* the midpoint rule */
        a += h * wm;
        w += h * turning_rate(am, wm);
    }
    return fabs(a) + fabs(w) <= 0.1;
}

TEST(
    "rotations: the potential is the work of the feedback up to the angle pi, and motions from the set go to "
    "the goal") {
    enum { N = 100000 };
    lg_certify_rotation_spec s = rotation_spec();
    lg_certify_rotation_result r;
    double work = 0;
    s.damping = s.gains[1] = 2, s.gains[0] = 1, s.limit[0] = 20, s.map[0] = 1;
    assert_ok(lg_certify_rotation(&s, &r, NULL));
    print_message("%s\n", r.claim);
    for (int i = 0; i < N; i++) work -= turning_rate(3.141592653589793 * (i + 0.5) / N, 0);
    assert_close(r.critical, work * 3.141592653589793 / N, 1e-6, 0);
    assert_true(r.verified && r.level < r.critical && r.level > 0.999 * r.critical && r.angle > 3.1415);
    /* w^2/2 = level - the potential at a */
    for (double from_pi = 1e-4; from_pi < 3; from_pi *= 2) {
        const double a = 3.141592653589793 - from_pi, c = cos(0.5 * a);
        const double rest = r.level - 4 * (sqrt(1 + 1e-6) - sqrt(c * c + 1e-6));
        assert_true(returns(a, sqrt(2 * rest)) && returns(a, -sqrt(2 * rest)));
    }
    assert_true(returns(r.angle, 0) && !returns(3.141592653589793 - 0.006, 0.14));
}

TEST("sentences do not say more than what is proved") {
    double x;
    lg_certify_rotation_spec s = rotation_spec();
    lg_certify_rotation_result r;
    s.gains[0] = 1, s.map[0] = 1;
    for (int i = 0; i < 50; i++) {
        s.limit[0] = 0.1 + 0.01 * i;
        assert_ok(lg_certify_rotation(&s, &r, NULL));
        assert_int_equal(sscanf(strstr(r.claim, "c = "), "c = %lf", &x), 1);
        assert_true(x <= r.level && x > r.level * (1 - 1e-5));
        assert_int_equal(sscanf(strstr(r.claim, "rest up to "), "rest up to %lf", &x), 1);
        assert_true(x <= r.angle && x > r.angle * (1 - 1e-5));
        const double A[9] = {s.limit[0] / 3, 0, 0, 0, 1, 0, 0, 0, 1};
        lg_certify_attitude_result t;
        assert_ok(lg_certify_attitude(A, 1, &t, NULL));
        assert_int_equal(sscanf(strstr(t.claim, "c = "), "c = %lf", &x), 1);
        assert_true(x <= t.level && x > t.level * (1 - 1e-5));
        const lg_certify_energy_result e = prove_pendulum((pendulum){0.15, 6 + s.limit[0] / 3, 3});
        assert_int_equal(sscanf(strstr(e.claim, "by at least "), "by at least %lf", &x), 1);
        assert_true(x <= e.margin && x > e.margin * (1 - 1e-5));
        assert_int_equal(sscanf(strstr(e.claim, "|q| >= "), "|q| >= %lf", &x), 1);
        assert_true(x >= (6 + s.limit[0] / 3) / 3);
    }
}

/* ---- attitude ---- */

/* Phi at the rotation by pi about axis k: tr(A (1 - Q)) with Q = 2 e e^T - 1 */
static double at_half_turn(const double *A, const double *e) {
    double sum = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) sum += A[3 * i + j] * ((i == j ? 2.0 : 0.0) - 2 * e[j] * e[i]);
    return sum;
}

TEST("attitude: the level is the lowest critical value of the energy, and a potential without one is "
     "refused") {
    /* eigenvectors (1, 1, 0), (1, -1, 0), (0, 0, 1); eigenvalues 3, 1, 2 */
    const double A[9] = {2, 1, 0, 1, 2, 0, 0, 0, 2}, root = sqrt(0.5);
    const double axis[3][3] = {{root, root, 0}, {root, -root, 0}, {0, 0, 1}};
    lg_certify_attitude_result r;
    assert_ok(lg_certify_attitude(A, 0.1, &r, NULL));
    print_message("%s\n", r.claim);
    assert_true(r.verified && r.level <= 6 && r.level > 6 - 1e-9);
    assert_close(r.critical[0], at_half_turn(A, axis[0]), 1e-9, 0);
    assert_close(r.critical[1], at_half_turn(A, axis[2]), 1e-9, 0);
    assert_close(r.critical[2], at_half_turn(A, axis[1]), 1e-9, 0);
    const double saddle[9] = {3, 0, 0, 0, 1, 0, 0, 0, -1};
    assert_ok(lg_certify_attitude(saddle, 0.1, &r, NULL));
    assert_true(!r.verified && r.level == 0 && strstr(r.reason, "no higher than the goal") != NULL);
    assert_ok(lg_certify_attitude(A, 0, &r, NULL));
    assert_true(!r.verified);
}
