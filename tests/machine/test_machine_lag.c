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

/* x_1' = a (u - x_1), and with order 2 x_2' = a (x_1 - x_2): the last one at s by many small steps of rk4; u
 * has the coefficients c. */
static double integrate(uint32_t order, double a, const double *c, const double *from, double s) {
    enum { STEPS = 20000 };
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1, 2, 2, 1};
    const double h = s / STEPS;
    double x[2] = {from[0], order == 2 ? from[1] : 0};
    for (int i = 0; i < STEPS; i++) {
        double k[2] = {0, 0}, sum[2] = {0, 0};
        for (int j = 0; j < 4; j++) {
            const double t = (i + at[j]) * h, u = c[0] + t * (c[1] + t * (c[2] + t * c[3])),
                         y[2] = {x[0] + at[j] * h * k[0], x[1] + at[j] * h * k[1]};
            k[0] = a * (u - y[0]), k[1] = a * (y[0] - y[1]);
            for (int d = 0; d < 2; d++) sum[d] += h / 6 * weight[j] * k[d];
        }
        for (int d = 0; d < 2; d++) x[d] += sum[d];
    }
    return x[order - 1];
}

static double moved(uint32_t order, double z, const double *c, double s, const double *x) {
    lg_lag_weights w;
    const double from[6] = {x[0], 0, 0, x[1]};
    double out[6];
    lg_lag_weights_at(z * s, &w);
    lg_lag_move(&w, order, s, c, 1, from, out);
    return out[3 * order - 3];
}

static const double zs[] = {1e-12, 1e-6, 1e-3, 0.1, 0.7, 1.999, 2.001, 5, 30, 700};

TEST("an interval of a lag with a cubic input is that of fine steps, at any ratio of step and lag") {
    const double c[4] = {0.7, -1.3, 0.4, 0.9}, x[2] = {-0.6, 0.8};
    for (uint32_t order = 1; order <= 2; order++)
        for (size_t i = 0; i < LG_COUNT(zs); i++)
            for (double s = 0.3; s < 1.1; s += 0.7)
                assert_close(moved(order, zs[i], c, s, x), integrate(order, zs[i], c, x, s), 1e-9, 1e-12);
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
            for (int d = 0; d < 3; d++)
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
    d->log = (lg_machine_log){ROWS, PARTS, d->first, d->t, d->q, d->v, d->u, NULL, NULL, NULL};
    return d;
}

static const char *const kinds[] = {"lag", "second_order_lag"};

/* A line with inputs u and w; w has an unknown lag of this order, u a first-order one of .05 s if `both`. */
static lg_machine lagged_line(bool both, uint32_t order) {
    lg_machine machine = empty_machine();
    add_coordinate(&machine, "x", LG_COORDINATE_LINE);
    add_input(&machine, "u");
    add_input(&machine, "w");
    odd_scales(&machine);
    machine.scales.lag[0] = 0.004, machine.scales.lag[1] = 4;
    add_term(&machine, LG_MACHINE_MASS, "constant");
    add_values(add_term(&machine, LG_MACHINE_INPUT_MAP, "known"), 2, (double[]){1.3, -0.8});
    add_feature(add_term(&machine, LG_MACHINE_ACTUATOR, kinds[order - 1]), LG_FEATURE_INPUT, 1);
    if (both) {
        lg_machine_term *known = add_term(&machine, LG_MACHINE_ACTUATOR, "lag");
        add_feature(known, LG_FEATURE_INPUT, 0);
        add_values(known, 1, (double[]){0.05});
    }
    assert_machine(&machine);
    return machine;
}

/* Compares the lagged inputs x (ROWS, lags, 3) with fine steps from row to row. */
static void check_recursion(const lg_machine *machine, const data *d, const double *tau, const double *x) {
    const uint32_t n = machine->lags;
    for (uint32_t k = 0; k < n; k++)
        for (size_t i = 0; i + 1 < ROWS; i++) {
            const bool second = k > 0 && machine->lagged[k - 1] == machine->lagged[k];
            const uint32_t first = k - second, input = machine->lagged[k];
            const double h = d->t[i + 1] - d->t[i], *u = d->u + 8 * i + input,
                         c[4] = {u[0], u[2], u[4], u[6]},
                         from[2] = {x[(i * n + first) * 3], x[(i * n + k) * 3]};
            if (i + 1 == FIRST || i + 1 == SECOND) continue;
            assert_close(x[((i + 1) * n + k) * 3], integrate(1 + second, h / tau[k], c, from, 1), 1e-9,
                         1e-10);
        }
}

enum { LAGS = 3 }; /* most of lagged_line */

TEST("lagged inputs of a log begin at u where a part begins at rest, else at 0, and follow the recursion") {
    for (uint32_t order = 1; order <= 2; order++) {
        const lg_machine machine = lagged_line(true, order);
        const data *d = make_data(true, 1);
        const double tau[LAGS] = {0.05, 0.03, 0.03};
        size_t at[ROWS];
        double x[ROWS * LAGS * 3], kept[ROWS * LAGS * 3];
        const uint32_t n = machine.lags;
        for (size_t i = 0; i < ROWS; i++) at[i] = i;
        assert_int_equal(n, 1 + order);
        assert_ok(lg_machine_lag_states(&machine, &d->log, tau, at, ROWS, x));
        for (uint32_t k = 0; k < n; k++) {
            assert_true(x[3 * k] == d->u[machine.lagged[k]]);
            assert_true(x[(FIRST * n + k) * 3] == 0.0 && x[(SECOND * n + k) * 3] == 0.0);
        }
        check_recursion(&machine, d, tau, x);
        lg_machine_log with = d->log;
        assert_told(lg_machine_filter_create(NULL, &machine, &d->log, &with.filter, &told));
        for (int round = 0; round < 3; round++) {
            const double w = round == 1 ? 0.2 : 0.03, other[LAGS] = {0.05, w, w};
            assert_ok(lg_machine_lag_states(&machine, &with, other, at, ROWS, kept));
            assert_true((kept[(4 * n + n - 1) * 3] == x[(4 * n + n - 1) * 3]) == (round != 1));
        }
        assert_memory_equal(kept, x, (size_t)ROWS * n * 3 * sizeof *x);
        lg_machine_filter_destroy(with.filter);
        const double start[PARTS * LAGS] = {1, 2, 3, 4, 5, 6, 7, 8, 9};
        with = d->log, with.lag = start;
        assert_ok(lg_machine_lag_states(&machine, &with, tau, at, ROWS, x));
        for (uint32_t k = 0; k < n; k++)
            assert_true(x[3 * k] == start[k] && x[(SECOND * n + k) * 3] == start[2 * n + k]);
    }
}

TEST("lagged inputs do not depend on the unit of time") {
    const lg_machine machine = lagged_line(true, 2);
    static const double units[] = {1e-9, 1e9};
    size_t at[ROWS];
    double x[ROWS * LAGS * 3], other[ROWS * LAGS * 3];
    for (size_t i = 0; i < ROWS; i++) at[i] = i;
    assert_ok(lg_machine_lag_states(&machine, &make_data(true, 1)->log, (const double[]){0.05, 0.03, 0.03},
                                    at, ROWS, x));
    for (size_t k = 0; k < LG_COUNT(units); k++) {
        const double tau[LAGS] = {0.05 * units[k], 0.03 * units[k], 0.03 * units[k]};
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
    assert_ok(fit.residuals(fit.user, tape, at, samples, problem.windows, problem.windows, &y));
    y = lg_sum(tape, lg_square(tape, y));
    assert_ok(lg_read(tape, y, 1, &loss));
    if (gradient == NULL) return loss;
    assert_ok(lg_grad(tape, y, &at, 1, &g));
    assert_ok(lg_read(tape, g, machine->parameters, gradient));
    const lg_var last = lg_sum(tape, lg_slice(tape, g, 0, (uint32_t)machine->parameters - 1, 1));
    assert_ok(lg_grad(tape, last, &at, 1, &gg));
    assert_ok(lg_read(tape, gg, machine->parameters, second));
    return loss;
}

static void check_loss(uint32_t order, bool jitter, double tau) {
    static const double h = 1e-4;
    const lg_machine machine = lagged_line(false, order);
    const size_t n = machine.parameters;
    const data *d = make_data(jitter, 1);
    double theta[4] = {0.2}, g[4], gg[4], low[4], high[4], unused[4];
    assert_int_equal(lg_machine_set_lags(&machine, tau, theta), 1);
    (void)loss_at(&machine, d, 6, theta, g, gg);
    theta[n - 1] -= h;
    const double below = loss_at(&machine, d, 6, theta, low, unused);
    theta[n - 1] += 2 * h;
    const double above = loss_at(&machine, d, 6, theta, high, unused);
    assert_close(g[n - 1], (above - below) / (2 * h), 1e-6, 1e-9 * fabs(above) / h);
    assert_close(gg[n - 1], (high[n - 1] - low[n - 1]) / (2 * h), 1e-5, 1e-7);
}

TEST("the loss has the first and second derivative of the lag: tiny, usual and huge ones, jitter, gaps") {
    static const double taus[] = {0.0045, 0.02, 0.3, 3.7};
    for (uint32_t order = 1; order <= 2; order++)
        for (size_t i = 0; i < LG_COUNT(taus); i++)
            for (int jitter = 0; jitter < 2; jitter++) check_loss(order, jitter == 1, taus[i]);
}

/* ---- the program ---- */

static void check_step(uint32_t order) {
    const lg_machine machine = lagged_line(true, order);
    const uint32_t n = machine.lags;
    double *theta = machine_theta(&machine, 5);
    lg_program *program = NULL;
    assert_told(lg_machine_program(NULL, &machine, theta, lg_scheme_find("cf4"), false, &program, &told));
    lg_test_owns(program, release_program);
    const ready step = make_ready(program, "step", 1, LG_F64),
                momenta = make_ready(program, "momenta", 1, LG_F64),
                positions = make_ready(program, "positions", 1, LG_F64);
    const double t[4] = {0, 0.03, 0.06, 0.09}, q[4] = {0.4}, v[4] = {0.7};
    double u[4 * 8] = {0}, out_q[4], out_v[4], tau[LAGS], x[2 + LAGS], got;
    const size_t first[2] = {0, 4}, start = 0;
    for (int i = 0; i < 4; i++) u[8 * i] = 0.5 * i - 0.2, u[8 * i + 1] = 1.5 - i;
    const double lag[LAGS] = {0.9, -0.3, 0.5};
    const lg_machine_log log = {4, 1, first, t, q, v, u, lag, NULL, NULL};
    assert_told(lg_machine_free_run(NULL, &machine, theta, lg_scheme_find("cf4"), 1, &log, &start, 1, 3,
                                    out_q, out_v, &told));
    lg_plan_eval(momenta.plan, (const void *const[]){q, v}, (void *const[]){x}, momenta.work);
    memcpy(x + 2, lag, n * sizeof *x);
    lg_identified numbers[4];
    assert_int_equal(lg_machine_numbers(&machine, theta, 4, numbers), 2);
    assert_string_equal(numbers[1].name, "lag.w");
    tau[0] = 0.05, tau[1] = tau[2] = numbers[1].value;
    for (int i = 0; i < 3; i++) {
        const double h = 0.03, w = u[8 * i + 1], z = h / tau[1], a = x[3], b = x[4];
        const double want[LAGS] = {u[8 * i] + (x[2] - u[8 * i]) * exp(-h / tau[0]), w + (a - w) * exp(-z),
                                   w + (b - w + (a - w) * z) * exp(-z)};
        lg_plan_eval(step.plan, (const void *const[]){x, u + 8 * i, &h}, (void *const[]){x}, step.work);
        assert_all_close(x + 2, want, n, 1e-14, 1e-14);
        lg_plan_eval(positions.plan, (const void *const[]){x}, (void *const[]){&got}, positions.work);
        assert_close(got, out_q[i + 1], 1e-12, 1e-13);
    }
}

TEST("a step of the program with a held input is that of the log, and its lags are exact") {
    for (uint32_t order = 1; order <= 2; order++) check_step(order);
}

TEST("lagged inputs at rows follow the time constants of the parameters; without lags, no array is made") {
    for (uint32_t order = 1; order <= 2; order++) {
        lg_machine machine = lagged_line(true, order);
        const double *theta = machine_theta(&machine, 5);
        const data *d = make_data(true, 1);
        const size_t at[3] = {3, 30, 59};
        const uint32_t n = machine.lags;
        lg_identified numbers[4];
        double x[3 * LAGS], states[3 * LAGS * 3];
        assert_int_equal(lg_machine_numbers(&machine, theta, 4, numbers), 2);
        const double tau[LAGS] = {0.05, numbers[1].value, numbers[1].value};
        assert_ok(lg_machine_lagged_inputs(NULL, &machine, theta, &d->log, at, 3, x, NULL));
        assert_ok(lg_machine_lag_states(&machine, &d->log, tau, at, 3, states));
        for (uint32_t i = 0; i < 3 * n; i++) assert_close(x[i], states[3 * i], 1e-12, 1e-14);
        assert_status(lg_machine_lagged_inputs(NULL, &machine, NULL, &d->log, at, 3, x, NULL),
                      LG_INVALID_ARGUMENT);
        EVERY_ALLOCATION_FAILS(
            context, 1,
            status = lg_machine_lagged_inputs(context, &machine, theta, &d->log, at, 3, x, NULL););
        x[0] = 7;
        assert_ok(lg_machine_lagged_inputs(NULL, &machine, theta, &d->log, at, 0, x, NULL));
        machine.term_count = 2;
        assert_machine(&machine);
        assert_int_equal(machine.lags, 0);
        assert_ok(lg_machine_lagged_inputs(NULL, &machine, theta, &d->log, at, 3, x, NULL));
        assert_close(x[0], 7, 0, 0);
    }
}

/* x: the state of the line, then the lagged inputs of w, of which the line sees the last one. */
static void check_model(uint32_t order) {
    const lg_machine machine = lagged_line(false, order);
    const uint32_t n = 2 + order;
    double *theta = machine_theta(&machine, 5);
    lg_model *model;
    lg_ekf *ekf;
    double rates[4], A[16], B[8], x[4] = {0.3, 0.5, -0.2, 0.6}, root[16] = {0}, tau;
    const double u[2] = {0.7, 1.1};
    lg_identified numbers[4];
    assert_told(test_machine_model(NULL, &machine, theta, &model, &told));
    lg_test_owns(model, release_model);
    void *work = test_work(lg_model_work_size(model));
    assert_int_equal(lg_model_inputs(model), n);
    assert_int_equal(lg_model_tangent_dim(model), n);
    assert_int_equal(lg_machine_numbers(&machine, theta, 4, numbers), 2);
    tau = numbers[1].value;
    assert_ok(lg_model_field(model, x, u, rates, work));
    assert_close(rates[2], (u[1] - x[2]) / tau, 1e-13, 1e-13);
    if (order == 2) assert_close(rates[3], (x[2] - x[3]) / tau, 1e-13, 1e-13);
    assert_close(rates[1], 1.3 * u[0] - 0.8 * x[n - 1], 1e-13, 1e-13);
    assert_ok(lg_model_linearise(model, x, u, A, B, NULL, work));
    for (uint32_t k = 2; k < n; k++) {
        assert_close(A[n + k], k == n - 1 ? -0.8 : 0, 1e-13, 1e-13);
        assert_close(A[k * n + k], -1 / tau, 1e-13, 1e-13);
        assert_close(B[2 * k + 1], k == 2 ? 1 / tau : 0, 1e-13, 1e-13);
    }
    if (order == 2) assert_close(A[3 * n + 2], 1 / tau, 1e-13, 1e-13);
    assert_close(B[3], 0, 0, 1e-13);
    const lg_sensor sensor = {.kind = LG_SENSOR_POSITION, .noise = 0.1};
    lg_ekf_options options;
    lg_ekf_options_init(&options);
    for (uint32_t k = 0; k < n; k++) root[k * n + k] = 1;
    options.scheme = lg_scheme_find("cf4");
    options.state = x, options.P = options.W = root, options.sensors = &sensor, options.sensor_count = 1;
    const size_t bytes = lg_ekf_size(model, options.scheme, 1);
    assert_told(lg_ekf_init(model, &options, &ekf, test_work(bytes), bytes, &told));
    assert_ok(lg_ekf_predict(ekf, 0.1 * tau, u));
    for (uint32_t k = 2; k < n; k++)
        assert_close(lg_ekf_state(ekf)[k], integrate(k - 1, 0.1, (const double[4]){u[1]}, x + 2, 1), 1e-6,
                     1e-6);
}

TEST("a model with a lag has it in its field and its linearisation, and a filter can be made of it") {
    for (uint32_t order = 1; order <= 2; order++) check_model(order);
}
