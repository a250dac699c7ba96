/* Bounds of held flows contain exact motions, their Jacobians and what happens between the samples.
 * ctest-labels: src/certify src/autodiff */
#include "flow_support.h"

#include "certify/flow.h"

enum { BOXES = 12, POINTS = 2, N = FLOW_MOST };

RELEASES(release_flow, lg_flow_destroy)

typedef struct part_log {
    size_t boxes, n;
    double F[2][64][BOXES * N], S[2][64][BOXES * N * N], D[2][64][BOXES * N], Q[2][64][BOXES * N * N],
        from[64], to[64];
    size_t parts;
} part_log;
static part_log parts;

static void log_part(void *user, size_t boxes, const lg_bounds *F, const lg_bounds *S, const lg_bounds *D,
                     const lg_bounds *Q, double from, double to) {
    const size_t p = parts.parts++;
    if (p >= 64) return;
    const lg_bounds *const all[4] = {F, S, D, Q};
    for (int k = 0; k < 4; k++) {
        const size_t bytes = boxes * all[k]->width * sizeof(double);
        double *low = k == 0   ? parts.F[0][p]
                      : k == 1 ? parts.S[0][p]
                      : k == 2 ? parts.D[0][p]
                               : parts.Q[0][p];
        double *high = k == 0   ? parts.F[1][p]
                       : k == 1 ? parts.S[1][p]
                       : k == 2 ? parts.D[1][p]
                                : parts.Q[1][p];
        memcpy(low, all[k]->low, bytes);
        memcpy(high, all[k]->high, bytes);
    }
    parts.from[p] = from;
    parts.to[p] = to;
}

typedef struct checking {
    flow_system f;
    lg_flow *flow;
    double period; /* in units of the system */
    double T[N * N], at[BOXES * N], low[BOXES * N], high[BOXES * N];
    double F[2][BOXES * N], S[2][BOXES * N * N], X[2][BOXES * N], tube[2][BOXES * N];
    bool unbounded[BOXES], no_tube[BOXES];
    uint8_t flag[BOXES];
    int pieces;
} checking;
static checking c;

/* X in units of the system at y, after `time` */
static void exact(const double *y, long double time, long double *X) {
    for (size_t i = 0; i < c.f.n; i++) {
        X[i] = 0;
        for (size_t j = 0; j < c.f.n; j++) X[i] += (long double)c.T[i * c.f.n + j] * y[j];
        X[i] /= c.f.size[i];
    }
    const long double u = flow_exact_control(&c.f, X);
    if (time > 0) flow_exact(&c.f, X, u, time, c.pieces);
}

static void assert_inside(double low, double high, long double value, long double slack, const char *what) {
    if (!(low - slack <= value && value <= high + slack))
        fail_msg("%s is %.20Lg, outside of [%.17g, %.17g] (period %g, n %zu)", what, value, low, high,
                 c.period, c.f.n);
}

/* Coordinates with another scale in each state, and mixed. */
static void draw_coordinates(lg_rng *r) {
    const size_t n = c.f.n;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            c.T[i * n + j] = c.f.size[i] * ((i == j) + 0.3 * lg_rng_uniform_in(r, -1, 1));
}

static void check_point(size_t box, lg_rng *r) {
    const size_t n = c.f.n;
    double y[N];
    long double X[N], low[N], high[N];
    for (size_t j = 0; j < n; j++) {
        const double l = c.low[box * n + j], h = c.high[box * n + j];
        y[j] =
            fmin(h, l + (h - l) * (lg_rng_below(r, 3) == 0 ? (double)lg_rng_below(r, 2) : lg_rng_uniform(r)));
    }
    exact(y, c.period, X);
    for (size_t i = 0; i < n; i++) {
        const size_t row = box * n + i;
        double l = c.F[0][row], h = c.F[1][row];
        for (size_t j = 0; j < n; j++) {
            const double k = y[j] - c.at[box * n + j], p = c.S[0][row * n + j] * k,
                         q = c.S[1][row * n + j] * k;
            l += fmin(p, q), h += fmax(p, q);
        }
        const long double slack = 1e-15L * c.f.size[i] * (1 + fabsl(X[i])); /* of the sum above */
        assert_inside(l, h, X[i] * c.f.size[i], slack, "a state by the mean value");
        assert_inside(c.X[0][row], c.X[1][row], X[i] * c.f.size[i], 1e-17L * c.f.size[i], "a state");
    }
    /* slopes of chords from the middle, along each side */
    exact(c.at + box * n, c.period, low);
    for (size_t j = 0; j < n; j++) {
        double to[N];
        memcpy(to, c.at + box * n, sizeof to);
        to[j] = y[j];
        const double by = to[j] - c.at[box * n + j];
        if (fabs(by) < 1e-5) continue;
        exact(to, c.period, high);
        for (size_t i = 0; i < n; i++)
            assert_inside(c.S[0][(box * n + i) * n + j], c.S[1][(box * n + i) * n + j],
                          (high[i] - low[i]) * c.f.size[i] / by, 1e-9L * c.f.size[i], "a slope");
    }
}

static void check_middle(size_t box) {
    long double X[N];
    exact(c.at + box * c.f.n, c.period, X);
    for (size_t i = 0; i < c.f.n; i++)
        assert_inside(c.F[0][box * c.f.n + i], c.F[1][box * c.f.n + i], X[i] * c.f.size[i],
                      2e-18L * c.f.size[i] * (1 + fabsl(X[i])), "the state from the middle");
}

/* Picard's map of the tube of a period's only step lies in the tube, at points of it. */
static void check_tube(size_t box, lg_rng *r) {
    const size_t n = c.f.n;
    for (int p = 0; p < 20 * POINTS; p++) {
        double y[N];
        long double X[N], Z[N], rate[N];
        const long double t = lg_rng_below(r, 2) == 0 ? 1 : lg_rng_uniform(r);
        for (size_t j = 0; j < n; j++) {
            const size_t row = box * n + j;
            y[j] = lg_rng_below(r, 2) == 0 ? c.low[row] : c.high[row];
            Z[j] = (lg_rng_below(r, 2) == 0 ? c.tube[0][row] : c.tube[1][row]) / c.f.size[j];
        }
        exact(y, 0, X);
        flow_exact_rate(&c.f, Z, flow_exact_control(&c.f, X), rate);
        for (size_t i = 0; i < n; i++)
            assert_inside(c.tube[0][box * n + i], c.tube[1][box * n + i],
                          (X[i] + t * c.period * rate[i]) * c.f.size[i],
                          1e-15L * c.f.size[i] * (1 + fabsl(X[i])), "Picard's map of a tube");
    }
}

/* F + S k + t (D + Q k) at times of each part */
static void check_parts(size_t box, lg_rng *r) {
    const size_t n = c.f.n;
    double y[N], start = 0;
    for (size_t j = 0; j < n; j++) y[j] = lg_rng_uniform_in(r, c.low[box * n + j], c.high[box * n + j]);
    for (size_t p = 0; p < parts.parts && p < 8; p++) {
        const double t = parts.from[p] + (parts.to[p] - parts.from[p]) * lg_rng_uniform(r);
        long double X[N];
        exact(y, ((long double)start + t) / c.f.tau, X);
        for (size_t i = 0; i < n; i++) {
            const size_t row = box * n + i;
            double l = parts.F[0][p][row] + t * parts.D[0][p][row],
                   h = parts.F[1][p][row] + t * parts.D[1][p][row];
            for (size_t j = 0; j < n; j++) {
                const double k = y[j] - c.at[box * n + j];
                const double a = (parts.S[0][p][row * n + j] + t * parts.Q[0][p][row * n + j]) * k,
                             b = (parts.S[1][p][row * n + j] + t * parts.Q[1][p][row * n + j]) * k;
                l += fmin(a, b), h += fmax(a, b);
            }
            assert_inside(l, h, X[i] * c.f.size[i], 4e-15L * c.f.size[i] * (1 + fabsl(X[i])),
                          "a state between");
        }
        if (parts.from[p] == parts.to[p]) start += parts.to[p];
    }
}

static size_t bounded, all, systems;

static void check_system(lg_rng *r) {
    static const double periods[] = {1e-12, 1e-3, 0.02, 0.1, 0.3, 0.7};
    static const double widths[] = {0, 1e-12, 1e-6, 1e-3, 0.03, 0.2};
    c.f = draw_flow(r);
    const size_t n = c.f.n;
    c.period = periods[lg_rng_below(r, LG_COUNT(periods))];
    double speed = 0;
    for (size_t i = 0; i < n * n; i++) speed = fmax(speed, fabs(c.f.a[i]));
    c.pieces = 2 + (int)(3 * c.period * (speed + 4));
    draw_coordinates(r);
    const double goal[N] = {0};
    const lg_flow_spec spec = {flow_program(&c.f), 0, 1, c.period * c.f.tau, goal, c.T};
    c.period = c.period * c.f.tau / c.f.tau;
    lg_error error = {LG_OK, ""};
    if (lg_flow_create(NULL, &spec, &c.flow, &error) != LG_OK) fail_msg("%s", error.message);
    lg_test_owns(c.flow, release_flow);
    for (size_t i = 0; i < BOXES; i++) {
        const double width = widths[lg_rng_below(r, LG_COUNT(widths))];
        for (size_t j = 0; j < n; j++) {
            const double at = lg_rng_uniform_in(r, -2, 2);
            c.at[i * n + j] = at;
            c.low[i * n + j] = at - width * lg_rng_uniform(r);
            c.high[i * n + j] = at + width * lg_rng_uniform(r);
        }
    }
    parts.parts = 0;
    const lg_flow_boxes boxes = {.count = BOXES,
                                 .at = c.at,
                                 .low = c.low,
                                 .high = c.high,
                                 .doublings = (uint32_t)lg_rng_below(r, 3),
                                 .part = log_part,
                                 .F = {c.F[0], c.F[1], n},
                                 .S = {c.S[0], c.S[1], n * n},
                                 .X = {c.X[0], c.X[1], n},
                                 .tube = {c.tube[0], c.tube[1], n},
                                 .unbounded = c.unbounded,
                                 .no_tube = c.no_tube,
                                 .flag = c.flag};
    lg_flow_eval(c.flow, &boxes, lg_test_memory(lg_flow_work_size(c.flow)));
    for (size_t i = 0; i < BOXES; i++) {
        all++;
        if (c.unbounded[i]) continue;
        bounded++;
        check_middle(i);
        if (lg_flow_steps(c.flow) == 1 && boxes.doublings == 0) check_tube(i, r);
        check_parts(i, r);
        for (int p = 0; p < POINTS; p++) check_point(i, r);
    }
    systems++;
}

TEST("bounds of held flows contain exact motions of random systems, boxes, units and periods") {
    lg_rng r = test_rng(64, 2);
    for (int k = 0; k < 70; k++) {
        const size_t mark = lg_test_owned();
        check_system(&r);
        lg_test_give_back(mark);
    }
    print_message("%zu systems, %zu of %zu boxes have bounds\n", systems, bounded, all);
    assert_true(2 * bounded > all);
}

/* A chain of integrals: v' = u, x' = v. Nothing is damped, so powers of the rate's Jacobian are 0. */
RECORDING(integrals) {
    const lg_var two[2] = {lg_slice(tape, x[0], 1, 1, 1), x[1]};
    y[0] = lg_concat(tape, two, 2, 1);
}
RECORDING(braked) {
    y[0] = saturated(tape, lg_scale(tape, lg_slice(tape, x[0], 1, 1, 1), -1), 10);
}

TEST("a chain of integrals has bounds, which are exact to rounding") {
    const lg_port in[2] = {{.name = "x", .shape = {1, {2}}}, {.name = "u", .shape = {1, {1}}}},
                  out = {.name = "y"};
    const lg_function_spec functions[2] = {{"rate", in, 2, &out, 1, integrals, NULL},
                                           {"control", in, 1, &out, 1, braked, NULL}};
    const lg_program_spec program = spec_of(NULL, 0, functions, 2);
    const double goal[2] = {0}, T[4] = {1, 0, 0, 1}, at[2] = {1, 2}, low[2] = {0.5, 1.5},
                 high[2] = {1.5, 2.5};
    const lg_flow_spec spec = {test_program(&program), 0, 1, 0.25, goal, T};
    const double wanted[4] = {1, 0.25 - 0.5 * 0.0625, 0, 0.75};
    lg_flow *flow = NULL;
    double F[2][2], S[2][4], X[2][2];
    bool unbounded, no_tube;
    uint8_t flag;
    assert_told(lg_flow_create(NULL, &spec, &flow, &told));
    lg_test_owns(flow, release_flow);
    const lg_flow_boxes boxes = {.count = 1,
                                 .at = at,
                                 .low = low,
                                 .high = high,
                                 .F = {F[0], F[1], 2},
                                 .S = {S[0], S[1], 4},
                                 .X = {X[0], X[1], 2},
                                 .unbounded = &unbounded,
                                 .no_tube = &no_tube,
                                 .flag = &flag};
    lg_flow_eval(flow, &boxes, lg_test_memory(lg_flow_work_size(flow)));
    assert_true(!unbounded && !no_tube && flag >= LG_INTERVAL_LIPSCHITZ);
    for (int i = 0; i < 4; i++) {
        assert_close(S[0][i], wanted[i], 1e-14, 1e-14);
        assert_close(S[1][i], wanted[i], 1e-14, 1e-14);
    }
}

/* x' = x^2 + u from x = 1 with u = 0 is 1/(1 - t). */
RECORDING(escaping) {
    y[0] = lg_add(tape, lg_square(tape, x[0]), x[1]);
}
RECORDING(at_rest) {
    y[0] = saturated(tape, lg_scale(tape, x[0], 1e-3), 1e-9);
}

TEST("a motion that leaves every bound within a period has no tube, and bounds until then hold") {
    const lg_port in[2] = {{.name = "x", .shape = {1, {1}}}, {.name = "u", .shape = {1, {1}}}},
                  out = {.name = "y"};
    const lg_function_spec functions[2] = {{"rate", in, 2, &out, 1, escaping, NULL},
                                           {"control", in, 1, &out, 1, at_rest, NULL}};
    const lg_program_spec program = spec_of(NULL, 0, functions, 2);
    const lg_program *made = test_program(&program);
    const double zero = 0, one = 1, low[2] = {1, 0.95}, high[2] = {1, 1.05}, at[2] = {1, 1};
    const double periods[] = {0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 1.1, 2, 5};
    size_t with_bounds = 0;
    for (size_t k = 0; k < LG_COUNT(periods); k++)
        for (uint32_t doublings = 0; doublings < LG_FLOW_DOUBLINGS; doublings++) {
            const lg_flow_spec spec = {made, 0, 1, periods[k], &zero, &one};
            lg_flow *flow = NULL;
            double F[2][2], S[2][2], X[2][2];
            bool unbounded[2], no_tube[2];
            uint8_t flag[2];
            assert_told(lg_flow_create(NULL, &spec, &flow, &told));
            lg_test_owns(flow, release_flow);
            const lg_flow_boxes boxes = {.count = 2,
                                         .at = at,
                                         .low = low,
                                         .high = high,
                                         .doublings = doublings,
                                         .F = {F[0], F[1], 1},
                                         .S = {S[0], S[1], 1},
                                         .X = {X[0], X[1], 1},
                                         .unbounded = unbounded,
                                         .no_tube = no_tube,
                                         .flag = flag};
            lg_flow_eval(flow, &boxes, lg_test_memory(lg_flow_work_size(flow)));
            for (int i = 0; i < 2; i++) {
                if (periods[k] > 1) assert_true(unbounded[i] && no_tube[i]);
                if (unbounded[i]) continue;
                const double end = 1 / (1 - periods[k]);
                assert_true(X[0][i] <= end * (1 - 1e-6) || i == 0);
                assert_true(F[0][i] <= end * (1 + 1e-6) && end * (1 - 1e-6) <= F[1][i]);
                assert_true(S[0][i] <= end * end * (1 + 1e-6) && end * end * (1 - 1e-6) <= S[1][i]);
                with_bounds++;
            }
        }
    assert_true(with_bounds > 10);
}
