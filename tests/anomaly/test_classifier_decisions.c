/* Decisions of classifiers and their Jacobians: every kind of features with every method compared with
 * extrapolated differences, decisions against scores, kinks, invalid input.
 *
 * The numbers of the windows are multiples of 2^-10 and the steps are powers of two, so that a perturbed
 * window is exact in single precision. */
#include "classify_support.h"
#include "support/decisions.h"

#include "anomaly/classify/features.h"

#include "liegrad/series.h"

enum { WINDOWS = 60, CHANNELS = 6, LENGTH = 50, MOST_OUTPUTS = 8 };

/* Windows whose channels are mixed and scaled depending on the class. */
static lg_series make_series(uint32_t channels, uint32_t length, uint32_t classes) {
    lg_series s = {.count = WINDOWS, .channels = channels, .length = length, .classes = classes};
    assert_ok(lg_series_allocate(NULL, &s, true, false));
    lg_rng rng = test_rng(11, classes);
    for (uint32_t i = 0; i < WINDOWS; i++) {
        s.label[i] = i % classes;
        for (uint32_t t = 0; t < length; t++) {
            const double common = lg_rng_normal(&rng);
            for (uint32_t c = 0; c < channels; c++) {
                const double own = lg_rng_normal(&rng) * (1.0 + 0.3 * c);
                const double value = own + 0.4 * (1.0 + s.label[i]) * common + 0.1 * c * s.label[i];
                s.x[(i * channels + c) * length + t] = (float)(round(value * 1024.0) / 1024.0);
            }
        }
    }
    return s;
}

typedef struct chain {
    lg_series series;
    lg_windows windows;
    lg_scaler scaler;
    lg_classifier c;
    size_t inputs, outputs;
    double *work;
    test_decider decider;
} chain;

static void release(void *of) {
    chain *f = of;
    lg_classifier_destroy(&f->c);
    lg_scaler_destroy(&f->scaler);
    lg_windows_destroy(&f->windows);
    lg_series_destroy(&f->series);
}

static chain *make(lg_series series, lg_feature_kind kind, bool directions_x, lg_classifier_method method,
                   uint32_t components) {
    chain *f = TEST_ARRAY(chain, 1);
    f->series = series;
    lg_test_owns(f, release);
    lg_error e;
    assert_ok(lg_windows_create(NULL, &f->series, 0, 0, &f->windows, NULL));
    assert_ok(lg_scaler_fit(NULL, &f->series, &f->windows, NULL, WINDOWS, false, &f->scaler));
    if (lg_features_create(NULL, kind, directions_x, &f->series, f->series.length, &f->scaler, &f->c.features,
                           &e) != LG_OK)
        fail_msg("%s", e.message);
    const uint32_t d = f->c.features.count;
    double *table = TEST_ARRAY(double, WINDOWS *d);
    assert_ok(lg_features_table(NULL, &f->c.features, &f->series, &f->windows, 1, table, NULL));
    lg_classifier_options o;
    lg_classifier_options_init(&o);
    o.method = method;
    o.components = components < d ? components : d;
    if (lg_classifier_fit(NULL, &o, table, f->series.label, NULL, WINDOWS, d, f->series.classes, &f->c, &e) !=
        LG_OK)
        fail_msg("%s", e.message);
    f->inputs = (size_t)f->series.channels * f->series.length;
    f->work = TEST_ARRAY(double, lg_classifier_work_size(&f->c) / sizeof(double) + 1);
    test_make_decider(&f->c, &f->decider);
    f->outputs = lg_plan_output_count(f->decider.value, 0);
    assert_in_range(f->outputs, 1, MOST_OUTPUTS);
    return f;
}

static lg_status decide(const chain *f, const float *x, double *y, double *jacobian) {
    test_decider decider = f->decider;
    return test_decide(&f->c, &decider, x, y, jacobian);
}

/* After a change of the scales. */
static void scale_again(chain *f) {
    lg_plan_destroy(f->c.features.plan);
    assert_ok(lg_features_ready(&f->c.features, NULL));
    test_make_decider(&f->c, &f->decider);
}

/* The whole Jacobian. Without it the same function gives the same decisions. */
static double *jacobian_of(const chain *f, const float *x, double *y) {
    const size_t count = f->outputs * f->inputs;
    const test_decider *d = &f->decider;
    double *jacobian = TEST_ARRAY(double, count), plain[MOST_OUTPUTS];
    for (size_t i = 0; i < count; i++) jacobian[i] = NAN;
    assert_ok(decide(f, x, y, jacobian));
    for (size_t i = 0; i < count; i++) assert_true(isfinite(jacobian[i]));
    lg_plan_eval(d->grad, (const void *const[]){d->window}, (void *const[]){plain, NULL}, d->memory);
    assert_memory_equal(plain, d->y, f->outputs * sizeof *y);
    assert_ok(decide(f, x, plain, NULL));
    assert_memory_equal(plain, y, f->outputs * sizeof *y);
    return jacobian;
}

/* Decisions of a window whose numbers are exact floats. */
static void decisions(const void *user, const double *x, double *y) {
    const chain *f = user;
    const size_t mark = lg_test_owned();
    float *window = TEST_ARRAY(float, f->inputs);
    for (size_t i = 0; i < f->inputs; i++) {
        window[i] = (float)x[i];
        assert_true((double)window[i] == x[i]);
    }
    assert_ok(decide(f, window, y, NULL));
    lg_test_give_back(mark);
}

static double largest_of(const double *row, size_t n) {
    double largest = 0.0;
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(row[i]));
    return largest;
}

/* Compares columns 0, every, 2 every, ... of the Jacobian with difference quotients, to `tolerance` times the
 * largest number of the row of the Jacobian. A tree is constant except for jumps: its Jacobian must be 0, and
 * difference quotients are left out, because their step may cross a jump. */
static void against_differences(const chain *f, float *x, size_t every, double step, double tolerance) {
    enum { LEVELS = 4 };
    double y[MOST_OUTPUTS], by[MOST_OUTPUTS], *at = TEST_ARRAY(double, f->inputs);
    double *jacobian = jacobian_of(f, x, y);
    for (size_t i = 0; i < f->inputs; i++) at[i] = x[i];
    if (f->c.method == LG_METHOD_TREE) assert_close(largest_of(jacobian, f->outputs * f->inputs), 0.0, 0, 0);
    for (size_t input = 0; f->c.method != LG_METHOD_TREE && input < f->inputs; input += every) {
        test_slope(decisions, f, at, input, step, LEVELS, f->outputs, by);
        for (size_t o = 0; o < f->outputs; o++) {
            const double *row = jacobian + o * f->inputs;
            assert_close(row[input], by[o], 0, tolerance * largest_of(row, f->inputs) + 1e-12);
        }
    }
}

/* ---- decisions compared with scores ---- */

static void softmax(const double *logit, size_t n, double *p) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += p[i] = exp(logit[i]);
    for (size_t i = 0; i < n; i++) p[i] /= sum;
}

static void votes(const double *decision, size_t classes, double *count) {
    for (size_t i = 0; i < classes; i++) count[i] = 0.0;
    for (size_t i = 0; i < classes; i++)
        for (size_t j = i + 1; j < classes; j++) count[*decision++ > 0.0 ? i : j] += 1.0;
}

static void against_scores(const chain *f, const float *x) {
    double y[MOST_OUTPUTS], score[MOST_OUTPUTS], wanted[MOST_OUTPUTS], plain[MOST_OUTPUTS];
    const size_t classes = f->c.classes;
    assert_ok(decide(f, x, y, NULL));
    assert_ok(lg_classifier_window(&f->c, x, plain, f->work));
    lg_plan_eval(f->decider.scores, (const void *const[]){f->decider.features}, (void *const[]){score},
                 f->decider.memory);
    for (size_t i = 0; i < classes; i++) assert_close(score[i], plain[i], 1e-12, 1e-12);
    assert_int_equal(lg_metrics_class(score, (uint32_t)classes), lg_metrics_class(plain, (uint32_t)classes));
    if (f->c.method == LG_METHOD_TREE) {
        assert_int_equal(f->outputs, classes);
        assert_memory_equal(y, score, classes * sizeof *y);
    } else if (f->c.method == LG_METHOD_LOGISTIC) {
        const double two[2] = {0.0, y[0]};
        assert_int_equal(f->outputs, classes == 2 ? 1 : classes);
        softmax(classes == 2 ? two : y, classes, wanted);
        for (size_t i = 0; i < classes; i++) assert_close(score[i], wanted[i], 1e-13, 0);
    } else if (f->c.method == LG_METHOD_RIDGE) {
        assert_int_equal(f->outputs, classes == 2 ? 1 : classes);
        for (size_t i = 0; i < classes; i++)
            assert_close(score[i], classes > 2 ? y[i] : i == 1 ? y[0] : -y[0], 0, 0);
    } else if (classes == 2) {
        assert_int_equal(f->outputs, 1);
        assert_close(score[0], y[0], 0, 0); /* positive for class 0 */
        assert_close(score[1], -y[0], 0, 0);
    } else {
        assert_int_equal(f->outputs, classes * (classes - 1) / 2);
        votes(y, classes, wanted);
        assert_int_equal(lg_metrics_class(score, (uint32_t)classes),
                         lg_metrics_class(wanted, (uint32_t)classes));
        for (size_t i = 0; i < classes; i++)
            assert_close(score[i], f->c.svm.vectors_of[i] > 0 ? wanted[i] : -1.0, 0, 0.34);
    }
}

/* ---- every kind of features with every method ---- */

static void all_chains(lg_feature_kind kind) {
    for (int method = 0; method < LG_METHOD_COUNT; method++)
        for (uint32_t classes = 2; classes <= 4; classes++)
            for (uint32_t components = 0; components <= 3; components += 3) {
                const bool directions_x = classes == 3;
                chain *f = make(make_series(CHANNELS, LENGTH, classes), kind, directions_x,
                                (lg_classifier_method)method, components);
                for (size_t i = 0; i < WINDOWS; i++) against_scores(f, f->series.x + i * f->inputs);
                against_differences(f, f->series.x + 7 * f->inputs, 13, 0x1p-5, 1e-9);
            }
}

TEST("decisions and Jacobians of every method on every kind of features are right") {
    for (int kind = 0; kind < LG_FEATURES_ROCKET; kind++) all_chains((lg_feature_kind)kind);
}

TEST("Jacobians of spectra with several segments are right") {
    for (int method = LG_METHOD_LOGISTIC; method < LG_METHOD_COUNT; method++) {
        chain *f = make(make_series(2, 300, 2), LG_FEATURES_SPECTRUM, false, (lg_classifier_method)method, 0);
        assert_int_equal(f->c.features.spectrum.segments, 4);
        against_differences(f, f->series.x, 37, 0x1p-5, 1e-9);
    }
}

TEST("one chain of each kind has the right Jacobian, with zeros for channels that are not selected") {
    for (int kind = 0; kind < LG_FEATURES_ROCKET; kind++) {
        chain *f = make(make_series(CHANNELS, LENGTH, 2), (lg_feature_kind)kind, true, LG_METHOD_LOGISTIC, 0);
        double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, f->series.x, y);
        against_differences(f, f->series.x, 1, 0x1p-5, 1e-9);
        for (size_t i = 0; i < f->inputs; i++)
            if (i / LENGTH % 2 == 1) assert_close(jacobian[i], 0.0, 0, 0);
        if (kind != LG_FEATURES_BASELINE)
            for (size_t c = 0; c < CHANNELS; c += 2)
                assert_true(largest_of(jacobian + c * LENGTH, LENGTH) > 1e-6);
    }
}

TEST("except for samples and levels, Jacobians sum to zero over a channel") {
    for (int kind = 0; kind < LG_FEATURES_ROCKET; kind++) {
        if (kind == LG_FEATURES_RAW || kind == LG_FEATURES_LEVELS) continue;
        chain *f = make(make_series(CHANNELS, LENGTH, 2), (lg_feature_kind)kind, false, LG_METHOD_SVM_RBF, 0);
        double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, f->series.x, y);
        for (size_t c = 0; c < CHANNELS; c++) {
            double sum = 0.0;
            for (size_t t = 0; t < LENGTH; t++) sum += jacobian[c * LENGTH + t];
            assert_close(sum, 0.0, 0, 1e-13 * largest_of(jacobian, f->inputs));
        }
    }
}

/* ---- kinks ---- */

/* For a constant channel deviations have a kink, with derivative 0, but its covariance with the other
 * channels changes. Central differences cancel the kink, which is even, and have a first-order error in the
 * step. */
TEST("a constant channel has the derivative zero, except for its covariance with others and its level") {
    for (int kind = 0; kind < LG_FEATURES_ROCKET; kind++) {
        if (kind == LG_FEATURES_RAW || kind == LG_FEATURES_LEVELS) continue;
        chain *f =
            make(make_series(CHANNELS, LENGTH, 2), (lg_feature_kind)kind, false, LG_METHOD_LOGISTIC, 0);
        for (size_t t = 0; t < LENGTH; t++) f->series.x[t] = 0.75f;
        double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, f->series.x, y);
        if (kind == LG_FEATURES_COV)
            assert_true(largest_of(jacobian, LENGTH) > 1e-3);
        else
            for (size_t t = 0; t < LENGTH; t++) assert_close(jacobian[t], 0.0, 0, 0);
        if (kind == LG_FEATURES_COV) against_differences(f, f->series.x, 3, 0x1p-10, 2e-3);
        for (size_t i = 0; i < f->inputs; i++) f->series.x[i] = 3.0f; /* all channels are constant */
        jacobian = jacobian_of(f, f->series.x, y);
        for (size_t i = 0; i < f->inputs; i++) assert_close(jacobian[i], 0.0, 0, 0);
    }
}

/* The derivative of a minimum or maximum goes to the first of the samples that are equal to it, here to
 * samples 3 and 4, and for the constant channel 0 to sample 0. */
TEST("levels have exact derivatives, at ties too") {
    lg_series s = make_series(2, LENGTH, 2);
    s.rate = 4.0;
    chain *f = make(s, LG_FEATURES_LEVELS, false, LG_METHOD_LOGISTIC, 0);
    float *x = f->series.x;
    for (size_t t = 0; t < LENGTH; t++) {
        x[t] = 7.25f;
        x[LENGTH + t] = t % 10 == 3 ? -9.0f : t % 10 == 4 ? 9.0f : 0.125f * (float)(t % 7);
    }
    double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, x, y);
    for (size_t c = 0; c < 2; c++)
        for (size_t t = 0; t < LENGTH; t++) {
            const double n = LENGTH, part[4] = {1 / n, t == 3 * c, t == 4 * c,
                                                4.0 * 12 * (t - 0.5 * (n - 1)) / (n * (n * n - 1))};
            double wanted = 0.0;
            for (size_t i = 0; i < 4; i++)
                wanted += part[i] * f->c.logistic.weight[4 * c + i] / f->c.pca.scale[4 * c + i];
            assert_close(jacobian[c * LENGTH + t], wanted, 1e-13, 1e-14);
        }
}

TEST("derivatives for linearly dependent channels agree with differences") {
    chain *f = make(make_series(CHANNELS, LENGTH, 2), LG_FEATURES_COV, false, LG_METHOD_LOGISTIC, 0);
    for (size_t t = 0; t < LENGTH; t++)
        f->series.x[2 * LENGTH + t] = f->series.x[t] + f->series.x[LENGTH + t];
    against_differences(f, f->series.x, 7, 0x1p-10, 2e-3);
    /* With fewer samples than channels. */
    f = make(make_series(CHANNELS, 4, 2), LG_FEATURES_COV, false, LG_METHOD_LOGISTIC, 0);
    against_differences(f, f->series.x, 1, 0x1p-10, 5e-3);
}

/* All m channels are equal: C = a 1 1^T = s^2 P with s^2 = m a, where P is the projection on (1, ..., 1) and
 * Q = I - P the projection on the null space. If G is the cotangent of the root, the cotangent of C is (P G Q
 * + Q G P)/s + P G P/(2 s); rounding of the zero eigenvalues must not enter. */
TEST("identical channels have the derivative of the projection") {
    enum { M = CHANNELS };
    chain *f = make(make_series(M, LENGTH, 2), LG_FEATURES_COV, false, LG_METHOD_LOGISTIC, 0);
    float *x = f->series.x;
    double y[MOST_OUTPUTS], g[M][M], row[M] = {0}, mean = 0.0, variance = 0.0, all = 0.0;
    for (size_t c = 0; c < M; c++) {
        f->c.features.scale[c] = 1.0;
        memcpy(x + c * LENGTH, x, LENGTH * sizeof *x);
    }
    scale_again(f);
    double *jacobian = jacobian_of(f, x, y);
    for (size_t i = 0, at = 0; i < M; i++)
        for (size_t j = i; j < M; j++, at++) {
            const double weight = f->c.logistic.weight[at] / f->c.pca.scale[at];
            g[i][j] = g[j][i] = i == j ? weight : 0.5 * weight;
        }
    for (size_t i = 0; i < M; i++) {
        for (size_t j = 0; j < M; j++) row[i] += g[i][j] / M; /* G P = row 1^T */
        all += row[i] / M;                                    /* P G P = all 1 1^T */
    }
    for (size_t t = 0; t < LENGTH; t++) mean += (double)x[t] / LENGTH;
    for (size_t t = 0; t < LENGTH; t++) variance += (x[t] - mean) * (x[t] - mean) / LENGTH;
    const double s = sqrt(M * variance);
    for (size_t i = 0; i < M; i++) {
        double sum = 0.0; /* sum of row i of the cotangent of C */
        for (size_t j = 0; j < M; j++) sum += (row[i] + row[j] - 2.0 * all) / s + all / (2.0 * s);
        for (size_t t = 0; t < LENGTH; t++)
            assert_close(jacobian[i * LENGTH + t], 2.0 * sum * (x[t] - mean) / LENGTH, 1e-12,
                         1e-13 * largest_of(jacobian, f->inputs));
    }
}

static double sign_of(unsigned bits) {
    return (bits ^ bits >> 1 ^ bits >> 2) & 1 ? -1.0 : 1.0;
}

/* Z = sum_k s_k v_k w_k^T with exact numbers: orthonormal v_k, and orthogonal w_k of ones and minus ones. If
 * G is the cotangent of the root, the cotangent of Z is 2/n sum_ab v_a (v_a.G v_b) s_b/(s_a + s_b) w_b^T. Its
 * error is eps s_max/s_min = 1e-12; computed from eigenvectors of Z Z^T it would be the square of that ratio
 * times eps. */
TEST("derivatives are accurate even if the singular values differ by a factor of 4096") {
    enum { M = 4, N = 8 };
    static const double root[M] = {0x1p-4, 1.0, 0x1p-12, 0x1p-8};
    chain *f = make(make_series(M, N, 2), LG_FEATURES_COV, false, LG_METHOD_LOGISTIC, 0);
    float *x = f->series.x;
    double y[MOST_OUTPUTS], g[M][M], turned[M][M] = {{0.0}};
    for (unsigned i = 0; i < M; i++) {
        f->c.features.scale[i] = 2.0;
        for (unsigned t = 0; t < N; t++) {
            double sum = 3.0;
            for (unsigned k = 0; k < M; k++) sum += root[k] * sign_of(k & i) * sign_of((k + 1) & t);
            x[i * N + t] = (float)sum;
            assert_true((double)x[i * N + t] == sum);
        }
    }
    scale_again(f);
    double *jacobian = jacobian_of(f, x, y);
    for (unsigned i = 0, at = 0; i < M; i++)
        for (unsigned j = i; j < M; j++, at++) {
            const double weight = f->c.logistic.weight[at] / f->c.pca.scale[at];
            g[i][j] = g[j][i] = i == j ? weight : 0.5 * weight;
        }
    for (unsigned a = 0; a < M; a++)
        for (unsigned b = 0; b < M; b++)
            for (unsigned i = 0; i < M; i++)
                for (unsigned j = 0; j < M; j++)
                    turned[a][b] += 0.25 * sign_of(a & i) * g[i][j] * sign_of(b & j);
    for (unsigned i = 0; i < M; i++)
        for (unsigned t = 0; t < N; t++) {
            double sum = 0.0;
            for (unsigned a = 0; a < M; a++)
                for (unsigned b = 0; b < M; b++)
                    sum += 0.5 * sign_of(a & i) * turned[a][b] * (root[b] / (root[a] + root[b])) *
                           sign_of((b + 1) & t);
            assert_close(jacobian[i * N + t], 2.0 * sum / (N * 2.0), 0,
                         1e-11 * largest_of(jacobian, f->inputs));
        }
}

/* The accelerations have the same deviation in all parts, so slope and its derivatives are 0; the intercept
 * is the mean of the moment's deviations. */
TEST("a level baseline has slope zero, with zero derivatives") {
    chain *f = make(make_series(CHANNELS, LENGTH, 2), LG_FEATURES_BASELINE, true, LG_METHOD_LOGISTIC, 0);
    assert_int_equal(f->c.features.count, 2);
    for (size_t t = 0; t < LENGTH; t++) f->series.x[t] = (float)(t % 5);
    double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, f->series.x, y);
    for (size_t i = 0; i < 4 * LENGTH; i++) assert_close(jacobian[i], 0.0, 0, 0);
    const double factor = f->c.logistic.weight[0] / f->c.pca.scale[0];
    for (size_t s = 0; s < 10; s++) {
        const float *x = f->series.x + 4 * LENGTH + 5 * s;
        double mean = 0.0, square = 0.0;
        for (size_t t = 0; t < 5; t++) mean += (double)x[t] / 5.0;
        for (size_t t = 0; t < 5; t++) square += (x[t] - mean) * (x[t] - mean) / 5.0;
        for (size_t t = 0; t < 5; t++) {
            const double wanted = factor * (x[t] - mean) / (50.0 * sqrt(square) * f->scaler.scale[4]);
            assert_close(jacobian[4 * LENGTH + 5 * s + t], wanted, 1e-11, 1e-13);
        }
    }
}

TEST("for windows of one sample only raw features and levels have derivatives") {
    static const lg_feature_kind kinds[] = {LG_FEATURES_RAW, LG_FEATURES_STD, LG_FEATURES_COV,
                                            LG_FEATURES_LEVELS};
    for (int method = 0; method < LG_METHOD_COUNT; method++)
        for (size_t k = 0; k < LG_COUNT(kinds); k++) {
            const bool level = kinds[k] == LG_FEATURES_RAW || kinds[k] == LG_FEATURES_LEVELS;
            chain *f = make(make_series(3, 1, 3), kinds[k], false, (lg_classifier_method)method, 0);
            double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, f->series.x, y);
            for (size_t i = 0; !level && i < f->outputs * f->inputs; i++)
                assert_close(jacobian[i], 0.0, 0, 0);
            if (level && method != LG_METHOD_TREE) assert_true(largest_of(jacobian, f->inputs) > 1e-6);
            against_differences(f, f->series.x, 1, 0x1p-5, 1e-9);
            against_scores(f, f->series.x);
        }
}

TEST("trees have the derivative zero") {
    chain *f = make(make_series(CHANNELS, LENGTH, 3), LG_FEATURES_COV, false, LG_METHOD_TREE, 2);
    double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, f->series.x, y), sum = 0.0;
    for (size_t i = 0; i < 3; i++) sum += y[i];
    assert_close(sum, 1.0, 1e-15, 0);
    for (size_t i = 0; i < f->outputs * f->inputs; i++) assert_close(jacobian[i], 0.0, 0, 0);
}

/* ---- classes that do not occur ---- */

TEST("classes that do not occur are never predicted") {
    for (int method = 0; method < LG_METHOD_COUNT; method++) {
        lg_series s = make_series(CHANNELS, LENGTH, 4);
        for (size_t i = 0; i < WINDOWS; i++)
            if (s.label[i] == 1) s.label[i] = 3;
        chain *f = make(s, LG_FEATURES_STD, false, (lg_classifier_method)method, 0);
        double y[MOST_OUTPUTS], *jacobian = jacobian_of(f, f->series.x, y);
        against_differences(f, f->series.x, 13, 0x1p-5, 1e-9);
        against_scores(f, f->series.x);
        if (method == LG_METHOD_SVM_LINEAR || method == LG_METHOD_SVM_RBF) { /* pairs 01 02 03 12 13 23 */
            static const double fixed[6] = {1.0, 0.0, 0.0, -1.0, -1.0, 0.0};
            for (size_t p = 0; p < 6; p++) {
                const double size = largest_of(jacobian + p * f->inputs, f->inputs);
                if (fixed[p] != 0.0) assert_close(y[p], fixed[p], 0, 0);
                assert_int_equal(size > 0.0, fixed[p] == 0.0);
            }
        }
        if (method == LG_METHOD_LOGISTIC || method == LG_METHOD_RIDGE)
            assert_close(largest_of(jacobian + f->inputs, f->inputs), 0.0, 0, 0);
    }
}

/* ---- bad input ---- */

TEST("windows that are not finite and features that do not fit are refused") {
    chain *f = make(make_series(CHANNELS, LENGTH, 2), LG_FEATURES_COV, false, LG_METHOD_SVM_RBF, 0);
    double y[1] = {7.0}, *jacobian = TEST_ARRAY(double, f->inputs), score[2];
    f->series.x[70] = NAN;
    assert_status(decide(f, f->series.x, y, jacobian), LG_NOT_FINITE);
    assert_status(lg_classifier_window(&f->c, f->series.x, score, f->work), LG_NOT_FINITE);
    f->series.x[70] = INFINITY;
    assert_status(decide(f, f->series.x, y, jacobian), LG_NOT_FINITE);
    f->series.x[70] = 0.0f;
    const uint32_t count = f->c.features.count;
    f->c.features.count = 0;
    assert_status(lg_classifier_window(&f->c, f->series.x, score, f->work), LG_INVALID_ARGUMENT);
    f->c.features.count = count - 1;
    assert_status(lg_classifier_window(&f->c, f->series.x, score, f->work), LG_INVALID_ARGUMENT);
    f->c.features.count = count;
    assert_close(y[0], 7.0, 0, 0);
    assert_close(largest_of(jacobian, f->inputs), 0.0, 0, 0);
    lg_program *program = NULL;
    lg_error error;
    const lg_classifier empty = {.classes = 2};
    assert_status(lg_classifier_program(NULL, &empty, &program, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "not fitted"));
}
