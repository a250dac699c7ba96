/* CMA-ES climbs functions that are long and narrow, and ones with kinks.
 * ctest-labels: src/certify */
#include "support/fixtures.h"

#include "certify/evolution.h"

enum { N = 6, MEMBERS = 12 };

/* A turned basis */
static void turn(const double *x, double *out) {
    for (int i = 0; i < N; i++) out[i] = x[i];
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++) {
            const double a = out[i], b = out[j], c = cos(1 + i + 2 * j), s = sin(1 + i + 2 * j);
            out[i] = c * a - s * b;
            out[j] = s * a + c * b;
        }
}

/* 1 - sum 10^(6 i/5) y_i^2 */
static double ellipsoid(const double *x) {
    double y[N], sum = 0;
    turn(x, y);
    for (int i = 0; i < N; i++) sum += pow(10, 6.0 * i / (N - 1)) * y[i] * y[i];
    return 1 - sum;
}

/* The least of slopes of different size: largest at 0 */
static double roof(const double *x) {
    double y[N], most = 0;
    turn(x, y);
    for (int i = 0; i < N; i++) most = fmax(most, pow(10, 2.0 * i / (N - 1)) * fabs(y[i]));
    return 1 - most;
}

static double climb(double (*value)(const double *), size_t generations, double *sigma) {
    lg_evolution e;
    double mean[N], spread[N], values[MEMBERS];
    for (int i = 0; i < N; i++) mean[i] = 1 + i, spread[i] = 0.5;
    assert_ok(lg_evolution_begin(NULL, N, MEMBERS, mean, spread, 3, &e));
    for (size_t g = 0; g < generations; g++) {
        lg_evolution_ask(&e);
        for (int k = 0; k < MEMBERS; k++) values[k] = k == 5 ? (double)NAN : value(e.x + k * N);
        lg_evolution_tell(&e, values);
    }
    const double found = value(e.mean);
    *sigma = e.sigma;
    lg_evolution_end(NULL, &e);
    return found;
}

TEST("a condition of 1e6 is learned, though one member of each generation has no value") {
    double sigma;
    assert_true(climb(ellipsoid, 40, &sigma) < 1 - 1e-3);
    const double found = climb(ellipsoid, 600, &sigma);
    print_message("1 - %.3g, sigma %.3g\n", 1 - found, sigma);
    assert_true(found > 1 - 1e-10 && sigma < 1e-3);
}

TEST("a roof is climbed to its corner") {
    double sigma;
    const double found = climb(roof, 600, &sigma);
    print_message("1 - %.3g\n", 1 - found);
    assert_true(found > 1 - 1e-4);
}
