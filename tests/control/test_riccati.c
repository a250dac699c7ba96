/* Riccati equations: compared with solutions of 40 digits, residuals computed by independent arithmetic, and
 * equations without a solution. */
#include <float.h>

#include "support/fixtures.h"

#include "golden/riccati_table.h"
#include "liegrad/control.h"

typedef lg_status (*solver)(const lg_riccati *, double *, double *, double *, lg_riccati_result *, void *,
                            size_t, lg_error *);

typedef struct solved {
    lg_riccati of;
    double *P, *K, *eigenvalues;
    lg_riccati_result result;
} solved;

static lg_riccati equation_of(const riccati_case *c, const double **P) {
    const size_t n = c->n, m = c->m;
    const double *x = c->numbers;
    lg_riccati of = {.size = sizeof of, .n = n, .m = m, .A = x};
    of.B = of.A + n * n;
    of.Q = of.B + n * m;
    of.R = of.Q + n * n;
    of.S = c->cross ? of.R + m * m : NULL;
    *P = of.R + m * m + (c->cross ? n * m : 0);
    return of;
}

static lg_status attempt(solver solve, solved *s, lg_error *error) {
    const size_t n = s->of.n, m = s->of.m, bytes = lg_riccati_work_size(n, m);
    s->P = TEST_ARRAY(double, n *n);
    s->K = TEST_ARRAY(double, m *n);
    s->eigenvalues = TEST_ARRAY(double, 2 * n);
    return solve(&s->of, s->P, s->K, s->eigenvalues, &s->result, test_work(bytes), bytes, error);
}

static double distance(size_t count, const double *a, const double *b) {
    double apart = 0.0, size = 0.0;
    for (size_t i = 0; i < count; i++) apart += (a[i] - b[i]) * (a[i] - b[i]), size += b[i] * b[i];
    return sqrt(apart / size);
}

/* The largest element of the residual, relative to the largest sum of its terms' magnitudes, by plain
 * sums. */
static double residual_of(const solved *s, bool discrete) {
    const size_t n = s->of.n, m = s->of.m;
    const double *A = s->of.A, *B = s->of.B, *P = s->P, *K = s->K;
    double worst = 0.0, most = 0.0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            double sum = s->of.Q[i * n + j], size = fabs(sum);
#define TERM(x)                                                                                              \
    do {                                                                                                     \
        const double term_ = (x);                                                                            \
        sum += term_;                                                                                        \
        size += fabs(term_);                                                                                 \
    } while (0)
            if (discrete) TERM(-P[i * n + j]);
            for (size_t k = 0; k < n; k++) {
                if (!discrete) {
                    TERM(A[k * n + i] * P[k * n + j]);
                    TERM(P[i * n + k] * A[k * n + j]);
                }
                for (size_t l = 0; discrete && l < n; l++) {
                    double closed = A[l * n + j];
                    for (size_t h = 0; h < m; h++) closed -= B[l * m + h] * K[h * n + j];
                    TERM(A[k * n + i] * P[k * n + l] * closed);
                }
                for (size_t h = 0; !discrete && h < m; h++) TERM(-P[i * n + k] * B[k * m + h] * K[h * n + j]);
            }
            for (size_t h = 0; s->of.S != NULL && h < m; h++) TERM(-s->of.S[i * m + h] * K[h * n + j]);
            worst = fmax(worst, fabs(sum));
            most = fmax(most, size);
            if (P[i * n + j] != P[j * n + i]) worst = INFINITY;
        }
    return worst / most;
}

static void check_table(const riccati_case *table, size_t count, bool discrete) {
    print_message("%-28s  %9s %9s %9s %9s\n", "relative errors of P", "here", "SciPy", "residual",
                  "correction");
    for (size_t i = 0; i < count; i++) {
        const double *exact;
        lg_error error = {LG_OK, ""};
        solved s = {.of = equation_of(&table[i], &exact)};
        if (attempt(discrete ? lg_dare : lg_care, &s, &error) != LG_OK)
            fail_msg("%s: %s", table[i].name, error.message);
        const double off = distance(s.of.n * s.of.n, s.P, exact);
        print_message("%-28s  %9.1e %9.1e %9.1e %9.1e\n", table[i].name, off, table[i].scipy,
                      s.result.residual, s.result.correction);
        /* The residual has twice the digits, so P is right to its last digits. */
        assert_true(off <= 2.0 * DBL_EPSILON);
        assert_true(off <= 30.0 * s.result.correction + 1e-12);
        assert_true(s.result.residual <= 1e-12 && s.result.margin > 0.0);
        assert_true(residual_of(&s, discrete) < 3e-12);
        for (size_t k = 0; k < s.of.n; k++) {
            const double re = s.eigenvalues[2 * k], im = s.eigenvalues[2 * k + 1];
            assert_true(discrete ? hypot(re, im) < 1.0 : re < 0.0);
        }
    }
}

TEST("continuous equations agree with 40 digits: the collection, and mixed scales") {
    check_table(care_table, LG_COUNT(care_table), false);
}

TEST("discrete equations agree with 40 digits: the collection, singular A and R, and mixed scales") {
    check_table(dare_table, LG_COUNT(dare_table), true);
}

/* ---- equations that are not in the tables ---- */

static lg_riccati random_equation(uint64_t seed, size_t n, size_t m, double growth) {
    lg_riccati of = {.size = sizeof of, .n = n, .m = m};
    double *A = test_numbers(seed, n * n, -1.0, 1.0), *factor = test_numbers(seed + 1, n * n, -1.0, 1.0),
           *Q = TEST_ARRAY(double, n *n), *R = TEST_ARRAY(double, m *m);
    for (size_t i = 0; i < n * n; i++) A[i] *= growth;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            for (size_t k = 0; k < n; k++) Q[i * n + j] += factor[i * n + k] * factor[j * n + k];
    for (size_t i = 0; i < m; i++) R[i * m + i] = 0.5 + (double)i;
    of.A = A, of.B = test_numbers(seed + 2, n * m, -1.0, 1.0), of.Q = Q, of.R = R;
    return of;
}

TEST("random equations with up to 60 states are solved to rounding") {
    static const size_t sizes[][2] = {{1, 1}, {2, 3}, {7, 1}, {20, 4}, {60, 5}};
    for (int discrete = 0; discrete < 2; discrete++)
        for (size_t i = 0; i < LG_COUNT(sizes); i++) {
            const size_t n = sizes[i][0];
            solved s = {.of = random_equation(10 * i, n, sizes[i][1], 2.0 / sqrt((double)n))};
            assert_told(attempt(discrete ? lg_dare : lg_care, &s, &told));
            assert_true(residual_of(&s, discrete) < 1e-13 * (double)n);
            assert_true(s.result.correction < 1e-9);
        }
}

TEST("with Q = 0 a stable system has P = 0, and an unstable one the gain that mirrors its eigenvalue") {
    const double zero[1] = {0.0}, one[1] = {1.0}, stable[1] = {-2.0}, unstable[1] = {2.0};
    solved s = {.of = {sizeof s.of, 1, 1, stable, one, zero, one, NULL}};
    assert_ok(attempt(lg_care, &s, NULL));
    assert_close(s.P[0], 0.0, 0.0, 1e-15);
    assert_close(s.result.margin, 2.0, 1e-14, 0.0);
    s.of.A = unstable;
    assert_ok(attempt(lg_care, &s, NULL));
    assert_close(s.P[0], 4.0, 1e-14, 0.0); /* closed loop -2 */
    assert_close(s.eigenvalues[0], -2.0, 1e-14, 0.0);
    assert_ok(attempt(lg_dare, &s, NULL));
    assert_close(s.eigenvalues[0], 0.5, 1e-14, 0.0); /* 1/2 */
    assert_close(s.P[0], 3.0, 1e-14, 0.0);           /* W = 4, K = 2 * 3/4 */
}

TEST("with Q = 0 stable systems with several states have P = 0") {
    for (int discrete = 0; discrete < 2; discrete++)
        for (size_t n = 2; n <= 10; n += 4) {
            double *A = test_numbers(70 + n, n * n, -0.9, 0.9), *zero = TEST_ARRAY(double, n *n);
            /* row sums below 0.9; in the continuous case minus the identity */
            for (size_t i = 0; i < n * n; i++)
                A[i] = A[i] / (double)n - (!discrete && i % (n + 1) == 0 ? 1.0 : 0.0);
            solved s = {.of = {sizeof s.of, n, 1, A, test_numbers(7, n, -1.0, 1.0), zero, zero, NULL}};
            s.of.R = (const double[1]){2.0};
            assert_told(attempt(discrete ? lg_dare : lg_care, &s, &told));
            for (size_t i = 0; i < n * n; i++) assert_true(s.P[i] == 0.0);
            assert_true(s.result.residual == 0.0 && s.result.correction == 0.0 && s.result.margin > 0.1);
        }
}

/* ---- badly conditioned equations: |P| from 1e5 to 1e13, Q = 1, R = 1 ---- */

/* Whether exp(h (A - B K)), or A - B K if discrete, vanishes to rounding after 16 squarings. */
static bool is_stable(const solved *s, bool discrete) {
    const size_t n = s->of.n, m = s->of.m, bytes = lg_zero_order_hold_work_size(n, 1);
    double *power = TEST_ARRAY(double, n *n), *next = TEST_ARRAY(double, n *n), *zero = TEST_ARRAY(double, n),
           most = 0.0;
    for (size_t i = 0; i < n * n; i++) {
        power[i] = s->of.A[i];
        for (size_t k = 0; k < m; k++) power[i] -= s->of.B[i / n * m + k] * s->K[k * n + i % n];
    }
    if (!discrete)
        assert_ok(lg_zero_order_hold(n, 1, power, zero, 0.05, power, zero, test_work(bytes), bytes, NULL));
    for (int squaring = 0; squaring < 16; squaring++) {
        memset(next, 0, n * n * sizeof *next);
        for (size_t i = 0; i < n; i++)
            for (size_t k = 0; k < n; k++)
                for (size_t j = 0; j < n; j++) next[i * n + j] += power[i * n + k] * power[k * n + j];
        memcpy(power, next, n * n * sizeof *power);
    }
    for (size_t i = 0; i < n * n; i++) most = isfinite(power[i]) ? fmax(most, fabs(power[i])) : INFINITY;
    return most < 1e-12;
}

static lg_riccati with_unit_weights(size_t n, double *A, double *B) {
    double *Q = TEST_ARRAY(double, n *n), *R = TEST_ARRAY(double, 1);
    for (size_t i = 0; i < n; i++) Q[i * n + i] = 1.0;
    R[0] = 1.0;
    return (lg_riccati){.size = sizeof(lg_riccati), .n = n, .m = 1, .A = A, .B = B, .Q = Q, .R = R};
}

/* A system with random numbers of variance `growth`^2. */
static lg_riccati random_with_unit_weights(uint64_t seed, size_t n, double growth) {
    const double width = sqrt(3.0) * growth;
    return with_unit_weights(n, test_numbers(seed, n * n, -width, width),
                             test_numbers(seed + 1, n, -sqrt(3.0), sqrt(3.0)));
}

/* x_i' = x_i+1, x_n' = u; h > 0: its Euler steps. */
static lg_riccati chain(size_t n, double h) {
    double *A = TEST_ARRAY(double, n *n), *B = TEST_ARRAY(double, n);
    for (size_t i = 0; i < n; i++) {
        if (h > 0.0) A[i * n + i] = 1.0;
        if (i + 1 < n) A[i * n + i + 1] = h > 0.0 ? h : 1.0;
    }
    B[n - 1] = h > 0.0 ? h : 1.0;
    return with_unit_weights(n, A, B);
}

/* A row of inverted pendulums that are coupled by springs, with a force on the first one. */
static lg_riccati pendulums(size_t count) {
    const size_t n = 2 * count;
    double *A = TEST_ARRAY(double, n *n), *B = TEST_ARRAY(double, n);
    for (size_t i = 0; i < count; i++) {
        double *row = A + (count + i) * n;
        A[i * n + count + i] = 1.0;
        row[i] = 9.81 - 10.0, row[count + i] = -0.1;
        if (i > 0) row[i - 1] = 5.0;
        if (i + 1 < count) row[i + 1] = 5.0;
    }
    B[count] = 1.0;
    return with_unit_weights(n, A, B);
}

/* Solves the equation and updates the maxima in worst: {residual, correction, -margin}. */
static void check_solved(const char *name, lg_riccati of, bool discrete, double most, double worst[3]) {
    lg_error error = {LG_OK, ""};
    solved s = {.of = of};
    if (attempt(discrete ? lg_dare : lg_care, &s, &error) != LG_OK) fail_msg("%s: %s", name, error.message);
    const double residual = residual_of(&s, discrete);
    assert_true(residual < most && s.result.correction < 1e-3);
    assert_true(s.result.margin > 0.0 && is_stable(&s, discrete));
    worst[0] = fmax(worst[0], residual);
    worst[1] = fmax(worst[1], s.result.correction);
    worst[2] = fmax(worst[2], -s.result.margin);
}

TEST("badly conditioned random equations are solved, and the closed loop is stable") {
    static const struct {
        const char *name;
        size_t n;
        double growth, most;
        bool discrete;
    } kinds[] = {{"continuous, 12 states", 12, 1.0, 1e-10, false},
                 {"continuous, 14 states", 14, 1.0, 1e-10, false},
                 {"discrete, 15 states", 15, 0.5, 1e-10, true},
                 {"discrete, 20 states", 20, 0.5, 1e-8, true}};
    print_message("%-24s  %9s %9s %9s\n", "worst of 20", "residual", "correction", "margin");
    for (size_t i = 0; i < LG_COUNT(kinds); i++) {
        double worst[3] = {0.0, 0.0, -INFINITY};
        for (uint64_t seed = 100; seed <= 2000; seed += 100)
            check_solved(kinds[i].name, random_with_unit_weights(seed, kinds[i].n, kinds[i].growth),
                         kinds[i].discrete, kinds[i].most, worst);
        print_message("%-24s  %9.1e %9.1e %9.2g\n", kinds[i].name, worst[0], worst[1], -worst[2]);
    }
}

TEST("long chains of integrators and of pendulums are stabilised by a single input") {
    const struct {
        const char *name;
        lg_riccati of;
        bool discrete;
    } chains[] = {{"16 integrators", chain(16, 0.0), false},
                  {"20 integrators", chain(20, 0.0), false},
                  {"30 integrators", chain(30, 0.0), false},
                  {"16 integrators, 0.01 s", chain(16, 0.01), true},
                  {"20 integrators, 0.01 s", chain(20, 0.01), true},
                  {"8 pendulums", pendulums(8), false},
                  {"10 pendulums", pendulums(10), false}};
    print_message("%-24s  %9s %9s %9s\n", "", "residual", "correction", "margin");
    for (size_t i = 0; i < LG_COUNT(chains); i++) {
        double worst[3] = {0.0, 0.0, -INFINITY};
        check_solved(chains[i].name, chains[i].of, chains[i].discrete, 1e-7, worst);
        print_message("%-24s  %9.1e %9.1e %9.2g\n", chains[i].name, worst[0], worst[1], -worst[2]);
    }
}

TEST("the gain of an estimator is that of the transposed system") {
    /* dx = -x dt + noise, y = x + noise with unit densities: P^2 + 2 P - 1 = 0. */
    const double a[1] = {-1.0}, one[1] = {1.0};
    solved s = {.of = {sizeof s.of, 1, 1, a, one, one, one, NULL}};
    assert_ok(attempt(lg_care, &s, NULL));
    assert_close(s.P[0], sqrt(2.0) - 1.0, 1e-15, 0.0);
    assert_close(s.K[0], s.P[0], 1e-15, 0.0);
}

/* ---- equations without a solution ---- */

static const double integrators[4] = {0, 1, 0, 0}, swing[4] = {0, 1, -1, 0}, turn[4] = {0.6, 0.8, -0.8, 0.6},
                    identity[4] = {1, 0, 0, 1}, nothing[4] = {0}, last[2] = {0, 1}, first[2] = {1, 0},
                    growing[4] = {-1, 0, 0, 3}, unit[1] = {1}, jumping[4] = {0.5, 0, 0, 3},
                    negative[1] = {-1}, zero_weight[1] = {0}, skew[4] = {1, 0.1, 0, 1},
                    infinite[4] = {1, 0, 0, INFINITY};

TEST("equations without a stabilising solution are refused with the reason, and nothing is written") {
    static const struct {
        solver solve;
        const double *A, *B, *Q, *R;
        lg_status status;
        const char *says;
    } cases[] = {
        {lg_care, growing, first, identity, unit, LG_CHECK_FAILED, "no input reaches the eigenvalue 3+0i"},
        {lg_dare, jumping, first, identity, unit, LG_CHECK_FAILED, "no input reaches the eigenvalue 3+0i"},
        {lg_care, swing, nothing, identity, unit, LG_CHECK_FAILED, "no input reaches"},
        {lg_dare, turn, nothing, identity, unit, LG_CHECK_FAILED, "no input reaches"},
        {lg_care, swing, last, nothing, unit, LG_CHECK_FAILED, "Q gives no weight to the eigenvalue 0+1i"},
        {lg_dare, turn, last, nothing, unit, LG_CHECK_FAILED, "Q gives no weight to the eigenvalue 0.6+0.8i"},
        {lg_care, integrators, last, nothing, unit, LG_CHECK_FAILED, "no stabilising solution"},
        {lg_dare, identity, last, identity, unit, LG_CHECK_FAILED, "not stabilisable"},
        {lg_care, integrators, last, identity, zero_weight, LG_INVALID_ARGUMENT,
         "R is not positive definite"},
        {lg_care, integrators, last, identity, negative, LG_INVALID_ARGUMENT, "R is not positive definite"},
        {lg_care, integrators, last, skew, unit, LG_INVALID_ARGUMENT, "Q is not symmetric"},
        {lg_care, infinite, last, identity, unit, LG_NOT_FINITE, "number 3 of A"},
        {lg_dare, integrators, last, infinite, unit, LG_NOT_FINITE, "number 3 of Q"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_error error = {LG_OK, ""};
        solved s = {.of = {sizeof s.of, 2, 1, cases[i].A, cases[i].B, cases[i].Q, cases[i].R, NULL}};
        const lg_status status = attempt(cases[i].solve, &s, &error);
        if (status != cases[i].status || error.status != status)
            fail_msg("case %zu: %s, %s", i, lg_status_name(status), error.message);
        assert_says(error.message, cases[i].says);
        for (size_t k = 0; k < 4; k++) assert_true(s.P[k] == 0.0 && s.eigenvalues[k] == 0.0);
        assert_true(s.K[0] == 0.0 && s.result.residual == 0.0);
    }
}

TEST("an equation without one of its matrices is refused") {
    for (int k = 0; k < 4; k++) {
        lg_error error = {LG_OK, ""};
        solved s = {.of = {sizeof s.of, 2, 1, integrators, last, identity, unit, NULL}};
        *(const double **[]){&s.of.A, &s.of.B, &s.of.Q, &s.of.R}[k] = NULL;
        assert_status(attempt(lg_care, &s, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "A, B, Q or R is NULL");
    }
}

TEST("an undetectable mode on the boundary is refused even if all others are fine") {
    /* Two integrators in series that Q does not weight, and one state that it weights. */
    const double A[9] = {0, 1, 0, 0, 0, 0, 0, 0, -1}, B[6] = {0, 0, 1, 0, 0, 1}, R[4] = {1, 0, 0, 1};
    const double Q[9] = {0, 0, 0, 0, 0, 0, 0, 0, 1};
    lg_error error = {LG_OK, ""};
    solved s = {.of = {sizeof s.of, 3, 2, A, B, Q, R, NULL}};
    assert_status(attempt(lg_care, &s, &error), LG_CHECK_FAILED);
    assert_says(error.message, "no stabilising solution");
}

TEST("integrators in series that Q does not weight are refused in rotated coordinates too, except for a "
     "few") {
    enum { N = 6, ROW = 3, COUNT = 40 };
    int refused = 0;
    for (uint64_t seed = 1; seed <= COUNT; seed++) {
        /* Reflected by 1 - 2 v v^T / |v|^2: three integrators in series, and three weighted states that
         * decay. */
        double turn_by[N][N], A[N * N] = {0}, Q[N * N] = {0}, length = 0.0;
        const double *v = test_numbers(seed, N, -1.0, 1.0), two[4] = {1, 0, 0, 1};
        lg_error error = {LG_OK, ""};
        for (size_t i = 0; i < N; i++) length += v[i] * v[i];
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j < N; j++) turn_by[i][j] = (i == j) - 2.0 * v[i] * v[j] / length;
        for (size_t i = 0; i < N * N; i++)
            for (size_t k = 0; k < N; k++) {
                const double left = turn_by[i / N][k], *right = turn_by[i % N];
                A[i] += left * (k < ROW ? right[k] : (0.1 + 0.2 * (double)(k - ROW)) * right[k]);
                if (k + 1 < ROW) A[i] += left * right[k + 1];
                if (k >= ROW) Q[i] += left * right[k];
            }
        solved s = {.of = {sizeof s.of, N, 2, A, test_numbers(seed + 50, 2 * N, -1.0, 1.0), Q, two, NULL}};
        if (attempt(lg_dare, &s, &error) == LG_OK) continue;
        assert_says(error.message, "no stabilising solution");
        refused++;
    }
    print_message("%d refused of %d\n", refused, COUNT);
    assert_true(refused >= COUNT * 3 / 4);
}

TEST("an equation that only rounding makes solvable is refused") {
    /* Modes 1 and -1 along axes rotated by t; u reaches only the stable mode. */
    for (int n = 1; n <= 20; n++) {
        const double t = 0.07 * n, cc = cos(t) * cos(t), ss = sin(t) * sin(t), cs = cos(t) * sin(t);
        const double A[4] = {cc - ss, 2.0 * cs, 2.0 * cs, ss - cc}, B[2] = {-sin(t), cos(t)};
        lg_error error = {LG_OK, ""};
        solved s = {.of = {sizeof s.of, 2, 1, A, B, identity, unit, NULL}};
        assert_status(attempt(lg_care, &s, &error), LG_CHECK_FAILED);
        assert_says(error.message, "no input reaches the eigenvalue 1+0i");
    }
}

TEST("sizes and memory are checked") {
    enum { BYTES = 1 << 16 };
    char *memory = test_work(BYTES);
    lg_riccati of = {sizeof of, 2, 1, integrators, last, identity, unit, NULL};
    const size_t needed = lg_riccati_work_size(2, 1);
    double P[4], K[2];
    assert_true(needed > 0 && needed < BYTES);
    assert_ok(lg_care(&of, P, K, NULL, NULL, memory, needed, NULL));
    assert_ok(lg_care(&of, NULL, K, NULL, NULL, memory, needed, NULL));
    assert_close(K[0], 1.0, 1e-15, 0.0);
    assert_close(K[1], sqrt(3.0), 1e-15, 0.0);
    assert_status(lg_care(&of, P, K, NULL, NULL, memory, needed - 1, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_care(&of, P, K, NULL, NULL, memory + 8, needed, NULL), LG_INVALID_ARGUMENT);
    of.n = 0;
    assert_status(lg_care(&of, P, K, NULL, NULL, memory, needed, NULL), LG_INVALID_ARGUMENT);
    of.n = 2, of.m = 10000;
    assert_status(lg_care(&of, P, K, NULL, NULL, memory, needed, NULL), LG_INVALID_ARGUMENT);
    of.m = 1, of.size = 1;
    assert_status(lg_care(&of, P, K, NULL, NULL, memory, needed, NULL), LG_INVALID_ARGUMENT);
    assert_int_equal(lg_riccati_work_size(0, 1), 0);
    assert_int_equal(lg_riccati_work_size(1, 0), 0);
    assert_int_equal(lg_riccati_work_size(SIZE_MAX, 1), 0);
    assert_int_equal(lg_riccati_work_size(1, SIZE_MAX), 0);
    assert_int_equal(lg_riccati_work_size(5000, 1), 0);
}
