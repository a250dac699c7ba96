/* Logistic regression compared with scikit-learn's result, and with the gradient of the minimised
 * function. */
#include "classify_support.h"

#include "golden/logistic_table.h"

OWNED(lg_logistic, lg_logistic_destroy)

static const lg_logistic *fit(const double *x, const uint32_t *label, size_t n, uint32_t d, uint32_t classes,
                              double c) {
    lg_logistic model;
    assert_ok(lg_logistic_fit(NULL, x, label, n, d, classes, c, &model, NULL));
    return own_lg_logistic(model);
}

TEST("weights agree with scikit-learn") {
    for (size_t t = 0; t < sizeof logistic_table / sizeof logistic_table[0]; t++) {
        const uint32_t classes = logistic_table[t].classes, n = logistic_table[t].n, d = logistic_table[t].d;
        double x[600];
        uint32_t label[60];
        for (uint32_t i = 0; i < n; i++) {
            label[i] = i % classes;
            for (uint32_t j = 0; j < d; j++)
                x[i * d + j] =
                    sin(0.7 * (i + 1.0) * (j + 1.0) + 0.3 * j) + 0.4 * cos((label[i] + 1.0) * (j + 2.0));
        }
        const lg_logistic *m = fit(x, label, n, d, classes, logistic_table[t].c);
        for (uint32_t a = 0; a < (classes == 2 ? 1 : classes); a++) {
            const double *row = logistic_table[t].row + a * (d + 1);
            for (uint32_t j = 0; j < d; j++) assert_close(m->weight[a * d + j], row[j], 1e-7, 1e-7);
            assert_close(m->intercept[a], row[d], 1e-7, 1e-7);
        }
    }
}

/* The largest entry of the gradient of C sum -log p + |w|^2/2, computed with the predicted probabilities. */
static double largest_gradient(const lg_logistic *m, const double *x, const uint32_t *label, size_t n,
                               double c) {
    const uint32_t d = m->inputs, k = m->classes, rows = k == 2 ? 1 : k;
    double *p = TEST_ARRAY(double, n *k), largest = 0;
    logistic_scores(m, x, n, p);
    for (uint32_t a = 0; a < rows; a++)
        for (uint32_t j = 0; j <= d; j++) {
            const uint32_t of = k == 2 ? 1 : a;
            double g = j < d ? m->weight[a * d + j] : 0.0;
            for (size_t i = 0; i < n; i++)
                g += c * (p[i * k + of] - (label[i] == of)) * (j < d ? x[i * d + j] : 1.0);
            largest = fmax(largest, fabs(g));
        }
    return largest;
}

TEST("the gradient of the minimised function vanishes") {
    static const struct {
        uint32_t n, d, classes;
        double c, apart, tolerance;
    } cases[] = {
        {200, 5, 2, 1.0, 1.0, 1e-9},    {200, 5, 2, 1e4, 20.0, 1e-7},   {200, 13, 3, 1.0, 1.0, 1e-9},
        {20, 600, 4, 1.0, 1.0, 1e-9},   {20, 600, 2, 1.0, 0.0, 1e-9},   {2, 3, 2, 1.0, 1.0, 1e-9},
        {3, 1, 3, 1.0, 1.0, 1e-9},      {100, 1, 2, 1.0, 1.0, 1e-9},    {300, 60, 3, 10.0, 0.3, 1e-7},
        {300, 100, 2, 10.0, 0.3, 1e-8}, {400, 200, 2, 10.0, 0.3, 1e-8}, {300, 290, 3, 1.0, 0.3, 1e-8},
    };
    for (size_t t = 0; t < sizeof cases / sizeof cases[0]; t++) {
        uint32_t *label = TEST_ARRAY(uint32_t, cases[t].n);
        double *x = clouds(cases[t].n, cases[t].d, cases[t].classes, cases[t].apart, 11 + t, label);
        const lg_logistic *m = fit(x, label, cases[t].n, cases[t].d, cases[t].classes, cases[t].c);
        assert_close(largest_gradient(m, x, label, cases[t].n, cases[t].c), 0.0, 0, cases[t].tolerance);
        for (uint32_t j = 0; j <= m->inputs && m->classes > 2; j++) {
            double sum = 0;
            for (uint32_t a = 0; a < m->classes; a++)
                sum += j < m->inputs ? m->weight[a * m->inputs + j] : m->intercept[a];
            assert_close(sum, 0.0, 0, 1e-11);
        }
    }
}

/* Series are smooth: neighbouring features are nearly equal, so conjugate gradients alone converge slowly. */
TEST("correlated features need few iterations") {
    enum { N = 200, D = 190 };
    for (uint32_t classes = 2; classes <= 4; classes++) {
        uint32_t label[N];
        double *x = clouds(N, D, classes, 0.5, classes, label);
        for (int i = 0; i < N; i++)
            for (int j = 1; j < D; j++) x[i * D + j] = 0.97 * x[i * D + j - 1] + 0.03 * x[i * D + j];
        const lg_logistic *m = fit(x, label, N, D, classes, 100.0);
        assert_close(largest_gradient(m, x, label, N, 100.0), 0.0, 0, 1e-6);
        assert_true(m->iterations <= 20); /* Newton iterations; none is spent on an inaccurate solution */
    }
}

TEST("without a penalty the weights of the classes still sum to zero") {
    enum { N = 200, D = 13, K = 3 };
    uint32_t label[N];
    double *x = clouds(N, D, K, 0.1, 9, label), largest = 0;
    const lg_logistic *m = fit(x, label, N, D, K, 1e10);
    for (int i = 0; i < K * D; i++) largest = fmax(largest, fabs(m->weight[i]));
    for (int j = 0; j < D; j++)
        assert_close((m->weight[j] + m->weight[D + j] + m->weight[2 * D + j]) / largest, 0.0, 0, 1e-13);
    assert_close(largest_gradient(m, x, label, N, 1e10), 0.0, 0, 1e-1);
}

TEST("the minimum is found for contradictory, scaled and incomplete tables") {
    uint32_t label[40];
    double *x = clouds(40, 2, 2, 1.0, 6, label), p[120];
    for (int i = 0; i < 40; i++) { /* the same rows with both labels, 3 to 1 */
        x[2 * i] = x[2 * i + 1] = 7.0;
        label[i] = i % 4 == 0;
    }
    const lg_logistic *m = fit(x, label, 40, 2, 2, 1.0);
    assert_close(m->intercept[0], log(1.0 / 3.0), 1e-9, 0);
    assert_close(m->weight[0], 0.0, 0, 1e-12);
    static const double factors[] = {1e-12, 1e12};
    for (int f = 0; f < 2; f++) {
        x = clouds(40, 2, 2, 1.0, 6, label);
        for (int i = 0; i < 80; i++) x[i] *= factors[f];
        m = fit(x, label, 40, 2, 2, 1.0);
        logistic_scores(m, x, 40, p);
        for (int i = 0; i < 80; i++) assert_true(p[i] >= 0.0 && p[i] <= 1.0);
        assert_close(largest_gradient(m, x, label, 40, 1.0) / factors[f], 0.0, 0, f == 0 ? 1e3 : 1e-4);
    }
    for (int i = 0; i < 40; i++) label[i] = i % 2 == 0 ? 0 : 2; /* class 1 does not occur */
    m = fit(x, label, 40, 2, 3, 1.0);
    logistic_scores(m, x, 40, p);
    for (int i = 0; i < 40; i++) {
        assert_close(p[3 * i + 1], 0.0, 0, 0);
        assert_close(p[3 * i] + p[3 * i + 2], 1.0, 1e-14, 0);
    }
}

TEST("invalid tables and penalties are refused") {
    uint32_t label[6];
    double *x = clouds(6, 2, 2, 1.0, 4, label);
    lg_logistic m = {.inputs = 99};
    lg_error e;
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, 2, 0.0, &m, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, 2, NAN, &m, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, 2, INFINITY, &m, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, UINT32_MAX, 1.0, &m, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_logistic_fit(NULL, x, label, 6, 0, 2, 1.0, &m, &e), LG_INVALID_ARGUMENT);
    lg_logistic_destroy(NULL);
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, 1, 1.0, &m, &e), LG_INVALID_ARGUMENT);
    label[3] = 2;
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, 2, 1.0, &m, &e), LG_INVALID_ARGUMENT);
    memset(label, 0, sizeof label);
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, 2, 1.0, &m, &e), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(e.message, "one class"));
    label[1] = 1;
    x[5] = INFINITY;
    assert_status(lg_logistic_fit(NULL, x, label, 6, 2, 2, 1.0, &m, &e), LG_NOT_FINITE);
    assert_int_equal(m.inputs, 99);
}

TEST("every allocation may fail") {
    static const uint32_t shapes[][3] = {{30, 2, 2}, {12, 40, 3}, {200, 80, 2}};
    for (size_t t = 0; t < 3; t++) {
        const uint32_t n = shapes[t][0], d = shapes[t][1], classes = shapes[t][2];
        uint32_t label[200];
        double *x = clouds(n, d, classes, 1.0, 4, label);
        EVERY_ALLOCATION_FAILS(context, 1, {
            lg_logistic m = {0};
            status = lg_logistic_fit(context, x, label, n, d, classes, 1.0, &m, NULL);
            lg_logistic_destroy(&m);
        });
    }
}
