/* Novelty detection: distances, causes, limits, files. */
#include "anomaly/series_support.h"

#include "kernels/lapack.h"
#include "liegrad/core.h"
#include "anomaly/novelty_internal.h"
#include "support/memory_archive.h"

static const double PI = 3.14159265358979323846;

OWNED(lg_novelty, lg_novelty_destroy)

enum { CHANNELS = 3, LENGTH = 200, RUNS = 20, EACH = 10 };

/* Three sensors measure one motion, a resonance at .05 cycles per sample; its amplitude varies from run to
 * run. In class 1 its frequency is lower and sensor 0 shows more of it. Noise is 1e-2 of each sensor; sensor
 * 2 has a range of 1e6. */
static void simulate(lg_rng *rng, uint32_t class_index, double level, double noise, float *x) {
    const double w = 2 * PI * (class_index == 0 ? 0.05 : 0.045), r = 0.97;
    double a = 0, b = 0;
    for (int t = -200; t < LENGTH; t++) {
        const double next = 2 * r * cos(w) * a - r * r * b + level * 0.1 * lg_rng_normal(rng);
        const double own = lg_rng_normal(rng);
        b = a;
        a = next;
        if (t < 0) continue;
        x[t] = (float)((class_index == 0 ? 1 : 1.5) * a + noise * lg_rng_normal(rng));
        x[LENGTH + t] = (float)(0.5 * a + 0.1 * own * level + noise * lg_rng_normal(rng));
        x[2 * LENGTH + t] = (float)(1e6 * (3 - a + noise * lg_rng_normal(rng)));
    }
}

/* Runs 0, 2, ... have class 0. */
static lg_series make_windows(uint64_t seed, double noise) {
    lg_series s = make_series(RUNS * EACH, CHANNELS, LENGTH, 2, false, true);
    lg_rng rng = test_rng(seed, 7);
    for (uint32_t i = 0; i < s.count; i++) {
        s.run[i] = i / EACH;
        s.label[i] = s.run[i] % 2;
        const double level = 1 + (double)(s.run[i] / 2 % 5) / 4;
        simulate(&rng, s.label[i], level, noise, s.x + (size_t)i * CHANNELS * LENGTH);
    }
    return s;
}

static lg_novelty fit_on(const lg_series *s, const uint32_t *chosen, size_t count, int threads) {
    const lg_windows w = cut_windows(s, 0, 0);
    lg_novelty_options options;
    lg_novelty v;
    lg_novelty_options_init(&options);
    assert_told(lg_novelty_fit(NULL, &options, s, &w, chosen, count, threads, &v, &told));
    return *own_lg_novelty(v);
}

static lg_novelty fit(const lg_series *s) {
    return fit_on(s, NULL, s->count, 1);
}

static lg_novelty_result look(const lg_novelty *v, const float *x) {
    lg_novelty_result r;
    lg_novelty_eval(v, x, &r, NULL, lg_test_memory(lg_novelty_work_size(v)));
    return r;
}

static float *window(uint64_t seed, uint32_t class_index, double level, double noise) {
    float *x = TEST_ARRAY(float, CHANNELS *LENGTH);
    lg_rng rng = test_rng(seed, 9);
    simulate(&rng, class_index, level, noise, x);
    return x;
}

static const char *reason(const lg_novelty *v, const lg_novelty_result *r) {
    static char names[CHANNELS][LG_SERIES_NAME] = {"a", "b", ""}, text[256];
    (void)lg_novelty_explain(v, r, names, 10, text, sizeof text);
    return text;
}

/* The window must be novel because of this channel, with a reason that begins with this text. */
static void expect_novel(const lg_novelty *v, const float *x, const char *begin) {
    const lg_novelty_result r = look(v, x);
    if (!r.novel || strncmp(reason(v, &r), begin, strlen(begin)) != 0)
        fail_msg("novel %d, distance %g, %s; expected %s", r.novel, r.distance, reason(v, &r), begin);
}

TEST("windows of the same sensors are known, for both classes") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    size_t novel = 0, nearest = 0;
    for (uint64_t i = 0; i < 400; i++) {
        const lg_novelty_result r = look(&v, window(i, i % 2, 1 + (double)(i % 7) / 6, 1e-2));
        novel += r.novel;
        nearest += r.nearest == i % 2;
    }
    assert_in_range(novel, 0, 4);
    assert_in_range(nearest, 390, 400);
}

TEST("sensor faults are reported with the sensor's name") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    for (uint64_t seed = 0; seed < 20; seed++) {
        float *x = window(seed, seed % 2, 1.5, 1e-2);
        memset(x, 0, LENGTH * sizeof *x);
        expect_novel(&v, x, "a: stands still for 200 of 200 samples");
        x = window(seed, seed % 2, 1.5, 1e-2);
        for (uint32_t t = 100; t < LENGTH; t++) x[LENGTH + t] = x[LENGTH + 99];
        expect_novel(&v, x, "b: stands still for 101 of 200 samples");
        x = window(seed, seed % 2, 1.5, 1e-2);
        for (uint32_t t = 0; t < LENGTH; t++) x[t] *= 0.01f;
        expect_novel(&v, x, "a: standard deviation 0.0");
        x = window(seed, seed % 2, 1.5, 1e-2);
        for (uint32_t t = 0; t < LENGTH; t++) x[LENGTH + t] = fminf(fmaxf(x[LENGTH + t], -0.05f), 0.05f);
        expect_novel(&v, x, "b: ");
        x = window(seed, seed % 2, 1.5, 1e-2);
        for (uint32_t t = 0; t < LENGTH; t++) x[2 * LENGTH + t] += 3e5f * (float)sin(2 * PI * 0.3 * t);
        expect_novel(&v, x, "channel 3: standard deviation");
        assert_non_null(strstr(reason(&v, (lg_novelty_result[]){look(&v, x)}), ", amplitude from 2."));
        x = window(seed, seed % 2, 1.5, 1e-2);
        for (uint32_t t = 0; t < LENGTH; t++) x[t] = -x[t];
        expect_novel(&v, x, "");
        x = window(seed, seed % 2, 1.5, 1e-2);
        for (uint32_t t = 0; t < LENGTH; t++) x[2 * LENGTH + t] += 3e7f;
        expect_novel(&v, x, "channel 3: ");
    }
}

TEST("a clipped channel is reported even if its distances do not show it") {
    const lg_series s = make_windows(1, 1e-2);
    lg_novelty v = fit(&s);
    float *x = window(3, 0, 1.5, 1e-2);
    for (uint32_t g = 0; g < lg_novelty_groups(&v); g++) v.limit[g] = 1e300;
    for (uint32_t t = 0; t < LENGTH; t++) x[LENGTH + t] = fminf(x[LENGTH + t], 0.05f);
    const lg_novelty_result r = look(&v, x);
    assert_int_equal(r.cause, LG_NOVELTY_EXTREME);
    assert_int_equal(r.channel, 1);
    assert_true(r.novel && r.samples > LENGTH / 8 && r.distance < 1);
}

TEST("another noise level is novel, and is measured") {
    const lg_series s = make_windows(1, 0.1);
    const lg_novelty v = fit(&s);
    double features[256], ratio[CHANNELS], log_ratio[CHANNELS] = {0};
    for (uint64_t seed = 0; seed < 20; seed++) {
        lg_novelty_result r;
        const float *x = window(seed, 0, 1.5, 1);
        lg_novelty_eval(&v, x, &r, features, lg_test_memory(lg_novelty_work_size(&v)));
        assert_true(r.novel);
        lg_novelty_noise(&v, 0, features, ratio);
        for (uint32_t c = 0; c < CHANNELS; c++) log_ratio[c] += log(ratio[c]) / 20;
    }
    /* at high frequencies the channels contain almost only noise */
    assert_close(exp(log_ratio[0]), 10, 0.3, 0);
    assert_close(exp(log_ratio[2]), 10, 0.3, 0);
    assert_close(lg_novelty_noise_from(&v), 0.4375, 0.02, 0);
}

TEST("a value that is not finite is novel") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    const float wrong[] = {NAN, INFINITY, -INFINITY, 3e38f};
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        float *x = window(2, 0, 1.5, 1e-2);
        x[LENGTH + 17] = wrong[i];
        assert_true(look(&v, x).novel);
        assert_true(strlen(reason(&v, (lg_novelty_result[]){look(&v, x)})) > 5);
    }
}

/* ---- formulas ---- */

/* d' Sigma^-1 d for the features with keep[i], where Sigma is the inverse of `precision`. */
static double marginal(const lg_novelty *v, const double *difference, const bool *keep) {
    const int d = (int)v->features, one = 1;
    double *sigma = TEST_ARRAY(double, (size_t)d *d), *part = TEST_ARRAY(double, (size_t)d *d);
    double *right = TEST_ARRAY(double, d), sum = 0;
    int *index = TEST_ARRAY(int, d), count = 0, info;
    memcpy(sigma, v->precision, (size_t)d * d * sizeof *sigma);
    dpotrf_("L", &d, sigma, &d, &info);
    dpotri_("L", &d, sigma, &d, &info);
    assert_int_equal(info, 0);
    for (int i = 0; i < d; i++)
        if (keep[i]) index[count++] = i;
    for (int i = 0; i < count; i++) {
        right[i] = difference[index[i]];
        for (int j = 0; j < count; j++) {
            const int a = index[i] < index[j] ? index[i] : index[j], b = index[i] + index[j] - a;
            part[i * count + j] = sigma[a * d + b];
        }
    }
    dposv_("L", &count, &one, part, &count, right, &count, &info);
    assert_int_equal(info, 0);
    for (int i = 0; i < count; i++) sum += right[i] * difference[index[i]];
    return sum;
}

TEST("the distance of a group is Mahalanobis' distance minus the part that the other features explain") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    const size_t d = v.features;
    double *f = TEST_ARRAY(double, d), *difference = TEST_ARRAY(double, d), *work = TEST_ARRAY(double, 2 * d);
    double square[CHANNELS + 2];
    lg_novelty_result r;
    lg_novelty_eval(&v, window(5, 1, 1.2, 2e-2), &r, f, lg_test_memory(lg_novelty_work_size(&v)));
    for (size_t i = 0; i < d; i++) difference[i] = (f[i] - v.centre[i]) / v.spread[i];
    lg_novelty_distances(&v, 0, f, square, work);
    bool *keep = TEST_ARRAY(bool, d);
    for (uint32_t g = 0; g < lg_novelty_groups(&v); g++) {
        const novelty_group group = lg_novelty_group(&v, g);
        for (size_t i = 0; i < d; i++) keep[i] = g == 0 || i < group.first || i >= group.first + group.count;
        const double rest = marginal(&v, difference, keep);
        assert_close(square[g], g == 0 ? rest : square[0] - rest, 1e-8, 1e-8);
    }
}

TEST("features follow their definition") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    const float *x = window(5, 1, 1.2, 2e-2);
    double *f = TEST_ARRAY(double, v.features), z[CHANNELS][LENGTH], deviation[CHANNELS];
    lg_novelty_result r;
    lg_novelty_eval(&v, x, &r, f, lg_test_memory(lg_novelty_work_size(&v)));
    for (uint32_t c = 0; c < CHANNELS; c++) {
        double mean = 0, largest = 0;
        deviation[c] = 0;
        for (uint32_t t = 0; t < LENGTH; t++) mean += (x[c * LENGTH + t] - v.mean[c]) / v.scale[c] / LENGTH;
        for (uint32_t t = 0; t < LENGTH; t++) {
            z[c][t] = (x[c * LENGTH + t] - v.mean[c]) / v.scale[c] - mean;
            deviation[c] += z[c][t] * z[c][t] / LENGTH;
            largest = fmax(largest, fabs(z[c][t]));
        }
        deviation[c] = sqrt(deviation[c]);
        const double *own = f + c * (NOVELTY_BAND + v.bands);
        assert_close(own[NOVELTY_MEAN], mean, 1e-9, 1e-9);
        assert_close(own[NOVELTY_DEVIATION], log(deviation[c] + 1e-3), 1e-9, 1e-9);
        assert_close(own[NOVELTY_CREST], log((largest + 1e-3) / (deviation[c] + 1e-3)), 1e-9, 1e-9);
    }
    const double *pair = f + CHANNELS * (NOVELTY_BAND + v.bands);
    for (uint32_t a = 0; a < CHANNELS; a++)
        for (uint32_t b = a + 1; b < CHANNELS; b++) {
            double product = 0;
            for (uint32_t t = 0; t < LENGTH; t++) product += z[a][t] * z[b][t] / LENGTH;
            assert_close(tanh(*pair++), 0.999999 * product / (deviation[a] + 1e-3) / (deviation[b] + 1e-3),
                         1e-9, 1e-9);
        }
}

/* ---- fitting ---- */

TEST("the bits do not depend on the number of threads") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty one = fit_on(&s, NULL, s.count, 1), three = fit_on(&s, NULL, s.count, 3);
    const size_t d = one.features;
    assert_memory_equal(one.precision, three.precision, 2 * d * d * sizeof *one.precision);
    assert_memory_equal(one.limit, three.limit, lg_novelty_groups(&one) * sizeof *one.limit);
}

TEST("if one class alone is trained, the other one is novel") {
    const lg_series s = make_windows(1, 1e-2);
    uint32_t chosen[RUNS * EACH];
    size_t count = 0, novel = 0, known = 0;
    for (uint32_t i = 0; i < s.count; i++)
        if (s.label[i] == 0) chosen[count++] = i;
    const lg_novelty v = fit_on(&s, chosen, count, 1);
    assert_close(v.windows[0], (double)count, 0, 0);
    assert_close(v.windows[1], 0, 0, 0);
    for (uint64_t i = 0; i < 100; i++) {
        novel += look(&v, window(i, 1, 1.5, 1e-2)).novel;
        known += !look(&v, window(i, 0, 1.5, 1e-2)).novel;
    }
    assert_in_range(novel, 90, 100);
    assert_in_range(known, 98, 100);
}

TEST("a class of one window, a constant channel and few windows are allowed") {
    lg_series s = make_windows(1, 1e-2);
    for (uint32_t i = 0; i < s.count; i++) {
        s.label[i] = i == 5;
        for (uint32_t t = 0; t < LENGTH; t++) s.x[((size_t)i * CHANNELS + 1) * LENGTH + t] = 4;
    }
    const lg_novelty v = fit(&s);
    assert_close(v.windows[1], 1, 0, 0);
    float *x = window(2, 0, 1.5, 1e-2);
    for (uint32_t t = 0; t < LENGTH; t++) x[LENGTH + t] = 4;
    assert_false(look(&v, x).novel); /* as in training */
    x[LENGTH + 3] = 4.5f;
    expect_novel(&v, x, "b: ");
    const lg_novelty few = fit_on(&s, NULL, 8, 1);
    assert_true(isfinite(look(&few, x).distance));
}

TEST("an outlier among the training windows does not widen the limits") {
    lg_series s = make_windows(1, 1e-2);
    const lg_novelty clean = fit(&s);
    s.x[(size_t)77 * CHANNELS * LENGTH + 50] = 1e4f;
    const lg_novelty spoiled = fit(&s);
    assert_true(spoiled.limit[0] < 2 * clean.limit[0]);
    float *x = window(3, 0, 1.5, 1e-2);
    memset(x, 0, LENGTH * sizeof *x);
    assert_true(look(&spoiled, x).novel);
}

TEST("many channels have fewer bands and no pairs; short windows have no bands") {
    lg_series s = make_series(40, 100, 64, 1, false, false);
    lg_rng rng = test_rng(1, 1);
    for (size_t i = 0; i < s.count * 100 * 64; i++) s.x[i] = (float)lg_rng_normal(&rng);
    const lg_novelty wide = fit(&s);
    assert_int_equal(wide.pairs, 0);
    assert_int_equal(wide.bands, 7);
    assert_true(wide.features <= LG_NOVELTY_FEATURES);
    assert_false(look(&wide, s.x).novel);
    lg_series t = make_series(40, 2, 3, 1, false, false);
    for (size_t i = 0; i < t.count * 6; i++) t.x[i] = (float)lg_rng_normal(&rng);
    const lg_novelty brief = fit(&t);
    double ratio[2], *features = TEST_ARRAY(double, brief.features);
    lg_novelty_result r;
    assert_int_equal(brief.bands, 0);
    lg_novelty_eval(&brief, t.x, &r, features, lg_test_memory(lg_novelty_work_size(&brief)));
    assert_false(r.novel);
    lg_novelty_noise(&brief, 0, features, ratio);
    assert_close(ratio[1], 1, 0, 0);
}

TEST("data that cannot be fitted are refused with a message") {
    const lg_series s = make_windows(1, 1e-2), tiny = make_series(40, 2, 1, 1, false, false),
                    wide = make_series(10, LG_NOVELTY_FEATURES, 8, 1, false, false);
    const lg_windows w = cut_windows(&s, 0, 0), one = cut_windows(&tiny, 0, 0),
                     many = cut_windows(&wide, 0, 0);
    lg_novelty_options options;
    lg_novelty v;
    lg_error error;
    lg_novelty_options_init(&options);
    const struct {
        const lg_series *series;
        const lg_windows *windows;
        size_t count;
        const char *says;
    } wrong[] = {{&s, &w, 7, "7 windows"},
                 {&tiny, &one, 40, "fewer than two samples"},
                 {&wide, &many, 10, "channels"}};
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        assert_int_equal(lg_novelty_fit(NULL, &options, wrong[i].series, wrong[i].windows, NULL,
                                        wrong[i].count, 1, &v, &error),
                         LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, wrong[i].says));
    }
    lg_novelty_options bad[7];
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = options;
    bad[0].folds = 1, bad[1].size = 3, bad[2].quantile = 0, bad[3].quantile = 1.5, bad[4].margin = 0;
    bad[5].most = 1, bad[6].margin = NAN;
    for (size_t i = 0; i <= LG_COUNT(bad); i++) { /* the last turn: 0 threads */
        const lg_novelty_options *how = i < LG_COUNT(bad) ? &bad[i] : &options;
        assert_int_equal(lg_novelty_fit(NULL, how, &s, &w, NULL, s.count, how != &options, &v, &error),
                         LG_INVALID_ARGUMENT);
        assert_says(error.message, "options of novelty are out of range");
    }
    const volatile int stop = 1;
    lg_context_options cancelling;
    lg_context *context;
    lg_context_options_init(&cancelling);
    cancelling.cancel = &stop;
    assert_ok(lg_context_create(&cancelling, &context));
    assert_int_equal(lg_novelty_fit(context, &options, &s, &w, NULL, s.count, 1, &v, &error), LG_CANCELLED);
    lg_context_destroy(context);
    s.x[5] = NAN;
    assert_int_equal(lg_novelty_fit(NULL, &options, &s, &w, NULL, s.count, 1, &v, &error), LG_NOT_FINITE);
}

TEST("every allocation of a fit may fail") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_windows w = cut_windows(&s, 0, 0);
    lg_novelty_options options;
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    lg_novelty_options_init(&options);
    options.most = 40;
    long n = 1;
    for (;; n++) {
        lg_novelty v;
        lg_fail_alloc_arm(&memory, n);
        const lg_status status = lg_novelty_fit(context, &options, &s, &w, NULL, s.count, 1, &v, NULL);
        if (!lg_fail_alloc_hit(&memory)) {
            assert_int_equal(status, LG_OK);
            lg_novelty_destroy(&v);
            break;
        }
        assert_int_equal(status, LG_OUT_OF_MEMORY);
        assert_int_equal(lg_fail_alloc_live(&memory), 0);
    }
    assert_true(n > 20);
    lg_context_destroy(context);
}

/* ---- files ---- */

TEST("after saving and loading, the distances have the same bits") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    memory_archive archive = {.count = 0};
    const lg_archive_writer writer = memory_writer(&archive);
    const lg_archive_reader reader = memory_reader(&archive);
    lg_novelty again;
    lg_error error;
    assert_int_equal(lg_novelty_load(NULL, &reader, &again, &error), LG_NOT_FOUND);
    assert_ok(lg_novelty_save(&v, &writer, &error));
    assert_ok(lg_novelty_load(NULL, &reader, &again, &error));
    (void)own_lg_novelty(again);
    for (size_t i = 1; i < archive.count; i++) {
        memory_archive full = {.fail_after = i};
        const lg_archive_writer no_room = memory_writer(&full);
        assert_int_equal(lg_novelty_save(&v, &no_room, &error), LG_FILE);
        assert_says(error.message, "could not be saved");
    }
    for (uint64_t seed = 0; seed < 10; seed++) {
        const float *x = window(seed, seed % 2, 1.5, 1e-2);
        const lg_novelty_result a = look(&v, x), b = look(&again, x);
        assert_close(a.distance, b.distance, 0, 0);
        assert_true(a.nearest == b.nearest && a.feature == b.feature && a.cause == b.cause);
    }
}

TEST("a damaged file is refused") {
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    const struct {
        const char *path;
        double value; /* replaces the first entry */
        lg_status status;
    } wrong[] = {{"novelty/scale", 0, LG_FORMAT},        {"novelty/limit", -1, LG_FORMAT},
                 {"novelty/centre", NAN, LG_NOT_FINITE}, {"novelty/precision", -1, LG_FORMAT},
                 {"novelty/spread", 0, LG_FORMAT},       {"novelty/still", INFINITY, LG_NOT_FINITE}};
    for (size_t i = 0; i < LG_COUNT(wrong) + 3; i++) {
        memory_archive archive = {.count = 0};
        const lg_archive_writer writer = memory_writer(&archive);
        const lg_archive_reader reader = memory_reader(&archive);
        lg_novelty again;
        lg_error error = {LG_OK, ""};
        lg_status expected = LG_FORMAT;
        assert_ok(lg_novelty_save(&v, &writer, &error));
        if (i < LG_COUNT(wrong)) {
            *(double *)memory_find(&archive, wrong[i].path)->data = wrong[i].value;
            expected = wrong[i].status;
        } else if (i == LG_COUNT(wrong)) {
            *(uint32_t *)memory_find(&archive, "novelty/bands")->data = 9; /* the shapes do not fit */
        } else if (i == LG_COUNT(wrong) + 1) {
            *(uint32_t *)memory_find(&archive, "novelty/channels")->data = 1u << 30;
        } else {
            memory_find(&archive, "novelty/windows")->path[9] = 'x';
        }
        assert_int_equal(lg_novelty_load(NULL, &reader, &again, &error), expected);
        assert_true(error.message[0] != '\0' && again.channels == 0);
    }
}

TEST("a file whose sizes contradict each other is refused") {
    static const struct {
        const char *path;
        uint32_t value;
    } wrong[] = {{"novelty/channels", 0},
                 {"novelty/length", 0},
                 {"novelty/length", 1},
                 {"novelty/length", UINT32_MAX},
                 {"novelty/classes", 0},
                 {"novelty/classes", 65537},
                 {"novelty/bands", UINT32_MAX / 2},
                 {"novelty/channels", LG_NOVELTY_FEATURES}};
    const lg_series s = make_windows(1, 1e-2);
    const lg_novelty v = fit(&s);
    for (size_t i = 0; i <= LG_COUNT(wrong); i++) {
        memory_archive archive = {.count = 0};
        const lg_archive_writer writer = memory_writer(&archive);
        const lg_archive_reader reader = memory_reader(&archive);
        lg_novelty again;
        lg_error error = {LG_OK, ""};
        assert_ok(lg_novelty_save(&v, &writer, &error));
        if (i < LG_COUNT(wrong))
            *(uint32_t *)memory_find(&archive, wrong[i].path)->data = wrong[i].value;
        else
            memory_find(&archive, "novelty/scale")->rank = 2;
        assert_int_equal(lg_novelty_load(NULL, &reader, &again, &error), LG_FORMAT);
        assert_says(error.message, i < LG_COUNT(wrong) ? "not possible together" : "novelty/scale");
    }
}
