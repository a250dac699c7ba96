/* How much cheaper the best inputs are that a search finds: compared with optima that are known, and with a
 * search over a grid of inputs.
 * ctest-labels: src/control */
#include "autodiff/program_support.h"
#include "liegrad/ops.h"
#include "support/policies.h"

enum { STARTS = 8 };

static lg_policy *create(const lg_context *context, const lg_policy_task *task, lg_program *plant) {
    lg_policy *policy = NULL;
    assert_told(lg_policy_create(context, task, plant, 1, &policy, &told));
    lg_test_owns(policy, release_policy);
    return policy;
}

/* ---- a mass without limits: the optimum is the regulator of the discrete Riccati equation ---- */

/* The mass m under u held for h, z = (q, v): S of the cost z^T S z, and the gain. */
static void solve_riccati(const double Q[2], double R, double m, double h, double S[2][2], double K[2]) {
    const double B[2] = {0.5 * h * h / m, h / m};
    S[0][0] = Q[0], S[1][1] = Q[1], S[0][1] = S[1][0] = 0;
    for (int k = 0; k < 5000; k++) {
        const double sb[2] = {S[0][0] * B[0] + S[0][1] * B[1], S[1][0] * B[0] + S[1][1] * B[1]};
        const double by = R + B[0] * sb[0] + B[1] * sb[1];
        const double sa[2][2] = {{S[0][0], S[0][0] * h + S[0][1]}, {S[1][0], S[1][0] * h + S[1][1]}};
        K[0] = sb[0] / by, K[1] = (sb[0] * h + sb[1]) / by;
        const double next[3] = {sa[0][0], sa[0][1], h * sa[0][1] + sa[1][1]};
        S[0][0] = Q[0] + next[0] - by * K[0] * K[0];
        S[0][1] = S[1][0] = next[1] - by * K[0] * K[1];
        S[1][1] = Q[1] + next[2] - by * K[1] * K[1];
    }
}

TEST("where the regulator is the optimum the search finds nothing better, in any units of mass and length") {
    static const double scales[][2] = {{1, 1}, {1e9, 1}, {1, 1e9}, {1e-9, 1e-9}};
    for (size_t i = 0; i < LG_COUNT(scales); i++) {
        const double m = scales[i][0], L = scales[i][1], h = 0.1, w = 0.05 / (m * m);
        double S[2][2], K[2];
        lg_policy_gap gap[STARTS];
        lg_policy_task task;
        lg_policy_task_init(&task);
        task.kind = LG_POLICY_LQR, task.coordinate_count = task.input_count = 1;
        task.coordinate[0] = coordinate("q", "v", LG_POLICY_LINE, L);
        task.coordinate[0].success = L;
        task.coordinate[0].start_velocity[0] = -L, task.coordinate[0].start_velocity[1] = L;
        task.input[0] = (lg_policy_input){"u", -100 * m * L, 100 * m * L, w};
        task.period = h, task.horizon = task.within = 12;
        solve_riccati((double[]){h, 0.1 * h}, h * w, m, h, S, K);
        task.gain_count = 2;
        memcpy(task.gains, K, sizeof K);
        lg_policy *policy = create(
            NULL, &task,
            machine_program(test_text("columns: {time: t}\ncoordinates: [{name: q, kind: line, velocity: "
                                      "v}]\ninputs: {columns: [u]}\nmass: {kind: known, values: [%.17g]}\n"
                                      "input_map: {kind: known, values: [1]}\n",
                                      m)));
        assert_told(lg_policy_find_gaps(policy, STARTS, 3, 0, gap, NULL, &told));
        for (size_t k = 0; k < STARTS; k++) {
            const double *z = gap[k].errors;
            const double optimum =
                z[0] * (S[0][0] * z[0] + S[0][1] * z[1]) + z[1] * (S[1][0] * z[0] + S[1][1] * z[1]);
            assert_close(gap[k].cost, optimum, 1e-3, 0);
            assert_close(gap[k].best, optimum, 1e-3, 0);
            assert_true(gap[k].ratio >= 1 && gap[k].ratio < 1.001);
        }
    }
}

/* ---- a state over five periods: all inputs of a grid, then smaller and smaller steps from the best ---- */

enum { PERIODS = 5, GRID = 21 };
static const double period = 0.25;

/* x' = x - x^3/3 + u by Euler's method. */
static double moved(double x, double u) {
    return x + period * (x - x * x * x / 3 + u);
}

RECORDING(step) {
    (void)user;
    const lg_var cube = lg_mul(tape, lg_square(tape, x[0]), x[0]),
                 rate = lg_add(tape, lg_sub(tape, x[0], lg_scale(tape, cube, 1.0 / 3)), x[1]);
    y[0] = lg_add(tape, x[0], lg_mul(tape, rate, x[2]));
}

static lg_program *scalar_plant(void) {
    const lg_port in[3] = {{.name = "x", .shape = lg_shape1(1)},
                           {.name = "u", .shape = lg_shape1(1)},
                           {.name = "h", .shape = lg_shape1(1)}},
                  out = {.name = "next"};
    const lg_function_spec all = {"step", in, 3, &out, 1, step, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &all, 1);
    lg_program *program = NULL;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    return program;
}

static double stage_of(const lg_policy *p, double x, double u) {
    return period * (p->task.coordinate[0].weight * x * x + p->task.input[0].weight * u * u);
}

static double end_of(const lg_policy *p, double x) {
    return p->terminal * log(1 + p->regulator.P[0] * x * x / (13 * p->regulator.c));
}

static double cost_of(const lg_policy *p, double x, const double *u) {
    double sum = 0;
    for (int k = 0; k < PERIODS; k++) sum += stage_of(p, x, u[k]), x = moved(x, u[k]);
    return sum + end_of(p, x);
}

/* The least cost over the grid from period k on; u becomes the inputs. */
static double search_grid(const lg_policy *p, double x, int k, double *u) {
    double best = INFINITY, own[PERIODS];
    if (k == PERIODS) return end_of(p, x);
    for (int i = 0; i < GRID; i++) {
        own[k] = -1 + 2.0 * i / (GRID - 1);
        const double cost = stage_of(p, x, own[k]) + search_grid(p, moved(x, own[k]), k + 1, own);
        if (!(cost < best)) continue;
        best = cost;
        memcpy(u + k, own + k, (size_t)(PERIODS - k) * sizeof *u);
    }
    return best;
}

static double refine(const lg_policy *p, double x, double *u) {
    double best = cost_of(p, x, u);
    for (double by = 1.0 / GRID; by > 1e-7;) {
        bool better = false;
        for (int i = 0; i < 2 * PERIODS; i++) {
            const double was = u[i / 2];
            u[i / 2] = fmin(1, fmax(-1, was + (i % 2 ? by : -by)));
            const double cost = cost_of(p, x, u);
            if (cost < best)
                best = cost, better = true;
            else
                u[i / 2] = was;
        }
        if (!better) by *= 0.5;
    }
    return best;
}

TEST("the gap of a bad controller is that of a search over all inputs of a grid, at the limits too") {
    lg_policy_task task;
    lg_policy_gap gap[STARTS];
    lg_policy_task_init(&task);
    task.kind = LG_POLICY_LQR, task.coordinate_count = task.input_count = 1;
    task.coordinate[0] = (lg_policy_coordinate){
        .name = "x", .start = {-1.2, 1.2}, .weight = 1, .success = 0.5, .success_velocity = INFINITY};
    task.input[0] = (lg_policy_input){"u", -1, 1, 0.05};
    task.period = period, task.horizon = task.within = PERIODS * period, task.hold = 0, task.substeps = 1;
    task.gain_count = 1, task.gains[0] = 1.05; /* the weakest gains hold x = 0 just so */
    lg_policy *policy = create(NULL, &task, scalar_plant());
    double largest = 0;
    size_t limited = 0, inside = 0;
    assert_told(lg_policy_find_gaps(policy, STARTS, 5, 0, gap, NULL, &told));
    for (size_t i = 0; i < STARTS; i++) {
        double u[PERIODS], own[PERIODS], x = gap[i].errors[0];
        for (int k = 0; k < PERIODS; k++) own[k] = fmin(1, fmax(-1, -1.05 * x)), x = moved(x, own[k]);
        x = gap[i].errors[0];
        (void)search_grid(policy, x, 0, u);
        const double optimum = refine(policy, x, u);
        for (int k = 0; k < PERIODS; k++) fabs(u[k]) > 1 - 1e-6 ? limited++ : inside++;
        assert_close(gap[i].cost, cost_of(policy, x, own), 1e-9, 0);
        assert_close(gap[i].best, optimum, 2e-3, 0);
        assert_true(gap[i].best > optimum * (1 - 1e-6)); /* inputs beyond the limits would cost less */
        assert_close(gap[i].ratio, gap[i].cost / gap[i].best, 1e-12, 0);
        largest = fmax(largest, gap[i].ratio);
        print_message("start %g: cost %.6g, best %.6g, optimum %.6g\n", x, gap[i].cost, gap[i].best, optimum);
    }
    print_message("%zu inputs at a limit, %zu inside\n", limited, inside);
    assert_true(largest > 1.5 && limited >= 3 && inside >= 3);
}

/* ---- any policy ---- */

enum { FEW = 4 };

/* J of the first starts of lg_policy_evaluate: the costs of its periods up to the horizon, then W. */
static void evaluate(const lg_policy *p, uint64_t seed, double cost[FEW]) {
    const size_t steps = lg_policy_steps(p), end = lg_policy_periods(p, p->task.horizon);
    lg_policy_outcome outcome;
    double last[FEW];
    lg_policy_runs runs = {.motion = TEST_ARRAY(double, (steps + 1) * FEW * p->state),
                           .costs = TEST_ARRAY(double, steps *FEW)};
    assert_told(lg_policy_evaluate(p, LG_POLICY_NOMINAL, FEW, seed, 1, &outcome, &runs, &told));
    assert_told(lg_program_eval(NULL, p->program, "terminal", FEW,
                                (const double *const[]){runs.motion + end * FEW * p->state},
                                (double *const[]){last}, &told));
    for (size_t i = 0; i < FEW; i++) {
        cost[i] = last[i];
        for (size_t k = 0; k < end; k++) cost[i] += runs.costs[k * FEW + i];
    }
}

/* Friction that sticks, a lag, and inputs that act late. */
static lg_program *truck(double width) {
    return machine_program(
        test_text("columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}]\ninputs: {columns: "
                  "[u], lag: 0.06}\nmass: {kind: known, values: [10]}\ndamping: [{kind: known, values: [2]}, "
                  "{kind: coulomb, values: [4]%s}]\ninput_map: {kind: known, values: [6]}\n",
                  width > 0 ? test_text(", width: %g", width) : ""));
}

static lg_status soften(void *user, const double *speed, lg_program **out, lg_error *error) {
    (void)user, (void)error;
    *out = truck(speed != NULL ? speed[0] : 1e9);
    return LG_OK;
}

static lg_policy_task truck_task(void) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.kind = LG_POLICY_LQR, task.coordinate_count = 2, task.input_count = 1;
    task.coordinate[0] = coordinate("x", "vx", LG_POLICY_LINE, 1);
    task.coordinate[0].integral = true;
    task.coordinate[1] = (lg_policy_coordinate){
        .name = "lagged.u", .follows = 1, .success = INFINITY, .success_velocity = INFINITY};
    task.input[0] = (lg_policy_input){"u", -5, 5, 0.01};
    task.dead_time[0] = 0.08, task.soften = soften;
    task.horizon = 3, task.within = 4;
    return task;
}

TEST("the cost is that of the policy's run, no best is above it, and the same search gives the same bits") {
    static const lg_policy_kind bodies[] = {LG_POLICY_LQR, LG_POLICY_NETWORK, LG_POLICY_ENERGY};
    lg_policy_task task = cart_task(), late = truck_task();
    lg_policy *policies[5] = {make(&task, cart_pole), create(NULL, &late, truck(0))};
    for (size_t i = 0; i < LG_COUNT(bodies); i++) {
        lg_policy_task turning = body_task(bodies[i]);
        turning.horizon = 2, turning.within = 3;
        policies[2 + i] = make(&turning, body);
    }
    double best[5][FEW];
    for (size_t i = 0; i < LG_COUNT(policies); i++) {
        lg_policy_gap gap[FEW], same[FEW];
        double cost[FEW];
        bool complete = false;
        evaluate(policies[i], 7, cost);
        assert_told(lg_policy_find_gaps(policies[i], FEW, 7, 0, gap, &complete, &told));
        assert_true(complete);
        assert_told(lg_policy_find_gaps(policies[i], FEW, 7, 0, same, NULL, &told));
        assert_memory_equal(gap, same, sizeof gap);
        for (size_t k = 0; k < FEW; k++) {
            assert_close(gap[k].cost, cost[k], 1e-9, 0);
            assert_true(gap[k].best <= gap[k].cost && gap[k].best > 0);
            assert_close(gap[k].ratio, gap[k].cost / gap[k].best, 1e-12, 0);
            best[i][k] = gap[k].best;
            print_message("%zu: %.5g / %.5g = %.4f\n", i, gap[k].cost, gap[k].best, gap[k].ratio);
        }
    }
    /* three controllers of a body, one optimum */
    for (size_t k = 0; k < FEW; k++)
        for (size_t i = 3; i < 5; i++) assert_close(best[i][k], best[2][k], 0.03, 0);
}

TEST("a search without time keeps the cheapest guess and says so; a search that is stopped fails") {
    volatile int flag = 0;
    lg_context_options options;
    lg_context *context;
    const lg_policy_task task = cart_task();
    lg_policy_gap gap[STARTS], whole[STARTS];
    bool complete = true;
    lg_context_options_init(&options);
    options.cancel = &flag;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    lg_policy *policy = create(context, &task, machine_program(cart_pole));
    assert_told(lg_policy_find_gaps(policy, STARTS, 2, 1e-9, gap, &complete, &told));
    assert_false(complete);
    assert_told(lg_policy_find_gaps(policy, STARTS, 2, 0, whole, &complete, &told));
    assert_true(complete);
    for (size_t i = 0; i < STARTS; i++)
        assert_true(gap[i].best <= gap[i].cost && whole[i].best <= gap[i].best &&
                    whole[i].cost == gap[i].cost);
    flag = 1;
    assert_int_equal(lg_policy_find_gaps(policy, STARTS, 2, 0, gap, NULL, NULL), LG_CANCELLED);
    flag = 0;
    assert_int_equal(lg_policy_find_gaps(policy, 0, 2, 0, gap, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_int_equal(lg_policy_find_gaps(policy, 1001, 2, 0, gap, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_int_equal(lg_policy_find_gaps(policy, 1, 2, NAN, gap, NULL, NULL), LG_INVALID_ARGUMENT);
}
