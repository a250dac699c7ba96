/* The stepper and its loops: exact cases, memory, reuse of field values, step control, invalid input. */
#include "support/fixtures.h"

#include "liegrad/geometry.h"
#include "integrators/stepper.h"
#include "kernels/kernels.h"

#define PI 3.14159265358979323846

/* y' = a . y, where `user` points to the constant a. */
FIELD(constant_field, y) {
    memcpy(out, user, 6 * sizeof(double));
}

/* constant_field as an ambient field. */
FIELD(turning_field, y) {
    lg_se3_generator(user, y, out);
}

/* R^2: y' = (t^4, input or 0). */
FIELD(time_field, y) {
    out[0] = t * t * t * t;
    out[1] = input ? input[0] : 0.0;
}

/* R^1: y' = y^2, which becomes infinite at t = 1/y0. `user`: NULL, or points to the status to return. */
static lg_status blow_up_field(void *user, double t, const double *y, const double *input, double *out) {
    out[0] = y[0] * y[0];
    return user ? *(lg_status *)user : LG_OK;
}

FIELD(sqrt_field, y) {
    out[0] = sqrt(0.5 - t); /* NaN for t > 1/2 */
}

static lg_stepper *make(const char *name, lg_ode ode) {
    return test_stepper(lg_scheme_find(name), &ode);
}

static lg_ode ode_on(lg_space_kind kind, size_t count, lg_vector_field field, void *user) {
    lg_ode ode = {.field = field, .user = user};
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){kind, count}, 1));
    return ode;
}

/* Stages must be evaluated at t + c_i h: order 5 integrates t^4 exactly, and the quadrature of order 4 has a
 * known error. */
TEST("stages get the right time and the input") {
    double y0[2] = {0.0, 0.0}, out[4 * 2];
    const double inputs[3] = {1.0, -2.0, 4.0};
    lg_stepper *stepper = make("rkmk5", ode_on(LG_SPACE_RN, 2, time_field, NULL));
    assert_ok(lg_integrate_fixed(stepper, 1.0, 0.5, 3, inputs, 1, 1, y0, out, NULL));
    for (int i = 0; i < 4; i++) assert_close(out[2 * i], (pow(1.0 + 0.5 * i, 5.0) - 1.0) / 5.0, 1e-14, 1e-14);
    assert_close(out[3], 0.5, 1e-15, 0.0);
    assert_close(out[5], -0.5, 1e-15, 0.0);
    assert_close(out[7], 1.5, 1e-15, 0.0);
    stepper = make("cf4", ode_on(LG_SPACE_RN, 2, time_field, NULL)); /* Simpson's rule on R^n */
    assert_ok(lg_stepper_step(stepper, 1.0, 1.0, y0, NULL, out));
    assert_close(out[0], (1.0 + 4.0 * pow(1.5, 4.0) + 16.0) / 6.0, 1e-15, 0.0);
}

TEST("on R^n the Lie group schemes have the bits of the classical schemes") {
    static const char *const pairs[][2] = {
        {"euler", "lie-euler"}, {"rk4", "rkmk4"}, {"rk4", "rkmk4-2c"}, {"dp54", "rkmk54"}};
    const double y0[1] = {0.3};
    for (int i = 0; i < 4; i++) {
        double out[2][2];
        for (int j = 0; j < 2; j++) {
            lg_stepper *stepper = make(pairs[i][j], ode_on(LG_SPACE_RN, 1, blow_up_field, NULL));
            assert_ok(lg_integrate_fixed(stepper, 0.0, 0.1, 10, NULL, 0, 10, y0, out[j], NULL));
        }
        assert_memory_equal(out[0], out[1], sizeof(out[0]));
    }
}

TEST("with first same as last a step takes six evaluations, and a rejected step does not evaluate its "
     "start again") {
    const double y0[1] = {0.3};
    double out[2], y[1];
    lg_run_stats stats;
    static const struct {
        const char *name;
        size_t evaluations;
    } cases[] = {{"rkmk54", 61}, {"rkmk5", 60}, {"cf4", 40}, {"lie-euler", 10}, {"dp54", 61}};
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        lg_stepper *stepper = make(cases[i].name, ode_on(LG_SPACE_RN, 1, blow_up_field, NULL));
        assert_ok(lg_integrate_fixed(stepper, 0.7, 0.1, 10, NULL, 0, 10, y0, out, &stats));
        assert_int_equal(stats.evaluations, cases[i].evaluations);
        assert_int_equal(stats.steps, 10);
    }
    lg_stepper *stepper = make("rkmk54", ode_on(LG_SPACE_RN, 1, blow_up_field, NULL));
    assert_ok(lg_stepper_step(stepper, 0.0, 0.2, y0, NULL, y));
    assert_ok(lg_stepper_step(stepper, 0.0, 0.1, y0, NULL, y));
    assert_int_equal(lg_stepper_evaluations(stepper), 7 + 6);
    assert_ok(lg_stepper_step(stepper, 0.1, 0.1, y, NULL, y));
    assert_int_equal(lg_stepper_evaluations(stepper), 7 + 6 + 6);
    lg_stepper_reset(stepper);
    assert_ok(lg_stepper_step(stepper, 0.2, 0.1, y, NULL, y));
    assert_int_equal(lg_stepper_evaluations(stepper), 7 + 6 + 6 + 7);
}

FIELD(spring, q) {
    out[0] = (input ? input[0] : 0.0) - q[0];
}

FIELD(same, p) {
    out[0] = p[0];
}

static lg_status drifting(void *user, double t, double h, double *y) {
    y[0] += h * y[1];
    return LG_OK;
}

/* A field value must not be reused where it is invalid: after a step with another input, or after a final
 * drift. The same step by a stepper that has made no step is the reference. */
TEST("a field value is not reused where it is invalid") {
    const double y0[2] = {0.2, 0.3}, input[1] = {5.0};
    double y[2], here[2], there[2];
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        lg_ode ode = ode_on(LG_SPACE_RN, 2, time_field, NULL);
        if (scheme->kind == LG_SCHEME_SLGI) continue; /* not possible on R^2 */
        ode.force = spring, ode.velocity = same, ode.step = drifting;
        lg_stepper *stepper = make(scheme->name, ode), *fresh = make(scheme->name, ode);
        assert_ok(lg_stepper_step(stepper, 0.0, 0.1, y0, input, y));
        assert_ok(lg_stepper_step(stepper, 0.1, 0.1, y, NULL, here));
        assert_ok(lg_stepper_step(fresh, 0.1, 0.1, y, NULL, there));
        assert_memory_equal(here, there, sizeof(here));
    }
    const lg_scheme drift_last = {.name = "kick-drift",
                                  .kind = LG_SCHEME_SPLITTING,
                                  .stages = 1,
                                  .order = 1,
                                  .kick = {1.0},
                                  .drift = {1.0}};
    lg_ode ode = ode_on(LG_SPACE_RN, 2, time_field, NULL);
    ode.force = spring, ode.velocity = same;
    lg_stepper *stepper = test_stepper(&drift_last, &ode);
    memcpy(y, y0, sizeof(y));
    for (int i = 0; i < 2; i++) {
        const double p = y[1] - 0.1 * y[0], q = y[0] + 0.1 * p;
        assert_ok(lg_stepper_step(stepper, 0.1 * i, 0.1, y, NULL, y));
        assert_close(y[0], q, 1e-15, 0.0);
        assert_close(y[1], p, 1e-15, 0.0);
    }
}

TEST("a stepper writes only into the caller's memory") {
    const lg_ode ode = ode_on(LG_SPACE_RN, 3, blow_up_field, NULL);
    const lg_scheme *scheme = lg_scheme_find("rkmk54");
    const size_t bytes = lg_stepper_size(scheme, &ode);
    unsigned char *memory = aligned_alloc(64, (bytes + 127) / 64 * 64);
    lg_stepper *stepper = NULL;
    memset(memory, 0xa5, bytes + 1);
    assert_status(lg_stepper_init(scheme, &ode, &stepper, memory, bytes - 1), LG_INVALID_ARGUMENT);
    assert_status(lg_stepper_init(scheme, &ode, &stepper, memory + 8, bytes), LG_INVALID_ARGUMENT);
    assert_null(stepper);
    assert_ok(lg_stepper_init(scheme, &ode, &stepper, memory, bytes));
    double y[3] = {0.1, 0.2, 0.3};
    assert_ok(lg_stepper_step(stepper, 0.0, 0.1, y, NULL, y));
    assert_true(memory[bytes] == 0xa5); /* nothing is written beyond the block */
    free(memory);
}

/* ---- step control ---- */

TEST("step control depends only on its arguments") {
    lg_step_controller c;
    lg_step_controller_init(&c);
    const lg_step_history plain = {.h = 0.1}, after = {.h = 0.1, .rejected = true};
    lg_step_decision d = lg_step_controller_decide(&c, 0.2, 0.5, &plain);
    assert_true(d.accept);
    assert_close(d.h, 0.1 * 0.9 * pow(0.5, -0.2), 1e-15, 0.0);
    d = lg_step_controller_decide(&c, 0.2, 32.0, &plain);
    assert_false(d.accept);
    assert_close(d.h, 0.1 * 0.9 / 2.0, 1e-15, 0.0);
    assert_close(lg_step_controller_decide(&c, 0.2, 1e-20, &plain).h, 0.5, 1e-15, 0.0); /* largest growth */
    assert_close(lg_step_controller_decide(&c, 0.2, 0.0, &plain).h, 0.5, 1e-15, 0.0);
    /* largest reduction */
    assert_close(lg_step_controller_decide(&c, 0.2, 1e20, &plain).h, 0.02, 1e-15, 0.0);
    assert_close(lg_step_controller_decide(&c, 0.2, 1e-20, &after).h, 0.1, 1e-15,
                 0.0); /* no growth after a rejection */
    d = lg_step_controller_decide(&c, 0.2, NAN, &plain);
    assert_true(!d.accept && lg_is_close(d.h, 0.02, 1e-15, 0.0));
    d = lg_step_controller_decide(&c, 0.2, INFINITY, &plain);
    assert_true(!d.accept && lg_is_close(d.h, 0.02, 1e-15, 0.0));
    const lg_step_history turned = {.h = 0.1, .angle = 3.2}, near = {.h = 0.1, .angle = 3.1},
                          undefined = {.h = 0.1, .angle = NAN};
    d = lg_step_controller_decide(&c, 0.2, 1e-9, &turned);
    assert_true(!d.accept && d.h <= 0.05);
    assert_true(lg_step_controller_decide(&c, 0.2, 1e-9, &near).accept);
    assert_true(lg_step_controller_decide(&c, 0.2, 1e-9, &near).h < 0.1);
    assert_false(lg_step_controller_decide(&c, 0.2, 1e-9, &undefined).accept);
    c.h_max = 0.2;
    assert_close(lg_step_controller_decide(&c, 0.2, 1e-20, &plain).h, 0.2, 0.0, 0.0);
    const double e[2] = {3e-6, 0.0}, y[2] = {1.0, 0.0}, next[2] = {-2.0, 0.0};
    const double atol[2] = {0.0, 0.0};
    assert_close(lg_kernels_for(LG_F64)->error_norm(2, 1e-6, atol, e, y, next), sqrt(0.5 * 1.5 * 1.5), 1e-14,
                 0.0);
}

/* y' = y; records the times of the evaluations. */
typedef struct times_seen {
    double t[16];
    size_t count;
} times_seen;

FIELD(noting_field, y) {
    times_seen *seen = user;
    if (seen->count < 16) seen->t[seen->count++] = t;
    out[0] = y[0];
}

/* The second step of a run must have the length that follows from the first error: safety h err^(-1/5). */
TEST("step control uses the lower order of an embedded pair") {
    const double y0[1] = {1.0}, times[1] = {10.0}, h = 0.25;
    double y[1], out[1];
    times_seen seen = {.count = 0};
    lg_step_controller c;
    lg_step_controller_init(&c);
    c.h_initial = h;
    c.atol = 1e-9;
    lg_stepper *stepper = make("dp54", ode_on(LG_SPACE_RN, 1, noting_field, &seen));
    assert_ok(lg_stepper_step(stepper, 0.0, h, y0, NULL, y));
    const double error = lg_kernels_for(LG_F64)->error_norm(1, c.rtol, &c.atol, stepper->error, y0, y);
    assert_true(error < 1.0 && error > 1e-3); /* accepted, and within the limits of growth */
    lg_stepper_reset(stepper);
    seen.count = 0;
    assert_ok(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 1, out, NULL));
    /* The first step makes seven evaluations; the first one of the second step is at c_2 = 1/5. */
    assert_close(seen.t[6], h, 1e-15, 0.0);
    assert_close(5.0 * (seen.t[7] - h), 0.9 * h * pow(error, -0.2), 1e-12, 0.0);
}

TEST("a run that fails keeps the results so far") {
    const double y0[1] = {1.0}, times[] = {0.5, 2.0}, none[] = {0.25, 1.0};
    double out[2] = {7.0, 7.0};
    lg_run_stats stats;
    lg_step_controller c;
    lg_step_controller_init(&c);
    lg_stepper *stepper = make("dp54", ode_on(LG_SPACE_RN, 1, blow_up_field, NULL));
    const lg_status status = lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 2, out, &stats);
    assert_true(status == LG_STEP_TOO_SMALL || status == LG_NOT_FINITE); /* the solution ends at t = 1 */
    assert_close(out[0], 2.0, 1e-5, 0.0);
    assert_true(out[1] == 7.0 && stats.steps > 10);
    c.max_steps = 5;
    assert_status(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 1, out, &stats), LG_TOO_MANY_STEPS);
    assert_int_equal(stats.steps + stats.rejected, 5);
    stepper = make("dp54", ode_on(LG_SPACE_RN, 1, sqrt_field, NULL));
    out[1] = 7.0;
    assert_status(lg_integrate_adaptive(stepper, NULL, 0.0, y0, none, 2, out, NULL), LG_NOT_FINITE);
    assert_true(out[1] == 7.0);
    double start[1] = {1.0};
    assert_status(lg_stepper_step(stepper, 0.4, 0.5, start, NULL, start), LG_NOT_FINITE);
    assert_true(start[0] == 1.0);
    lg_status cancelled = LG_CANCELLED;
    stepper = make("dp54", ode_on(LG_SPACE_RN, 1, blow_up_field, &cancelled));
    assert_status(lg_integrate_adaptive(stepper, NULL, 0.0, y0, times, 1, out, NULL), LG_CANCELLED);
    assert_status(lg_integrate_fixed(stepper, 0.0, 0.1, 2, NULL, 0, 2, y0, out, &stats), LG_CANCELLED);
    assert_int_equal(stats.evaluations, 1);
}

TEST("invalid arguments of a run are refused, and nothing is written") {
    const double y0[1] = {1.0}, bad[1] = {NAN}, zigzag[] = {0.5, 0.25}, through[] = {-0.5, 0.5},
                 nan_time[] = {NAN};
    double out[8] = {7.0};
    lg_step_controller c;
    lg_step_controller_init(&c);
    lg_stepper *s = make("dp54", ode_on(LG_SPACE_RN, 1, blow_up_field, NULL));
    assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, zigzag, 2, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, through, 2, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, nan_time, 1, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_adaptive(s, &c, 0.0, bad, zigzag, 1, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, zigzag, 0, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_adaptive(s, &c, INFINITY, y0, zigzag, 1, out, NULL), LG_INVALID_ARGUMENT);
    const struct {
        double *field, value;
    } wrong[] = {{&c.rtol, -1},      {&c.safety, -1},    {&c.factor_min, -1}, {&c.factor_max, -1},
                 {&c.max_angle, -1}, {&c.h_max, -1},     {&c.rtol, INFINITY}, {&c.safety, 0},
                 {&c.safety, 1},     {&c.factor_min, 0}, {&c.factor_min, 1},  {&c.factor_max, 1},
                 {&c.max_angle, 0},  {&c.atol, INFINITY}};
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        *wrong[i].field = wrong[i].value;
        assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, zigzag, 1, out, NULL), LG_INVALID_ARGUMENT);
        lg_step_controller_init(&c);
    }
    c.max_steps = 0;
    assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, zigzag, 1, out, NULL), LG_INVALID_ARGUMENT);
    lg_step_controller_init(&c);
    c.size = 3;
    assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, zigzag, 1, out, NULL), LG_INVALID_ARGUMENT);
    lg_step_controller_init(&c);
    c.rtol = c.atol = 0.0;
    assert_status(lg_integrate_adaptive(s, &c, 0.0, y0, zigzag, 1, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_fixed(s, 0.0, 0.1, 0, NULL, 0, 1, y0, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_fixed(s, 0.0, 0.1, 4, NULL, 0, 3, y0, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_fixed(s, 0.0, 0.1, 4, NULL, 0, 0, y0, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_fixed(s, 0.0, NAN, 4, NULL, 0, 4, y0, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_fixed(s, INFINITY, 0.1, 4, NULL, 0, 4, y0, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_integrate_fixed(s, 0.0, 0.1, 4, NULL, 0, 4, bad, out, NULL), LG_INVALID_ARGUMENT);
    assert_true(out[0] == 7.0);
    s = make("rk4", ode_on(LG_SPACE_RN, 1, blow_up_field, NULL));
    assert_status(lg_integrate_adaptive(s, NULL, 0.0, y0, zigzag, 1, out, NULL), LG_UNSUPPORTED);
}

/* ---- checks of schemes ---- */

TEST("every scheme of the table is consistent") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        lg_error error;
        assert_ok(lg_scheme_check(lg_scheme_at(i), &error));
        assert_ptr_equal(lg_scheme_find(lg_scheme_at(i)->name), lg_scheme_at(i));
    }
    assert_null(lg_scheme_at(lg_scheme_count()));
    assert_null(lg_scheme_find("rk5"));
    assert_null(lg_scheme_find(NULL));
    const lg_scheme *dp = lg_scheme_find("dp54");
    const double e[7] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                         -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    for (int i = 0; i < 7; i++) assert_close(dp->b[i] - dp->embedded[i], e[i], 0.0, 1e-16);
}

static void assert_faulty(const lg_scheme *scheme) {
    lg_error error = {0};
    const lg_ode ode = ode_on(LG_SPACE_RN, 2, time_field, NULL);
    lg_stepper *stepper = NULL;
    assert_status(lg_scheme_check(scheme, &error), LG_INVALID_ARGUMENT);
    assert_true(strlen(error.message) > 0);
    assert_status(lg_stepper_create(NULL, scheme, &ode, &stepper), LG_INVALID_ARGUMENT);
    assert_int_equal(lg_stepper_size(scheme, &ode), 0);
    assert_null(stepper);
}

TEST("wrong schemes are refused") {
    const lg_scheme rk4 = *lg_scheme_find("rk4"), cf4 = *lg_scheme_find("cf4"),
                    sv = *lg_scheme_find("stormer-verlet"), dp = *lg_scheme_find("rkmk54");
    lg_scheme s;
    lg_cf_row rows[5];
    assert_faulty(NULL);
    s = rk4, s.stages = LG_SCHEME_MAX_STAGES + 1, assert_faulty(&s);
    s = rk4, s.stages = 0, assert_faulty(&s);
    s = rk4, s.stages = 0, s.name = NULL, assert_faulty(&s);
    s = rk4, s.embedded_order = -1, assert_faulty(&s);
    s = rk4, s.dexpinv = LG_DEXPINV_MAX + 1, assert_faulty(&s);
    s = *lg_scheme_find("euler"), s.fsal = true, assert_faulty(&s);
    s = sv, s.kick[0] = 0.75, assert_faulty(&s);
    s = rk4, s.kind = LG_SCHEME_KINDS, assert_faulty(&s);
    s = rk4, s.b[1] += 1e-9, assert_faulty(&s);
    s = rk4, s.b[0] = NAN, assert_faulty(&s);
    s = rk4, s.c[2] = 0.4, assert_faulty(&s);
    s = rk4, s.a[1][1] = 0.5, s.a[1][0] = 0.0, assert_faulty(&s);
    s = rk4, s.dexpinv = -2, assert_faulty(&s);
    s = rk4, s.fsal = true, assert_faulty(&s);
    s = dp, s.embedded[0] += 0.1, assert_faulty(&s);
    s = cf4, s.rows = NULL, assert_faulty(&s);
    for (int fault = 0; fault < 4; fault++) {
        s = cf4, s.rows = rows;
        memcpy(rows, cf4.rows, sizeof(rows));
        if (fault == 0) rows[3].base = 3;
        if (fault == 1) rows[3].exponentials = LG_SCHEME_MAX_EXPONENTIALS + 1;
        if (fault == 2) rows[4].coefficient[0][0] = 0.0;
        if (fault == 3) rows[1].coefficient[0][1] = 0.5, rows[1].coefficient[0][0] = 0.0;
        assert_faulty(&s);
    }
    s = sv, s.drift[0] = 0.5, assert_faulty(&s);
    s = sv, s.embedded_order = 1, assert_faulty(&s);
}

TEST("wrong brackets, dense output and angles are refused") {
    const lg_scheme two = *lg_scheme_find("rkmk4-2c"), dp = *lg_scheme_find("rkmk54"),
                    midpoint = *lg_scheme_find("midpoint"), slgi = *lg_scheme_find("slgi");
    static const lg_commutator bad[] = {{0, 0, 0, 1.0},  {5, 0, 1, 1.0}, {2, 2, 1, 1.0}, {2, 0, 2, 1.0},
                                        {2, -1, 0, 1.0}, {2, 0, 1, NAN}, {2, 0, -1, 1.0}};
    lg_scheme s;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        s = two, s.commutators = &bad[i], s.commutator_count = 1;
        assert_faulty(&s);
    }
    static const lg_commutator late = {7, 0, 1, 1.0};
    s = two, s.commutators = NULL, assert_faulty(&s);
    s = two, s.commutator_count = -1, assert_faulty(&s);
    static const lg_commutator early = {1, 0, 0, 0.0};
    s = dp, s.commutators = &early, s.commutator_count = 1, assert_faulty(&s); /* dense output */
    s = dp, s.dense_order = 0, s.commutators = &late, s.commutator_count = 1, assert_faulty(&s);
    s = *lg_scheme_find("cf4"), s.commutators = &late, s.commutator_count = 1, assert_faulty(&s);
    s = dp, s.dense[0][1] += 1e-3, assert_faulty(&s);
    s = dp, s.dense[0][0] += 1e-3, s.dense[0][1] -= 1e-3, assert_faulty(&s);
    s = dp, s.dense_order = -1, assert_faulty(&s);
    s = midpoint, s.dense_order = 4, assert_faulty(&s);
    s = midpoint, s.theta = 1.5, assert_faulty(&s);
    s = midpoint, s.theta = NAN, assert_faulty(&s);
    s = midpoint, s.stages = 2, assert_faulty(&s);
    s = midpoint, s.embedded_order = 1, assert_faulty(&s);
    s = slgi, s.theta = -0.1, assert_faulty(&s);
    s = *lg_scheme_find("rkmk4"), s.project = true, assert_faulty(&s);
}

TEST("each new state is projected, also if the scheme reuses its last field value") {
    double a[6] = {0.5, -0.4, 0.7, 0.3, 0.6, -0.2}, y0[6] = {0.6, 0.0, 0.8, 0.8, 0.5, -0.6}, out[12], next[6];
    lg_scheme dp = *lg_scheme_find("dp54");
    lg_space ts2;
    dp.project = true;
    assert_ok(lg_space_init(&ts2, &(lg_space_factor){LG_SPACE_TS2, 1}, 1));
    const lg_scheme *const cases[] = {lg_scheme_find("rk4"), lg_scheme_find("rk4-projected"), &dp};
    for (int i = 0; i < 3; i++) {
        lg_ode ode = ode_on(LG_SPACE_RN, 6, turning_field, a);
        lg_stepper *stepper = NULL;
        ode.manifold = ts2;
        stepper = test_stepper(cases[i], &ode);
        lg_stepper *fresh = test_stepper(cases[i], &ode);
        assert_ok(lg_integrate_fixed(stepper, 0.0, 0.3, 20, NULL, 0, 20, y0, out, NULL));
        assert_true((lg_space_manifold_error(&ts2, out + 6) < 1e-15) == (i > 0));
        assert_ok(lg_stepper_step(stepper, 6.0, 0.3, out + 6, NULL, out));
        assert_ok(lg_stepper_step(fresh, 6.0, 0.3, out + 6, NULL, next));
        assert_memory_equal(out, next, sizeof(next));
        assert_ok(lg_space_init(&ode.manifold, &(lg_space_factor){LG_SPACE_TS2, 2}, 1));
        if (i > 0) assert_status(lg_stepper_create(NULL, cases[i], &ode, &stepper), LG_INVALID_ARGUMENT);
    }
}

FIELD(half, x) {
    out[0] = x[0];
}

TEST("schemes and equations that do not fit together are refused") {
    lg_stepper *stepper = NULL;
    lg_ode ode = ode_on(LG_SPACE_TS2, 1, constant_field, NULL);
    assert_status(lg_stepper_create(NULL, lg_scheme_find("rk4"), &ode, &stepper), LG_UNSUPPORTED);
    assert_status(lg_stepper_create(NULL, lg_scheme_find("stormer-verlet"), &ode, &stepper), LG_UNSUPPORTED);
    lg_scheme implicit = *lg_scheme_find("midpoint");
    implicit.ambient = false;
    assert_status(lg_stepper_create(NULL, &implicit, &ode, &stepper), LG_UNSUPPORTED);
    assert_ok(lg_space_init_rn(&ode.space, 20000)); /* the Jacobian is a full matrix, too large here */
    assert_status(lg_stepper_create(NULL, &implicit, &ode, &stepper), LG_UNSUPPORTED);
    assert_int_equal(lg_stepper_size(&implicit, &ode), 0);
    ode = ode_on(LG_SPACE_RN, 3, constant_field, NULL);
    ode.force = ode.velocity = half;
    assert_status(lg_stepper_create(NULL, lg_scheme_find("stormer-verlet"), &ode, &stepper), LG_UNSUPPORTED);
    ode = ode_on(LG_SPACE_RN, 2, constant_field, NULL);
    assert_status(lg_stepper_create(NULL, lg_scheme_find("stormer-verlet"), &ode, &stepper),
                  LG_INVALID_ARGUMENT);
    ode.force = half;
    assert_status(lg_stepper_create(NULL, lg_scheme_find("stormer-verlet"), &ode, &stepper),
                  LG_INVALID_ARGUMENT);
    ode.field = NULL;
    assert_status(lg_stepper_create(NULL, lg_scheme_find("rk4"), &ode, &stepper), LG_INVALID_ARGUMENT);
    ode = ode_on(LG_SPACE_RN, 2, constant_field, NULL);
    ode.space.dim = 1; /* differs from the dimension that lg_space_init computed */
    assert_status(lg_stepper_create(NULL, lg_scheme_find("rk4"), &ode, &stepper), LG_INVALID_ARGUMENT);
    ode.space.dim = 2, ode.space.algebra_dim = 3;
    assert_status(lg_stepper_create(NULL, lg_scheme_find("rk4"), &ode, &stepper), LG_INVALID_ARGUMENT);
    assert_null(stepper);
}
