/* Friction without a width: steps in which a machine sticks, slides and breaks away. They are compared with
 * an event-driven integrator that this file has for itself: small steps of rk4 in one mode, ends of modes
 * found by bisection. */
#include <float.h>

#include "autodiff/compiled.h"
#include "support/machine_support.h"
#include "support/model_support.h"
#include "support/plan_support.h"

#include "liegrad/model.h"
#include "liegrad/ops.h"
#include "machine/internal.h"

/* ---- machines and their formulas ---- */

enum { N = 2, TROLLEY, ARM, BELT };

typedef struct rig {
    const char *yaml;
    int kind, n;              /* n: velocities; the first n - (TROLLEY) of them rub */
    double q[N], v[N], drive; /* start; size of the input */
} rig;

static const char trolley_yaml[] =
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: a, kind: angle, velocity: "
    "va}]\ninputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: 10, pole: 1, length: 0.8, gravity: "
    "-9.81}\ndamping: [{kind: known, values: [0.5, 0.05]}, {kind: coulomb, values: [6, 0]}]\ninput_map: "
    "{kind: "
    "known, values: [[1], [0]]}\n",
                  arm_yaml[] =
                      "columns: {time: t}\ncoordinates: [{name: a, kind: angle, velocity: va}, {name: b, "
                      "kind: angle, velocity: "
                      "vb}]\ninputs: {columns: [u]}\nsystem: two-link-arm\nparameters: {masses: [1, 0.7], "
                      "centres: [0.5, 0.4], "
                      "inertia: [0.02, 0.01], length: 0.5, gravity: 9.81}\ndamping: [{kind: known, values: "
                      "[0.05, 0.05]}, {kind: "
                      "coulomb, values: [1.5, 0.5]}]\ninput_map: {kind: known, values: [[1], [0.3]]}\n",
                  belt_yaml[] = "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: "
                                "v}]\ninputs: {columns: [u]}\nmass: {kind: "
                                "known, values: [1]}\npotential: {kind: known, form: quadratic, of: x, "
                                "values: [10]}\ndamping: [{kind: known, "
                                "values: [0.2]}, {kind: stribeck, values: [[2], [3.5], [0.1]]}]\ninput_map: "
                                "{kind: known, values: [[1]]}\n";

static const rig rigs[] = {{trolley_yaml, TROLLEY, 2, {0.1, 0.6}, {0.7, -0.4}, 14},
                           {arm_yaml, ARM, 2, {0.8, -0.5}, {0.5, 1.5}, 5},
                           {belt_yaml, BELT, 1, {0.3}, {0.4}, 4}};

/* M, F without the friction c sign v, and c at (q, v, u). */
static void formulas(const rig *r, const double *q, const double *v, double u, double M[N][N], double *F,
                     double *c) {
    const double g = 9.81;
    if (r->kind == TROLLEY) {
        const double C = cos(q[1]), S = sin(q[1]);
        M[0][0] = 11, M[0][1] = M[1][0] = 0.8 * C, M[1][1] = 0.64;
        F[0] = u - 0.5 * v[0] + 0.8 * S * v[1] * v[1];
        F[1] = -g * 0.8 * S - 0.05 * v[1];
        c[0] = 6, c[1] = 0;
    } else if (r->kind == ARM) {
        const double a = 0.7 * 0.5 * 0.4, C = cos(q[1]), S = sin(q[1]);
        M[1][1] = 0.01 + 0.7 * 0.16;
        M[0][1] = M[1][0] = M[1][1] + a * C;
        M[0][0] = 0.02 + 0.25 + 0.7 * 0.25 + M[1][1] + 2 * a * C;
        const double second = 0.7 * 0.4 * g * sin(q[0] + q[1]);
        F[0] =
            a * S * (2 * v[0] * v[1] + v[1] * v[1]) - (0.5 + 0.35) * g * sin(q[0]) - second - 0.05 * v[0] + u;
        F[1] = -a * S * v[0] * v[0] - second - 0.05 * v[1] + 0.3 * u;
        c[0] = 1.5, c[1] = 0.5;
    } else {
        M[0][0] = 1;
        F[0] = u - 20 * q[0] - 0.2 * v[0];
        c[0] = 2 + 1.5 * exp(-(v[0] / 0.1) * (v[0] / 0.1));
    }
}

/* ---- the reference ---- */

/* Accelerations in the mode s, in which velocities with s = 0 and c > 0 stick; `hold`: the force that holds
 * them, divided by c. */
static void accelerate(const rig *r, const double *q, const double *v, double u, const int *s, double *a,
                       double *hold) {
    double M[N][N], F[N], c[N], A[N][N], b[N];
    formulas(r, q, v, u, M, F, c);
    for (int i = 0; i < r->n; i++) {
        const bool stuck = s[i] == 0 && c[i] > 0;
        b[i] = stuck ? 0 : F[i] - s[i] * c[i];
        for (int j = 0; j < r->n; j++) {
            const bool other = s[j] == 0 && c[j] > 0;
            A[i][j] = stuck || other ? (i == j) : M[i][j];
        }
    }
    if (r->n == 1) {
        a[0] = b[0] / A[0][0];
    } else {
        const double det = A[0][0] * A[1][1] - A[0][1] * A[1][0];
        a[0] = (b[0] * A[1][1] - b[1] * A[0][1]) / det;
        a[1] = (A[0][0] * b[1] - A[1][0] * b[0]) / det;
    }
    for (int i = 0; i < r->n; i++) {
        double rest = F[i];
        for (int j = 0; j < r->n; j++) rest -= M[i][j] * a[j];
        hold[i] = s[i] == 0 && c[i] > 0 ? rest / c[i] : 0;
    }
}

/* The mode: the signs where v is not 0, elsewhere the only choice of signs that contradicts nothing. */
static void find_mode(const rig *r, const double *q, const double *v, double u, int *s) {
    static const int signs[3] = {0, 1, -1};
    for (int try = 0; try < 9; try++) {
        const int pick[N] = {signs[try % 3], signs[try / 3]};
        double a[N], hold[N], M[N][N], F[N], c[N];
        bool fits = true;
        formulas(r, q, v, u, M, F, c);
        for (int i = 0; i < r->n; i++) s[i] = v[i] > 0 ? 1 : v[i] < 0 ? -1 : c[i] > 0 ? pick[i] : 0;
        accelerate(r, q, v, u, s, a, hold);
        for (int i = 0; i < r->n; i++) {
            if (v[i] != 0 || c[i] == 0) continue;
            fits = fits && (s[i] == 0 ? fabs(hold[i]) <= 1 + 1e-12 : s[i] * a[i] > 0);
        }
        if (fits) return;
    }
    fail_msg("no mode fits");
}

static void small_step(const rig *r, double *q, double *v, double u, const int *s, double h) {
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1, 2, 2, 1};
    double dq[N] = {0}, dv[N] = {0}, kq[N] = {0}, kv[N] = {0}, hold[N];
    for (int j = 0; j < 4; j++) {
        double Q[N], V[N], a[N];
        for (int i = 0; i < r->n; i++) Q[i] = q[i] + at[j] * h * kq[i], V[i] = v[i] + at[j] * h * kv[i];
        accelerate(r, Q, V, u, s, a, hold);
        for (int i = 0; i < r->n; i++) {
            kq[i] = V[i], kv[i] = a[i];
            dq[i] += h / 6 * weight[j] * kq[i], dv[i] += h / 6 * weight[j] * kv[i];
        }
    }
    for (int i = 0; i < r->n; i++) q[i] += dq[i], v[i] += dv[i];
}

/* How far the mode is from its end; below 0: beyond. *which: the velocity that ends it. */
static double margin(const rig *r, const double *q, const double *v, double u, const int *s, int *which) {
    double a[N], hold[N], M[N][N], F[N], c[N], least = INFINITY;
    formulas(r, q, v, u, M, F, c);
    accelerate(r, q, v, u, s, a, hold);
    for (int i = 0; i < r->n; i++) {
        const double x = c[i] == 0 ? INFINITY : s[i] != 0 ? s[i] * v[i] : 1 - fabs(hold[i]);
        if (x < least) least = x, *which = i;
    }
    return least;
}

/* Moves by the time T with u held. */
static void reference(const rig *r, double *q, double *v, double u, double T) {
    const double most = 2e-4;
    for (double left = T; left > 1e-13 * T;) {
        double Q[N], V[N], h = fmin(most, left);
        int s[N], which = 0;
        find_mode(r, q, v, u, s);
        memcpy(Q, q, sizeof Q), memcpy(V, v, sizeof V);
        small_step(r, Q, V, u, s, h);
        if (margin(r, Q, V, u, s, &which) < 0) {
            double low = 0, high = h;
            for (int i = 0; i < 60; i++) {
                h = (low + high) / 2;
                memcpy(Q, q, sizeof Q), memcpy(V, v, sizeof V);
                small_step(r, Q, V, u, s, h);
                if (margin(r, Q, V, u, s, &which) < 0)
                    high = h;
                else
                    low = h;
            }
            h = high;
            memcpy(Q, q, sizeof Q), memcpy(V, v, sizeof V);
            small_step(r, Q, V, u, s, h);
            (void)margin(r, Q, V, u, s, &which);
            double a[N], hold[N];
            accelerate(r, Q, V, u, s, a, hold);
            V[which] = s[which] != 0 ? 0 : hold[which] > 0 ? 1e-300 : -1e-300;
        }
        memcpy(q, Q, sizeof Q), memcpy(v, V, sizeof V);
        left -= h;
    }
}

/* ---- runs ---- */

static void read_machine(const char *yaml, lg_machine *out) {
    lg_machine_file file;
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", yaml, strlen(yaml), &file, &told));
    *out = file.machine;
    lg_machine_file_destroy(&file);
}

enum { PIECES = 100 };
#define PIECE 0.05

static double input_of(const rig *r, int piece) {
    return r->drive * (sin(0.37 * piece) + (piece / 7 % 3 == 1 ? -0.8 : 0.3));
}

/* The same motion by `each` steps for each piece: root mean square of the errors of q over the ends of
 * pieces, in which `exact` (PIECES + 1, N) is right. */
static double error_of(const rig *r, const double (*exact)[N], size_t each) {
    const size_t rows = PIECES * each + 1;
    double *t = TEST_ARRAY(double, rows), *q = TEST_ARRAY(double, rows *N), *v = TEST_ARRAY(double, rows *N),
           *u = TEST_ARRAY(double, rows * 4), *out = TEST_ARRAY(double, rows *N);
    const size_t first[2] = {0, rows}, start = 0;
    lg_machine machine;
    for (size_t i = 0; i < rows; i++) {
        t[i] = PIECE * (double)i / (double)each;
        memset(u + 4 * i, 0, 4 * sizeof *u);
        u[4 * i] = input_of(r, (int)(i / each));
        for (int k = 0; k < r->n; k++) q[i * r->n + k] = r->q[k], v[i * r->n + k] = r->v[k];
    }
    const lg_machine_log log = {.rows = rows, .parts = 1, .first = first, .t = t, .q = q, .v = v, .u = u};
    read_machine(r->yaml, &machine);
    assert_told(lg_machine_free_run(NULL, &machine, NULL, lg_scheme_find("cf4"), 1, &log, &start, 1, rows - 1,
                                    out, NULL, &told));
    double sum = 0;
    for (int i = 0; i <= PIECES; i++)
        for (int k = 0; k < r->n; k++) {
            const double e = out[i * each * r->n + k] - exact[i][k];
            sum += e * e / (PIECES + 1) / r->n;
        }
    return sqrt(sum);
}

TEST("errors of steps against the event-driven reference fall with order 3 or more, and are small at 50 ms") {
    static const double most[] = {3e-4, 3e-4, 2e-2}, order[] = {2.8, 2.8, 2.2};
    for (size_t m = 0; m < LG_COUNT(rigs); m++) {
        const rig *r = &rigs[m];
        double exact[PIECES + 1][N], q[N], v[N], error[3], stuck = 0;
        memcpy(q, r->q, sizeof q), memcpy(v, r->v, sizeof v);
        for (int i = 0; i <= PIECES; i++) {
            memcpy(exact[i], q, sizeof q);
            stuck += v[0] == 0;
            if (i < PIECES) reference(r, q, v, input_of(r, i), PIECE);
        }
        static const size_t each[] = {1, 5, 50};
        for (int i = 0; i < 3; i++) error[i] = error_of(r, exact, each[i]);
        print_message("%zu: stuck %g; %.2g %.2g %.2g\n", m, stuck, error[0], error[1], error[2]);
        assert_true(stuck > 5); /* the motion sticks and slides */
        assert_true(error[0] < most[m]);
        const double slope = log(error[0] / fmax(error[2], 1e-12)) / log(50.0);
        assert_true(slope > order[m]);
    }
}

/* ---- programs ---- */

static lg_program *program_of(const char *yaml) {
    lg_machine machine;
    lg_program *program = NULL;
    read_machine(yaml, &machine);
    assert_told(lg_machine_program(NULL, &machine, NULL, NULL, false, &program, &told));
    lg_test_owns(program, release_program);
    return program;
}

/* The states of positions and velocities. */
static void to_states(const lg_program *program, size_t rows, const double *q, const double *v, double *x) {
    const ready momenta = make_ready(program, "momenta", rows, LG_F64);
    lg_plan_eval(momenta.plan, (const void *const[]){q, v}, (void *const[]){x}, momenta.work);
}

/* Takes `count` steps of length h with the input u, all rows alike. */
static void step_all(const lg_program *program, size_t rows, size_t n, int count, double u, double h,
                     double *x) {
    const ready step = make_ready(program, "step", rows, LG_F64);
    double *input = TEST_ARRAY(double, rows), *time = TEST_ARRAY(double, rows),
           *next = TEST_ARRAY(double, rows * 2 * n);
    for (size_t i = 0; i < rows; i++) input[i] = u, time[i] = h;
    for (int i = 0; i < count; i++) {
        lg_plan_eval(step.plan, (const void *const[]){x, input, time}, (void *const[]){next}, step.work);
        memcpy(x, next, rows * 2 * n * sizeof *x);
    }
}

TEST("a body on an incline that holds it does not creep by one bit in 100 s") {
    static const double scales[] = {1, 0.3, 49};
    for (size_t i = 0; i < LG_COUNT(scales); i++)
        for (int second = 0; second < 2; second++) { /* the input does what the incline does */
            double x[2] = {0.1234567890123, 0};
            lg_machine machine;
            lg_program *program = NULL;
            read_machine(belt_yaml, &machine);
            machine.terms[1].values[0] = 0;
            machine.scales.time = scales[i];
            machine.scales.place[0] = machine.scales.velocity[0] = scales[i] * 1.7;
            assert_machine(&machine);
            assert_told(lg_machine_program(NULL, &machine, NULL, NULL, false, &program, &told));
            lg_test_owns(program, release_program);
            step_all(program, 1, 1, 2000, second ? 0.9 * 3.5 : -0.9 * 3.5, 0.05, x);
            assert_true(x[0] == 0.1234567890123 && x[1] == 0);
        }
}

TEST("at the limit of friction a body stays; a thousandth beyond it slides, and a hanging load moves it") {
    const lg_program *belt = program_of(belt_yaml), *trolley = program_of(trolley_yaml);
    double still[2] = {0, 0}, slides[2] = {0, 0}, x[4] = {0, 1.2, 0, 0};
    step_all(belt, 1, 1, 1, 3.5, 0.05, still);
    step_all(belt, 1, 1, 1, 3.5 * 1.001, 0.05, slides);
    assert_true(still[0] == 0 && still[1] == 0 && slides[0] > 0 && slides[1] > 0);
    step_all(trolley, 1, 2, 1, 0, 0.05, x);
    assert_true(x[0] == 0 && x[1] < 1.2); /* the load swings, the trolley holds */
    step_all(trolley, 1, 2, 20, 0, 0.05, x);
    assert_true(x[0] != 0); /* until it pulls by more than the friction */
}

TEST("of two joints at rest one slides where the forces exceed its friction by a hundredth") {
    const lg_program *arm = program_of(arm_yaml);
    const double q[N] = {0.01402703706, -0.01534118211}, v[N] = {0, 0};
    double x[4];
    to_states(arm, 1, q, v, x);
    step_all(arm, 1, N, 5, -1.4041, 0.01, x);
    assert_true(x[0] < q[0] && x[1] == q[1]);
    to_states(arm, 1, q, v, x);
    step_all(arm, 1, N, 5, -1.37, 0.01, x);
    assert_true(x[0] == q[0] && x[1] == q[1]);
}

TEST("friction that sticks gives no energy without an input, in steps of 50 ms") {
    enum { ROWS = 300 };
    for (size_t m = 0; m < 2; m++) {
        const lg_program *program = program_of(rigs[m].yaml);
        const double *q = test_numbers(5, (size_t)ROWS * N, -1.5, 1.5),
                     *v = test_numbers(6, (size_t)ROWS * N, -2, 2);
        double *x = TEST_ARRAY(double, (size_t)ROWS * 2 * N), before[ROWS], after[ROWS];
        const ready energy = make_ready(program, "value", ROWS, LG_F64);
        to_states(program, ROWS, q, v, x);
        for (int i = 0; i < 40; i++) {
            run_value(&energy, x, before);
            step_all(program, ROWS, N, 1, 0, 0.05, x);
            run_value(&energy, x, after);
            for (int s = 0; s < ROWS; s++) assert_true(after[s] <= before[s] + 1e-5 * fabs(before[s]));
        }
    }
}

TEST("a change of the units of mass, length and time by 1e9 changes nothing") {
    static const double units[][3] = {{1, 1, 1},    {1e9, 1, 1}, {1e-9, 1, 1}, {1, 1e9, 1},
                                      {1, 1e-9, 1}, {1, 1, 1e9}, {1, 1, 1e-9}};
    double first[4] = {0};
    for (size_t i = 0; i < LG_COUNT(units); i++) {
        const double m = units[i][0], L = units[i][1], T = units[i][2], force = m * L / (T * T);
        const lg_program *program =
            program_of(test_text("columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, "
                                 "{name: a, kind: angle, velocity: "
                                 "va}]\ninputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: %.17g, "
                                 "pole: %.17g, length: %.17g, "
                                 "gravity: %.17g}\ndamping: [{kind: known, values: [%.17g, %.17g]}, {kind: "
                                 "coulomb, values: [%.17g, "
                                 "%.17g]}]\ninput_map: {kind: known, values: [[1], [0]]}\n",
                                 10 * m, m, 0.8 * L, -9.81 * L / (T * T), 0.5 * m / T, 0.05 * m * L * L / T,
                                 6 * force, 0.3 * force * L));
        double x[4];
        to_states(program, 1, (const double[]){0.1 * L, 0.6}, (const double[]){0.7 * L / T, -0.4 / T}, x);
        step_all(program, 1, N, 60, 4 * force, 0.05 * T, x);
        const double got[4] = {x[0] / L, x[1], x[2] * T / (m * L), x[3] * T / (m * L * L)};
        if (i == 0) memcpy(first, got, sizeof first);
        for (int k = 0; k < 4; k++) assert_close(got[k], first[k], 1e-9, 1e-12);
    }
}

TEST("plan, tape and compiled C take the same steps, at rest, at the limit and at a speed of 1e-300, too") {
    enum { ROWS = 40 };
    for (size_t m = 0; m < LG_COUNT(rigs); m++) {
        const size_t n = (size_t)rigs[m].n;
        const lg_program *program = program_of(rigs[m].yaml);
        const double *random = test_numbers(9 + m, (size_t)ROWS * 6, -1, 1);
        double q[ROWS * N], v[ROWS * N], u[ROWS], h[ROWS], x[ROWS * 2 * N], out[ROWS * 2 * N],
            taped[ROWS * 2 * N], one[2 * N];
        for (size_t s = 0; s < ROWS; s++) {
            for (size_t k = 0; k < n; k++) {
                q[s * n + k] = random[s * 6 + k];
                v[s * n + k] = s % 3 == 0   ? 0
                               : s % 7 == 0 ? 1e-300
                                            : random[s * 6 + 2 + k] * (s % 2 ? 1 : 0.02);
            }
            u[s] = 8 * random[s * 6 + 4];
            if (m == 2 && s % 6 == 0) u[s] = 20 * q[s] + (s % 12 == 0 ? 3.5 : -3.5); /* the limit */
            h[s] = s % 2 ? 0.05 : 0.004;
        }
        to_states(program, ROWS, q, v, x);
        const ready step = make_ready(program, "step", ROWS, LG_F64);
        lg_plan_eval(step.plan, (const void *const[]){x, u, h}, (void *const[]){out}, step.work);
        lg_tape *tape = test_tape(LG_F64);
        size_t at;
        lg_var y;
        assert_ok(lg_program_find(program, "step", &at, NULL));
        const lg_var in[3] = {lg_input_f64(tape, lg_shape2(ROWS, (uint32_t)(2 * n)), x),
                              lg_input_f64(tape, lg_shape2(ROWS, 1), u),
                              lg_input_f64(tape, lg_shape2(ROWS, 1), h)};
        assert_ok(lg_program_record(tape, program, at, NULL, in, &y));
        assert_ok(lg_read(tape, y, ROWS * 2 * n, taped));
        compiled c;
        if (has_compiler() && !compile_program(&c, program, "cc", "-O1", LG_F64, false))
            fail_msg("%s", c.why);
        double *work = TEST_ARRAY(double, 4096);
        for (size_t s = 0; s < ROWS; s++) {
            if (has_compiler())
                shim_of(&c, "step")((const void *const[]){x + s * 2 * n, u + s, h + s}, (void *const[]){one},
                                    work);
            for (size_t k = 0; k < 2 * n; k++) {
                assert_close(taped[s * 2 * n + k], out[s * 2 * n + k], 1e-11, 1e-13);
                if (has_compiler()) assert_close(one[k], out[s * 2 * n + k], 1e-11, 1e-13);
            }
        }
        if (has_compiler()) assert_true(discard_compiled(&c));
    }
}

/* ---- derivatives ---- */

/* q_0 + q_1 after the time T with the input u. */
static double after(const rig *r, const double *start, double u, double T) {
    double q[N] = {start[0], start[1]}, v[N] = {start[2], start[3]};
    reference(r, q, v, u, T);
    return q[0] + q[1];
}

TEST("gradients and Hessians by the start converge to those of the reference") {
    static const struct { double h, gradient, hessian; } rows[] = {{0.05, 2e-3, 2e-2}, {0.01, 2e-5, 1e-3}};
    static const double inputs[2] = {-3, 0.6};
    for (size_t m = 0; m < 2; m++) {
        const rig *r = &rigs[m];
        const double T = 1, e[2] = {1e-5, 1e-3}, u = inputs[m];
        double start[4] = {r->q[0], r->q[1], r->v[0], r->v[1]}, g[4], H[4][4], size[2] = {0, 0};
        for (int i = 0; i < 4; i++)
            for (int j = 0; j <= i; j++) {
                double sum = 0;
                for (int k = 0; k < 4; k++) {
                    double x[4];
                    memcpy(x, start, sizeof x);
                    x[i] += k % 2 ? e[1] : -e[1], x[j] += k / 2 ? e[1] : -e[1];
                    sum += (k == 0 || k == 3 ? 1 : -1) * after(r, x, u, T);
                }
                H[i][j] = H[j][i] = sum / (4 * e[1] * e[1]);
                size[1] = fmax(size[1], fabs(H[i][j]));
            }
        for (int i = 0; i < 4; i++) {
            double up[4], down[4];
            memcpy(up, start, sizeof up), memcpy(down, start, sizeof down);
            up[i] += e[0], down[i] -= e[0];
            g[i] = (after(r, up, u, T) - after(r, down, u, T)) / (2 * e[0]);
            size[0] = fmax(size[0], fabs(g[i]));
        }
        for (size_t k = 0; k < LG_COUNT(rows); k++) {
            lg_machine machine;
            lg_machine_vars vars;
            lg_var parts[LG_TAPED_MAX_PARTS], gradient;
            double got[4], second[16], error[2] = {0, 0};
            lg_tape *tape = test_tape(LG_F64);
            read_machine(r->yaml, &machine);
            assert_ok(lg_machine_bind(tape, &machine, LG_NONE, &vars));
            const lg_var x = lg_input_f64(tape, lg_shape2(1, 4), start);
            assert_ok(lg_machine_record_state(tape, &vars, lg_slice(tape, x, 1, 0, 2),
                                              lg_slice(tape, x, 1, 2, 2), parts));
            const lg_machine_stick over = {.h = lg_full(tape, lg_shape2(1, 1), rows[k].h),
                                           .u = {lg_input_f64(tape, lg_shape2(1, 1), &u), LG_NONE, LG_NONE}};
            for (int i = 0; i < (int)lround(T / rows[k].h); i++)
                assert_ok(lg_machine_stick_step(tape, &vars, &over, parts));
            const lg_var y = lg_sum(tape, parts[lg_machine_parts(&machine).x]);
            assert_ok(lg_grad(tape, y, &x, 1, &gradient));
            assert_ok(lg_read(tape, gradient, 4, got));
            assert_ok(lg_read(tape, lg_jacobian(tape, gradient, x), 16, second));
            for (int i = 0; i < 4; i++) {
                error[0] = fmax(error[0], fabs(got[i] - g[i]) / size[0]);
                for (int j = 0; j < 4; j++)
                    error[1] = fmax(error[1], fabs(second[4 * i + j] - H[i][j]) / size[1]);
            }
            print_message("%zu, %g s: gradient %.2g, Hessian %.2g of %.2g, %.2g\n", m, rows[k].h, error[0],
                          error[1], size[0], size[1]);
            assert_true(error[0] < rows[k].gradient && error[1] < rows[k].hessian);
        }
    }
}

/* ---- inputs that change within a step, and lags ---- */

/* The end of a run of 2 s in `each` steps for each of 40 intervals, over which the input is the cubic c. */
static void run_driven(const lg_machine *machine, const double (*c)[4], size_t each, double *end) {
    enum { INTERVALS = 40 };
    const size_t rows = INTERVALS * each + 1, start = 0, first[2] = {0, rows};
    double *t = TEST_ARRAY(double, rows), *q = TEST_ARRAY(double, rows *N), *v = TEST_ARRAY(double, rows *N),
           *u = TEST_ARRAY(double, rows * 4), *out = TEST_ARRAY(double, rows *N);
    for (size_t i = 0; i < rows; i++) {
        const double *p = c[i / each], a = (double)(i % each) / (double)each, s = 1 / (double)each;
        t[i] = 0.05 * (double)i / (double)each;
        q[2 * i] = 0.1, q[2 * i + 1] = 0.6, v[2 * i] = 0.7, v[2 * i + 1] = -0.4;
        u[4 * i] = p[0] + a * (p[1] + a * (p[2] + a * p[3]));
        u[4 * i + 1] = s * (p[1] + a * (2 * p[2] + 3 * a * p[3]));
        u[4 * i + 2] = s * s * (p[2] + 3 * a * p[3]);
        u[4 * i + 3] = s * s * s * p[3];
    }
    const lg_machine_log log = {.rows = rows, .parts = 1, .first = first, .t = t, .q = q, .v = v, .u = u};
    assert_told(lg_machine_free_run(NULL, machine, NULL, lg_scheme_find("cf4"), 1, &log, &start, 1, rows - 1,
                                    out, NULL, &told));
    memcpy(end, out + (rows - 1) * N, N * sizeof *end);
}

TEST("inputs that change within a step, and lags, act in steps of 12.5 ms as in steps of 1.25 ms") {
    for (int lag = 0; lag < 2; lag++)
        for (int powers = 1; powers <= 4; powers++) {
            double c[41][4] = {{0}}, coarse[N], fine[N];
            lg_machine machine;
            read_machine(trolley_yaml, &machine);
            if (lag == 1) {
                static const double tau = 0.08;
                lg_machine_term *term = add_term(&machine, LG_MACHINE_ACTUATOR, "lag");
                add_feature(term, LG_FEATURE_INPUT, 0);
                add_values(term, 1, &tau);
                assert_machine(&machine);
            }
            const double *random = test_numbers(3, 41 * 4, -9, 9);
            for (int i = 0; i < 41; i++)
                for (int k = 0; k < powers; k++) c[i][k] = random[4 * i + k];
            run_driven(&machine, (const double(*)[4])c, 4, coarse);
            run_driven(&machine, (const double(*)[4])c, 40, fine);
            for (int k = 0; k < N; k++) assert_close(coarse[k], fine[k], 0, 5e-5);
        }
}

TEST("a step of the program moves lagged inputs and the machine as a run does") {
    static const double tau = 0.08;
    double c[41][4] = {{0}}, end[N], x[5], u, next[5];
    lg_machine machine;
    lg_program *program = NULL;
    read_machine(trolley_yaml, &machine);
    lg_machine_term *term = add_term(&machine, LG_MACHINE_ACTUATOR, "lag");
    add_feature(term, LG_FEATURE_INPUT, 0);
    add_values(term, 1, &tau);
    odd_scales(&machine);
    assert_machine(&machine);
    for (int i = 0; i < 41; i++) c[i][0] = 12 * sin(i);
    run_driven(&machine, (const double(*)[4])c, 1, end);
    assert_told(lg_machine_program(NULL, &machine, NULL, NULL, false, &program, &told));
    lg_test_owns(program, release_program);
    const ready momenta = make_ready(program, "momenta", 1, LG_F64),
                step = make_ready(program, "step", 1, LG_F64);
    const double q[N] = {0.1, 0.6}, v[N] = {0.7, -0.4}, h = 0.05;
    lg_plan_eval(momenta.plan, (const void *const[]){q, v}, (void *const[]){x}, momenta.work);
    for (int i = 0; i < 40; i++) {
        u = c[i][0];
        lg_plan_eval(step.plan, (const void *const[]){x, &u, &h}, (void *const[]){next}, step.work);
        memcpy(x, next, sizeof x);
    }
    for (int k = 0; k < N; k++) assert_close(x[k], end[k], 1e-9, 1e-9);
}
