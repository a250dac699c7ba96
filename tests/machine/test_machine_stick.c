/* Friction without a width: steps in which a machine sticks, slides and breaks away. They are compared with an
 * event-driven integrator that this file has for itself: small steps of rk4 in one mode, ends of modes found by
 * bisection. */
#include <float.h>

#include "support/machine_support.h"
#include "support/model_support.h"
#include "support/plan_support.h"

#include "liegrad/model.h"
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

/* The same motion by `each` steps for each piece: root mean square of the errors of q over the ends of pieces,
 * in which `exact` (PIECES + 1, N) is right. */
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
