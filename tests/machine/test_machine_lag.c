/* Lags of inputs: closed forms against fine integration, derivatives against differences, kept states,
 * steps of programs, and fits of simulated logs. */
#include "support/machine_support.h"
#include "support/model_support.h"
#include "support/plan_support.h"

#include "liegrad/control.h"
#include "liegrad/model.h"
#include "liegrad/ops.h"
#include "machine/internal.h"

/* ---- one interval ---- */

/* x(1) of x' = a (u - x) from x0 by many small steps of rk4; u has the coefficients c. */
static double integrate(double a, const double *c, double x, double s) {
    enum { STEPS = 20000 };
    const double h = s / STEPS;
    for (int i = 0; i < STEPS; i++) {
        double u[3], k[4];
        for (int j = 0; j < 3; j++) {
            const double t = (i + 0.5 * j) * h;
            u[j] = c[0] + t * (c[1] + t * (c[2] + t * c[3]));
        }
        k[0] = a * (u[0] - x), k[1] = a * (u[1] - x - 0.5 * h * k[0]);
        k[2] = a * (u[1] - x - 0.5 * h * k[1]), k[3] = a * (u[2] - x - h * k[2]);
        x += h / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3]);
    }
    return x;
}

static double moved(double z, const double *c, double s, double x) {
    lg_lag_weights w;
    const double from[3] = {x, 0, 0};
    double out[3];
    lg_lag_weights_at(z * s, &w);
    lg_lag_move(&w, s, c, 1, from, out);
    return out[0];
}

static const double zs[] = {1e-12, 1e-6, 1e-3, 0.1, 0.7, 1.999, 2.001, 5, 30, 700};

TEST("an interval of a lag with a cubic input is that of fine steps, at any ratio of step and lag") {
    const double c[4] = {0.7, -1.3, 0.4, 0.9};
    for (size_t i = 0; i < LG_COUNT(zs); i++)
        for (double s = 0.3; s < 1.1; s += 0.7)
            assert_close(moved(zs[i], c, s, -0.6), integrate(zs[i], c, -0.6, s), 1e-9, 1e-12);
}

TEST("weights of small intervals keep their digits") {
    for (double z = 1e-300; z < 1e-8; z *= 1e12) {
        lg_lag_weights w;
        lg_lag_weights_at(z, &w);
        for (int j = 0; j < 4; j++) {
            assert_close(w.g[j][0], z / (j + 1), 2e-8, 0);
            assert_close(w.g[j][1], -z / (j + 1), 2e-8, 0);
            assert_close(w.g[j][2], z / (j + 1), 2e-8, 0);
        }
    }
}

TEST("derivatives of the weights by log tau are those of differences") {
    static const double h = 1e-4;
    for (size_t i = 0; i < LG_COUNT(zs); i++) {
        lg_lag_weights w, low, high;
        lg_lag_weights_at(zs[i], &w);
        lg_lag_weights_at(zs[i] * exp(h), &low); /* tau smaller by e^-h */
        lg_lag_weights_at(zs[i] * exp(-h), &high);
        for (int j = 0; j < 5; j++) {
            const double *at = j < 4 ? w.g[j] : w.E, *a = j < 4 ? low.g[j] : low.E,
                         *b = j < 4 ? high.g[j] : high.E;
            const double size = fmin(1.0, zs[i]);
            for (int d = 0; d < 2; d++)
                assert_close((b[d] - a[d]) / (2 * h), at[d + 1], 1e-5, 1e-5 * size + 1e-11);
        }
    }
}

/* ---- logs ---- */

enum { ROWS = 60, PARTS = 3, FIRST = 25, SECOND = 40 };

/* A log of a line with two inputs: three parts (the first from rest), jittering steps, cubic inputs. */
typedef struct data {
    double t[ROWS], q[ROWS], v[ROWS], u[ROWS * 8];
    size_t first[PARTS + 1];
    lg_machine_log log;
} data;

static data *make_data(bool jitter, double unit) {
    data *d = TEST_ARRAY(data, 1);
    const double *noise = test_numbers(4, ROWS * 10, -1, 1);
    double t = 0;
    for (int i = 0; i < ROWS; i++) {
        d->t[i] = t;
        t += unit * (jitter ? 0.02 * (1 + 0.5 * noise[i]) : 0.02) +
             (i == FIRST - 1 || i == SECOND - 1 ? unit : 0);
        d->q[i] = noise[ROWS + i];
        d->v[i] = (i == 0 ? 0 : noise[2 * ROWS + i]) / unit;
        for (int k = 0; k < 8; k++) d->u[8 * i + k] = noise[(2 + k) * ROWS / 2 + i] / (1 + k / 2);
    }
    d->first[1] = FIRST, d->first[2] = SECOND, d->first[3] = ROWS;
    d->log = (lg_machine_log){ROWS, PARTS, d->first, d->t, d->q, d->v, d->u, NULL, NULL};
    return d;
}

/* A line with inputs u and w; w has an unknown lag, u one of .05 s if `both`. */
static lg_machine lagged_line(bool both) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_input(&machine, "u");
    add_input(&machine, "w");
    odd_scales(&machine);
    machine.scales.lag[0] = 0.004, machine.scales.lag[1] = 4;
    add_term(&machine, LG_MACHINE_MASS, "constant");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 2, (double[]){1.3, -0.8});
    add_feature(add_term(&machine, LG_MACHINE_ACTUATOR, "lag"), LG_FEATURE_INPUT, 1);
    if (both) {
        lg_machine_term *known = add_term(&machine, LG_MACHINE_ACTUATOR, "lag");
        add_feature(known, LG_FEATURE_INPUT, 0);
        add_values(known, 1, (double[]){0.05});
    }
    assert_machine(&machine);
    return machine;
}

TEST("lagged inputs of a log begin at u where a part begins at rest, else at 0, and follow the recursion") {
    const lg_machine machine = lagged_line(true);
    const data *d = make_data(true, 1);
    const double tau[2] = {0.05, 0.03};
    size_t at[ROWS];
    double x[ROWS * 2 * 3], kept[ROWS * 2 * 3];
    for (size_t i = 0; i < ROWS; i++) at[i] = i;
    assert_int_equal(machine.lags, 2);
    assert_ok(lg_machine_lag_states(&machine, &d->log, tau, at, ROWS, x));
    for (int k = 0; k < 2; k++) {
        assert_true(x[3 * k] == d->u[k]);
        assert_true(x[(FIRST * 2 + k) * 3] == 0.0 && x[(SECOND * 2 + k) * 3] == 0.0);
        for (size_t i = 0; i + 1 < ROWS; i++) {
            const double h = d->t[i + 1] - d->t[i];
            const double c[4] = {d->u[8 * i + k], d->u[8 * i + 2 + k], d->u[8 * i + 4 + k],
                                 d->u[8 * i + 6 + k]};
            if (i + 1 == FIRST || i + 1 == SECOND) continue;
            assert_close(x[((i + 1) * 2 + k) * 3], integrate(h / tau[k], c, x[(i * 2 + k) * 3], 1), 1e-9,
                         1e-10);
        }
    }
    lg_machine_log with = d->log;
    assert_told(lg_machine_filter_create(NULL, &machine, &d->log, &with.filter, &told));
    for (int round = 0; round < 3; round++) {
        const double other[2] = {0.05, round == 1 ? 0.2 : 0.03};
        assert_ok(lg_machine_lag_states(&machine, &with, other, at, ROWS, kept));
        assert_true((kept[4 * 6 + 3] == x[4 * 6 + 3]) == (round != 1));
    }
    assert_memory_equal(kept, x, sizeof x);
    lg_machine_filter_destroy(with.filter);
    const double start[PARTS * 2] = {1, 2, 3, 4, 5, 6};
    with = d->log, with.lag = start;
    assert_ok(lg_machine_lag_states(&machine, &with, tau, at, ROWS, x));
    assert_true(x[0] == 1 && x[3] == 2 && x[FIRST * 6] == 3 && x[SECOND * 6 + 3] == 6);
}

TEST("lagged inputs do not depend on the unit of time") {
    const lg_machine machine = lagged_line(true);
    static const double units[] = {1e-9, 1e9};
    size_t at[ROWS];
    double x[ROWS * 2 * 3], other[ROWS * 2 * 3];
    for (size_t i = 0; i < ROWS; i++) at[i] = i;
    assert_ok(
        lg_machine_lag_states(&machine, &make_data(true, 1)->log, (const double[]){0.05, 0.03}, at, ROWS, x));
    for (size_t k = 0; k < LG_COUNT(units); k++) {
        const double tau[2] = {0.05 * units[k], 0.03 * units[k]};
        assert_ok(lg_machine_lag_states(&machine, &make_data(true, units[k])->log, tau, at, ROWS, other));
        assert_all_close(other, x, LG_COUNT(x), 1e-8, 1e-8);
    }
}

/* Loss of windows over the log's parts. */
static double loss_at(const lg_machine *machine, const data *d, uint32_t window, const double *theta,
                      double *gradient, double *second) {
    size_t start[ROWS];
    uint32_t samples[ROWS];
    lg_machine_problem problem = {.machine = machine,
                                  .scheme = lg_scheme_find("cf4"),
                                  .substeps = 2,
                                  .window = window,
                                  .log = d->log,
                                  .start = start};
    lg_fit_problem fit;
    double loss;
    problem.windows = lg_machine_windows(machine, &d->log, window, 3, false, start);
    for (size_t i = 0; i < problem.windows; i++) samples[i] = (uint32_t)i;
    problem.position_scale[0] = problem.velocity_scale[0] = 1;
    assert_told(lg_machine_problem_check(&problem, &told));
    lg_machine_fit_problem(&problem, &fit);
    lg_tape *tape = test_tape(LG_F64);
    const lg_var at = lg_parameter(tape, lg_shape1((uint32_t)machine->parameters), theta);
    lg_var y, g, gg;
    assert_ok(fit.loss(fit.user, tape, at, samples, problem.windows, problem.windows, &y));
    assert_ok(lg_read(tape, y, 1, &loss));
    if (gradient == NULL) return loss;
    assert_ok(lg_grad(tape, y, &at, 1, &g));
    assert_ok(lg_read(tape, g, machine->parameters, gradient));
    const lg_var last = lg_sum(tape, lg_slice(tape, g, 0, (uint32_t)machine->parameters - 1, 1));
    assert_ok(lg_grad(tape, last, &at, 1, &gg));
    assert_ok(lg_read(tape, gg, machine->parameters, second));
    return loss;
}

TEST("the loss has the first and second derivative of the lag: tiny, usual and huge ones, jitter, gaps") {
    const lg_machine machine = lagged_line(false);
    static const double taus[] = {0.0045, 0.02, 0.3, 3.7}, h = 1e-4;
    const size_t n = machine.parameters;
    for (int jitter = 0; jitter < 2; jitter++)
        for (size_t i = 0; i < LG_COUNT(taus); i++) {
            const data *d = make_data(jitter == 1, 1);
            double theta[4] = {0.2}, g[4], gg[4], low[4], high[4], unused[4];
            assert_int_equal(lg_machine_set_lags(&machine, taus[i], theta), 1);
            (void)loss_at(&machine, d, 6, theta, g, gg);
            theta[n - 1] -= h;
            const double below = loss_at(&machine, d, 6, theta, low, unused);
            theta[n - 1] += 2 * h;
            const double above = loss_at(&machine, d, 6, theta, high, unused);
            assert_close(g[n - 1], (above - below) / (2 * h), 1e-6, 1e-9 * fabs(above) / h);
            assert_close(gg[n - 1], (high[n - 1] - low[n - 1]) / (2 * h), 1e-5, 1e-7);
        }
}

/* ---- the program ---- */

TEST("a step of the program with a held input is that of the log, and its lag is exact") {
    const lg_machine machine = lagged_line(true);
    double *theta = machine_theta(&machine, 5);
    lg_program *program = NULL;
    assert_told(lg_machine_program(NULL, &machine, theta, lg_scheme_find("cf4"), &program, &told));
    lg_test_owns(program, release_program);
    const ready step = make_ready(program, "step", 1, LG_F64),
                momenta = make_ready(program, "momenta", 1, LG_F64),
                positions = make_ready(program, "positions", 1, LG_F64);
    const double t[4] = {0, 0.03, 0.06, 0.09}, q[4] = {0.4}, v[4] = {0.7};
    double u[4 * 8] = {0}, out_q[4], out_v[4], tau[2], x[4], got;
    const size_t first[2] = {0, 4}, start = 0;
    for (int i = 0; i < 4; i++) u[8 * i] = 0.5 * i - 0.2, u[8 * i + 1] = 1.5 - i;
    const double lag[2] = {0.9, -0.3};
    const lg_machine_log log = {4, 1, first, t, q, v, u, lag, NULL};
    assert_told(lg_machine_free_run(NULL, &machine, theta, lg_scheme_find("cf4"), 1, &log, &start, 1, 3,
                                    out_q, out_v, &told));
    lg_plan_eval(momenta.plan, (const void *const[]){q, v}, (void *const[]){x}, momenta.work);
    x[2] = lag[0], x[3] = lag[1];
    lg_identified numbers[4];
    assert_int_equal(lg_machine_numbers(&machine, theta, 4, numbers), 2);
    assert_string_equal(numbers[1].name, "lag.w");
    tau[0] = 0.05, tau[1] = numbers[1].value;
    for (int i = 0; i < 3; i++) {
        const double h = 0.03, before[2] = {x[2], x[3]};
        lg_plan_eval(step.plan, (const void *const[]){x, u + 8 * i, &h}, (void *const[]){x}, step.work);
        for (int k = 0; k < 2; k++)
            assert_close(x[2 + k], u[8 * i + k] + (before[k] - u[8 * i + k]) * exp(-h / tau[k]), 1e-14,
                         1e-14);
        lg_plan_eval(positions.plan, (const void *const[]){x}, (void *const[]){&got}, positions.work);
        assert_close(got, out_q[i + 1], 1e-12, 1e-13);
    }
}

TEST("a model with a lag has it in its field and its linearisation, and a filter can be made of it") {
    const lg_machine machine = lagged_line(false);
    double *theta = machine_theta(&machine, 5);
    lg_model *model;
    lg_ekf *ekf;
    double rates[3], A[9], B[6], x[3] = {0.3, 0.5, -0.2}, root[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, tau;
    const double u[2] = {0.7, 1.1};
    lg_identified numbers[4];
    assert_told(test_machine_model(NULL, &machine, theta, &model, &told));
    lg_test_owns(model, release_model);
    void *work = test_work(lg_model_work_size(model));
    assert_int_equal(lg_model_inputs(model), 3);
    assert_int_equal(lg_model_tangent_dim(model), 3);
    assert_int_equal(lg_machine_numbers(&machine, theta, 4, numbers), 2);
    tau = numbers[1].value;
    assert_ok(lg_model_field(model, x, u, rates, work));
    assert_close(rates[2], (u[1] - x[2]) / tau, 1e-13, 1e-13);
    assert_close(rates[1], 1.3 * u[0] - 0.8 * x[2], 1e-13, 1e-13);
    assert_ok(lg_model_linearise(model, x, u, A, B, NULL, work));
    assert_close(A[5], -0.8, 1e-13, 1e-13);
    assert_close(A[8], -1 / tau, 1e-13, 1e-13);
    assert_close(B[5], 1 / tau, 1e-13, 1e-13);
    assert_close(B[3], 0, 0, 1e-13);
    const lg_sensor sensor = {.kind = LG_SENSOR_POSITION, .noise = 0.1};
    lg_ekf_options options;
    lg_ekf_options_init(&options);
    options.scheme = lg_scheme_find("cf4");
    options.state = x, options.P = options.W = root, options.sensors = &sensor, options.sensor_count = 1;
    const size_t bytes = lg_ekf_size(model, options.scheme, 1);
    assert_told(lg_ekf_init(model, &options, &ekf, test_work(bytes), bytes, &told));
    const double h = 0.1 * tau;
    assert_ok(lg_ekf_predict(ekf, h, u));
    assert_close(lg_ekf_state(ekf)[2], u[1] + (x[2] - u[1]) * exp(-0.1), 1e-6, 1e-6);
}
