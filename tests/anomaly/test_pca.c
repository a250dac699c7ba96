/* Principal components: orthonormal, with the right variances and fixed signs; both ways to compute them
 * agree; difficult tables. */
#include "classify_support.h"

#include "anomaly/classify/classify_internal.h"
#include "anomaly/classify/features.h"

#define HALF_ROOT 0.70710678118654752440

OWNED(lg_pca, lg_pca_destroy)

static const lg_pca *fit(const double *x, size_t n, uint32_t d, uint32_t components) {
    lg_pca pca;
    assert_ok(lg_pca_fit(NULL, x, n, d, components, &pca, NULL));
    return own_lg_pca(pca);
}

/* W must be orthonormal, the projections uncorrelated with the stated variances, and these must sum to the
 * trace. */
static void check_components(const double *x, size_t n, uint32_t d, const lg_pca *p) {
    const uint32_t k = p->components;
    double *z = TEST_ARRAY(double, n *k), *work = TEST_ARRAY(double, d);
    lg_pca_eval(p, x, n, z, work);
    for (uint32_t a = 0; a < k; a++) {
        double largest = 0;
        for (uint32_t i = 0; i < d; i++)
            if (fabs(p->vectors[i * k + a]) > fabs(largest) * (1 + 1e-9)) largest = p->vectors[i * k + a];
        assert_true(largest > 0.0);
        for (uint32_t b = 0; b <= a; b++) {
            double dot = 0, cross = 0;
            for (uint32_t i = 0; i < d; i++) dot += p->vectors[i * k + a] * p->vectors[i * k + b];
            for (size_t i = 0; i < n; i++) cross += z[i * k + a] * z[i * k + b] / (double)n;
            assert_close(dot, a == b ? 1.0 : 0.0, 0, 1e-12);
            assert_close(cross, a == b ? p->variance[a] : 0.0, 1e-10, 1e-11 * p->variance[0]);
        }
        if (a > 0) assert_true(p->variance[a] <= p->variance[a - 1]);
    }
}

TEST("components are orthonormal, uncorrelated, sorted, and have a fixed sign") {
    static const uint32_t sizes[][3] = {{50, 4, 4}, {50, 4, 2}, {20, 60, 20},
                                        {7, 7, 7},  {2, 5, 2},  {30, 1, 1}};
    for (size_t i = 0; i < LG_COUNT(sizes); i++) {
        uint32_t label[50];
        const uint32_t n = sizes[i][0], d = sizes[i][1];
        double *x = clouds(n, d, 2, 2.0, 3, label), trace = 0;
        const lg_pca *p = fit(x, n, d, sizes[i][2]);
        assert_int_equal(lg_pca_outputs(p), sizes[i][2]);
        check_components(x, n, d, p);
        for (uint32_t j = 0; j < p->variances; j++) trace += p->variance[j];
        assert_close(trace, d, 1e-12, 0); /* each standardised feature has variance 1 */
    }
}

/* A table and the same table with its rows repeated have the same components. They are computed in different
 * ways: one for d > n, one for d < n. */
TEST("both ways to compute components agree: for more rows and for more features") {
    uint32_t label[6];
    double *x = clouds(6, 9, 2, 1.0, 8, label), twice[12 * 9];
    memcpy(twice, x, 54 * sizeof *x);
    memcpy(twice + 54, x, 54 * sizeof *x);
    const lg_pca *a, *b;
    a = fit(x, 6, 9, 5);
    b = fit(twice, 12, 9, 5);
    for (int i = 0; i < 5; i++) assert_close(a->variance[i], b->variance[i], 1e-12, 0);
    for (int i = 0; i < 45; i++) assert_close(a->vectors[i], b->vectors[i], 1e-10, 1e-11);
}

TEST("components of two features agree with those by hand") {
    const double x[] = {1, 1, -1, -1, 1, -1, -1, 1, 1, 1, -1, -1}; /* r = (4 - 2)/6 */
    const lg_pca *p = fit(x, 6, 2, 2);
    assert_close(p->variance[0], 4.0 / 3.0, 1e-14, 0);
    assert_close(p->variance[1], 2.0 / 3.0, 1e-14, 0);
    const double expected[] = {HALF_ROOT, HALF_ROOT, HALF_ROOT, -HALF_ROOT};
    for (int i = 0; i < 4; i++) assert_close(p->vectors[i], expected[i], 1e-14, 0);
}

TEST("scaled features, constant features and constant tables work") {
    uint32_t label[30];
    double *x = clouds(30, 3, 2, 1.0, 4, label), z[90], expected[90], work[3];
    const lg_pca *p = fit(x, 30, 3, 0);
    assert_int_equal(lg_pca_outputs(p), 3);
    lg_pca_eval(p, x, 30, expected, work);
    double mean = 0, square = 0;
    for (int i = 0; i < 30; i++) mean += expected[3 * i] / 30;
    for (int i = 0; i < 30; i++) square += expected[3 * i] * expected[3 * i] / 30;
    assert_close(mean, 0.0, 0, 1e-15);
    assert_close(square, 1.0, 1e-14, 0);
    const double factor[3] = {1e-12, 1e12, 1};
    for (int i = 0; i < 90; i++) x[i] = x[i] * factor[i % 3] + (i % 3 == 2 ? 1e6 : 0.0);
    p = fit(x, 30, 3, 0);
    lg_pca_eval(p, x, 30, z, work);
    for (int i = 0; i < 90; i++) assert_close(z[i], expected[i], 1e-8, 1e-8);
    for (int i = 0; i < 30; i++) x[3 * i + 1] = 0.1; /* constant: scale 1, and not its rounding error */
    p = fit(x, 30, 3, 3);
    assert_close(p->scale[1], 1.0, 0, 0);
    assert_close(p->variance[2], 0.0, 0, 1e-14);
    for (int i = 0; i < 30; i++) { /* constant to rounding; a large offset and little spread */
        x[3 * i + 1] = i % 2 == 0 ? 0.3 : 0.1 + 0.2;
        x[3 * i + 2] = 1e8 + 1e-5 * (i % 2);
    }
    p = fit(x, 30, 3, 0);
    assert_close(p->scale[1], 1.0, 0, 0);
    assert_close(p->scale[2], 0.5e-5, 1e-2, 0);
    for (int i = 0; i < 90; i++) x[i] = 5.0; /* all constant, and d > n: still orthonormal */
    p = fit(x, 3, 30, 3);
    check_components(x, 3, 30, p);
    p = fit(x, 1, 5, 1);
}

TEST("too many components and numbers that are not finite are refused") {
    uint32_t label[6];
    double *x = clouds(6, 3, 2, 1.0, 4, label);
    lg_pca p = {.inputs = 99};
    lg_error e;
    assert_status(lg_pca_fit(NULL, x, 6, 3, 4, &p, &e), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(e.message, "at most 3"));
    assert_status(lg_pca_fit(NULL, x, 2, 9, 3, &p, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_pca_fit(NULL, x, 0, 3, 0, &p, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_pca_fit(NULL, x, 6, 0, 0, &p, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_pca_fit(NULL, x, (size_t)1 << 31, 3, 0, &p, &e), LG_INVALID_ARGUMENT);
    assert_says(e.message, "too large");
    assert_status(lg_pca_fit(NULL, x, 6, LG_FEATURES_MAX + 1, 0, &p, &e), LG_INVALID_ARGUMENT);
    lg_pca_destroy(NULL);
    x[4] = NAN;
    assert_status(lg_pca_fit(NULL, x, 6, 3, 1, &p, &e), LG_NOT_FINITE);
    x[4] = 1e308, x[1] = 1e308; /* their sum overflows */
    assert_status(lg_pca_fit(NULL, x, 6, 3, 1, &p, &e), LG_NOT_FINITE);
    x[4] = 1e200, x[1] = 0; /* its square overflows */
    assert_status(lg_pca_fit(NULL, x, 6, 3, 1, &p, &e), LG_NOT_FINITE);
    assert_int_equal(p.inputs, 99);
}

TEST("every allocation may fail") {
    uint32_t label[6];
    double *x = clouds(6, 3, 2, 1.0, 4, label);
    for (uint32_t n = 2; n <= 6; n += 4)
        EVERY_ALLOCATION_FAILS(context, 1, {
            lg_pca p = {0};
            status = lg_pca_fit(context, x, n, 3, 2, &p, NULL);
            lg_pca_destroy(&p);
        });
}
