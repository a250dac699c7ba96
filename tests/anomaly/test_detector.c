/* Detectors: scaling, losses compared with direct formulas, learning to separate two sounds, equal bits for
 * any number of threads and interruptions, refusals. */
#include "anomaly/series_support.h"
#include "nn/nn_support.h"

/* ---- a small data set: noisy sines, with one frequency per class ---- */

enum { CHANNELS = 2, LENGTH = 40 };

typedef struct sounds {
    lg_series series;
    lg_windows windows;
    lg_scaler scaler;
    uint32_t *chosen; /* training part, then test part */
    size_t training;
} sounds;

static double frequency(uint32_t label) {
    static const double cycles[] = {0.05, 0.2, 0.4};
    return 6.283185307179586 * cycles[label];
}

/* With two classes and rare > 0, `rare` of every ten windows have class 1. */
static sounds make_sounds(size_t count, uint32_t classes, size_t rare, double noise, bool centred) {
    sounds s = {.series = make_series(count, CHANNELS, LENGTH, classes, false, false)};
    lg_rng rng = test_rng(31, 0);
    for (size_t i = 0; i < count; i++) {
        const uint32_t label = rare > 0 ? i % 10 < rare : (uint32_t)(i % classes);
        s.series.label[i] = label;
        for (size_t c = 0; c < CHANNELS; c++) {
            const double phase = 6.3 * lg_rng_uniform(&rng);
            for (size_t t = 0; t < LENGTH; t++)
                s.series.x[(i * CHANNELS + c) * LENGTH + t] =
                    (float)(100.0 * (double)c + (c + 0.5) * (sin(frequency(label) * (double)t + phase) +
                                                             noise * lg_rng_normal(&rng)));
        }
    }
    s.windows = cut_windows(&s.series, 0, 0);
    uint8_t *parts = TEST_ARRAY(uint8_t, count);
    s.chosen = TEST_ARRAY(uint32_t, count);
    assert_ok(lg_series_split(NULL, &s.series, &s.windows, LG_SPLIT_RANDOM, count > 9 ? 0.3 : 0.0, 0.0, 1,
                              parts, NULL));
    size_t at = 0;
    for (int part = LG_PART_TRAIN; part <= LG_PART_TEST; part++) {
        for (size_t i = 0; i < count; i++)
            if (parts[i] == part) s.chosen[at++] = (uint32_t)i;
        if (part == LG_PART_TRAIN) s.training = at;
    }
    s.scaler = fit_scaler(&s.series, &s.windows, s.chosen, s.training, centred);
    return s;
}

static lg_cnn default_net(uint32_t channels, uint32_t length, uint32_t outputs, lg_activation activation) {
    lg_cnn net;
    lg_cnn_init_default(&net, channels, length, outputs, activation);
    return net;
}

static lg_detector make_detector(uint32_t classes, lg_detector_loss loss, bool centred) {
    const uint32_t outputs = loss == LG_DETECTOR_MSE ? 1 : classes;
    const lg_detector model = {.net = default_net(CHANNELS, LENGTH, outputs, LG_SWISH),
                               .classes = classes,
                               .loss = loss,
                               .centred = centred};
    assert_told(lg_detector_check(&model, &told));
    return model;
}

static double *start_of(const lg_detector *model) {
    lg_rng rng = test_rng(32, 0);
    double *theta = TEST_ARRAY(double, lg_cnn_parameters(&model->net));
    lg_cnn_initialise(&model->net, &rng, theta);
    return theta;
}

static lg_detector_data data_of(const sounds *s, const lg_detector *model, size_t count, lg_dtype dtype) {
    lg_detector_data data;
    assert_told(lg_detector_data_create(NULL, model, &s->scaler, &s->series, &s->windows, s->chosen, count,
                                        dtype, &data, &told));
    return *own_lg_detector_data(data);
}

/* ---- scaling ---- */

TEST("windows are scaled by channel, and centred by their own mean if asked") {
    for (int centred = 0; centred < 2; centred++)
        for (int dtype = LG_F64; dtype <= LG_F32; dtype++) {
            sounds s = make_sounds(20, 2, 0, 0.1, centred);
            const lg_detector model = make_detector(2, LG_DETECTOR_MSE, centred);
            lg_detector_data data = data_of(&s, &model, s.training, (lg_dtype)dtype);
            double sum[CHANNELS] = {0}, squares[CHANNELS] = {0};
            assert_int_equal(data.count, s.training);
            for (size_t i = 0; i < data.count; i++) {
                assert_int_equal(data.label[i], s.series.label[s.chosen[i]]);
                for (size_t c = 0; c < CHANNELS; c++) {
                    const float *x = s.series.x + (s.chosen[i] * CHANNELS + c) * LENGTH;
                    double own = 0.0;
                    for (size_t t = 0; t < LENGTH; t++) own += (double)x[t] / LENGTH;
                    for (size_t t = 0; t < LENGTH; t++) {
                        const size_t at = (i * LENGTH + t) * CHANNELS + c;
                        const double z =
                            dtype == LG_F64 ? ((double *)data.x)[at] : (double)((float *)data.x)[at];
                        const double mean = centred ? own : s.scaler.mean[c];
                        assert_close(z, ((double)x[t] - mean) / s.scaler.scale[c], 1e-7,
                                     dtype == LG_F64 ? 1e-11 : 1e-7);
                        sum[c] += z;
                        squares[c] += z * z;
                    }
                }
            }
            for (size_t c = 0; c < CHANNELS; c++) {
                assert_close(sum[c] / (double)(data.count * LENGTH), 0.0, 0, 1e-6);
                assert_close(squares[c] / (double)(data.count * LENGTH), 1.0, 1e-5, 0);
            }
        }
}

/* ---- evaluation and loss ---- */

static void probabilities(const lg_detector *model, const sounds *s, lg_dtype dtype, const double *theta,
                          uint32_t window, double *probability, double *plane) {
    lg_detector_plan *plan;
    float x[CHANNELS * LENGTH];
    assert_ok(lg_detector_plan_create(NULL, model, &s->scaler, theta, dtype, &plan, NULL));
    lg_windows_copy(&s->series, &s->windows, window, x);
    lg_detector_eval(plan, x, probability, plane, test_work(lg_detector_work_size(plan)));
    lg_detector_plan_destroy(plan);
}

/* The loss as defined in the header, computed from the probabilities. */
static double direct_loss(const lg_detector *model, const sounds *s, const double *theta,
                          const uint32_t *samples, size_t count) {
    double sum = 0.0, p[3];
    for (size_t i = 0; i < count; i++) {
        const uint32_t window = s->chosen[samples[i]], label = s->series.label[window];
        probabilities(model, s, LG_F64, theta, window, p, NULL);
        double total = 0.0;
        for (uint32_t c = 0; c < model->classes; c++) total += p[c];
        assert_close(total, 1.0, 1e-14, 0);
        sum += model->loss == LG_DETECTOR_MSE ? (p[1] - label) * (p[1] - label) : -log(p[label]);
    }
    return sum;
}

TEST("losses follow from the probabilities, in both types and over parts of a batch") {
    static const uint32_t samples[] = {4, 0, 11, 5, 5};
    for (int which = 0; which < 3; which++) {
        const uint32_t classes = which == 2 ? 3 : 2;
        const lg_detector model =
            make_detector(classes, which == 0 ? LG_DETECTOR_MSE : LG_DETECTOR_CROSS_ENTROPY, true);
        sounds s = make_sounds(30, classes, 0, 0.2, true);
        double *theta = start_of(&model);
        for (int dtype = LG_F64; dtype <= LG_F32; dtype++)
            for (int stored = LG_F64; stored <= LG_F32; stored++) {
                lg_detector_data data = data_of(&s, &model, s.training, (lg_dtype)stored);
                const lg_detector_problem problem = {&model, &data, s.training, 1};
                lg_fit_problem fit;
                lg_detector_fit_problem(&problem, &fit);
                assert_int_equal(fit.parameters, lg_cnn_parameters(&model.net));
                assert_int_equal(fit.samples, s.training);
                assert_int_equal(fit.validation, 0);
                lg_tape *tape = test_tape((lg_dtype)dtype);
                const lg_var flat = lg_input_f64(tape, lg_shape1((uint32_t)fit.parameters), theta);
                for (size_t count = 1; count <= 5; count += 4) {
                    lg_var loss;
                    double value;
                    assert_ok(fit.loss(fit.user, tape, flat, samples, count, 5, &loss));
                    assert_ok(lg_read(tape, loss, 1, &value));
                    const double rtol = dtype == LG_F64 && stored == LG_F64 ? 1e-12 : 1e-5;
                    assert_close(value, direct_loss(&model, &s, theta, samples, count) / 5.0, rtol, 0);
                }
            }
    }
}

TEST("single precision agrees with double, and logits beyond the range of exp are harmless") {
    for (int loss = 0; loss < LG_DETECTOR_LOSS_COUNT; loss++) {
        const lg_detector model = make_detector(2, (lg_detector_loss)loss, false);
        sounds s = make_sounds(10, 2, 0, 0.2, false);
        double *theta = start_of(&model), p[2], q[2], plane[2], plane32[2];
        for (uint32_t i = 0; i < 10; i++) {
            probabilities(&model, &s, LG_F64, theta, i, p, plane);
            probabilities(&model, &s, LG_F32, theta, i, q, plane32);
            for (int c = 0; c < 2; c++) {
                assert_true(p[c] > 0.0 && p[c] < 1.0);
                assert_close(q[c], p[c], 1e-5, 0);
                assert_close(plane32[c], plane[c], 1e-4, 1e-5);
            }
        }
        const size_t last = lg_cnn_parameters(&model.net) - 1;
        theta[last] = 5000.0; /* the bias of the output layer */
        probabilities(&model, &s, LG_F64, theta, 0, p, NULL);
        assert_close(p[0], 0.0, 0, 0);
        assert_close(p[1], 1.0, 0, 0);
        theta[last] = -300.0;
        probabilities(&model, &s, LG_F64, theta, 0, p, NULL);
        assert_close(p[0], 1.0, 0, 0);
        assert_true(p[1] > 0.0 && p[1] < 1e-120);
    }
}

/* ---- training ---- */

static lg_fit *run_detector(const lg_detector_problem *problem, uint64_t epochs, size_t batch, int threads) {
    lg_fit_problem fit_problem;
    lg_fit_options options;
    lg_detector_fit_problem(problem, &fit_problem);
    lg_fit_options_init(&options);
    lg_fit_settings_apply(&lg_detector_preset_find("best", NAN)->training, &options);
    options.epochs = epochs;
    options.batch = batch;
    options.threads = threads;
    options.adam.lr = 1e-2;
    options.keep_best = true;
    lg_fit *fit = test_fit(NULL, &fit_problem, &options, start_of(problem->model));
    run_fit(fit);
    return fit;
}

/* Number of chosen windows, from `first` on, that are classified correctly. */
static size_t told_right(const lg_detector *model, const sounds *s, const lg_fit *fit, size_t first) {
    double *theta = TEST_ARRAY(double, lg_cnn_parameters(&model->net)), p[3];
    size_t right = 0;
    lg_fit_parameters(fit, theta);
    for (size_t i = first; i < s->series.count; i++) {
        uint32_t best = 0;
        probabilities(model, s, LG_F32, theta, s->chosen[i], p, NULL);
        for (uint32_t c = 1; c < model->classes; c++)
            if (p[c] > p[best]) best = c;
        right += best == s->series.label[s->chosen[i]];
    }
    return right;
}

TEST("all test windows are classified correctly: with both losses, three classes, and one class in ten") {
    static const struct {
        uint32_t classes;
        size_t rare;
        lg_detector_loss loss;
        bool centred;
    } cases[] = {{2, 0, LG_DETECTOR_MSE, false},
                 {2, 0, LG_DETECTOR_CROSS_ENTROPY, true},
                 {3, 0, LG_DETECTOR_CROSS_ENTROPY, false},
                 {2, 1, LG_DETECTOR_CROSS_ENTROPY, false}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        sounds s = make_sounds(160, cases[i].classes, cases[i].rare, 0.2, cases[i].centred);
        const lg_detector model = make_detector(cases[i].classes, cases[i].loss, cases[i].centred);
        lg_detector_data data = data_of(&s, &model, s.training, LG_F32);
        const lg_detector_problem problem = {&model, &data, s.training, 1};
        lg_fit *fit = run_detector(&problem, 60, 10, 1);
        assert_int_equal(told_right(&model, &s, fit, s.training), s.series.count - s.training);
    }
}

TEST("a fit gives the same bits for any number of threads") {
    sounds s = make_sounds(60, 2, 0, 0.3, false);
    const lg_detector model = make_detector(2, LG_DETECTOR_CROSS_ENTROPY, false);
    lg_detector_data data = data_of(&s, &model, s.series.count, LG_F32);
    const lg_detector_problem problem = {&model, &data, s.training, 1};
    lg_fit_problem fit_problem;
    lg_detector_fit_problem(&problem, &fit_problem);
    assert_int_equal(fit_problem.validation, s.series.count - s.training);
    assert_same_fits(run_detector(&problem, 6, 7, 1), run_detector(&problem, 6, 7, 2));
}

TEST("one sample, batches of one window and a single class are allowed") {
    static const size_t counts[] = {1, 2, 5};
    for (size_t i = 0; i < 3; i++)
        for (size_t batch = 0; batch < 2; batch++) {
            sounds s = {.series = make_series(counts[i], 1, 1 + (uint32_t)i, 2, false, false)};
            for (size_t j = 0; j < counts[i]; j++) s.series.label[j] = 0;
            for (size_t j = 0; j < counts[i] * (1 + i); j++) s.series.x[j] = (float)j;
            s.windows = cut_windows(&s.series, 0, 0);
            s.scaler = fit_scaler(&s.series, &s.windows, NULL, counts[i], true);
            const lg_detector model = {.net = default_net(1, 1 + (uint32_t)i, 2, LG_RELU),
                                       .classes = 2,
                                       .loss = LG_DETECTOR_CROSS_ENTROPY,
                                       .centred = true};
            assert_ok(lg_detector_check(&model, NULL));
            lg_detector_data data = data_of(&s, &model, 0, LG_F32);
            assert_int_equal(data.count, counts[i]);
            const lg_detector_problem problem = {&model, &data, data.count, 1};
            assert_true(isfinite(lg_fit_loss(run_detector(&problem, 3, batch, 1))));
        }
}

/* ---- settings ---- */

TEST("the presets have their published settings, and losses have their names") {
    static const struct {
        double noise, lr, decay;
        uint64_t batch;
        lg_activation activation;
    } rows[] = {{1, 2.562e-2, 1.243e-5, 30, LG_LEAKY_RELU},  {0, 2.562e-2, 1.243e-5, 30, LG_LEAKY_RELU},
                {10, 2.102e-3, 1.221e-5, 10, LG_LEAKY_RELU}, {20, 2.102e-3, 1.221e-5, 10, LG_LEAKY_RELU},
                {50, 1.017e-2, 1.52e-7, 30, LG_SWISH},       {1e9, 1.017e-2, 1.52e-7, 30, LG_SWISH}};
    for (size_t i = 0; i < 6; i++) {
        const lg_detector_preset *p = lg_detector_preset_find("thesis", rows[i].noise);
        assert_non_null(p);
        assert_close(p->training.lr, rows[i].lr, 0, 0);
        assert_close(p->training.weight_decay, rows[i].decay, 0, 0);
        assert_int_equal(p->training.batch, rows[i].batch);
        assert_int_equal(p->activation, rows[i].activation);
        assert_int_equal(p->loss, LG_DETECTOR_MSE);
        assert_int_equal(p->training.epochs, 100);
        assert_int_equal(p->training.schedule, LG_SCHEDULE_CONSTANT);
        assert_int_equal(p->training.dtype, LG_F32);
        assert_string_equal(p->source, "table 6.5");
    }
    assert_close(lg_detector_preset_find("best", 11.0)->noise, 10, 0, 0);
    assert_close(lg_detector_preset_find("best", 50.0)->training.weight_decay, 1e-3, 0, 0);
    assert_true(
        isnan(lg_detector_preset_find("best", NAN)->noise)); /* data of unknown noise have their own row */
    assert_close(lg_detector_preset_find("thesis", NAN)->noise, 1, 0, 0);
    assert_null(lg_detector_preset_find("worst", 1.0));
    assert_null(lg_detector_preset_find(NULL, 1.0));
    ASSERT_NAMES(lg_detector_loss, lg_detector_loss, LG_DETECTOR_LOSS_COUNT);
}

/* ---- bad input ---- */

TEST("a detector that does not fit its network or loss is refused") {
    const lg_detector good = make_detector(2, LG_DETECTOR_MSE, false);
    lg_detector bad[6] = {good, good, good, good, good, good};
    static const char *const sentences[6] = {"at least 2 classes", "cross-entropy", "2 outputs",
                                             "lg_cnn_init",        "unknown loss",  "kernel"};
    bad[0].classes = 1;
    bad[1].classes = 3;
    bad[2].net = default_net(CHANNELS, LENGTH, 2, LG_SWISH);
    bad[3].net.lengths[1] = 7;
    bad[4].loss = (lg_detector_loss)LG_DETECTOR_LOSS_COUNT;
    bad[5].net.block[0].kernel = 41;
    for (size_t i = 0; i < 6; i++) {
        lg_error error;
        assert_status(lg_detector_check(&bad[i], &error), LG_INVALID_ARGUMENT);
        if (strstr(error.message, sentences[i]) == NULL) fail_msg("%s", error.message);
    }
}

TEST("series, scalers and choices that do not fit the detector are refused") {
    sounds s = make_sounds(10, 3, 0, 0.1, false);
    const lg_detector model = make_detector(3, LG_DETECTOR_CROSS_ENTROPY, false);
    const lg_detector two = make_detector(2, LG_DETECTOR_MSE, false);
    lg_detector longer = model, wider = model;
    lg_scaler narrow = s.scaler, tiny = s.scaler;
    static const uint32_t beyond[] = {0, 10};
    double scale[CHANNELS] = {1e-300, 1};
    longer.net = default_net(CHANNELS, LENGTH + 1, 3, LG_SWISH);
    wider.net = default_net(CHANNELS + 1, LENGTH, 3, LG_SWISH);
    narrow.channels = 1;
    tiny.scale = scale;
    const struct {
        const lg_detector *model;
        const lg_scaler *scaler;
        const uint32_t *chosen;
        size_t count;
        lg_status status;
        const char *word;
    } cases[] = {
        {&longer, &s.scaler, NULL, 0, LG_SHAPE, ""},
        {&wider, &s.scaler, NULL, 0, LG_SHAPE, "3 channels"},
        {&two, &s.scaler, NULL, 0, LG_SHAPE, "class 2"},
        {&model, &narrow, NULL, 0, LG_SHAPE, ""},
        {&model, &s.scaler, beyond, 2, LG_INVALID_ARGUMENT, ""},
        {&model, &s.scaler, beyond, 0, LG_INVALID_ARGUMENT, ""},
        {NULL, &s.scaler, NULL, 0, LG_INVALID_ARGUMENT, ""},
        {&model, &tiny, NULL, 0, LG_NOT_FINITE, ""}, /* zero as floats */
        {&model, &s.scaler, NULL, 0, LG_NOT_FINITE, ""},
    };
    lg_detector_data data = {.count = 5};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_error error = {LG_OK, ""};
        if (i + 1 == LG_COUNT(cases)) s.series.x[77] = NAN;
        assert_status(lg_detector_data_create(NULL, cases[i].model, cases[i].scaler, &s.series, &s.windows,
                                              cases[i].chosen, cases[i].count, LG_F32, &data, &error),
                      cases[i].status);
        if (strstr(error.message, cases[i].word) == NULL) fail_msg("%zu: %s", i, error.message);
        assert_int_equal(data.count, 5);
    }
    s.series.x[77] = 0;
    s.scaler = tiny;
    assert_int_equal(data_of(&s, &model, 10, LG_F64).count, 10);
}

TEST("a training part that does not fit the data is refused when the fit is made") {
    sounds s = make_sounds(10, 2, 0, 0.1, false);
    const lg_detector model = make_detector(2, LG_DETECTOR_MSE, false);
    lg_detector_data data = data_of(&s, &model, 10, LG_F32);
    double *theta = start_of(&model);
    static const size_t parts[] = {0, 11};
    for (size_t i = 0; i < 2; i++) {
        const lg_detector_problem problem = {&model, &data, parts[i], 1};
        lg_fit_problem fit_problem;
        lg_fit *fit = NULL;
        lg_detector_fit_problem(&problem, &fit_problem);
        assert_status(lg_fit_create(NULL, &fit_problem, NULL, theta, &fit, NULL), LG_INVALID_ARGUMENT);
        assert_null(fit);
    }
}

TEST("every allocation may fail, and nothing leaks") {
    sounds s = make_sounds(10, 2, 0, 0.1, false);
    const lg_detector model = make_detector(2, LG_DETECTOR_MSE, false);
    EVERY_ALLOCATION_FAILS(context, 3, {
        lg_detector_data data = {.count = 3};
        status = lg_detector_data_create(context, &model, &s.scaler, &s.series, &s.windows, NULL, 0, LG_F32,
                                         &data, NULL);
        if (status == LG_OK)
            lg_detector_data_destroy(&data);
        else
            assert_int_equal(data.count, 3);
    });
}

/* ---- dead units ---- */

/* Adds `value` to the biases from..to - 1 of slice `name`. */
static void shift(const lg_detector *model, double *theta, const char *name, size_t from, size_t to,
                  double value) {
    lg_slice_info info;
    for (uint32_t i = 0; lg_cnn_slice(&model->net, i, &info); i++)
        if (strcmp(info.name, name) == 0)
            for (size_t j = from; j < to; j++) theta[info.offset + j] += value;
}

static lg_detector detector_with(lg_activation activation) {
    lg_detector model = make_detector(2, LG_DETECTOR_MSE, false);
    model.net.activation = activation;
    return model;
}

static void assert_layer(const lg_detector_units *units, uint32_t layer, uint32_t all, uint32_t constant,
                         uint32_t zero) {
    assert_int_equal(units->layer[layer].units, all);
    assert_int_equal(units->layer[layer].constant, constant);
    assert_int_equal(units->layer[layer].zero, zero);
}

TEST("units with the same value for all windows are counted per layer") {
    sounds s = make_sounds(40, 2, 0, 0.2, false);
    lg_detector_units units;
    for (int dtype = LG_F64; dtype <= LG_F32; dtype++) {
        const lg_detector living = detector_with(LG_SWISH);
        lg_detector_data data = data_of(&s, &living, s.training, (lg_dtype)dtype);
        lg_detector_problem problem = {&living, &data, s.training, 1};
        assert_ok(lg_detector_count_units(&problem, start_of(&living), &units));
        assert_int_equal(units.layers, 4);
        assert_false(units.died);
        for (uint32_t i = 0; i < 4; i++) assert_layer(&units, i, i < 3 ? 4u << i : 2, 0, 0);

        /* In the first layer 3 of 4 units are zero, in the plane 1 of 2: no layer is completely dead. */
        const lg_detector relu = detector_with(LG_RELU);
        double *theta = start_of(&relu);
        problem.model = &relu;
        shift(&relu, theta, "conv1/bias", 0, 4, 10.0);
        shift(&relu, theta, "conv1/bias", 1, 4, -1e6);
        shift(&relu, theta, "plane/bias", 0, 2, 10.0);
        shift(&relu, theta, "plane/bias", 1, 2, -1e6);
        assert_ok(lg_detector_count_units(&problem, theta, &units));
        assert_layer(&units, 0, 4, 3, 3);
        assert_layer(&units, 3, 2, 1, 1);
        assert_false(units.died);
        shift(&relu, theta, "plane/bias", 0, 1, -1e6);
        assert_ok(lg_detector_count_units(&problem, theta, &units));
        assert_layer(&units, 3, 2, 2, 2);
        assert_true(units.died);

        /* Saturated units: constant, but not zero. */
        const lg_detector tanh_ = detector_with(LG_TANH);
        theta = start_of(&tanh_);
        problem.model = &tanh_;
        shift(&tanh_, theta, "conv2/bias", 0, 8, -1e3);
        assert_ok(lg_detector_count_units(&problem, theta, &units));
        assert_layer(&units, 1, 8, 8, 0);
        assert_true(units.died);
    }
}

/* A unit with the same value for most windows is not dead. There are more windows than are evaluated at
 * once. */
TEST("a dead unit is constant for all training windows, and test windows do not count") {
    sounds s = make_sounds(2 * LG_FIT_CHUNK, 2, 0, 0.2, false);
    const lg_detector relu = detector_with(LG_RELU);
    lg_detector_data data = data_of(&s, &relu, s.training, LG_F64);
    double *theta = start_of(&relu), *x = data.x;
    lg_detector_units units;
    const size_t numbers = CHANNELS * LENGTH, last = data.count - 1;
    shift(&relu, theta, "conv1/bias", 0, 4, -100.0);
    for (size_t i = 0; i < numbers; i++) x[last * numbers + i] *= 1e4;
    const lg_detector_problem all = {&relu, &data, data.count, 1}, rest = {&relu, &data, last, 1};
    assert_ok(lg_detector_count_units(&all, theta, &units));
    assert_true(units.layer[0].constant < 4);
    assert_ok(lg_detector_count_units(&rest, theta, &units));
    assert_layer(&units, 0, 4, 4, 4);
    assert_true(units.died);
    const lg_detector_problem one = {&relu, &data, 1, 1};
    assert_ok(lg_detector_count_units(&one, theta, &units));
    assert_false(units.died);

    /* Unit values at their maximum for all windows but the first. */
    const lg_detector tanh_ = detector_with(LG_TANH);
    const lg_detector_problem saturated = {&tanh_, &data, last, 1};
    theta = start_of(&tanh_);
    shift(&tanh_, theta, "conv1/bias", 0, 4, 100.0);
    for (size_t i = 0; i < numbers; i++) x[i] *= 1e4;
    assert_ok(lg_detector_count_units(&saturated, theta, &units));
    assert_true(units.layer[0].constant < 4);
}

static lg_fit *run_dead(const lg_detector_problem *problem, uint32_t restarts, double bias) {
    lg_fit_problem fit_problem;
    lg_fit_options options = options_of(60, 10);
    double *theta = TEST_ARRAY(double, lg_cnn_parameters(&problem->model->net));
    lg_detector_initialise(problem->model, problem->seed, 0, theta);
    shift(problem->model, theta, "plane/bias", 0, 2, bias);
    lg_detector_fit_problem(problem, &fit_problem);
    options.dtype = LG_F32;
    options.restarts = restarts;
    lg_fit *fit = test_fit(NULL, &fit_problem, &options, theta);
    run_fit(fit);
    return fit;
}

TEST("a network that died starts again with the next weights of its seed, and learns") {
    sounds s = make_sounds(160, 2, 0, 0.2, false);
    const lg_detector model = detector_with(LG_RELU);
    lg_detector_data data = data_of(&s, &model, s.training, LG_F32);
    const size_t n = lg_cnn_parameters(&model.net);
    double *theta = TEST_ARRAY(double, n), *other = TEST_ARRAY(double, n);
    lg_detector_units units;
    bool dead;
    /* Finds a seed whose first two draws are not dead. */
    lg_detector_problem problem = {&model, &data, s.training, 0};
    do {
        problem.seed++;
        lg_detector_initialise(&model, problem.seed, 1, theta);
        assert_ok(lg_detector_count_units(&problem, theta, &units));
    } while (units.layer[3].constant > 0);
    lg_fit *left = run_dead(&problem, 0, -1e3), *again = run_dead(&problem, 3, -1e3);
    assert_int_equal(lg_fit_restarts(left), 0);
    assert_int_equal(lg_fit_restarts(again), 1);
    lg_fit_parameters(left, theta);
    assert_ok(lg_detector_count_units(&problem, theta, &units));
    assert_true(units.died);
    lg_fit_parameters(again, theta);
    assert_ok(lg_detector_count_units(&problem, theta, &units));
    assert_false(units.died);
    assert_int_equal(told_right(&model, &s, again, s.training), s.series.count - s.training);
    assert_true(told_right(&model, &s, left, s.training) < s.series.count - s.training);

    /* Draws come one after another from the same generator. */
    lg_rng rng = test_rng(5, 1);
    for (uint64_t draw = 0; draw < 3; draw++) {
        lg_cnn_initialise(&model.net, &rng, theta);
        lg_detector_initialise(&model, 5, draw, other);
        assert_memory_equal(theta, other, n * sizeof *theta);
    }
    lg_fit_problem fit_problem;
    lg_detector_fit_problem(&problem, &fit_problem);
    shift(&model, theta, "plane/bias", 0, 2, -1e3);
    assert_ok(fit_problem.revive(fit_problem.user, 2, theta, &dead));
    lg_detector_initialise(&model, problem.seed, 2, other);
    assert_true(dead);
    assert_memory_equal(theta, other, n * sizeof *theta);
    /* A network that is not dead is not changed. */
    const lg_detector swish = detector_with(LG_SWISH);
    problem.model = &swish;
    assert_ok(fit_problem.revive(fit_problem.user, 1, theta, &dead));
    assert_false(dead);
    assert_memory_equal(theta, other, n * sizeof *theta);
}

TEST("every allocation while counting units may fail, and nothing leaks") {
    sounds s = make_sounds(10, 2, 0, 0.1, false);
    const lg_detector model = make_detector(2, LG_DETECTOR_MSE, false);
    lg_detector_data data = data_of(&s, &model, s.training, LG_F32);
    double *theta = start_of(&model);
    EVERY_ALLOCATION_FAILS(context, 4, {
        lg_detector_data borrowed = data;
        lg_detector_units units = {.layers = 77};
        borrowed.context = context;
        const lg_detector_problem problem = {&model, &borrowed, borrowed.count, 1};
        status = lg_detector_count_units(&problem, theta, &units);
        if (status != LG_OK) assert_int_equal(units.layers, 77);
    });
}
