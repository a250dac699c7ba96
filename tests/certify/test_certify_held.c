/* Held loops: what is proved is true of the exact motion, whatever integrator a program may have.
 * ctest-labels: src/certify src/autodiff */
#include "flow_support.h"

#include "liegrad/control.h"
#include "liegrad/interval.h"
#include "liegrad/ops.h"

/* The system whose loop is proved, with V = x^T P x; units are 1. */
typedef struct held_loop {
    flow_system f;
    double period, P[FLOW_MOST * FLOW_MOST], radius, unit; /* unit: of the controller's rounding */
} held_loop;

static void next_state(const held_loop *l, long double *X, long double part) {
    flow_exact(&l->f, X, flow_exact_control(&l->f, X), l->period * part, 2);
}

static long double value(const held_loop *l, const long double *X) {
    long double sum = 0;
    for (size_t i = 0; i < l->f.n; i++)
        for (size_t j = 0; j < l->f.n; j++) sum += X[i] * l->P[i * l->f.n + j] * X[j];
    return sum;
}

/* The linear map of a period at 0, by differences, (n, n) */
static void linear_map(const held_loop *l, double *M) {
    const double h = 0x1p-20;
    for (size_t j = 0; j < l->f.n; j++) {
        long double low[FLOW_MOST] = {0}, high[FLOW_MOST] = {0};
        low[j] = -h, high[j] = h;
        next_state(l, low, 1);
        next_state(l, high, 1);
        for (size_t i = 0; i < l->f.n; i++) M[i * l->f.n + j] = (double)((high[i] - low[i]) / (2 * h));
    }
}

/* The spectral radius of M, of two states, and P = sum_k (M^k/r^k)^T M^k/r^k with r slightly above it */
static void find_form(held_loop *l) {
    enum { POWERS = 3000 };
    double M[4], now[4] = {1, 0, 0, 1}, next[4];
    linear_map(l, M);
    const double half = 0.5 * (M[0] + M[3]), determinant = M[0] * M[3] - M[1] * M[2],
                 rest = half * half - determinant;
    l->radius = rest >= 0 ? fabs(half) + sqrt(rest) : sqrt(determinant);
    memset(l->P, 0, sizeof l->P);
    for (int k = 0; k < POWERS; k++) {
        for (size_t i = 0; i < 2; i++)
            for (size_t j = 0; j < 2; j++) {
                l->P[i * 2 + j] += now[i] * now[j] + now[2 + i] * now[2 + j];
                next[i * 2 + j] =
                    (M[i * 2] * now[j] + M[i * 2 + 1] * now[2 + j]) / fmax(1.004 * l->radius, 1e-3);
            }
        memcpy(now, next, sizeof now);
    }
}

static lg_certify_result prove_loop(held_loop *l, double box, double level, size_t boxes) {
    static double low[FLOW_MOST], high[FLOW_MOST];
    lg_certify_spec spec;
    lg_certify_result r;
    lg_certify_spec_init(&spec);
    for (size_t i = 0; i < l->f.n; i++) low[i] = -(high[i] = box);
    spec.program = flow_program(&l->f);
    spec.rate = "rate";
    spec.control = "control";
    spec.period = l->period;
    spec.unit = l->unit;
    spec.P = l->P;
    spec.low = low;
    spec.high = high;
    spec.level = level;
    assert_told(lg_certify_run(test_certify(&spec), boxes, 30, &r, &told));
    return r;
}

/* Motions from the boundary of {V <= c}: V falls in each period, and stays below `between`. */
static void attack(const held_loop *l, const lg_certify_result *r, lg_rng *rng, int starts) {
    for (int s = 0; s < starts; s++) {
        long double X[FLOW_MOST] = {0};
        for (size_t i = 0; i < l->f.n; i++) X[i] = lg_rng_uniform_in(rng, -1, 1);
        const long double scale =
            sqrtl((long double)r->level * (s % 2 == 0 ? 1 : lg_rng_uniform(rng)) / value(l, X));
        for (size_t i = 0; i < l->f.n; i++) X[i] *= scale * (1 - 1e-12L);
        for (int k = 0; k < 4; k++) {
            const long double V = value(l, X);
            for (int t = 1; t < 8; t++) {
                long double now[FLOW_MOST];
                memcpy(now, X, sizeof now);
                const long double u = flow_exact_control(&l->f, X);
                flow_exact(&l->f, now, u, l->period * t / 8, 2);
                if (!(value(l, now) <= r->between))
                    fail_msg("V is %Lg between the samples: %s", value(l, now), r->claim);
            }
            next_state(l, X, 1);
            if (V >= r->eps && !(value(l, X) < V))
                fail_msg("V rises from %Lg to %Lg: %s", V, value(l, X), r->claim);
        }
    }
}

/* ---- known loops ---- */

/* x'' = -w^2 x + damping x' + u, u = -k x' */
static held_loop oscillator(double w, double damping, double k, double period) {
    held_loop l = {.f = {.n = 2,
                         .a = {0, 1, -w * w, damping},
                         .b = {0, 1},
                         .k = {0, k},
                         .limit = 100,
                         .s = 1,
                         .size = {1, 1},
                         .tau = 1},
                   .period = period};
    find_form(&l);
    return l;
}

TEST("undamped and unstable oscillators are not proved, though Runge-Kutta maps of theirs contract; the "
     "damped one is") {
    const double periods[] = {0.05, 0.12, 0.15, 0.3};
    for (size_t i = 0; i < LG_COUNT(periods); i++) {
        held_loop still = oscillator(10, 0, 0, periods[i]), growing = oscillator(10, 0.2, 0, periods[i]),
                  fed = oscillator(10, 0, -0.3, periods[i]), damped = oscillator(10, -1, 0, periods[i]);
        held_loop *const bad[] = {&still, &growing, &fed};
        for (size_t k = 0; k < LG_COUNT(bad); k++) {
            const lg_certify_result r = prove_loop(bad[k], 100, 0, 1000);
            assert_true(!r.verified && r.failed_low != NULL && r.reason[0] != '\0');
        }
        const lg_certify_result r = prove_loop(&damped, 100, 0, SIZE_MAX);
        assert_true(r.verified && r.converges);
        assert_says(r.claim, "every period of the exact motion");
    }
}

static void riccati(held_loop *l, const double *Q, double R) {
    const size_t n = l->f.n;
    double A[16], B[4], q[16] = {0}, K[4];
    flow_system open = l->f;
    memset(open.k, 0, sizeof open.k);
    held_loop free_loop = {.f = open, .period = l->period};
    linear_map(&free_loop, A);
    long double X[FLOW_MOST] = {0};
    flow_exact(&l->f, X, 0x1p-20L, l->period, 6);
    for (size_t i = 0; i < n; i++) B[i] = (double)(X[i] * 0x1p20L), q[i * (n + 1)] = Q[i];
    const lg_riccati equation = {sizeof equation, (uint32_t)n, 1, A, B, q, &R, NULL};
    const size_t bytes = lg_riccati_work_size((uint32_t)n, 1);
    assert_told(lg_dare(&equation, l->P, K, NULL, NULL, lg_test_memory(bytes), bytes, &told));
    memcpy(l->f.k, K, n * sizeof *K);
}

/* The smallest V at which V does not fall in a period, along many directions */
static double sampled_level(const held_loop *l, double most) {
    enum { DIRECTIONS = 150, LEVELS = 60 };
    for (int i = 1; i <= DIRECTIONS; i++) {
        const double angle = 3.14159265358979 * i / DIRECTIONS;
        long double X[FLOW_MOST] = {cosl(angle), sinl(angle)};
        const long double scale = sqrtl(1 / value(l, X));
        for (int k = 1; k <= LEVELS; k++) {
            const long double V = most * k / LEVELS, by = scale * sqrtl(V);
            long double now[FLOW_MOST] = {X[0] * by, X[1] * by};
            next_state(l, now, 1);
            if (value(l, now) < V) continue;
            most = (double)V;
            break;
        }
    }
    return most;
}

TEST("a pendulum whose period times its fastest mode is .12 to .6: at least .95 of the sampled level") {
    const double periods[] = {0.02, 0.05, 0.1}, Q[2] = {10, 0.1};
    for (size_t i = 0; i < LG_COUNT(periods); i++) {
        held_loop l = {.f = {.n = 2,
                             .a = {0, 1, 0, -0.1 / 0.0375},
                             .b = {0, 1 / 0.0375},
                             .c = {0, 19.62},
                             .limit = 1.125,
                             .s = 1,
                             .size = {1, 1},
                             .tau = 1},
                       .period = periods[i]};
        riccati(&l, Q, 1);
        lg_rng rng = test_rng(64, i);
        const lg_certify_result r = prove_loop(&l, 50, 0, SIZE_MAX);
        const double truth = sampled_level(&l, 2 * r.level);
        print_message("period %g: level %.6g, %.4g of the sampled one; between %.5g; %zu boxes, %.3f s\n",
                      periods[i], r.level, r.level / truth, r.between / r.level, r.boxes, r.seconds);
        assert_true(r.verified && r.converges && r.level >= 0.95 * truth);
        attack(&l, &r, &rng, 30);
    }
}

/* ---- rounding of the controller ---- */

/* The largest V of the last quarter of 400 periods, where the input errs by +-d, by that which makes V
 * larger */
static long double shaken(const held_loop *l, double d) {
    enum { PERIODS = 400 };
    long double X[FLOW_MOST] = {0}, most = 0;
    for (int k = 0; k < PERIODS; k++) {
        long double best[FLOW_MOST], highest = -1;
        for (int sign = -1; sign <= 1; sign += 2) {
            long double next[FLOW_MOST];
            memcpy(next, X, sizeof next);
            flow_exact(&l->f, next, flow_exact_control(&l->f, X) + sign * d, l->period, 2);
            if (value(l, next) <= highest) continue;
            highest = value(l, next);
            memcpy(best, next, sizeof best);
        }
        memcpy(X, best, sizeof X);
        if (k >= PERIODS * 3 / 4) most = fmaxl(most, value(l, X));
    }
    return most;
}

TEST("with rounding in f64 motions reach a small set that errors do not leave; in f32 the claim is smaller") {
    const double periods[] = {0.02, 0.05, 0.1}, units[] = {0, 0x1p-53, 0x1p-24};
    for (size_t i = 0; i < LG_COUNT(periods); i++) {
        lg_certify_result r[3];
        for (size_t k = 0; k < 3; k++) {
            held_loop l = oscillator(3, -1, 1.5, periods[i]);
            l.unit = units[k];
            r[k] = prove_loop(&l, 10, 1, SIZE_MAX);
            print_message("%s\n", r[k].claim);
            assert_true(r[k].verified && r[k].converges == (k < 2 || r[k].eps_rounded < 1e-4 * r[k].eps));
            assert_true(k == 0 ? r[k].input_error == 0 : r[k].input_error > 0);
            if (k == 0) continue;
            const long double most = shaken(&l, r[k].input_error);
            print_message("eps_rounded %g, a motion has %Lg\n", r[k].eps_rounded, most);
            assert_true(most < r[k].eps_rounded && most > 1e-2 * r[k].eps_rounded);
            assert_says(r[k].claim, "the controller's rounding, errors of inputs of up to");
        }
        assert_says(r[1].claim, "converge to the goal in exact arithmetic");
        assert_true(r[2].input_error > 1e8 * r[1].input_error);
    }
}

RECORDING(pulled) {
    y[0] = lg_neg(tape, x[0]);
}
/* x' = u, u = -((x + 1e5) - 1e5): the digits of x cancel */
RECORDING(driven) {
    y[0] = lg_scale(tape, x[1], 1);
}
RECORDING(cancelling) {
    y[0] = lg_neg(tape, lg_add_scalar(tape, lg_add_scalar(tape, x[0], 1e5), -1e5));
}
RECORDING(deciding) {
    y[0] =
        lg_neg(tape, lg_mul(tape, x[0], lg_add_scalar(tape, lg_ge(tape, x[0], lg_scale(tape, x[0], 0)), 1)));
}
TEST("a controller whose digits cancel is proved near the goal in f64, in f32 farther away; one with a jump "
     "has no bound") {
    static const double P[1] = {1}, low[1] = {-1}, high[1] = {1};
    static const struct {
        lg_record_function control;
        double unit, level;
        bool verified, finite;
    } rows[] = {{cancelling, 0, 1e-6, true, true},
                {cancelling, 0x1p-53, 1e-6, true, true},
                {cancelling, 0x1p-24, 0.9, true, true},
                {cancelling, 0x1p-24, 1e-6, false, true},
                {deciding, 0x1p-24, 0.9, false, false}};
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1(1)}, {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "y"};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_function_spec functions[2] = {{"rate", in, 2, &out, 1, driven, NULL},
                                               {"control", in, 1, &out, 1, rows[i].control, NULL}};
        const lg_program_spec program = spec_of(NULL, 0, functions, 2);
        lg_certify_spec spec;
        lg_certify_result r;
        lg_certify_spec_init(&spec);
        spec.program = test_program(&program);
        spec.rate = "rate", spec.control = "control", spec.period = 0.1;
        spec.P = P, spec.low = low, spec.high = high, spec.level = rows[i].level, spec.unit = rows[i].unit;
        assert_told(lg_certify_run(test_certify(&spec), 20000, 30, &r, &told));
        print_message("%g: %s %s\n", r.input_error, r.claim, r.reason);
        assert_true(r.verified == rows[i].verified && !r.converges);
        assert_true(isfinite(r.input_error) == rows[i].finite);
        if (!rows[i].finite) assert_says(r.claim, "rounding has no bound and is not covered");
        /* the set holds all states that f32 takes for 0 */
        if (rows[i].unit == 0x1p-24 && r.verified) assert_true(sqrt(r.eps_rounded) > 1e5 * 0x1p-25);
    }
}

TEST("a unit of rounding is for held loops, and it is that of f64 or f32") {
    static const double units[] = {1, -0x1p-53, 0x1p-52, NAN};
    static const double P[1] = {1}, low[1] = {-1}, high[1] = {1};
    lg_program *program = loop_program(1, pulled, NULL, NULL);
    for (size_t i = 0; i <= LG_COUNT(units); i++) {
        lg_certify_spec spec = spec_for(program, P, low, high);
        lg_certify *certify = NULL;
        lg_error error = {LG_OK, ""};
        spec.unit = i < LG_COUNT(units) ? units[i] : 0x1p-53; /* the loop is continuous */
        assert_int_equal(lg_certify_create(NULL, &spec, &certify, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "unit of rounding");
        double bound;
        if (i == LG_COUNT(units)) continue;
        assert_int_equal(lg_interval_rounding(program, 0, low, high, units[i], &bound, &error),
                         LG_INVALID_ARGUMENT);
    }
}

/* ---- fields that jump or have a kink ---- */

/* x' = u - g(x - 1/2) with g = 0 below 0, u = -x; all are stable */
static lg_var past_half(lg_tape *tape, lg_var x) {
    return lg_add_scalar(tape, x, -0.5);
}
RECORDING(jumping_sign) {
    const lg_var jump = lg_add_scalar(tape, lg_sign(tape, past_half(tape, x[0])), 1);
    y[0] = lg_sub(tape, x[1], lg_scale(tape, jump, 0.05));
}
RECORDING(jumping_ge) {
    const lg_var half = lg_add_scalar(tape, lg_scale(tape, x[0], 0), 0.5);
    y[0] = lg_sub(tape, x[1], lg_scale(tape, lg_ge(tape, x[0], half), 0.1));
}
RECORDING(saturated_inside) {
    y[0] = lg_sub(tape, x[1], lg_scale(tape, lg_act(tape, past_half(tape, x[0]), LG_RELU), 0.1));
}

TEST("a field that jumps or has a kink at 1/2 is not proved across it, with a box there; below 1/2 it is") {
    static const double P[1] = {1}, low[1] = {-1}, high[1] = {1};
    const lg_record_function fields[] = {jumping_sign, jumping_ge, saturated_inside};
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1(1)}, {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "y"};
    for (size_t i = 0; i < LG_COUNT(fields); i++)
        for (int given = 0; given < 2; given++) {
            const lg_function_spec functions[2] = {{"rate", in, 2, &out, 1, fields[i], NULL},
                                                   {"control", in, 1, &out, 1, pulled, NULL}};
            const lg_program_spec program = spec_of(NULL, 0, functions, 2);
            lg_certify_spec spec;
            lg_certify_result r;
            lg_certify_spec_init(&spec);
            spec.program = test_program(&program);
            spec.rate = "rate", spec.control = "control", spec.period = 0.1;
            spec.P = P, spec.low = low, spec.high = high;
            spec.level = given ? 0.64 : 0;
            assert_told(lg_certify_run(test_certify(&spec), 20000, 30, &r, &told));
            print_message("field %zu, level %g, %s\n", i, r.level, r.reason);
            if (given) {
                assert_true(!r.verified && r.finished);
                assert_true(fabs(r.failed_low[0]) < 0.7 && fabs(r.failed_high[0]) > 0.45);
            } else
                assert_true(r.verified && r.converges && r.level > 0.2 && r.level < 0.25);
        }
}

/* ---- drawn loops ---- */

TEST("random held loops near the boundary of stability: nothing false is proved, most of what is true is") {
    lg_rng rng = test_rng(64, 3);
    size_t proved = 0, stable = 0, unstable = 0;
    for (int k = 0; k < 30; k++) {
        const size_t mark = lg_test_owned();
        held_loop l = {.f = draw_flow(&rng), .period = lg_rng_uniform_in(&rng, 0.02, 0.5)};
        const bool linear = k % 2 == 0;
        double fast = 1;
        for (size_t i = 0; i < FLOW_MOST * FLOW_MOST; i++) fast = fmax(fast, fabs(l.f.a[i]));
        l.period /= fast;
        l.f.n = 2;
        for (size_t i = 0; i < FLOW_MOST; i++) {
            l.f.size[i] = 1;
            if (linear) l.f.c[i] = l.f.d[i] = l.f.g[i] = 0;
        }
        l.f.tau = 1;
        /* A shift of the diagonal moves the spectral radius to .97 to 1.03. */
        for (int pass = 0; pass < 4; pass++) {
            find_form(&l);
            const double wanted = 1 + 0.03 * (pass < 3 ? 0 : lg_rng_uniform_in(&rng, -1, 1));
            for (size_t i = 0; i < l.f.n; i++) l.f.a[i * (l.f.n + 1)] -= log(l.radius / wanted) / l.period;
        }
        find_form(&l);
        const lg_certify_result r = prove_loop(&l, 2, 0, 2000);
        const bool is_stable = l.radius < 1;
        stable += l.radius < 0.995;
        unstable += !is_stable;
        if (r.verified && r.converges && l.radius > 1 + 1e-9) fail_msg("radius %.12g: %s", l.radius, r.claim);
        if (r.verified && r.converges) attack(&l, &r, &rng, 4);
        proved += r.verified && r.converges;
        lg_test_give_back(mark);
    }
    print_message("%zu proved, %zu stable, %zu unstable\n", proved, stable, unstable);
    assert_true(unstable > 5 && 3 * proved > stable);
}
