/* Random convolution features against their definition, and ridge regression against refits without each
 * row. */
#include "classify_support.h"
#include "support/dense_solve.h"

#include <math.h>

#include "core/core.h"
#include "anomaly/classify/features.h"
#include "autodiff/compiled.h"
#include "autodiff/ops/op.h"

static const double PHI = 1.618033988749895;

static lg_series make_series(size_t count, uint32_t channels, uint32_t length, uint64_t seed) {
    lg_series s = {.count = count, .channels = channels, .length = length, .classes = 2};
    assert_ok(lg_series_allocate(NULL, &s, false, false));
    lg_rng rng = test_rng(seed, 2);
    for (size_t i = 0; i < count * channels * length; i++) s.x[i] = (float)lg_rng_normal(&rng);
    return *own_lg_series(s);
}

static double *compute(const lg_features *f, const float *x) {
    double *out = TEST_ARRAY(double, f->count),
           *work = TEST_ARRAY(double, lg_features_work_size(f) / sizeof(double));
    assert_ok(lg_features_compute(f, x, out, work));
    return out;
}

/* The nine weights of a kernel. */
static void weights_of(uint32_t kernel, double weight[9]) {
    uint32_t number = 0;
    for (int j = 0; j < 9; j++) weight[j] = kernel < 84 ? -1 : 1;
    for (int a = 0; a < 9; a++)
        for (int b = a + 1; b < 9; b++)
            for (int c = b + 1; c < 9; c++)
                if (number++ == kernel) weight[a] = weight[b] = weight[c] = 2;
}

/* Compares the features of a window with their definition. All sums of the window must be exact in float. */
static void against_definition(const lg_features *f, const float *x) {
    const lg_rocket *r = &f->rocket;
    const double *found = compute(f, x);
    const uint32_t *channel = r->channel;
    const float *bias = r->bias;
    double squares = 0;
    for (size_t i = 0; i < (size_t)f->channels * f->length; i++) squares += (double)x[i] * (double)x[i];
    const float rms = (float)sqrt(squares / ((double)f->channels * f->length));
    for (uint32_t i = 0; i < r->count; i++) {
        const lg_rocket_convolution *c = &r->convolution[i];
        const int n = (int)f->length, step = (int)c->dilation, first = c->padded ? 0 : 4 * step;
        double weight[9], *y = TEST_ARRAY(double, f->length);
        weights_of(c->kernel, weight);
        for (uint32_t k = 0; k < c->channels; k++)
            for (int t = 0; t < n; t++)
                for (int j = 0; j < 9; j++) {
                    const int at = t + (j - 4) * step;
                    const double z =
                        at >= 0 && at < n ? (double)x[channel[k] / 2 * f->length + (size_t)at] : 0;
                    y[t] += (channel[k] % 2 == 1 ? -1 : 1) * weight[j] * z;
                }
        for (uint32_t b = 0; b < c->features; b++) {
            const float level = c->kernel < 84 ? bias[b] * rms : bias[b];
            int above = 0;
            for (int t = first; t < n - first; t++) above += y[t] > (double)level;
            assert_close(*found++, above / (double)(n - 2 * first), 0, 0);
        }
        channel += c->channels, bias += c->features;
    }
}

TEST("random convolution features follow their definition, for any length and number of channels") {
    static const struct {
        uint32_t channels, length;
    } cases[] = {{1, 9}, {1, 24}, {2, 17}, {3, 100}, {12, 33}, {1, 300}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const uint32_t channels = cases[i].channels;
        lg_series s = make_series(4, channels, cases[i].length, i);
        for (size_t k = 0; k < 4 * (size_t)channels * s.length; k++) s.x[k] = roundf(8 * s.x[k]) / 8;
        double *mean = TEST_ARRAY(double, channels), *scale = TEST_ARRAY(double, channels);
        for (uint32_t c = 0; c < channels; c++) scale[c] = 1;
        const lg_scaler scaler = {.channels = channels, .mean = mean, .scale = scale};
        const lg_windows w = windows_of(&s);
        lg_rocket_options options;
        lg_features f;
        lg_rocket_options_init(&options);
        options.features = 960;
        assert_ok(lg_rocket_fit(NULL, &options, &s, &w, NULL, 4, &scaler, &f, NULL));
        f = *own_lg_features(f);
        assert_int_equal(f.count, 960);
        for (size_t k = 0; k < 4; k++) against_definition(&f, s.x + k * channels * s.length);
    }
}

TEST("dilations are powers of 2 rounded down, and every kernel has the same number of features") {
    for (uint32_t length = 9; length < 400; length += 13) {
        lg_series s = make_series(2, 1, length, 3);
        const lg_features f = rocket_of(&s, 3000, 5);
        uint32_t of_kernel[96] = {0}, last = 0, dilations = 0;
        for (uint32_t i = 0; i < f.rocket.count; i++) {
            const lg_rocket_convolution *c = &f.rocket.convolution[i];
            of_kernel[c->kernel] += c->features;
            assert_true(c->dilation >= last);
            dilations += c->dilation > last;
            last = c->dilation;
        }
        for (int k = 0; k < 96; k++) assert_int_equal(of_kernel[k], 3000 / 96);
        assert_int_equal(f.rocket.convolution[0].dilation, 1);
        assert_int_equal(last, (length - 1) / 8); /* exponents end at log2((length - 1)/8) */
        assert_in_range(dilations, 1, last);
    }
}

/* Fitted to one window, feature number i of this window is the part of the samples above the quantile
 * frac((i + 1) phi). */
TEST("thresholds are quantiles of a training window") {
    for (uint32_t length = 200; length <= 600; length += 400) {
        lg_series s = make_series(1, 1, length, 7);
        const lg_features f = rocket_of(&s, 1920, 1);
        const double *part = compute(&f, s.x);
        for (uint32_t i = 0, at = 0; i < f.rocket.count; i++) {
            const lg_rocket_convolution *c = &f.rocket.convolution[i];
            const double samples = c->padded ? length : length - 8.0 * c->dilation;
            for (uint32_t k = 0; k < c->features; k++, at++)
                assert_close(part[at], 1 - fmod((at + 1) * PHI, 1), 0, 1.01 / samples);
        }
    }
}

TEST("units of the channels do not matter, and padding sees a level that the kernels do not") {
    lg_series s = make_series(6, 3, 80, 11);
    const lg_features f = rocket_of(&s, 960, 2);
    const double *plain = compute(&f, s.x);
    static const double units[] = {1024, 1e9, 1e-9};
    for (size_t u = 0; u < LG_COUNT(units); u++) {
        lg_series other = make_series(6, 3, 80, 11);
        for (size_t i = 0; i < 6 * 3 * 80; i++)
            if (i / 80 % 3 == 1) other.x[i] = (float)((double)other.x[i] * units[u]);
        const lg_features g = rocket_of(&other, 960, 2);
        const double *scaled = compute(&g, other.x);
        size_t different = 0;
        for (uint32_t i = 0; i < f.count; i++) {
            assert_close(scaled[i], plain[i], 0, units[u] == 1024 ? 0 : 1.01 / 16);
            different += scaled[i] != plain[i];
        }
        assert_in_range(different, 0, 10);
    }
}

TEST("pruned features are a part of the features") {
    lg_series s = make_series(5, 4, 60, 13);
    const lg_features whole = rocket_of(&s, 960, 2);
    const double *all = compute(&whole, s.x);
    lg_features f = rocket_made(&s, 960, 2);
    uint32_t keep[] = {0, 1, 5, 300, 301, 302, 958, 959};
    lg_error error;
    static const uint32_t falling[] = {3, 2}, beyond[] = {2, 960};
    assert_status(lg_rocket_prune(&f, falling, 2, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_rocket_prune(&f, beyond, 2, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_rocket_prune(&f, keep, 0, &error), LG_INVALID_ARGUMENT);
    const uint32_t before = f.rocket.count;
    assert_ok(lg_rocket_prune(&f, keep, LG_COUNT(keep), &error));
    assert_int_equal(f.count, LG_COUNT(keep));
    assert_true(f.rocket.count < before);
    const double *part = compute(&f, s.x);
    for (size_t i = 0; i < LG_COUNT(keep); i++) assert_close(part[i], all[keep[i]], 0, 0);
    lg_features_destroy(&f);
    lg_features deviations = features_of(LG_FEATURES_STD, false, &s, 60, NULL);
    assert_status(lg_rocket_prune(&deviations, keep, 2, &error), LG_UNSUPPORTED);
    assert_says(error.message, "std");
}

TEST("windows, options and samples that do not fit are refused with a reason") {
    lg_series s = make_series(3, 2, 30, 17), small = make_series(3, 2, 8, 17);
    const lg_windows w = windows_of(&s), narrow = windows_of(&small);
    double mean[2] = {0}, scale[2] = {1, 1};
    const lg_scaler scaler = {.channels = 2, .mean = mean, .scale = scale};
    lg_rocket_options o;
    lg_features f;
    lg_error e;
    lg_rocket_options_init(&o);
    assert_status(lg_rocket_fit(NULL, &o, &small, &narrow, NULL, 3, &scaler, &f, &e), LG_INVALID_ARGUMENT);
    assert_says(e.message, "8 samples");
    assert_status(lg_rocket_fit(NULL, &o, &s, &w, NULL, 0, &scaler, &f, &e), LG_INVALID_ARGUMENT);
    assert_says(e.message, "0 training windows");
    o.features = 95;
    assert_status(lg_rocket_fit(NULL, &o, &s, &w, NULL, 3, &scaler, &f, &e), LG_INVALID_ARGUMENT);
    assert_says(e.message, "95");
    o.features = 96;
    o.size--;
    assert_status(lg_rocket_fit(NULL, &o, &s, &w, NULL, 3, &scaler, &f, &e), LG_INVALID_ARGUMENT);
    o.size++;
    assert_status(lg_features_create(NULL, LG_FEATURES_ROCKET, false, &s, 30, &scaler, &f, &e),
                  LG_INVALID_ARGUMENT);
    assert_says(e.message, "lg_rocket_fit");
    o.features = LG_FEATURES_MAX + 1;
    assert_status(lg_rocket_fit(NULL, &o, &s, &w, NULL, 3, &scaler, &f, &e), LG_INVALID_ARGUMENT);
    assert_says(e.message, "random convolution features");
    f = rocket_of(&s, 96, 1);
    double *work = TEST_ARRAY(double, lg_features_work_size(&f) / sizeof(double)), out[96];
    s.x[40] = NAN;
    assert_status(lg_features_compute(&f, s.x, out, work), LG_NOT_FINITE);
    s.x[40] = 0;
    for (int i = 0; i < 60; i++) s.x[i] = 0; /* a window without motion is judged */
    assert_ok(lg_features_compute(&f, s.x, out, work));
}

/* ---- the operation ---- */

extern const lg_op lg_op_rocket;
static const lg_rocket_row two_rows[] = {{3, 1, 1, 2, 2}, {90, 1, 0, 1, 1}};
static const uint32_t their_channels[] = {0, 3, 2};

static lg_status record_two(void *user, lg_tape *t, const lg_var *w, const lg_var *x, lg_var *out) {
    static const double mean[] = {0.125, -0.25}, inverse[] = {1.5, 0.75}, bias[] = {0.25, -0.5, 1};
    out[0] = lg_rocket_record(t, x[0], lg_input_f64(t, lg_shape1(2), mean),
                              lg_input_f64(t, lg_shape1(2), inverse), lg_input_f64(t, lg_shape1(3), bias),
                              &(lg_rocket_table){two_rows, their_channels, 2, 3});
    return lg_tape_status(t);
}

TEST("a window whose scaled samples overflow has no features, neither in a plan nor in C") {
    const lg_port window = {.name = "x", .shape = lg_shape2(2, 9)}, features = {.name = "f"};
    const lg_function_spec function = {"f", &window, 1, &features, 1, record_two, NULL};
    lg_program_spec spec;
    lg_program *program;
    compiled c;
    double x[18], plan[3], code[3];
    if (!has_compiler()) return;
    lg_program_spec_init(&spec);
    spec.functions = &function;
    spec.function_count = 1;
    assert_ok(lg_program_build(NULL, &spec, &program, NULL));
    if (!compile_program(&c, program, "gcc", "-O2", LG_F64, false)) fail_msg("%s", c.why);
    double *work = TEST_ARRAY(double, c.source->work_size + 1);
    for (int i = 0; i < 18; i++) x[i] = sin(i);
    for (int large = 0; large < 2; large++) {
        if (large == 1) x[4] = 1e300;
        assert_ok(lg_program_eval(NULL, program, "f", 1, (const double *const[]){x}, (double *const[]){plan},
                                  NULL));
        shim_of(&c, "f")((const void *const[]){x}, (void *const[]){code}, work);
        for (int j = 0; j < 3; j++) {
            assert_true(isnan(plan[j]) == (large == 1) && isnan(code[j]) == (large == 1));
            if (large == 0) assert_close(code[j], plan[j], 0, 0);
        }
    }
    assert_true(discard_compiled(&c));
    lg_program_destroy(program);
}

TEST("a table of convolutions that is missing, cut off or does not fit is rejected") {
    const lg_shape x = lg_shape3(1, 2, 9), each = lg_shape1(2), bias = lg_shape1(3);
    const lg_shape *in[] = {&x, &each, &each, &bias};
    uint32_t table[13];
    lg_shape out;
    memcpy(table, two_rows, sizeof two_rows);
    memcpy(table + 10, their_channels, sizeof their_channels);
    lg_attr attr = {.i = {13, INT32_MAX, 2, 0}, .pointer = table};
    assert_ok(lg_op_rocket.shape(in, 4, &attr, &out));
    attr.pointer = NULL;
    assert_status(lg_op_rocket.shape(in, 4, &attr, &out), LG_INVALID_ARGUMENT);
    attr.pointer = table;
    for (attr.i[0] = 0; attr.i[0] < 13; attr.i[0]++)
        assert_status(lg_op_rocket.shape(in, 4, &attr, &out), LG_INVALID_ARGUMENT);
    for (int i = 0; i < 13; i++) {
        const uint32_t kept = table[i];
        table[i] = UINT32_MAX;
        assert_status(lg_op_rocket.shape(in, 4, &attr, &out), LG_INVALID_ARGUMENT);
        table[i] = kept;
    }
}

/* ---- ridge regression ---- */

/* out (d + 1): weights and intercept of the ridge regression without row `left_out`, or with all rows if it
 * is n. */
static void refit(const double *x, const uint32_t *label, uint32_t class, size_t n, size_t d, double penalty,
                  size_t left_out, double *out) {
    double *a = TEST_ARRAY(double, (d + 1) * (d + 1)), *b = TEST_ARRAY(double, d + 1);
    for (size_t j = 0; j < d; j++) a[j * (d + 2)] = penalty;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; i != left_out && j <= d; j++) {
            const double xj = j < d ? x[i * d + j] : 1;
            b[j] += xj * (label[i] == class ? 1 : -1);
            for (size_t k = 0; k <= d; k++) a[j * (d + 1) + k] += xj * (k < d ? x[i * d + k] : 1);
        }
    dense_solve(d + 1, a, b, out);
}

static void against_refits(size_t n, uint32_t d, uint32_t classes) {
    uint32_t *label = TEST_ARRAY(uint32_t, n);
    double *x = clouds(n, d, classes, 0.7, n + d, label), *copy = TEST_ARRAY(double, n *d),
           *w = TEST_ARRAY(double, d + 1);
    lg_logistic found;
    memcpy(copy, x, n * d * sizeof *x);
    assert_told(lg_ridge_fit(NULL, copy, label, n, d, classes, 1, &found, &told));
    double best = INFINITY, penalty = 0;
    for (int p = 0; p < 10; p++) {
        const double candidate = (double)n * pow(10, -3 + 6.0 * p / 9);
        double sum = 0;
        for (uint32_t c = classes == 2 ? 1 : 0; c < classes; c++)
            for (size_t i = 0; i < n; i++) {
                refit(x, label, c, n, d, candidate, i, w);
                double miss = w[d] - (label[i] == c ? 1 : -1);
                for (size_t j = 0; j < d; j++) miss += w[j] * x[i * d + j];
                sum += miss * miss;
            }
        if (sum < best) best = sum, penalty = candidate;
    }
    assert_close(found.penalty, penalty, 1e-12, 0);
    for (uint32_t c = classes == 2 ? 1 : 0; c < classes; c++) {
        const size_t row = classes == 2 ? 0 : c;
        refit(x, label, c, n, d, penalty, n, w);
        for (size_t j = 0; j < d; j++) assert_close(found.weight[row * d + j], w[j], 1e-7, 1e-9);
        assert_close(found.intercept[row], w[d], 1e-7, 1e-9);
    }
    lg_logistic_destroy(&found);
}

TEST("ridge regression chooses the penalty of refits without each row, for few and for many features") {
    against_refits(30, 4, 2);
    against_refits(30, 4, 3);
    against_refits(12, 20, 2);
    against_refits(15, 40, 4);
    against_refits(9, 9, 2);
    for (size_t n = 6; n < 30; n++) against_refits(n, 5, 2); /* small data move the choice most */
}

/* Overwrites a (n, n), symmetric positive definite, by its inverse: Gauss and Jordan. */
static void invert(size_t n, double *a) {
    for (size_t k = 0; k < n; k++) {
        const double pivot = 1 / a[k * n + k];
        a[k * n + k] = 1;
        for (size_t j = 0; j < n; j++) a[k * n + j] *= pivot;
        for (size_t i = 0; i < n; i++) {
            const double factor = a[i * n + k];
            if (i == k) continue;
            a[i * n + k] = 0;
            for (size_t j = 0; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
        }
    }
}

/* Mean of the columns of x (n, d) taken off, gram (n, n) = x x^T. */
static void centred_gram(double *x, size_t n, size_t d, double *gram) {
    for (size_t j = 0; j < d; j++) {
        double mean = 0;
        for (size_t i = 0; i < n; i++) mean += x[i * d + j] / (double)n;
        for (size_t i = 0; i < n; i++) x[i * d + j] -= mean;
    }
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < n; k++)
            for (size_t j = 0; j < d; j++) gram[i * n + k] += x[i * d + j] * x[k * d + j];
}

/* Sum of the squared residuals of rows left out: (G + a)^-1 y over diag (G + a)^-1 - 1/(n a). */
static double left_out(const double *gram, const double *y, size_t n, double penalty) {
    double *a = TEST_ARRAY(double, n *n), sum = 0;
    memcpy(a, gram, n * n * sizeof *a);
    for (size_t i = 0; i < n; i++) a[i * n + i] += penalty;
    invert(n, a);
    for (size_t i = 0; i < n; i++) {
        double c = 0;
        for (size_t k = 0; k < n; k++) c += a[i * n + k] * y[k];
        c /= a[i * n + i] - 1 / ((double)n * penalty);
        sum += c * c;
    }
    return sum;
}

/* For tables of several tiles. Returns the number of the penalty that was chosen. misled: every fifth row,
 * with which the choice begins, has a class that is not its own, so that it asks for a large penalty. */
static int against_inverse(size_t n, uint32_t d, double spread, bool misled) {
    uint32_t *label = TEST_ARRAY(uint32_t, n);
    double *x = clouds(n, d, 2, spread, n + d, label), *y = TEST_ARRAY(double, n), mean = 0, best = INFINITY,
           *gram = TEST_ARRAY(double, n *n), *copies[2], penalty = 0;
    lg_logistic found[2];
    int number = 0;
    for (size_t i = 0; misled && i < n; i += 5) label[i] = (uint32_t)(i / 10 % 2);
    for (int i = 0; i < 2; i++) {
        copies[i] = TEST_ARRAY(double, n *d);
        memcpy(copies[i], x, n * d * sizeof *x);
        assert_told(lg_ridge_fit(NULL, copies[i], label, n, d, 2, 1 + 2 * i, &found[i], &told));
    }
    assert_memory_equal(found[0].weight, found[1].weight, d * sizeof *x);
    assert_close(found[0].intercept[0], found[1].intercept[0], 0, 0);
    for (size_t i = 0; i < n; i++) mean += (label[i] == 1 ? 1.0 : -1.0) / (double)n;
    for (size_t i = 0; i < n; i++) y[i] = (label[i] == 1 ? 1 : -1) - mean;
    centred_gram(x, n, d, gram);
    for (int p = 0; p < 10; p++) {
        const double candidate = (double)n * pow(10, -3 + 6.0 * p / 9);
        if (n > 300 && fabs(log(candidate / found[0].penalty)) > 2) continue; /* only its neighbours */
        const double sum = left_out(gram, y, n, candidate);
        if (sum < best) best = sum, penalty = candidate, number = p;
    }
    assert_close(found[0].penalty, penalty, 1e-12, 0);
    for (size_t i = 0; i < n; i++) gram[i * n + i] += penalty;
    invert(n, gram);
    for (size_t j = 0; j < d; j++) { /* X^T (G + a)^-1 y */
        double w = 0;
        for (size_t i = 0; i < n; i++) {
            double c = 0;
            for (size_t k = 0; k < n && j < 3; k++) c += gram[i * n + k] * y[k];
            w += x[i * d + j] * c;
        }
        if (j < 3) assert_close(found[0].weight[j], w, 1e-7, 1e-9);
    }
    for (int i = 0; i < 2; i++) lg_logistic_destroy(&found[i]);
    return number;
}

TEST("ridge regression on many rows: the penalty and weights of the inverse matrix, for any number of "
     "threads") {
    int least = 9, most = 0;
    static const double spreads[] = {0.01, 0.1, 0.5, 1.5};
    for (size_t i = 0; i < LG_COUNT(spreads); i++) {
        const int number = against_inverse(300, 330, spreads[i], false);
        if (number < least) least = number;
        if (number > most) most = number;
    }
    assert_true(most > least + 1);
    (void)against_inverse(300, 330, 0.3, true);
    (void)against_inverse(520, 530, 0.3, false); /* three tiles in a row */
    (void)against_inverse(330, 300, 0.3, false); /* still by rows, with more rows than features */
    (void)against_inverse(400, 270, 0.3, false); /* by features */
    (void)against_inverse(300, 40, 0.3, false);
}

TEST("each group of neighbours gives its share of the features with the largest weights") {
    static const struct {
        size_t groups, count;
        uint32_t expected[4];
    } cases[] = {{1, 1, {3}},       {1, 3, {1, 3, 6}}, {2, 2, {1, 3}}, /* groups of 3 and 4 */
                 {2, 3, {1, 3, 6}}, {3, 3, {1, 3, 6}},                 /* groups of 2, 2, 3 */
                 {7, 2, {3, 6}}}; /* one by one: groups 4 and 7 bring the count to 1 and 2 */
    uint32_t label[40], index[8];
    double *x = clouds(40, 7, 2, 0.0, 3, label);
    for (size_t i = 0; i < 40; i++) {
        const double side = label[i] == 1 ? 1 : -1;
        x[7 * i + 3] += 4 * side, x[7 * i + 1] -= 2 * side, x[7 * i + 6] += side;
    }
    lg_classifier_options o;
    lg_classifier c = {0};
    lg_error e;
    lg_classifier_options_init(&o);
    o.method = LG_METHOD_RIDGE;
    assert_ok(lg_classifier_fit(NULL, &o, x, label, NULL, 40, 7, 2, &c, &e));
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        assert_ok(lg_classifier_largest(NULL, &c, cases[i].groups, cases[i].count, index, &e));
        for (size_t k = 0; k < cases[i].count; k++) assert_int_equal(index[k], cases[i].expected[k]);
    }
    assert_ok(lg_classifier_largest(NULL, &c, 9, 7, index, &e)); /* more groups than features */
    for (uint32_t k = 0; k < 7; k++) assert_int_equal(index[k], k);
    assert_status(lg_classifier_largest(NULL, &c, 1, 8, index, &e), LG_INVALID_ARGUMENT);
    assert_status(lg_classifier_largest(NULL, &c, 0, 2, index, &e), LG_INVALID_ARGUMENT);
    lg_classifier_destroy(&c);
    o.method = LG_METHOD_TREE;
    assert_ok(lg_classifier_fit(NULL, &o, x, label, NULL, 40, 7, 2, &c, &e));
    assert_status(lg_classifier_largest(NULL, &c, 1, 2, index, &e), LG_UNSUPPORTED);
    lg_classifier_destroy(&c);
}

static const char *check(const lg_features *f) {
    const lg_rocket_table table = lg_rocket_table_of(&f->rocket);
    return lg_rocket_check(&table, f->selected, f->length, f->count);
}

TEST("convolutions that do not fit their windows are refused") {
    lg_series s = make_series(3, 2, 30, 17);
    const lg_features f = rocket_of(&s, 96, 1);
    assert_null(check(&f));
    lg_rocket_convolution *first = &f.rocket.convolution[0];
    const lg_rocket_convolution good = *first;
    const struct {
        lg_rocket_convolution made;
        const char *says;
    } bad[] = {{{96, good.dilation, good.padded, good.channels, good.features}, "out of range"},
               {{good.kernel, good.dilation, 2, good.channels, good.features}, "out of range"},
               {{good.kernel, good.dilation, good.padded, good.channels, 0}, "out of range"},
               {{good.kernel, 0, good.padded, good.channels, good.features}, "dilation"},
               {{good.kernel, 4, good.padded, good.channels, good.features}, "dilation"},
               {{good.kernel, good.dilation, good.padded, 0, good.features}, "no channels, or too many"},
               {{good.kernel, good.dilation, good.padded, 3, good.features}, "no channels, or too many"},
               {{good.kernel, good.dilation, good.padded, 3 - good.channels, good.features}, "does not fit"},
               {{good.kernel, good.dilation, good.padded, good.channels, good.features + 1}, "does not fit"}};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        *first = bad[i].made;
        const char *what = check(&f);
        assert_non_null(what);
        assert_says(what, bad[i].says);
    }
    *first = good;
    const uint32_t channel = f.rocket.channel[0];
    f.rocket.channel[0] = 4;
    assert_says(check(&f), "does not exist");
    f.rocket.channel[0] = channel;
    assert_null(check(&f));
}

/* The bias of feature i; channels that are subtracted have a minus. */
TEST("features of convolutions are named after kernel, dilation and channels") {
    lg_series s = make_series(3, 2, 30, 17);
    const lg_features f = rocket_of(&s, 192, 1);
    const lg_rocket *r = &f.rocket;
    uint32_t index = 0, at = 0;
    for (uint32_t i = 0; i < r->count; i++) {
        const lg_rocket_convolution *c = &r->convolution[i];
        for (uint32_t b = 0; b < c->features; b++, index++) {
            char text[200], want[200], channels[20] = "";
            for (uint32_t k = 0; k < c->channels; k++)
                (void)sprintf(channels + strlen(channels), "%s%u",
                              r->channel[at + k] % 2 == 1 ? "-"
                              : k > 0                     ? "+"
                                                          : "",
                              r->channel[at + k] / 2);
            (void)snprintf(want, sizeof want, "rocket %u dilation %u %s > %.6g%s", c->kernel, c->dilation,
                           channels, (double)r->bias[index], c->kernel < 84 ? " rms" : "");
            (void)lg_features_name(&f, NULL, index, text, sizeof text);
            assert_string_equal(text, want);
        }
        at += c->channels;
    }
    assert_int_equal(index, f.count);
}
