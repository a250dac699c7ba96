/* Fits of a program's step function to logs: errors against the spread of many fits and against a bootstrap,
 * units, parameters that a log does not determine, missing values, rejected logs.
 * ctest-labels: slow src/nn src/autodiff/program */
#include "support/fixtures.h"

#include "core/core.h"

#include "liegrad/fit.h"
#include "liegrad/ops.h"
#include "liegrad/taped.h"

enum { ROWS = 240, PARAMETERS = 6, HELD = 15 };

RELEASES(release_program, lg_program_destroy)

/* A motor: angle' = speed, J speed' = K i - d speed - c tanh(2 speed), L i' = u - R i - K speed, with
 * p = (R, L, K, J, d, c). Angle and current are measured. */
static const double truth[PARAMETERS] = {1.2, 0.05, 0.3, 0.02, 0.01, 0.05};
static const double deviations[2] = {1e-2, 5e-2}, h = 0.02;

/* `user` NULL: six parameters. Otherwise a seventh one only appears as the sum R + p[6]. */
static lg_status field(void *user, lg_tape *t, const lg_var *p, const lg_var *in, lg_var *out) {
    const lg_var w = lg_slice(t, in[0], 1, 1, 1), i = lg_slice(t, in[0], 1, 2, 1);
    const lg_var R = user != NULL ? lg_add(t, p[0], p[6]) : p[0];
    const lg_var friction = lg_mul(t, p[5], lg_act(t, lg_scale(t, w, 2.0), LG_TANH));
    const lg_var torque = lg_sub(t, lg_mul(t, p[2], i), lg_add(t, lg_mul(t, p[4], w), friction));
    const lg_var drop = lg_add(t, lg_mul(t, R, i), lg_mul(t, p[2], w));
    const lg_var rates[] = {w, lg_div(t, torque, p[3]), lg_div(t, lg_sub(t, in[1], drop), p[1])};
    out[0] = lg_concat(t, rates, 3, 1);
    return lg_tape_status(t);
}

static lg_status seen(void *user, lg_tape *t, const lg_var *p, const lg_var *in, lg_var *out) {
    const lg_var y[] = {lg_slice(t, in[0], 1, 0, 1), lg_slice(t, in[0], 1, 2, 1)};
    out[0] = lg_concat(t, y, 2, 1);
    return lg_tape_status(t);
}

static lg_program *build(const double *start, bool open) {
    static const char *const names[] = {"R", "L", "K", "J", "d", "c", "more"};
    static const double none = 0.1;
    static int marker;
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(3)}, {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "y"};
    const lg_function_spec functions[] = {{"field", in, 2, &out, 1, field, open ? &marker : NULL},
                                          {"seen", in, 1, &out, 1, seen, NULL}};
    lg_parameter_spec p[PARAMETERS + 1];
    lg_program_spec spec;
    lg_space space;
    lg_program *program;
    for (int i = 0; i <= PARAMETERS; i++)
        p[i] = (lg_parameter_spec){names[i], lg_shape1(1), i < PARAMETERS ? &start[i] : &none};
    lg_program_spec_init(&spec);
    spec.parameters = p, spec.parameter_count = PARAMETERS + open;
    spec.functions = functions, spec.function_count = 2;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    lg_test_owns(program, release_program);
    assert_ok(lg_space_init_rn(&space, 3));
    assert_told(lg_program_add_step(program, &space, lg_scheme_find("rk4"), 0.01, 0.05, &told));
    return program;
}

static void set(lg_program *program, const double *values) {
    for (size_t i = 0; i < PARAMETERS; i++) assert_ok(lg_program_set_parameter(program, i, &values[i]));
}

static void get(const lg_program *program, double *values) {
    for (size_t i = 0; i < PARAMETERS; i++) values[i] = *lg_program_parameter(program, i).values;
}

typedef double numbers[PARAMETERS];
typedef double pair[2];
typedef double triple[3];

typedef struct logged {
    double t[ROWS], u[ROWS], exact[ROWS][2], y[ROWS][2];
    lg_program_log log;
} logged;

static void rates(const double *x, double u, double *f) {
    const double *p = truth;
    f[0] = x[1];
    f[1] = (p[2] * x[2] - p[4] * x[1] - p[5] * tanh(2.0 * x[1])) / p[3];
    f[2] = (u - p[0] * x[2] - p[2] * x[1]) / p[1];
}

/* The log without noise, by the scheme that the fit uses. */
static logged *simulate(void) {
    logged *l = TEST_ARRAY(logged, 1);
    lg_rng rng = test_rng(4, 0);
    double x[3] = {0.3, 1.0, -0.5}, f[4][3], z[3];
    for (int j = 0; j < ROWS; j++) {
        l->t[j] = j * h;
        l->u[j] = j % HELD == 0 ? 6.0 * lg_rng_normal(&rng) : l->u[j - 1];
        l->exact[j][0] = l->y[j][0] = x[0];
        l->exact[j][1] = l->y[j][1] = x[2];
        memcpy(z, x, sizeof z);
        for (int s = 0; s < 4; s++) {
            rates(z, l->u[j], f[s]);
            for (int i = 0; i < 3; i++) z[i] = x[i] + (s < 2 ? 0.5 : 1.0) * h * f[s][i];
        }
        for (int i = 0; i < 3; i++) x[i] += h / 6.0 * (f[0][i] + 2.0 * (f[1][i] + f[2][i]) + f[3][i]);
    }
    l->log = (lg_program_log){.rows = ROWS, .t = l->t, .u = l->u, .y = l->y[0]};
    return l;
}

static void add_noise(logged *l, uint64_t seed) {
    lg_rng rng = test_rng(seed, 1);
    for (int j = 0; j < ROWS; j++)
        for (int k = 0; k < 2; k++) l->y[j][k] = l->exact[j][k] + deviations[k] * lg_rng_normal(&rng);
}

typedef struct result {
    double value[PARAMETERS], error[PARAMETERS + 1], covariance[49], noise[2];
    lg_program_log_result of;
} result;

static void fit(lg_program *program, const logged *l, result *r) {
    r->of = (lg_program_log_result){.error = r->error, .covariance = r->covariance, .noise = r->noise};
    assert_told(lg_program_fit_log(NULL, program, "step", "seen", &l->log, NULL, &r->of, &told));
    get(program, r->value);
}

/* Mean and standard deviation of the columns of rows (count, PARAMETERS). */
static void spread_of(size_t count, numbers *rows, double *mean, double *deviation) {
    for (int i = 0; i < PARAMETERS; i++) {
        double sum = 0.0, squares = 0.0;
        for (size_t k = 0; k < count; k++) sum += rows[k][i];
        mean[i] = sum / (double)count;
        for (size_t k = 0; k < count; k++) squares += pow(rows[k][i] - mean[i], 2.0);
        deviation[i] = sqrt(squares / ((double)count - 1.0));
    }
}

TEST("over 200 logs 90 to 98 % of the intervals of 1.96 standard errors hold the parameter, for windows and "
     "for whole "
     "runs") {
    enum { LOGS = 200 };
    numbers *values = TEST_ARRAY(numbers, LOGS);
    double mean[PARAMETERS], spread[PARAMETERS];
    logged *l = simulate();
    result r;
    for (size_t window = 0; window <= 40; window += 40) {
        double error[PARAMETERS] = {0};
        int held[PARAMETERS] = {0};
        lg_program *program = build(truth, false);
        l->log.window = window;
        for (int k = 0; k < LOGS; k++) {
            add_noise(l, (uint64_t)(100 + k));
            set(program, truth);
            fit(program, l, &r);
            memcpy(values[k], r.value, sizeof r.value);
            for (int i = 0; i < PARAMETERS; i++) {
                held[i] += fabs(r.value[i] - truth[i]) < 1.96 * r.error[i];
                error[i] += r.error[i] / LOGS;
            }
        }
        spread_of(LOGS, values, mean, spread);
        for (int i = 0; i < PARAMETERS; i++) {
            print_message("window %zu, parameter %d: %.1f %% hold it; stated/spread %.3f\n", window, i,
                          100.0 * held[i] / LOGS, error[i] / spread[i]);
            assert_in_range(held[i], LOGS * 90 / 100, LOGS * 98 / 100);
            assert_close(error[i], spread[i], 0.15, 0.0);
            assert_close(mean[i], truth[i], 0.0, 4.0 * spread[i] / sqrt(LOGS));
        }
    }
}

TEST("stated errors are within 5 % of a bootstrap, which draws the noise of a log again") {
    enum { DRAWS = 800 };
    numbers *values = TEST_ARRAY(numbers, DRAWS);
    double mean[PARAMETERS], spread[PARAMETERS], ratio = 0.0;
    logged *l = simulate();
    lg_program *program = build(truth, false);
    lg_rng rng = test_rng(9, 2);
    result first, r;
    add_noise(l, 7);
    fit(program, l, &first);
    pair *residual = TEST_ARRAY(pair, ROWS);
    for (int j = 0; j < ROWS; j++)
        for (int k = 0; k < 2; k++)
            residual[j][k] = (l->y[j][k] - l->exact[j][k]) * first.noise[k] / deviations[k];
    double squares[2] = {0};
    for (int j = 0; j < ROWS; j++)
        for (int k = 0; k < 2; k++) squares[k] += residual[j][k] * residual[j][k] / ROWS;
    l->log.scale = first.noise;
    for (int n = 0; n < DRAWS; n++) {
        for (int j = 0; j < ROWS; j++)
            for (int k = 0; k < 2; k++)
                l->y[j][k] = l->exact[j][k] +
                             residual[lg_rng_below(&rng, ROWS)][k] * first.noise[k] / sqrt(squares[k]);
        set(program, truth);
        fit(program, l, &r);
        memcpy(values[n], r.value, sizeof r.value);
    }
    spread_of(DRAWS, values, mean, spread);
    for (int i = 0; i < PARAMETERS; i++) {
        print_message("parameter %d: stated/bootstrap %.3f\n", i, first.error[i] / spread[i]);
        assert_close(first.error[i], spread[i], 0.1, 0.0);
        ratio += first.error[i] / spread[i] / PARAMETERS;
    }
    print_message("stated/bootstrap %.3f on average\n", ratio);
    assert_close(ratio, 1.0, 0.05, 0.0);
}

TEST("a poor guess converges in windows of any length, and then whole runs give smaller errors") {
    static const double guess[PARAMETERS] = {1, 0.1, 0.2, 0.05, 0.02, 0.1};
    logged *l = simulate();
    result whole, windows;
    add_noise(l, 3);
    lg_program *program = build(guess, false);
    fit(program, l, &whole);
    assert_true(strstr(whole.of.end, "rounding") != NULL);
    assert_true(whole.of.block == 0.0 && whole.of.open == 0);
    for (size_t window = 10; window <= 80; window *= 2) {
        set(program, guess);
        l->log.window = window;
        fit(program, l, &windows);
        for (int i = 0; i < PARAMETERS; i++) {
            assert_close(windows.value[i], truth[i], 0.0, 5.0 * windows.error[i]);
            assert_true(windows.error[i] > whole.error[i]);
        }
        l->log.window = 0;
        fit(program, l, &windows);
        for (int i = 0; i < PARAMETERS; i++)
            assert_close(windows.value[i], whole.value[i], 0.0, 1e-3 * whole.error[i]);
    }
    for (int k = 0; k < 2; k++) assert_close(whole.noise[k], deviations[k], 0.15, 0.0);
    for (int i = 0; i < PARAMETERS; i++)
        assert_close(sqrt(whole.covariance[i * PARAMETERS + i]), whole.error[i], 1e-12, 0.0);
}

TEST("volts and amperes in units of 1e-9 change parameters and errors by the powers of 1e9 that they must") {
    static const int power[PARAMETERS] = {0, 0, 1, 2, 2, 2};
    double guess[PARAMETERS];
    logged *l = simulate();
    result r, scaled;
    add_noise(l, 5);
    for (int i = 0; i < PARAMETERS; i++) guess[i] = truth[i] * (i % 2 ? 1.3 : 0.8);
    fit(build(guess, false), l, &r);
    for (int i = 0; i < PARAMETERS; i++) guess[i] *= pow(1e9, power[i]);
    for (int j = 0; j < ROWS; j++) l->u[j] *= 1e9, l->y[j][1] *= 1e9;
    fit(build(guess, false), l, &scaled);
    for (int i = 0; i < PARAMETERS; i++) {
        const double unit = pow(1e9, power[i]);
        assert_close(scaled.value[i] / unit, r.value[i], 0.0, 1e-4 * r.error[i]);
        assert_close(scaled.error[i] / unit, r.error[i], 1e-5, 0.0);
    }
}

TEST("two parameters that appear only as a sum have infinite errors, the others keep theirs") {
    logged *l = simulate();
    result r, open;
    add_noise(l, 6);
    fit(build(truth, false), l, &r);
    fit(build(truth, true), l, &open);
    assert_int_equal(open.of.open, 2);
    assert_true(isinf(open.error[0]) && isinf(open.error[6]) && isinf(open.covariance[0]));
    for (int i = 1; i < PARAMETERS; i++) {
        assert_close(open.value[i], r.value[i], 0.0, 1e-3 * r.error[i]);
        assert_close(open.error[i], r.error[i], 1e-2, 0.0);
    }
}

TEST("values that are not measured are left out; a residual that is correlated in time widens the errors") {
    logged *l = simulate();
    result r, half, coloured;
    lg_program *program = build(truth, false);
    add_noise(l, 8);
    fit(program, l, &r);
    for (int j = 1; j < ROWS; j += 2) l->y[j][0] = l->y[j - 1][1] = NAN;
    fit(program, l, &half);
    for (int i = 0; i < PARAMETERS; i++) {
        assert_close(half.value[i], truth[i], 0.0, 4.0 * half.error[i]);
        assert_true(half.error[i] > 1.15 * r.error[i] && half.error[i] < 2.0 * r.error[i]);
    }
    for (int j = 0; j < ROWS; j++) l->y[j][1] = NAN; /* angle alone: J, c, d and K come as ratios */
    set(program, truth);
    fit(program, l, &half);
    assert_true(half.of.open >= 3 && isnan(half.noise[1]) && isfinite(half.noise[0]));
    add_noise(l, 8);
    for (int j = 1; j < ROWS; j++)
        for (int k = 0; k < 2; k++) l->y[j][k] += 0.9 * (l->y[j - 1][k] - l->exact[j - 1][k]);
    set(program, truth);
    fit(program, l, &coloured);
    assert_true(coloured.of.block > 10 * h);
    for (int i = 0; i < PARAMETERS; i++)
        assert_close(coloured.value[i], truth[i], 0.0, 4.0 * coloured.error[i]);
}

TEST("several runs are several windows, and a state that is measured itself needs no function") {
    static const size_t first[] = {0, 100, 110, 200};
    logged *l = simulate();
    result r;
    add_noise(l, 2);
    l->log.first = first, l->log.runs = 4;
    for (int j = 100; j < ROWS; j++) l->t[j] -= 2.0; /* times begin anew */
    lg_program *program = build(truth, false);
    fit(program, l, &r);
    for (int i = 0; i < PARAMETERS; i++) assert_close(r.value[i], truth[i], 0.0, 4.0 * r.error[i]);
    triple *x = TEST_ARRAY(triple, ROWS);
    for (int j = 0; j < ROWS; j++) x[j][0] = l->y[j][0], x[j][1] = NAN, x[j][2] = l->y[j][1];
    l->log.y = x[0];
    lg_program *again = build(truth, false);
    assert_told(lg_program_fit_log(NULL, again, "step", NULL, &l->log, NULL, &r.of, &told));
    double value[PARAMETERS];
    get(again, value);
    for (int i = 0; i < PARAMETERS; i++) assert_close(value[i], r.value[i], 0.0, 1e-3 * r.error[i]);
}

TEST("logs that cannot be fitted are rejected with a sentence, and the program stays as it was") {
    static const size_t wrong[] = {0, 300};
    logged *l = simulate();
    lg_program *program = build(truth, false);
    double value[PARAMETERS];
    lg_program_log_result none = {.error = NULL};
    lg_error error;
#define REJECTS(step, seen, status, words)                                                                   \
    do {                                                                                                     \
        assert_int_equal(lg_program_fit_log(NULL, program, step, seen, &l->log, NULL, &none, &error),        \
                         status);                                                                            \
        if (strstr(error.message, words) == NULL) fail_msg("%s", error.message);                             \
    } while (0)
    REJECTS("none", "seen", LG_NOT_FOUND, "none");
    REJECTS("seen", "seen", LG_SHAPE, "x (n), u (m), h (1)");
    REJECTS("step", "step", LG_SHAPE, "x (n) -> y (k)");
    l->log.window = ROWS + 1;
    REJECTS("step", "seen", LG_INVALID_ARGUMENT, "longest run");
    l->log.window = 1;
    REJECTS("step", "seen", LG_INVALID_ARGUMENT, "at least 2 rows");
    l->log.window = 2;
    for (int j = 0; j < ROWS; j += 2) l->y[j][0] = NAN;
    REJECTS("step", "seen", LG_INVALID_ARGUMENT, "take longer windows");
    l->log.window = 0, l->log.first = wrong, l->log.runs = 2;
    REJECTS("step", "seen", LG_INVALID_ARGUMENT, "run 0 of the log, from row 0 on");
    l->log.first = NULL, l->t[5] = l->t[4];
    REJECTS("step", "seen", LG_INVALID_ARGUMENT, "row 5");
    l->t[5] = 5 * h, l->u[7] = NAN;
    REJECTS("step", "seen", LG_NOT_FINITE, "row 7");
    l->u[7] = 0.0, l->y[9][1] = INFINITY;
    REJECTS("step", "seen", LG_NOT_FINITE, "row 9");
    l->log.u = NULL;
    REJECTS("step", "seen", LG_INVALID_ARGUMENT, "no u");
    get(program, value);
    for (int i = 0; i < PARAMETERS; i++) assert_true(value[i] == truth[i]);
}
