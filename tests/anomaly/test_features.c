/* Features of windows: formulas compared with long double, roots whose squares are the covariance, names,
 * threads, invalid input. */
#include "classify_support.h"

#include "anomaly/classify/classify_internal.h"
#include "anomaly/classify/features.h"

#include "core/core.h"

static const char *const riser[6] = {"acc_lower_x", "acc_lower_y", "acc_upper_x",
                                     "acc_upper_y", "moment_x",    "moment_y"};

static lg_series make_series(size_t count, uint32_t channels, uint32_t length, bool named) {
    lg_series s = {.count = count, .channels = channels, .length = length, .classes = 2};
    assert_ok(lg_series_allocate(NULL, &s, false, false));
    lg_rng rng = test_rng(5, 1);
    for (size_t i = 0; i < count * channels * length; i++)
        s.x[i] = (float)(lg_rng_normal(&rng) * (1.0 + (double)((i / length) % channels)) + 3.0);
    if (named) {
        s.channel_name = lg_test_gives(channels, sizeof *s.channel_name);
        for (uint32_t c = 0; c < channels; c++)
            (void)snprintf(s.channel_name[c], LG_SERIES_NAME, "%s", riser[c]);
    }
    return *own_lg_series(s);
}

static double covariance(const float *a, const float *b, size_t n) {
    long double ma = 0, mb = 0, sum = 0;
    for (size_t i = 0; i < n; i++) {
        ma += (long double)a[i] / n;
        mb += (long double)b[i] / n;
    }
    for (size_t i = 0; i < n; i++) sum += (a[i] - ma) * (b[i] - mb) / n;
    return (double)sum;
}

static double *compute(const lg_features *f, const float *x) {
    double *out = TEST_ARRAY(double, f->count),
           *work = TEST_ARRAY(double, lg_features_work_size(f) / sizeof(double));
    assert_ok(lg_features_compute(f, x, out, work));
    return out;
}

TEST("deviations follow their definition, and raw samples are unchanged") {
    lg_series s = make_series(1, 6, 37, true);
    lg_features f = features_of(LG_FEATURES_STD, false, &s, 37, NULL);
    assert_int_equal(f.count, 6);
    double *out = compute(&f, s.x);
    for (int c = 0; c < 6; c++)
        assert_close(out[c], sqrt(covariance(s.x + 37 * c, s.x + 37 * c, 37)), 1e-14, 0);
    for (int t = 0; t < 37; t++) s.x[t] = 1e5f + 0.1f;
    out = compute(&f, s.x);
    assert_close(out[0], 0.0, 0, 0); /* and not the rounding error of the mean */
    f = features_of(LG_FEATURES_RAW, true, &s, 37, NULL);
    assert_int_equal(f.count, 3 * 37);
    out = compute(&f, s.x);
    for (int i = 0; i < 37; i++) assert_close(out[37 + i], s.x[2 * 37 + i], 0, 0);
}

/* Up to *user bytes in all. */
static void *take_some(void *user, size_t bytes) {
    size_t *left = user;
    if (bytes > *left) return NULL;
    *left -= bytes;
    return aligned_alloc(64, (bytes + 63) / 64 * 64);
}
static void release_some(void *user, void *memory) {
    free(memory);
}

TEST("features of many channels take memory in proportion to their number") {
    enum { CHANNELS = 3000, LENGTH = 8 };
    lg_series s = make_series(1, CHANNELS, LENGTH, false);
    for (size_t i = 0; i < CHANNELS * LENGTH; i++) s.x[i] = (float)i;
    static const lg_feature_kind kinds[] = {LG_FEATURES_RAW, LG_FEATURES_STD, LG_FEATURES_SPECTRUM};
    for (size_t k = 0; k < LG_COUNT(kinds); k++) {
        size_t left = (size_t)128 << 20;
        lg_context_options o;
        lg_context *context;
        lg_features f;
        lg_context_options_init(&o);
        o.allocate = take_some, o.release = release_some, o.allocator_user = &left;
        assert_ok(lg_context_create(&o, &context));
        assert_ok(lg_features_create(context, kinds[k], true, &s, LENGTH, NULL, &f, NULL));
        print_message("%s: %zu MB\n", lg_feature_kind_name(kinds[k]), 128 - (left >> 20));
        const double *out = compute(&f, s.x);
        for (size_t c = 0; c < CHANNELS / 2 && k == 0; c++)
            for (size_t i = 0; i < LENGTH; i++)
                assert_close(out[c * LENGTH + i], (double)(2 * c * LENGTH + i), 0, 0);
        lg_features_destroy(&f);
        lg_context_destroy(context);
    }
}

/* ---- memory and sizes by the length of the window ---- */

/* Blocks in front of which their size stands. */
typedef struct usage {
    size_t now, most;
} usage;
static void *take_counted(void *user, size_t bytes) {
    usage *u = user;
    size_t *block = aligned_alloc(64, (bytes + 64 + 63) / 64 * 64);
    if (block == NULL) return NULL;
    *block = bytes;
    u->now += bytes;
    if (u->now > u->most) u->most = u->now;
    return block + 64 / sizeof *block;
}
static void release_counted(void *user, void *memory) {
    size_t *block = (size_t *)memory - 64 / sizeof *block;
    ((usage *)user)->now -= *block;
    free(block);
}

/* Recordings of a program for 2 to 5 windows would take hundreds of megabytes if they held the windows. The
 * slope has a weight for each sample. */
TEST("features of long windows are made without memory for the windows") {
    enum { CHANNELS = 6, LENGTH = 1000000 };
    lg_series s = {.count = 1, .channels = CHANNELS, .length = LENGTH, .classes = 2};
    s.channel_name = lg_test_gives(CHANNELS, sizeof *s.channel_name);
    for (uint32_t c = 0; c < CHANNELS; c++) (void)snprintf(s.channel_name[c], LG_SERIES_NAME, "%s", riser[c]);
    for (int kind = 0; kind < LG_FEATURE_KIND_COUNT; kind++) {
        usage u = {0, 0};
        lg_context_options o;
        lg_context *context;
        lg_features f;
        if (kind == LG_FEATURES_RAW || kind == LG_FEATURES_ROCKET) continue;
        lg_context_options_init(&o);
        o.allocate = take_counted, o.release = release_counted, o.allocator_user = &u;
        assert_ok(lg_context_create(&o, &context));
        assert_ok(lg_features_create(context, (lg_feature_kind)kind, false, &s, LENGTH, NULL, &f, NULL));
        print_message("%s: %zu kB\n", lg_feature_kind_name((lg_feature_kind)kind), u.most >> 10);
        assert_true(u.most < (size_t)(kind == LG_FEATURES_LEVELS ? 64 : 8) << 20);
        lg_features_destroy(&f);
        lg_context_destroy(context);
        assert_int_equal(u.now, 0);
    }
}

/* Channel 0 has an offset of 2^20 times its motion, channel 1 is constant, channel 2 is a straight line. */
TEST("levels follow their definition, per second, with large offsets and constant channels") {
    enum { N = 50 };
    lg_series s = make_series(1, 6, N, true);
    s.rate = 0.25;
    for (int t = 0; t < N; t++) {
        s.x[t] = 0x1p20f + (float)((7 * t) % 11 - 5);
        s.x[N + t] = 1e5f + 0.1f;
        s.x[2 * N + t] = 3.0f - 0.5f * (float)t;
    }
    lg_features f = features_of(LG_FEATURES_LEVELS, false, &s, N, NULL);
    assert_int_equal(f.count, 24);
    double *out = compute(&f, s.x);
    for (int c = 0; c < 6; c++) {
        long double low = INFINITY, high = -INFINITY, mean = 0, products = 0, squares = 0;
        for (int t = 0; t < N; t++) {
            const long double x = s.x[c * N + t];
            low = x < low ? x : low;
            high = x > high ? x : high;
            mean += x / N;
        }
        for (int t = 0; t < N; t++) {
            const long double seconds = (t - 0.5L * (N - 1)) / s.rate;
            products += seconds * (s.x[c * N + t] - mean);
            squares += seconds * seconds;
        }
        assert_close(out[4 * c], mean, 2e-16, 0);
        assert_close(out[4 * c + 1], low, 0, 0);
        assert_close(out[4 * c + 2], high, 0, 0);
        assert_close(out[4 * c + 3], products / squares, 1e-12, 1e-18);
    }
    assert_close(out[4], out[5], 0, 0); /* without rounding errors */
    assert_close(out[7], 0.0, 0, 0);
    assert_close(out[11], -0.125, 1e-15, 0); /* -0.5 a sample, every 4 s */
    s.rate = 0;                              /* unknown: per sample */
    f = features_of(LG_FEATURES_LEVELS, false, &s, N, NULL);
    out = compute(&f, s.x);
    assert_close(out[11], -0.5, 1e-15, 0);
    f = features_of(LG_FEATURES_LEVELS, true, &s, 1, NULL);
    assert_int_equal(f.count, 12);
    out = compute(&f, s.x);
    for (int i = 0; i < 4; i++) assert_close(out[i], i < 3 ? (double)s.x[0] : 0.0, 0, 0);
}

/* S S must be the covariance of the scaled channels, with S symmetric and positive semidefinite; also if one
 * channel is the sum of two others and one is constant. */
TEST("the root's square is the covariance, with dependent and constant channels") {
    lg_series s = make_series(1, 6, 50, true);
    for (int i = 0; i < 50; i++) {
        s.x[2 * 50 + i] = s.x[i] + s.x[50 + i];
        s.x[5 * 50 + i] = 1e5f + 0.1f;
    }
    double mean[6] = {0}, scale[6] = {1, 2, 3, 0.5, 1e6, 3};
    const lg_scaler scaler = {.channels = 6, .mean = mean, .scale = scale};
    lg_features f = features_of(LG_FEATURES_COV, false, &s, 50, &scaler);
    assert_int_equal(f.count, 21);
    double *out = compute(&f, s.x), root[6][6];
    for (int i = 0, at = 0; i < 6; i++)
        for (int j = i; j < 6; j++, at++) root[i][j] = root[j][i] = out[at];
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double square = 0;
            for (int k = 0; k < 6; k++) square += root[i][k] * root[k][j];
            const double e = covariance(s.x + 50 * i, s.x + 50 * j, 50) / scale[i] / scale[j];
            assert_close(square, e, 1e-12, 1e-12 * sqrt(root[i][i] * root[j][j]) + 1e-18);
        }
    for (int i = 0; i < 6; i++) assert_true(root[i][i] >= 0.0);
    /* a constant channel has no rounding errors */
    for (int j = 0; j < 6; j++) assert_close(root[5][j], 0.0, 0, 1e-18);
}

static double sign_of(unsigned bits) {
    return (bits ^ bits >> 1 ^ bits >> 2) & 1 ? -1.0 : 1.0;
}

/* Singular values that differ widely: Z = sum_k s_k v_k w_k^T with exact numbers, orthonormal v_k, and
 * orthogonal w_k of ones and minus ones, has the root S = sum_k s_k v_k v_k^T. The eigenvalues s_k^2 of the
 * covariance would have an error of eps, and s_3 then one of 1e-11. */
TEST("the root is right to the last digits even if singular values differ by 2^18") {
    enum { M = 4, N = 8 };
    static const double root[M] = {0x1p-6, 1.0, 0x1p-18, 0x1p-12};
    lg_series s = make_series(1, M, N, false);
    for (unsigned i = 0; i < M; i++)
        for (unsigned t = 0; t < N; t++) {
            double sum = 2.0;
            for (unsigned k = 0; k < M; k++) sum += root[k] * 0.5 * sign_of(k & i) * sign_of((k + 1) & t);
            s.x[i * N + t] = (float)sum;
            assert_true((double)s.x[i * N + t] == sum);
        }
    lg_features f = features_of(LG_FEATURES_COV, false, &s, N, NULL);
    double *out = compute(&f, s.x);
    for (unsigned k = 0; k < M; k++)
        for (unsigned l = 0; l < M; l++) {
            double sum = 0.0;
            for (unsigned i = 0, at = 0; i < M; i++)
                for (unsigned j = i; j < M; j++, at++) {
                    sum += 0.25 * sign_of(k & i) * sign_of(l & j) * out[at];
                    if (j > i) sum += 0.25 * sign_of(k & j) * sign_of(l & i) * out[at];
                }
            assert_close(sum, k == l ? root[k] : 0.0, 0, 4e-15);
        }
}

TEST("one channel, many, more than samples, and equal channels work; memory behind the work stays") {
    static const uint32_t channels[] = {1, 2, 9, 40}, lengths[] = {1, 2, 9, 40, 101};
    for (size_t a = 0; a < 4; a++)
        for (size_t b = 0; b < 5; b++)
            for (uint32_t copies = 0; copies < 2; copies++) {
                const uint32_t m = channels[a], n = lengths[b];
                lg_series s = make_series(1, m, n, false);
                for (uint32_t i = 1; copies && i < m; i += 2)
                    memcpy(s.x + i * n, s.x + (i - 1) * n, n * sizeof *s.x);
                lg_features f = features_of(LG_FEATURES_COV, false, &s, n, NULL);
                const size_t size = lg_features_work_size(&f) / sizeof(double);
                double *out = TEST_ARRAY(double, f.count), *work = TEST_ARRAY(double, (size + 1));
                double *root = TEST_ARRAY(double, m *m), largest = 0.0;
                work[size] = 55.0;
                assert_ok(lg_features_compute(&f, s.x, out, work));
                assert_close(work[size], 55.0, 0, 0);
                for (uint32_t i = 0, at = 0; i < m; i++)
                    for (uint32_t j = i; j < m; j++, at++) root[i * m + j] = root[j * m + i] = out[at];
                for (uint32_t i = 0; i < m; i++) {
                    assert_true(root[i * m + i] >= 0.0);
                    largest = fmax(largest, covariance(s.x + i * n, s.x + i * n, n));
                }
                for (uint32_t i = 0; i < m; i++)
                    for (uint32_t j = 0; j < m; j++) {
                        double square = 0.0;
                        for (uint32_t k = 0; k < m; k++) square += root[i * m + k] * root[k * m + j];
                        assert_close(square, covariance(s.x + i * n, s.x + j * n, n), 0, 1e-13 * largest);
                    }
            }
}

/* Channel 0 is a tone at 5/16 of Nyquist's frequency, the middle of the third of eight bands; channel 4 is
 * constant; channel 2 is compared with the library's spectrum of the scaled channel. */
TEST("band powers are those of the centred, scaled channel, with a floor") {
    enum { N = 200, BANDS = 8 };
    lg_series s = make_series(1, 6, N, true);
    double mean[6] = {0}, scale[6] = {1, 1, 3, 1, 1e3, 1};
    const lg_scaler scaler = {.channels = 6, .mean = mean, .scale = scale};
    lg_features f = features_of(LG_FEATURES_SPECTRUM, true, &s, N, &scaler);
    assert_int_equal(f.count, 3 * BANDS);
    assert_int_equal(f.spectrum.segments, 3);
    for (int t = 0; t < N; t++) s.x[4 * N + t] = 1e5f + 0.1f;
    for (int t = 0; t < N; t++) s.x[t] = (float)(8.0 * cos(3.14159265358979 * (0.25 + 0.0625) * t) + 100.0);
    double *out = compute(&f, s.x), z[N], power[BANDS],
           *work = TEST_ARRAY(double, lg_spectrum_work(&f.spectrum));
    /* leakage of the tone is far below the tone, the floor is below the leakage */
    for (int b = 0; b < BANDS; b++) {
        if (b == 2)
            assert_close(out[b], log(BANDS * 32.0), 0.05, 0);
        else
            assert_true(out[b] < out[2] - 6.0);
        assert_close(out[2 * BANDS + b], log(1e-6), 1e-15, 0);
    }
    double sum = 0;
    for (int t = 0; t < N; t++) sum += (double)s.x[2 * N + t];
    for (int t = 0; t < N; t++) z[t] = ((double)s.x[2 * N + t] - sum / N) / 3.0;
    lg_spectrum_powers(&f.spectrum, z, power, work);
    for (int b = 0; b < BANDS; b++) assert_close(exp(out[BANDS + b]), power[b] + 1e-6, 1e-12, 0);
}

TEST("short windows have at most as many bands as frequencies") {
    lg_series s = make_series(1, 2, 200, false);
    static const uint32_t lengths[] = {4, 5, 6, 15, 16, 128, 129, 200}, bands[] = {2, 2, 3, 7, 8, 8, 8, 8};
    for (size_t i = 0; i < LG_COUNT(lengths); i++) {
        lg_features f = features_of(LG_FEATURES_SPECTRUM, false, &s, lengths[i], NULL);
        assert_int_equal(f.bands, bands[i]);
        assert_int_equal(f.count, 2 * bands[i]);
        const size_t size = lg_features_work_size(&f) / sizeof(double);
        double *out = TEST_ARRAY(double, f.count), *work = TEST_ARRAY(double, size + 1);
        work[size] = 55.0;
        assert_ok(lg_features_compute(&f, s.x, out, work));
        assert_close(work[size], 55.0, 0, 0);
    }
    lg_features f;
    lg_error e;
    assert_status(lg_features_create(NULL, LG_FEATURES_SPECTRUM, false, &s, 3, NULL, &f, &e),
                  LG_INVALID_ARGUMENT);
    assert_non_null(strstr(e.message, "too short for a spectrum"));
}

TEST("if the moment's deviation is 2 * acceleration's + 3, the baseline has intercept 3 and slope 2") {
    lg_series s = make_series(1, 6, 100, true);
    for (int part = 0; part < 10; part++)
        for (int t = 0; t < 10; t++) {
            const float sign = t % 2 == 0 ? 1.0f : -1.0f;
            s.x[10 * part + t] = sign * (float)(1 + part) + 4.0f;
            s.x[400 + 10 * part + t] = sign * (3.0f + 2.0f * (float)(1 + part)) - 7.0f;
            s.x[100 + 10 * part + t] = sign; /* the deviation of acc_lower_y does not vary over the parts */
        }
    lg_features f = features_of(LG_FEATURES_BASELINE, false, &s, 100, NULL);
    assert_int_equal(f.count, 4);
    double *out = compute(&f, s.x), mean = 0;
    assert_close(out[0], 3.0, 1e-13, 0);
    assert_close(out[1], 2.0, 1e-13, 0);
    for (int p = 0; p < 10; p++) mean += 0.1 * sqrt(covariance(s.x + 500 + 10 * p, s.x + 500 + 10 * p, 10));
    assert_close(out[2], mean, 1e-13, 0);
    assert_close(out[3], 0.0, 0, 0);
    f = features_of(LG_FEATURES_BASELINE, true, &s, 100, NULL);
    assert_int_equal(f.count, 2);
}

TEST("windows of one sample have zeros") {
    lg_series s = make_series(1, 3, 1, false);
    lg_features f;
    for (int kind = LG_FEATURES_STD; kind <= LG_FEATURES_COV; kind++) {
        f = features_of((lg_feature_kind)kind, false, &s, 1, NULL);
        double *out = compute(&f, s.x);
        for (uint32_t i = 0; i < f.count; i++) assert_close(out[i], 0.0, 0, 0);
    }
}

TEST("a constant channel gives zero, and not the rounding error of its mean") {
    double mean[1] = {0}, scale[1] = {3};
    const lg_scaler scaler = {.channels = 1, .mean = mean, .scale = scale};
    for (uint32_t length = 2; length <= 60; length++) {
        lg_series s = make_series(1, 1, length, false);
        for (uint32_t t = 0; t < length; t++) s.x[t] = 0.1f;
        lg_features f = features_of(LG_FEATURES_COV, false, &s, length, &scaler);
        double *out = compute(&f, s.x);
        assert_close(out[0], 0.0, 0, 0);
    }
}

TEST("features are named after their channels") {
    lg_series s = make_series(1, 6, 20, true);
    static const struct {
        lg_feature_kind kind;
        bool x;
        uint32_t index;
        const char *name, *bare;
    } cases[] = {{LG_FEATURES_STD, true, 1, "std acc_upper_x", "std 2"},
                 {LG_FEATURES_COV, false, 6, "cov acc_lower_y acc_lower_y", "cov 1 1"},
                 {LG_FEATURES_COV, false, 20, "cov moment_y moment_y", "cov 5 5"},
                 {LG_FEATURES_COV, false, 7, "cov acc_lower_y acc_upper_x", "cov 1 2"},
                 {LG_FEATURES_RAW, true, 41, "raw moment_x 1", "raw 4 1"},
                 {LG_FEATURES_SPECTRUM, true, 10, "band 0.125-0.175 acc_upper_x", "band 0.125-0.175 2"},
                 {LG_FEATURES_LEVELS, true, 4, "mean acc_upper_x", "mean 2"},
                 {LG_FEATURES_LEVELS, true, 5, "min acc_upper_x", "min 2"},
                 {LG_FEATURES_LEVELS, true, 6, "max acc_upper_x", "max 2"},
                 {LG_FEATURES_LEVELS, true, 7, "slope acc_upper_x", "slope 2"},
                 {LG_FEATURES_BASELINE, false, 3, "slope moment_y acc_lower_y", "slope 5 1"}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        char text[200];
        lg_features f = features_of(cases[i].kind, cases[i].x, &s, 20, NULL);
        assert_int_equal(lg_features_name(&f, &s, cases[i].index, text, sizeof text), strlen(cases[i].name));
        assert_string_equal(text, cases[i].name);
        (void)lg_features_name(&f, NULL, cases[i].index, text, sizeof text);
        assert_string_equal(text, cases[i].bare);
    }
    assert_string_equal(lg_feature_kind_name((lg_feature_kind)LG_FEATURE_KIND_COUNT), "unknown");
    char text[40];
    const lg_features f = features_of(LG_FEATURES_STD, false, &s, 20, NULL);
    (void)lg_features_name(&f, &s, f.count, text, sizeof text);
    assert_string_equal(text, "unknown");
    s.channel_name[2][0] = '\0'; /* a channel without a name, or out of range, is named by its number */
    for (uint32_t c = 2; c < 7; c += 4) {
        (void)lg_channel_name(&s, c, text, sizeof text);
        assert_string_equal(text, c == 2 ? "2" : "6");
    }
}

TEST("any number of threads gives the same bits") {
    lg_series s = make_series(23, 6, 60, false);
    const lg_windows w = windows_of(&s);
    for (int kind = 0; kind < LG_FEATURE_KIND_COUNT; kind++) {
        lg_features f = kind == LG_FEATURES_ROCKET ? rocket_of(&s, 200, 1)
                                                   : features_of((lg_feature_kind)kind, false, &s, 60, NULL);
        double *one = TEST_ARRAY(double, 23 * f.count), *more = TEST_ARRAY(double, 23 * f.count);
        assert_ok(lg_features_table(NULL, &f, &s, &w, 1, one, NULL));
        double *row = compute(&f, s.x + 22 * 6 * 60);
        assert_memory_equal(row, one + 22 * f.count, f.count * sizeof *row);
        for (int threads = 2; threads <= 40; threads += 19) {
            memset(more, 0, 23 * f.count * sizeof *more);
            assert_ok(lg_features_table(NULL, &f, &s, &w, threads, more, NULL));
            assert_memory_equal(one, more, 23 * f.count * sizeof *one);
        }
    }
}

TEST("windows, scalers and samples that do not fit are refused") {
    lg_series s = make_series(2, 3, 20, false);
    lg_features f = {.count = 77};
    lg_error e;
    const lg_status bad = LG_INVALID_ARGUMENT;
    assert_status(lg_features_create(NULL, LG_FEATURES_BASELINE, false, &s, 20, NULL, &f, &e),
                  bad); /* there is no pair of channels */
    assert_non_null(strstr(e.message, "moment"));
    assert_status(lg_features_create(NULL, LG_FEATURES_BASELINE, false, &s, 9, NULL, &f, &e), bad);
    assert_status(
        lg_features_create(NULL, (lg_feature_kind)LG_FEATURE_KIND_COUNT, false, &s, 20, NULL, &f, &e), bad);
    assert_status(lg_features_create(NULL, LG_FEATURES_RAW, false, &s, 1u << 20, NULL, &f, &e), bad);
    assert_status(lg_features_create(NULL, LG_FEATURES_RAW, false, &s, 0, NULL, &f, &e), bad);
    lg_series none = s, wide = s;
    none.channels = 0, wide.channels = LG_FEATURES_MAX + 1;
    assert_status(lg_features_create(NULL, LG_FEATURES_RAW, false, &none, 20, NULL, &f, &e), bad);
    assert_status(lg_features_create(NULL, LG_FEATURES_RAW, false, &wide, 20, NULL, &f, &e), bad);
    assert_says(e.message, "at most");
    assert_status(lg_features_create(NULL, LG_FEATURES_BASELINE, true, &s, 20, NULL, &f, &e), bad);
    assert_says(e.message, "same direction (x)");
    lg_features_destroy(NULL);
    double mean[3] = {0}, scale[3] = {1, 0, 1};
    const lg_scaler zero = {.channels = 3, .mean = mean, .scale = scale},
                    narrow = {.channels = 2, .mean = mean, .scale = scale};
    assert_status(lg_features_create(NULL, LG_FEATURES_COV, false, &s, 20, &zero, &f, &e), bad);
    assert_status(lg_features_create(NULL, LG_FEATURES_COV, false, &s, 20, &narrow, &f, &e), bad);
    scale[1] = INFINITY;
    assert_status(lg_features_create(NULL, LG_FEATURES_COV, false, &s, 20, &zero, &f, &e), bad);
    assert_int_equal(f.count, 77);
    for (int kind = 0; kind < LG_FEATURES_BASELINE; kind++) {
        f = features_of((lg_feature_kind)kind, false, &s, 20, NULL);
        const uint32_t values[] = {0, 10, 19};
        double *y = TEST_ARRAY(double, f.count), *memory = lg_test_memory(lg_features_work_size(&f));
        for (int t = 0; t < 20; t++) s.x[20 + t] = INFINITY; /* infinity is constant too */
        assert_status(lg_features_compute(&f, s.x, y, memory), LG_NOT_FINITE);
        for (int t = 0; t < 20; t++) s.x[20 + t] = 1.0f;
        assert_ok(lg_features_compute(&f, s.x, y, memory));
        for (size_t i = 0; i < LG_COUNT(values); i++)
            for (int k = 0; k < 3; k++) {
                s.x[20 + values[i]] = k == 0 ? NAN : k == 1 ? INFINITY : -INFINITY;
                assert_status(lg_features_compute(&f, s.x, y, memory), LG_NOT_FINITE);
                s.x[20 + values[i]] = 1.0f;
            }
    }
    f = features_of(LG_FEATURES_COV, false, &s, 20, NULL);
    s.x[30] = NAN;
    const lg_windows w = windows_of(&s);
    double table[12];
    assert_status(lg_features_table(NULL, &f, &s, &w, 2, table, &e), LG_NOT_FINITE);
    assert_non_null(strstr(e.message, "window 0"));
    assert_status(lg_features_table(NULL, &f, &s, &w, 0, table, &e), bad);
    lg_windows shorter = w, empty = w;
    lg_series fewer = s;
    shorter.length = 10, empty.count = 0, fewer.channels = 2;
    assert_status(lg_features_table(NULL, &f, &s, &shorter, 1, table, &e), bad);
    assert_status(lg_features_table(NULL, &f, &fewer, &w, 1, table, &e), bad);
    assert_ok(lg_features_table(NULL, &f, &s, &empty, 1, table, &e));
    s.x[30] = 1.0f;
    const volatile int stop = 1;
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.cancel = &stop;
    assert_ok(lg_context_create(&options, &context));
    assert_status(lg_features_table(context, &f, &s, &w, 1, table, &e), LG_CANCELLED);
    lg_context_destroy(context);
}

TEST("every allocation may fail") {
    lg_series s = make_series(4, 6, 30, false);
    double table[4 * 48];
    const lg_windows w = windows_of(&s);
    for (int kind = LG_FEATURES_STD; kind < LG_FEATURES_ROCKET; kind++)
        EVERY_ALLOCATION_FAILS(context, 1, {
            lg_features f = {0};
            status = lg_features_create(context, (lg_feature_kind)kind, false, &s, 30, NULL, &f, NULL);
            if (status == LG_OK) status = lg_features_table(context, &f, &s, &w, 2, table, NULL);
            lg_features_destroy(&f);
        });
}
