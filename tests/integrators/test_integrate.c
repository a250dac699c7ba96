/* Adaptive runs: dense output and its order, observers, rejection by the angle for every adaptive scheme,
 * first steps, failures. */
#include "fields.h"
#include "liegrad/geometry.h"
#include "support/fixtures.h"

#define PI 3.14159265358979323846

static double swing = 0.3;

/* ---- dense output ---- */

/* The solution from t = 0, computed by short steps of rkmk5. */
static void reference(double t_end, double *y) {
    const lg_scheme *scheme = lg_scheme_find("rkmk5");
    const lg_ode ode = chain_ode(scheme, &swing);
    const size_t steps = 40 + (size_t)(400.0 * t_end);
    double out[2 * CHAIN_DIM], y0[CHAIN_DIM];
    lg_stepper *stepper = test_stepper(scheme, &ode);
    chain_start(y0);
    assert_ok(lg_integrate_fixed(stepper, 0.0, t_end / (double)steps, steps, NULL, 0, steps, y0, out, NULL));
    memcpy(y, out + CHAIN_DIM, CHAIN_DIM * sizeof(*y));
}

static double difference(const double *x, const double *y) {
    double worst = 0.0;
    for (int i = 0; i < CHAIN_DIM; i++) worst = fmax(worst, fabs(x[i] - y[i]));
    return isnan(worst) ? INFINITY : worst;
}

static lg_ode rigid_ode(bool ambient) {
    lg_ode ode = {.field = ambient ? rigid_ambient_field : rigid_field};
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_SO3_DUAL, 1}, 1));
    if (ambient) assert_ok(lg_space_init_rn(&ode.space, 3));
    return ode;
}

/* Error of dense output for a rigid body, inside the second of two steps of size h / 2, so that a value
 * reused by FSAL is involved. */
static double dense_error(const lg_scheme *scheme, double h) {
    const lg_ode ode = rigid_ode(scheme->ambient), lie = rigid_ode(false);
    const double y0[3] = {0.4, 1.1, -0.7};
    double y[3], out[3], exact[6], worst = 0.0;
    lg_stepper *stepper = test_stepper(scheme, &ode), *fine = test_stepper(lg_scheme_find("rkmk5"), &lie);
    assert_ok(lg_stepper_step(stepper, 0.0, h / 2, y0, NULL, y));
    assert_ok(lg_stepper_step(stepper, h / 2, h / 2, y, NULL, y));
    assert_ok(lg_stepper_dense(stepper, 0.4, out));
    assert_ok(lg_integrate_fixed(fine, 0.0, 0.7 * h / 400, 400, NULL, 0, 400, y0, exact, NULL));
    for (int i = 0; i < 3; i++) worst = fmax(worst, fabs(out[i] - exact[3 + i]));
    return worst;
}

/* The local order, which is the global order plus one. */
static double dense_slope(const lg_scheme *scheme) {
    fit_line fit = {0};
    for (int i = 0; i <= 20; i++) { /* five halvings */
        const double h = 1.2 * pow(2.0, -0.25 * i), error = dense_error(scheme, h);
        assert_true(error < 1e-2 && error > 1e-14);
        fit_add(&fit, log(h), log(error));
    }
    return fit_slope(&fit);
}

TEST("dense output has local order 5, and a planted error reduces the order") {
    static const char *const names[] = {"rkmk54", "dp54"};
    for (int i = 0; i < 2; i++) {
        const lg_scheme *scheme = lg_scheme_find(names[i]);
        const double slope = dense_slope(scheme);
        print_message("  %-7s dense output: local order %.3f\n", names[i], slope);
        assert_int_equal(scheme->dense_order, 4);
        assert_true(slope >= 5.0 - 0.15 && slope < 6.0 - 0.15);
        /* Planted error: coefficients are changed so that they stay consistent but lose the order. */
        lg_scheme wrong = *scheme;
        wrong.dense[2][1] += 1e-2, wrong.dense[2][2] -= 1e-2;
        wrong.dense[3][1] -= 1e-2, wrong.dense[3][2] += 1e-2;
        assert_ok(lg_scheme_check(&wrong, NULL));
        assert_true(dense_slope(&wrong) < 5.0 - 0.15);
    }
}

TEST("dense output meets both ends of a step and stays on the manifold") {
    const lg_scheme *scheme = lg_scheme_find("rkmk54");
    const lg_ode ode = chain_ode(scheme, &swing);
    const lg_space space = chain_ode(lg_scheme_find("rkmk4"), &swing).space;
    double y[CHAIN_DIM], next[CHAIN_DIM], out[CHAIN_DIM], input[1] = {0.0};
    lg_stepper *stepper = test_stepper(scheme, &ode);
    chain_start(y);
    assert_status(lg_stepper_dense(stepper, 0.5, out), LG_INVALID_ARGUMENT); /* no step yet */
    for (int n = 0; n < 20; n++) {
        assert_ok(lg_stepper_step(stepper, 0.1 * n, 0.1, y, n % 3 == 2 ? input : NULL, next));
        assert_ok(lg_stepper_dense(stepper, 0.0, out));
        assert_true(difference(out, y) <= 1e-15);
        assert_ok(lg_stepper_dense(stepper, 1.0, out));
        assert_true(difference(out, next) <= 1e-14);
        for (double s = 0.05; s < 1.0; s += 0.1) {
            assert_ok(lg_stepper_dense(stepper, s, out));
            assert_true(lg_space_manifold_error(&space, out) <= 1e-14);
        }
        memcpy(y, next, sizeof(y));
    }
    lg_stepper_reset(stepper); /* a reset keeps the result of the last step */
    assert_ok(lg_stepper_dense(stepper, 1.0, out));
    assert_true(difference(out, next) <= 1e-14);
    assert_status(lg_stepper_dense(stepper, 1.1, out), LG_INVALID_ARGUMENT);
    assert_status(lg_stepper_dense(stepper, -0.1, out), LG_INVALID_ARGUMENT);
    assert_status(lg_stepper_dense(stepper, NAN, out), LG_INVALID_ARGUMENT);
    y[0] = NAN;
    assert_status(lg_stepper_step(stepper, 0.0, 0.1, y, NULL, next), LG_NOT_FINITE);
    assert_status(lg_stepper_dense(stepper, 0.5, out), LG_INVALID_ARGUMENT); /* that step failed */
    const lg_ode same = chain_ode(lg_scheme_find("cf4"), &swing);
    stepper = test_stepper(lg_scheme_find("cf4"), &same);
    assert_status(lg_stepper_dense(stepper, 0.5, out), LG_UNSUPPORTED);
}

enum { TIMES = 200 };

TEST("output at many times is as accurate as the tolerance and costs no evaluations, in both directions") {
    static const char *const names[] = {"rkmk54", "dp54", "cf43"};
    const lg_space space = chain_ode(lg_scheme_find("rkmk4"), &swing).space;
    double times[TIMES], y0[CHAIN_DIM], exact[CHAIN_DIM];
    static double out[3][TIMES * CHAIN_DIM], back[TIMES * CHAIN_DIM], backwards[TIMES];
    for (int i = 0; i < TIMES; i++) times[i] = 2.0 * i / (TIMES - 1);
    chain_start(y0);
    reference(2.0, exact);
    for (int k = 0; k < 3; k++) {
        const lg_scheme *scheme = lg_scheme_find(names[k]);
        const lg_ode ode = chain_ode(scheme, &swing);
        lg_stepper *stepper = test_stepper(scheme, &ode);
        lg_run_stats dense, one, clipped;
        lg_step_controller c;
        lg_step_controller_init(&c);
        c.rtol = c.atol = 1e-9;
        c.dense = true;
        assert_ok(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, TIMES, out[k], &dense));
        const double *end = out[k] + (TIMES - 1) * CHAIN_DIM;
        print_message("  %-7s: %zu steps for %d times, error %.2g\n", names[k], dense.steps, TIMES,
                      difference(end, exact));
        assert_true(difference(end, exact) < 2e-6);
        assert_true(difference(out[k], y0) == 0.0);
        for (int i = 0; i < TIMES && !scheme->ambient; i++)
            assert_true(lg_space_manifold_error(&space, out[k] + i * CHAIN_DIM) <= 1e-14);
        assert_ok(lg_integrate_adaptive(stepper, &c, 0.0, y0, times + TIMES - 1, 1, back, &one));
        if (scheme->dense_order > 0) {
            assert_true(dense.steps == one.steps && dense.evaluations == one.evaluations);
            assert_memory_equal(back, end, sizeof(exact));
        }
        c.dense = false;
        assert_ok(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, TIMES, back, &clipped));
        assert_true(clipped.steps >= TIMES - 1);
        double worst = 0.0;
        for (int i = 0; i < TIMES; i++)
            worst = fmax(worst, difference(back + i * CHAIN_DIM, out[k] + i * CHAIN_DIM));
        print_message("           largest difference from clipped steps %.2g\n", worst);
        assert_true(worst < 2e-6);
        c.dense = true; /* back to the start */
        for (int i = 0; i < TIMES; i++) backwards[i] = times[TIMES - 1 - i];
        memcpy(exact, end, sizeof(exact));
        assert_ok(lg_integrate_adaptive(stepper, &c, 2.0, exact, backwards, TIMES, back, NULL));
        for (int i = 0; i < TIMES; i++)
            assert_true(difference(back + i * CHAIN_DIM, out[k] + (TIMES - 1 - i) * CHAIN_DIM) < 2e-6);
        reference(2.0, exact);
    }
}

/* ---- observers ---- */

typedef struct watch {
    size_t count, stop_at;
    double t[4096], h[4096], y[4096][CHAIN_DIM];
} watch;

static lg_status observe(void *user, double t, double h, const double *y) {
    watch *w = user;
    assert_true(w->count < 4096);
    w->t[w->count] = t, w->h[w->count] = h;
    memcpy(w->y[w->count], y, sizeof(w->y[0]));
    w->count++;
    return w->count == w->stop_at ? LG_CANCELLED : LG_OK;
}

TEST("observed steps follow one another from start to end, and repeating them gives the same bits") {
    static watch w;
    static const char *const names[] = {"rkmk54", "dp54", "cf43", "cf32a", "cf32b"};
    double y0[CHAIN_DIM], y[CHAIN_DIM], out[3 * CHAIN_DIM];
    const double times[] = {0.3, 0.7, 1.0};
    for (int k = 0; k < 5; k++) {
        const lg_scheme *scheme = lg_scheme_find(names[k]);
        const lg_ode ode = chain_ode(scheme, &swing);
        lg_stepper *stepper = test_stepper(scheme, &ode), *again = test_stepper(scheme, &ode);
        lg_run_stats stats;
        lg_step_controller c;
        lg_step_controller_init(&c);
        c.observe = observe, c.observer = &w, c.dense = k % 2 == 0;
        c.rtol = c.atol = 1e-7;
        chain_start(y0);
        memset(&w, 0, sizeof(w));
        assert_ok(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 3, out, &stats));
        assert_int_equal(w.count, stats.steps);
        assert_true(w.t[0] == 0.0);
        memcpy(y, y0, sizeof(y));
        for (size_t n = 0; n < w.count; n++) {
            assert_ok(lg_stepper_step(again, w.t[n], w.h[n], y, NULL, y));
            assert_memory_equal(y, w.y[n], sizeof(y));
            assert_close(w.t[n] + w.h[n], n + 1 < w.count ? w.t[n + 1] : 1.0, 1e-15, 0.0);
        }
        assert_memory_equal(y, out + 2 * CHAIN_DIM, sizeof(y));
        memset(&w, 0, sizeof(w));
        w.stop_at = 3;
        assert_status(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 3, out, &stats), LG_CANCELLED);
        assert_int_equal(stats.steps, 3);
    }
}

/* ---- rejection and first steps ---- */

FIELD(spin_field, y) {
    for (int i = 0; i < 6; i++) out[i] = ((const double *)user)[i];
}

FIELD(turning_field, y) {
    for (int i = 0; i < 3; i++) out[i] = ((const double *)user)[i];
}

/* Checks that each step begins where the last one ended, and that its length is the difference of the
 * times. */
typedef struct time_sum {
    double t;
} time_sum;

static lg_status add_time(void *user, double t, double h, const double *y) {
    time_sum *seen = user;
    assert_true(t == seen->t);
    seen->t = t + h;
    return LG_OK;
}

TEST("a free rotation is exact for every h, so only the angle limits the step") {
    const double a[6] = {30.0, -20.0, 50.0, 0.0, 0.0, 0.0}, y0[6] = {0.6, 0.0, 0.8, 0.8, 0.5, -0.6};
    const double times[] = {10.0};
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        double user[6], out[6];
        if (scheme->embedded_order == 0 || scheme->ambient) continue;
        memcpy(user, a, sizeof(user));
        lg_ode ode = {.field = spin_field, .user = user};
        assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_TS2, 1}, 1));
        for (int limited = 0; limited < 2; limited++) {
            lg_stepper *stepper = test_stepper(scheme, &ode);
            lg_run_stats stats;
            lg_step_controller c;
            lg_step_controller_init(&c);
            c.h_initial = 10.0; /* far too long */
            if (limited) c.max_angle = 0.5;
            assert_ok(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 1, out, &stats));
            assert_true(stats.max_angle <= c.max_angle && stats.max_angle > 0.7 * c.max_angle);
            assert_true(stats.rejected > 0 && stats.rejected < 20);
        }
    }
}

/* The exact solution exp(T a) y0 of R^3 turned about a, |a| = w: c + (y0 - c) cos(w T) + (a/w x y0) sin(w T),
 * where c is the part of y0 along a. */
static void turned(const double a[3], double T, const double y0[3], double out[3]) {
    const double w = sqrt(lg_dot3(a, a)), along = lg_dot3(a, y0) / (w * w);
    double side[3];
    lg_cross3(a, y0, side);
    for (int i = 0; i < 3; i++)
        out[i] = along * a[i] + (y0[i] - along * a[i]) * cos(w * T) + side[i] / w * sin(w * T);
}

/* A time that is wrong by 1e-5 gives an error of 5e-6 here. The angle w T has a relative error of 1e-16, and
 * each step one of an ulp. */
TEST("time does not drift: the steps up to t = 1e7 add up to rounding, in both directions") {
    const double a[3] = {0.3, 0.4, 0.0}, y0[3] = {0.6, 0.0, 0.8};
    for (int back = 0; back < 2; back++) {
        const double end = back ? -1e7 : 1e7, from = back ? 1e6 : -1e6, T = end - from;
        double user[3], out[3], exact[3];
        memcpy(user, a, sizeof(user));
        lg_ode ode = {.field = turning_field, .user = user};
        assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_SO3_DUAL, 1}, 1));
        lg_stepper *stepper = test_stepper(lg_scheme_find("cf32a"), &ode);
        lg_step_controller c;
        lg_run_stats stats;
        time_sum seen = {.t = from};
        lg_step_controller_init(&c);
        c.max_steps = 10000000;
        c.observe = add_time;
        c.observer = &seen;
        assert_ok(lg_integrate_adaptive(stepper, &c, from, y0, &end, 1, out, &stats));
        turned(a, T, y0, exact);
        print_message("           %zu steps: error %.1e\n", stats.steps, fabs(out[0] - exact[0]));
        assert_all_close(out, exact, 3, 0.0, 1e-8);
        assert_true(seen.t == end);
    }
}

/* R^1: y' = rate y. */
FIELD(growth, y) {
    out[0] = *(const double *)user * y[0];
}

FIELD(from_zero, y) {
    out[0] = t > 0.0 ? 3.0 * t * t : 0.0;
}

TEST("at any time scale few steps are rejected at the start") {
    const double rates[] = {1e-12, 1e-3, -1.0, 40.0, -1e6}, y0[1] = {1.0}, zero[1] = {0.0};
    double out[1];
    lg_run_stats stats;
    lg_ode ode = {.field = growth};
    assert_ok(lg_space_init_rn(&ode.space, 1));
    for (size_t i = 0; i < 5; i++) {
        for (double tol = 1e-3; tol > 1e-13; tol *= 1e-3) {
            double rate = rates[i];
            const double t_end[] = {1.0 / fmax(fabs(rate), 1e-6)};
            lg_step_controller c;
            lg_step_controller_init(&c);
            c.rtol = tol, c.atol = 0.0;
            ode.user = &rate;
            lg_stepper *stepper = test_stepper(lg_scheme_find("dp54"), &ode);
            assert_ok(lg_integrate_adaptive(stepper, &c, 0.0, y0, t_end, 1, out, &stats));
            assert_close(out[0], exp(rate * t_end[0]), 10.0 * tol, 1e-15);
            assert_true(stats.rejected <= 3 && stats.steps < 15.0 + 0.3 * pow(tol, -0.2));
        }
    }
    const double one[] = {1.0};
    ode.field = from_zero;
    lg_stepper *stepper = test_stepper(lg_scheme_find("dp54"), &ode);
    /* initial state and field are zero, so they give no scale for the first step */
    assert_ok(lg_integrate_adaptive(stepper, NULL, 0.0, zero, one, 1, out, &stats));
    assert_close(out[0], 1.0, 1e-6, 0.0);
}

/* ---- failures ---- */

FIELD(noise, y) {
    const double x = 1e9 * sin(1e9 * t + 1.0);
    out[0] = 1e12 * (x - floor(x) - 0.5);
}

TEST("runs that cannot continue return an error and keep the results so far") {
    const double y0[1] = {1.0}, times[] = {0.0, 1.0, 2.0};
    double out[3] = {7.0, 7.0, 7.0};
    lg_run_stats stats;
    lg_step_controller c;
    lg_ode ode = {.field = noise};
    assert_ok(lg_space_init_rn(&ode.space, 1));
    for (int dense = 0; dense < 2; dense++) {
        lg_step_controller_init(&c);
        c.dense = dense == 1;
        c.rtol = 1e-15, c.atol = 0.0;
        out[1] = out[2] = 7.0;
        lg_stepper *stepper = test_stepper(lg_scheme_find("dp54"), &ode);
        assert_status(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 3, out, &stats), LG_STEP_TOO_SMALL);
        assert_true(out[0] == 1.0 && out[1] == 7.0 && out[2] == 7.0);
        assert_true(stats.rejected > 0);
        c.rtol = 1e15;
        c.max_steps = 4, c.h_max = 0.01;
        assert_status(lg_integrate_adaptive(stepper, &c, 0.0, y0, times, 3, out, &stats), LG_TOO_MANY_STEPS);
        assert_int_equal(stats.steps + stats.rejected, 4);
    }
}

/* ---- an equation in one call ---- */

FIELD(blow_up, y) {
    (void)user, (void)t;
    out[0] = y[0] * y[0];
}

TEST("an equation on a named space is solved as by a stepper of rkmk54 with this tolerance") {
    const double times[] = {0.5, 0.5, 1.0, 3.0}, y0[3] = {0.4, 1.1, -0.7};
    double expected[4 * 3], got[4 * 3];
    const lg_ode ode = rigid_ode(false);
    lg_step_controller c;
    lg_error error;
    lg_step_controller_init(&c);
    for (double tolerance = 1e-3; tolerance > 1e-11; tolerance /= 100) {
        c.rtol = tolerance, c.atol = -tolerance;
        lg_stepper *stepper = test_stepper(lg_scheme_find("rkmk54"), &ode);
        assert_ok(lg_integrate_adaptive(stepper, &c, 0.5, y0, times, 4, expected, NULL));
        assert_ok(lg_ode_solve(NULL, "so(3)*", rigid_field, NULL, tolerance, times, 4, y0, got, &error));
        assert_memory_equal(got, expected, sizeof got);
    }
}

TEST("an equation that cannot be solved is refused with the reason and the time that was reached") {
    const double y0[1] = {1.0}, rising[] = {3.0, 3.5, 5.0}, mixed[] = {0.0, 1.0, 0.5}, bad[1] = {NAN};
    double out[3] = {7.0, 7.0, 7.0};
    lg_error error;
    const lg_status failed = lg_ode_solve(NULL, "R^1", blow_up, NULL, 1e-6, rising, 3, y0, out, &error);
    assert_true(failed == LG_STEP_TOO_SMALL || failed == LG_NOT_FINITE || failed == LG_TOO_MANY_STEPS);
    assert_says(error.message, "at t = ");
    assert_close(strtod(strstr(error.message, "at t = ") + 7, NULL), 4.0, 1e-3, 0); /* y = 1/(4 - t) */
    assert_true(out[0] == 1.0 && fabs(out[1] - 2.0) < 1e-4 && out[2] == 7.0);
    assert_status(lg_ode_solve(NULL, "R^1", blow_up, NULL, 1e-6, mixed, 3, y0, out, &error),
                  LG_INVALID_ARGUMENT);
    assert_says(error.message, "only rise or only fall");
    assert_status(lg_ode_solve(NULL, "R^1", blow_up, NULL, 1e-6, rising, 3, bad, out, &error),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_ode_solve(NULL, "S^9", blow_up, NULL, 1e-6, rising, 3, y0, out, &error), LG_FORMAT);
    assert_says(error.message, "S^9");
    assert_status(lg_ode_solve(NULL, "R^1", blow_up, NULL, 0.0, rising, 3, y0, out, &error),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_ode_solve(NULL, "R^1", blow_up, NULL, 1e-6, rising, 0, y0, out, &error),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_ode_solve(NULL, "R^1", blow_up, NULL, INFINITY, rising, 3, y0, out, &error),
                  LG_INVALID_ARGUMENT);
    EVERY_ALLOCATION_FAILS(context, 1, {
        status = lg_ode_solve(context, "R^1", blow_up, NULL, 1e-6, rising, 1, y0, out, NULL);
    });
}
