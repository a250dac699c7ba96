/* The training loop: steps compared with plain loops, convergence, equal bytes for any number of threads and
 * interruptions, validation and best epoch, and what stops it.
 * ctest-labels: isa */
#include "nn_support.h"

#include "nn/fit_internal.h"

static lg_fit *run_regression(regression *r, const lg_fit_options *o) {
    lg_fit *fit = regression_fit(NULL, r, o);
    run_fit(fit);
    return fit;
}

/* ---- comparison with plain loops: a line a x + b through 7 points, batches of 3, 3 and 1 ---- */
typedef struct line {
    double x[7], t[7];
} line;

static lg_status line_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *loss) {
    const line *data = user;
    double x[7], t[7];
    for (size_t i = 0; i < count; i++) {
        x[i] = data->x[samples[i]];
        t[i] = data->t[samples[i]];
    }
    const lg_shape shape = lg_shape1((uint32_t)count);
    const lg_var a = lg_slice(tape, theta, 0, 0, 1), b = lg_slice(tape, theta, 0, 1, 1);
    const lg_var y = lg_add(tape, lg_mul(tape, a, lg_input_f64(tape, shape, x)), b);
    const lg_var d = lg_sub(tape, y, lg_input_f64(tape, shape, t));
    *loss = lg_scale(tape, lg_sum(tape, lg_square(tape, d)), 1.0 / (double)batch);
    return LG_OK;
}

static const line points = {{-1.0, 0.5, 2.0, 0.1, -0.7, 1.3, 0.9}, {0.3, 1.1, 4.2, 0.2, -1.0, 2.0, 2.5}};

/* Adam with clipping and a step schedule, written by hand. Returns the loss of the last epoch. */
static double line_reference(int epochs, size_t batch, double clip, double theta[2]) {
    double m[2] = {0}, v[2] = {0}, loss = 0.0;
    int step = 0;
    for (int epoch = 0; epoch < epochs; epoch++) {
        const double lr = 0.1 * pow(0.5, epoch / 2);
        loss = 0.0;
        for (size_t at = 0; at < 7; at += batch) {
            const size_t end = at + batch < 7 ? at + batch : 7;
            double g[2] = {0};
            for (size_t i = at; i < end; i++) {
                const double d = theta[0] * points.x[i] + theta[1] - points.t[i];
                loss += d * d / 7.0;
                g[0] += 2.0 * d * points.x[i] / (double)(end - at);
                g[1] += 2.0 * d / (double)(end - at);
            }
            const double norm = sqrt(g[0] * g[0] + g[1] * g[1]), scale = norm > clip ? clip / norm : 1.0;
            step++;
            for (int i = 0; i < 2; i++) {
                m[i] = 0.9 * m[i] + 0.1 * scale * g[i];
                v[i] = 0.999 * v[i] + 0.001 * scale * scale * g[i] * g[i];
                theta[i] -=
                    lr * m[i] / (1.0 - pow(0.9, step)) / (sqrt(v[i] / (1.0 - pow(0.999, step))) + 1e-8);
            }
        }
    }
    return loss;
}

static void check_line(size_t batch, uint32_t shards) {
    line data = points;
    const lg_fit_problem problem = {.parameters = 2, .samples = 7, .loss = line_loss, .user = &data};
    const double start[2] = {0.2, -0.4};
    double theta[2], expected[2] = {0.2, -0.4};
    lg_fit_options o = options_of(5, batch);
    o.shards = shards;
    o.shuffle = false;
    o.clip_norm = 1.5;
    o.adam.lr = 0.1;
    o.schedule = (lg_schedule){.kind = LG_SCHEDULE_STEP, .every = 2, .gamma = 0.5};
    lg_fit *fit = test_fit(NULL, &problem, &o, start);
    assert_true(isnan(lg_fit_loss(fit)));
    run_fit(fit);
    const double loss = line_reference(5, batch == 0 ? 7 : batch, 1.5, expected);
    lg_fit_parameters(fit, theta);
    for (int i = 0; i < 2; i++) assert_close(theta[i], expected[i], 1e-12, 1e-13);
    assert_close(lg_fit_loss(fit), loss, 1e-12, 0.0);
    assert_close(lg_fit_history(fit, LG_FIT_RATE)[4], 0.025, 1e-15, 0.0);
    assert_int_equal(lg_fit_steps_done(fit), batch == 0 ? 5 : 5 * ((7 + batch - 1) / batch));
    assert_true(lg_fit_finished(fit));
}

TEST("steps agree with plain loops, with partial batches and more shards than samples") {
    const size_t batches[] = {3, 1, 0, 7, 100, 4};
    const uint32_t shards[] = {1, 2, 4, 5, 64};
    for (size_t i = 0; i < LG_COUNT(batches); i++)
        for (size_t j = 0; j < LG_COUNT(shards); j++) check_line(batches[i], shards[j]);
}

/* The same loss and its gradient in numbers, of the type of the fit. */
static lg_status line_gradient(void *user, const void *theta, const uint32_t *samples, size_t count,
                               size_t batch, double *loss, void *gradient) {
    const line *data = user;
    const double *at = theta;
    double *g = gradient;
    for (size_t i = 0; i < count; i++) {
        const double x = data->x[samples[i]], d = at[0] * x + at[1] - data->t[samples[i]];
        *loss += d * d / (double)batch;
        if (g == NULL) continue;
        g[0] += 2.0 * d * x / (double)batch;
        g[1] += 2.0 * d / (double)batch;
    }
    return data->x[0] == 99.0 ? LG_FILE : LG_OK;
}

TEST("a gradient in numbers trains as the recording does: batches, shards, chunks, validation, L-BFGS") {
    line data = points;
    const double start[2] = {0.2, -0.4};
    for (int k = 0; k < 24; k++) {
        const bool dense = k % 2 == 1;
        double theta[2][2];
        lg_fit *fit[2];
        for (int numeric = 0; numeric < 2; numeric++) {
            lg_fit_problem problem = {
                .parameters = 2, .samples = 7, .user = &data, .chunk = (size_t)(k / 2 % 3), .validation = 2};
            lg_fit_options o = options_of(6, (size_t[]){0, 2, 3, 5}[k / 6]);
            problem.repeats = numeric; /* there is no recording of which to make a plan */
            if (numeric)
                problem.gradient = line_gradient;
            else
                problem.loss = line_loss;
            o.plan.phases = 1, o.plan.phase[0].method = dense ? LG_FIT_LBFGS : LG_FIT_ADAM;
            o.shards = 3;
            run_fit(fit[numeric] = test_fit(NULL, &problem, &o, start));
            lg_fit_parameters(fit[numeric], theta[numeric]);
        }
        assert_all_close(theta[1], theta[0], 2, 1e-12, 1e-13);
        assert_close(lg_fit_loss(fit[1]), lg_fit_loss(fit[0]), 1e-12, 0.0);
        assert_close(lg_fit_history(fit[1], LG_FIT_VALIDATION)[5],
                     lg_fit_history(fit[0], LG_FIT_VALIDATION)[5], 1e-12, 0.0);
    }
    data.x[0] = 99.0;
    const lg_fit_problem failing = {.parameters = 2, .samples = 7, .gradient = line_gradient, .user = &data};
    const lg_fit_options o = options_of(1, 0);
    lg_error error;
    assert_int_equal(lg_fit_run(test_fit(NULL, &failing, &o, start), &error), LG_FILE);
}

TEST("a schedule that hurries goes by the larger one of the shares of epochs and seconds") {
    line data = points;
    const lg_fit_problem problem = {.parameters = 2, .samples = 7, .gradient = line_gradient, .user = &data};
    const double start[2] = {0.2, -0.4};
    for (int hurry = 0; hurry < 2; hurry++) {
        lg_fit_options o = options_of(1000000, 0);
        o.schedule = (lg_schedule){.kind = LG_SCHEDULE_COSINE};
        o.adam.lr = 0.5, o.seconds = 0.02, o.hurry = hurry == 1;
        lg_fit *fit = test_fit(NULL, &problem, &o, start);
        run_fit(fit);
        const double *rate = lg_fit_history(fit, LG_FIT_RATE), *took = lg_fit_history(fit, LG_FIT_SECONDS);
        double spent = 0.0;
        assert_true(lg_fit_epochs_done(fit) > 3);
        for (uint64_t i = 0; i < lg_fit_epochs_done(fit); spent += took[i++]) {
            const double share = fmax((double)i / 1e6, hurry ? spent / 0.02 : 0.0);
            assert_close(rate[i], 0.25 * (1.0 + cos(3.14159265358979323846 * share)), 0.0, 1e-5);
        }
    }
}

static lg_status counting_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                               size_t batch, lg_var *loss) {
    size_t *calls = user; /* number of calls, and the largest number of samples in one call */
    calls[0]++;
    if (count > calls[1]) calls[1] = count;
    *loss = lg_scale(tape, lg_sum(tape, lg_square(tape, theta)), (double)count / (double)batch);
    return LG_OK;
}

TEST("with shards = 0 the work decides: a small batch is one piece, a large one four") {
    static const struct {
        size_t parameters, samples, chunk, pieces;
    } cases[] = {{2, 7, 0, 1},        {2, 128, 0, 1},        {2, 129, 0, 2},      {2, 200, 64, 4},
                 {2, 192, 64, 4},     {1199, 100, 100, 1},   {1200, 100, 100, 2}, {2399, 100, 100, 2},
                 {2400, 100, 100, 4}, {1 << 20, 47, 0, 1},   {1 << 20, 48, 0, 2}, {1 << 20, 95, 0, 2},
                 {1 << 20, 96, 0, 4}, {1 << 20, 100, 100, 4}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        size_t calls[2] = {0, 0};
        const lg_fit_problem problem = {.parameters = cases[i].parameters,
                                        .samples = cases[i].samples,
                                        .chunk = cases[i].chunk,
                                        .loss = counting_loss,
                                        .user = calls};
        lg_fit_options o = options_of(1, 0);
        o.shards = 0;
        run_fit(test_fit(NULL, &problem, &o, TEST_ARRAY(double, cases[i].parameters)));
        const size_t longest = (cases[i].samples + cases[i].pieces - 1) / cases[i].pieces;
        if (calls[0] != cases[i].pieces || calls[1] != longest)
            fail_msg("case %zu: %zu pieces, up to %zu samples", i, calls[0], calls[1]);
    }
}

/* The mean squared error of these samples. */
static double error_of(regression *r, const double *theta, const uint32_t *samples, size_t count) {
    lg_tape *tape = test_tape(LG_F64);
    lg_var loss;
    double error;
    const lg_var at = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&r->net)), theta);
    assert_ok(regression_loss(r, tape, at, samples, count, count, &loss));
    assert_ok(lg_read(tape, loss, 1, &error));
    return error;
}

/* ---- convergence: another implementation of the same training, from seven other starts, reaches losses from
 * 1.4e-6 to 1.8e-5 after 1500 epochs, and from 0.7e-4 to 1.7e-4 after 400 ---- */
TEST("a regression converges in both types, and returns the parameters that belong to its loss") {
    for (int dtype = 0; dtype < 2; dtype++) {
        regression r = make_regression();
        lg_fit_options o = options_of(1500, 16);
        o.dtype = (lg_dtype)dtype;
        o.schedule = (lg_schedule){.kind = LG_SCHEDULE_COSINE, .floor = 0.01};
        lg_fit *fit = run_regression(&r, &o);
        const double *loss = lg_fit_history(fit, LG_FIT_LOSS);
        assert_true(loss[0] > 0.05 && lg_fit_loss(fit) < 1e-4);
        assert_close(lg_fit_loss(fit), loss[1499], 0.0, 0.0);
        assert_true(isnan(lg_fit_history(fit, LG_FIT_VALIDATION)[0]));
        assert_true(lg_fit_seconds_per_epoch(fit) > 0.0 && lg_fit_tape_size(fit) > 0);
        double theta[512];
        uint32_t all[REGRESSION_SAMPLES];
        for (uint32_t i = 0; i < REGRESSION_SAMPLES; i++) all[i] = i;
        lg_fit_parameters(fit, theta);
        assert_true(error_of(&r, theta, all, REGRESSION_SAMPLES) < 1e-4);
    }
}

/* ---- equal bytes ---- */
static lg_fit_options rich_options(lg_dtype dtype) {
    lg_fit_options o = options_of(40, 7);
    o.dtype = dtype;
    o.validation = 0.2;
    o.keep_best = true;
    o.clip_norm = 0.7;
    o.adam.weight_decay = 1e-3;
    o.schedule = (lg_schedule){.kind = LG_SCHEDULE_COSINE, .floor = 0.1};
    return o;
}

TEST("a fit gives the same bytes for any number of threads, and other bytes for another seed") {
    for (int dtype = 0; dtype < 2; dtype++) {
        regression r = make_regression();
        lg_fit_options o = rich_options((lg_dtype)dtype);
        lg_fit *one = run_regression(&r, &o);
        for (int threads = 1; threads <= 3; threads++) {
            o.threads = threads;
            lg_fit *other = run_regression(&r, &o);
            assert_same_fits(one, other);
        }
        /* Another seed or another number of shards must change the result. */
        o.seed = 2;
        lg_fit *other = run_regression(&r, &o);
        double a[512], b[512];
        lg_fit_current_parameters(one, a);
        lg_fit_current_parameters(other, b);
        assert_memory_not_equal(a, b, lg_mlp_parameters(&r.net) * sizeof *a);
    }
}

TEST("reduction and Adam in blocks on threads give the same bytes") {
    regression r = make_regression();
    const uint32_t wide[2] = {320, 320};
    assert_ok(lg_mlp_init(&r.net, 1, wide, 2, 1, LG_TANH, true));
    lg_fit_options o = options_of(2, 16);
    o.clip_norm = 0.1;
    lg_fit *one = run_regression(&r, &o);
    o.threads = 3;
    lg_fit *three = run_regression(&r, &o);
    assert_same_fits(one, three);
}

TEST("a resumed fit gives the bytes of an uninterrupted one") {
    for (int dtype = 0; dtype < 2; dtype++) {
        regression r = make_regression();
        lg_fit_options o = rich_options((lg_dtype)dtype);
        lg_fit *whole = run_regression(&r, &o);
        o.stop_after = 20;
        lg_fit *half = regression_fit(NULL, &r, &o);
        memory_archive archive = state_of(half); /* a state before the first epoch can be loaded too */
        load_state(half, &archive);
        run_fit(half);
        assert_int_equal(lg_fit_epochs_done(half), 20);
        assert_false(lg_fit_finished(half));
        archive = state_of(half);
        o.threads = 2;
        lg_fit *rest = regression_fit(NULL, &r, &o);
        load_state(rest, &archive);
        assert_int_equal(lg_fit_epochs_done(rest), 20);
        run_fit(rest);
        assert_true(lg_fit_finished(rest));
        assert_same_fits(whole, rest);
        run_fit(rest); /* nothing is left to do */
        assert_same_fits(whole, rest);
    }
}

TEST("a fit that is cancelled anywhere, saved and loaded many times gives the same bytes") {
    regression r = make_regression();
    lg_fit_options o = rich_options(LG_F64);
    lg_fit *whole = run_regression(&r, &o);

    volatile int cancel = 0;
    int countdown = 0, stops = 0, inside = 0;
    lg_context *context = cancelled_by(&cancel);
    r.cancel = &cancel;
    r.cancel_at = &countdown;
    lg_fit *fit = regression_fit(context, &r, &o);
    for (;;) {
        countdown = 131;
        cancel = 0;
        lg_error error;
        const lg_status status = lg_fit_run(fit, &error);
        if (status == LG_OK) break;
        assert_status(status, LG_CANCELLED);
        assert_non_null(strstr(error.message, "epoch"));
        stops++;
        inside += fit->state.position > 0;
        memory_archive archive = state_of(fit);
        fit = regression_fit(context, &r, &o);
        load_state(fit, &archive);
    }
    assert_true(stops >= 5);
    assert_true(inside >= 3);
    assert_same_fits(whole, fit);
}

/* ---- validation, best epoch, early stopping ---- */
typedef struct watcher {
    lg_fit_epoch last, best;
    double smallest;
    int epochs, stop_at, saves;
    uint64_t saved_epoch;
    size_t saved_position;
    lg_status save_status;
} watcher;

static int watch_epoch(void *user, const lg_fit_epoch *report) {
    watcher *w = user;
    w->epochs++;
    assert_int_equal(report->best, w->epochs == 1 || report->validation < w->smallest);
    if (report->best) {
        w->smallest = report->validation;
        w->best = *report;
    }
    w->last = *report;
    return w->epochs == w->stop_at;
}

static lg_status watch_checkpoint(void *user, const lg_fit *fit) {
    watcher *w = user;
    w->saves++;
    w->saved_epoch = lg_fit_epochs_done(fit);
    w->saved_position = fit->state.position;
    return w->save_status;
}

/* The mean squared error of the samples in [from, to) of the saved permutation. */
static double part_loss(const lg_fit *fit, regression *r, const double *theta, size_t from, size_t to) {
    const memory_archive archive = state_of(fit);
    const uint32_t *order = memory_find(&archive, "train/permutation")->data;
    return error_of(r, theta, order + from, to - from);
}

TEST("the best epoch by the validation part is kept and reported") {
    regression r = make_regression();
    watcher w = {.stop_at = -1};
    lg_fit_options o = options_of(60, 5);
    o.adam.lr = 0.05; /* large, so that the last epoch is not the best */
    o.validation = 0.2;
    o.keep_best = true;
    o.on_epoch = watch_epoch;
    o.user = &w;
    lg_fit *fit = run_regression(&r, &o);
    assert_int_equal(w.epochs, 60);
    assert_int_equal(w.last.epoch, 60);
    assert_int_equal(w.last.epochs, 60);
    assert_close(w.last.rate, 0.05, 0.0, 0.0);
    assert_int_equal(lg_fit_best_epoch(fit), w.best.epoch);
    assert_true(w.best.epoch < 60);
    const size_t training = 53 - 11; /* 0.2 * 53 = 10.6 */
    double best[512], current[512];
    lg_fit_parameters(fit, best);
    lg_fit_current_parameters(fit, current);
    assert_close(part_loss(fit, &r, best, training, 53), w.best.validation, 1e-10, 0.0);
    assert_close(part_loss(fit, &r, current, training, 53), w.last.validation, 1e-10, 0.0);
    const double *history = lg_fit_history(fit, LG_FIT_VALIDATION);
    for (int i = 0; i < 60; i++) assert_true(history[i] >= w.best.validation);
}

/* ---- a validation part that the problem defines ---- */
enum { OWN = 11 }; /* the last samples */

static lg_fit_options own_options(void) {
    lg_fit_options o = rich_options(LG_F64);
    o.validation = 0.0;
    return o;
}

TEST("the last samples validate in their order, and the others train in an order drawn for each epoch") {
    regression r = make_regression();
    r.validation = OWN;
    watcher w = {.stop_at = -1};
    lg_fit_options o = own_options();
    o.on_epoch = watch_epoch;
    o.user = &w;
    lg_fit *fit = run_regression(&r, &o);
    const memory_archive archive = state_of(fit);
    const uint32_t *order = memory_find(&archive, "train/permutation")->data;
    bool trains[REGRESSION_SAMPLES] = {false};
    size_t moved = 0;
    for (uint32_t i = 0; i < REGRESSION_SAMPLES; i++) {
        if (i >= REGRESSION_SAMPLES - OWN) assert_int_equal(order[i], i);
        trains[order[i]] = i < REGRESSION_SAMPLES - OWN;
        moved += order[i] != i;
    }
    for (uint32_t i = 0; i < REGRESSION_SAMPLES; i++)
        assert_int_equal(trains[i], i < REGRESSION_SAMPLES - OWN);
    assert_true(moved > 20);
    double theta[512];
    lg_fit_parameters(fit, theta);
    assert_close(part_loss(fit, &r, theta, REGRESSION_SAMPLES - OWN, REGRESSION_SAMPLES), w.best.validation,
                 1e-10, 0.0);
    assert_int_equal(lg_fit_best_epoch(fit), w.best.epoch);
}

TEST("samples after the training part do not change any step") {
    regression r = make_regression(), fewer = r;
    lg_fit_options o = own_options();
    double x[512], y[512];
    o.keep_best = false;
    lg_fit_problem problem = regression_problem(&fewer);
    problem.samples -= OWN;
    r.validation = OWN;
    lg_fit *fit = regression_fit(NULL, &r, &o),
           *alone = test_fit(NULL, &problem, &o, regression_start(&fewer));
    for (int i = REGRESSION_SAMPLES - OWN; i < REGRESSION_SAMPLES; i++) fewer.t[i] = NAN;
    run_fit(fit);
    run_fit(alone);
    lg_fit_parameters(fit, x);
    lg_fit_parameters(alone, y);
    assert_memory_equal(x, y, lg_mlp_parameters(&r.net) * sizeof *x);
}

TEST("a validation part that the problem defines is saved, compared and loaded") {
    regression r = make_regression();
    r.validation = OWN;
    lg_fit_options o = own_options();
    lg_fit *whole = run_regression(&r, &o);
    o.threads = 2;
    o.stop_after = 13;
    memory_archive archive;
    lg_fit *fit = regression_fit(NULL, &r, &o);
    while (!lg_fit_finished(fit)) {
        run_fit(fit);
        archive = state_of(fit);
        fit = regression_fit(NULL, &r, &o);
        load_state(fit, &archive);
    }
    assert_same_fits(whole, fit);

    /* With another validation part, none, or one drawn by the seed it is another run. */
    const lg_archive_reader reader = memory_reader(&archive);
    lg_error error;
    for (size_t validation = 0; validation < OWN; validation += OWN - 1) {
        r.validation = validation;
        assert_status(lg_fit_load(regression_fit(NULL, &r, &o), &reader, &error), LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, "validation_samples was 11"));
    }
    uint32_t *order = memory_find(&archive, "train/permutation")->data;
    order[REGRESSION_SAMPLES - 1] = order[0];
    order[0] = REGRESSION_SAMPLES - 1;
    assert_status(lg_fit_load(fit, &reader, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "validation part"));
    assert_same_fits(whole, fit);

    /* A state without a validation part of the problem. */
    r.validation = 0;
    fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    archive = state_of(fit);
    lg_fit *old = regression_fit(NULL, &r, &o);
    load_state(old, &archive);
    r.validation = OWN;
    assert_status(lg_fit_load(regression_fit(NULL, &r, &o), &reader, &error), LG_INVALID_ARGUMENT);
    run_fit(fit);
    run_fit(old);
    assert_same_fits(fit, old);
}

TEST("a validation part that leaves no training samples, or two validation parts, are refused") {
    regression r = make_regression();
    lg_fit_problem problem = regression_problem(&r);
    lg_fit_options o = own_options();
    double *theta = regression_start(&r);
    lg_fit *fit = NULL;
    lg_error error;
    static const size_t parts[] = {REGRESSION_SAMPLES, REGRESSION_SAMPLES + 1, SIZE_MAX};
    for (size_t i = 0; i < 3; i++) {
        problem.validation = parts[i];
        assert_status(lg_fit_create(NULL, &problem, &o, theta, &fit, &error), LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, "none is left to train on"));
    }
    problem.validation = 1;
    o.validation = 0.1;
    assert_status(lg_fit_create(NULL, &problem, &o, theta, &fit, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "already has a validation part"));
    assert_null(fit);
}

TEST("problems and options out of range are refused with the rule") {
    static const char *const rules[] = {"has 0 parameters",
                                        "has 4294967296 parameters",
                                        "has 0 samples",
                                        "has 4294967296 samples",
                                        "dtype must be",
                                        "epochs must be 1 to 2^32 - 1",
                                        "epochs must be 1 to 2^32 - 1",
                                        "shards must be 0 to 1024",
                                        "threads must be 1 to 1024",
                                        "threads must be 1 to 1024",
                                        "lr must be positive",
                                        "beta1 and beta2",
                                        "beta1 and beta2",
                                        "eps must be positive",
                                        "weight_decay must be",
                                        "the schedule is unknown",
                                        "the schedule is unknown",
                                        "the schedule's epochs per step",
                                        "the schedule's gamma",
                                        "the schedule's floor",
                                        "the schedule's floor",
                                        "prior must be",
                                        "clip_norm must be",
                                        "seconds must be"};
    regression r = make_regression();
    double *theta = regression_start(&r);
    for (size_t i = 0; i < LG_COUNT(rules); i++) {
        lg_fit_problem problem = regression_problem(&r);
        lg_fit_options o = own_options();
        lg_fit *fit = NULL;
        lg_error error = {LG_OK, ""};
        size_t row = 0;
        if (SIZE_MAX == UINT32_MAX && (i == 1 || i == 3)) continue;
        if (i == row++) problem.parameters = 0;
        if (i == row++) problem.parameters = (size_t)UINT32_MAX + 1;
        if (i == row++) problem.samples = 0;
        if (i == row++) problem.samples = (size_t)UINT32_MAX + 1;
        if (i == row++) o.dtype = (lg_dtype)99;
        if (i == row++) o.epochs = 0;
        if (i == row++) o.epochs = (uint64_t)UINT32_MAX + 1;
        if (i == row++) o.shards = 1025;
        if (i == row++) o.threads = 0;
        if (i == row++) o.threads = 1025;
        if (i == row++) o.adam.lr = 0;
        if (i == row++) o.adam.beta1 = 1;
        if (i == row++) o.adam.beta2 = -0.1;
        if (i == row++) o.adam.eps = INFINITY;
        if (i == row++) o.adam.weight_decay = -1;
        if (i == row++) o.schedule.kind = (lg_schedule_kind)-1;
        if (i == row++) o.schedule.kind = LG_SCHEDULE_COUNT;
        if (i == row++) o.schedule = (lg_schedule){.kind = LG_SCHEDULE_STEP, .every = 0, .gamma = 1};
        if (i == row++) o.schedule = (lg_schedule){.kind = LG_SCHEDULE_STEP, .every = 1, .gamma = NAN};
        if (i == row++) o.schedule = (lg_schedule){.kind = LG_SCHEDULE_COSINE, .floor = -0.1};
        if (i == row++) o.schedule = (lg_schedule){.kind = LG_SCHEDULE_COSINE, .floor = 1.1};
        if (i == row++) o.prior = NAN;
        if (i == row++) o.clip_norm = -1;
        if (i == row++) o.seconds = -1;
        assert_int_equal(row, LG_COUNT(rules));
        assert_status(lg_fit_create(NULL, &problem, &o, theta, &fit, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, rules[i]);
        assert_null(fit);
    }
    assert_string_equal(lg_schedule_name((lg_schedule_kind)-1), "unknown");
    assert_string_equal(lg_schedule_name(LG_SCHEDULE_COUNT), "unknown");
}

/* The loss is 1 per sample, for any parameter. */
static lg_status unit_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *loss) {
    (void)user, (void)samples;
    const lg_var ones = lg_input_f64(tape, lg_shape0(), (const double[1]){(double)count / (double)batch});
    *loss = lg_add(tape, lg_scale(tape, lg_sum(tape, theta), 0.0), ones);
    return LG_OK;
}

TEST("losses of an epoch are means over the training part and over the validation part") {
    const double start[1] = {0.5};
    const lg_fit_problem problem = {.parameters = 1, .samples = 53, .loss = unit_loss};
    for (size_t batch = 0; batch <= 10; batch += 5) {
        lg_fit_options o = options_of(2, batch);
        o.validation = 0.2;
        lg_fit *fit = test_fit(NULL, &problem, &o, start);
        run_fit(fit);
        for (int i = 0; i < 2; i++) {
            assert_close(lg_fit_history(fit, LG_FIT_LOSS)[i], 1.0, 1e-13, 0.0);
            assert_close(lg_fit_history(fit, LG_FIT_VALIDATION)[i], 1.0, 1e-13, 0.0);
        }
    }
}

/* Sample i has the loss (theta (i + 1))^2, divided by the batch. */
static lg_status indexed_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                              size_t batch, lg_var *loss) {
    double *x = NULL;
    const lg_var factor = lg_input_buffer(tape, lg_shape1((uint32_t)count), (void **)&x);
    (void)user;
    for (size_t i = 0; i < count && x != NULL; i++) x[i] = samples[i] + 1.0;
    const lg_var all = lg_sum(tape, lg_square(tape, lg_mul(tape, factor, theta)));
    *loss = lg_scale(tape, all, 1.0 / (double)batch);
    return lg_tape_status(tape);
}

TEST("the loss of a problem is the mean over all samples before the validation part, whatever the chunk") {
    const double theta = 0.5;
    for (size_t chunk = 0; chunk < 400; chunk += 57) {
        const lg_fit_problem problem = {
            .parameters = 1, .samples = 310, .validation = 9, .chunk = chunk, .loss = indexed_loss};
        double loss = NAN;
        assert_ok(lg_fit_problem_loss(NULL, &problem, &theta, &loss, NULL));
        assert_close(loss, 0.25 * 302.0 * 603.0 / 6.0, 1e-14, 0); /* sum of k^2 to n: n (n + 1) (2 n + 1)/6 */
    }
}

TEST("training stops when patience ends") {
    regression r = make_regression();
    lg_fit_options o = options_of(1000, 5);
    o.adam.lr = 0.05;
    o.validation = 0.2;
    o.patience = 3;
    lg_fit *fit = run_regression(&r, &o);
    assert_true(lg_fit_finished(fit));
    assert_true(lg_fit_epochs_done(fit) < 1000);
    assert_int_equal(lg_fit_epochs_done(fit), lg_fit_best_epoch(fit) + 3);
}

/* ---- callbacks ---- */
TEST("checkpoints come as often as requested and when the fit stops, and their failure stops the fit") {
    regression r = make_regression();
    watcher w = {.stop_at = 7};
    lg_fit_options o = options_of(20, 16);
    o.validation = 0.2;
    o.checkpoint_every = 3;
    o.checkpoint = watch_checkpoint;
    o.on_epoch = watch_epoch;
    o.user = &w;
    lg_fit *fit = regression_fit(NULL, &r, &o);
    lg_error error;
    assert_status(lg_fit_run(fit, &error), LG_CANCELLED);
    assert_int_equal(w.epochs, 7);
    assert_int_equal(w.saves, 3); /* after epochs 3, 6 and when stopped */
    assert_int_equal(w.saved_epoch, 7);
    w.save_status = LG_FILE;
    assert_status(lg_fit_run(fit, &error), LG_FILE);
    assert_non_null(strstr(error.message, "checkpoint"));
    assert_int_equal(lg_fit_epochs_done(fit), 9);
    w.save_status = LG_OK;
    run_fit(fit);
    assert_int_equal(lg_fit_epochs_done(fit), 20);

    volatile int cancel = 1;
    lg_context *context = cancelled_by(&cancel);
    w = (watcher){.stop_at = -1};
    fit = regression_fit(context, &r, &o);
    assert_status(lg_fit_run(fit, &error), LG_CANCELLED);
    assert_int_equal(w.saves, 1);
    assert_int_equal(lg_fit_steps_done(fit), 0);
}

/* ---- restarts ---- */

/* A model that is reported as dead, except with the parameters of restart `enough`, or only from call `from`
 * on. */
typedef struct dying {
    regression regression;
    uint64_t enough;
    int calls, from;
} dying;

static lg_status dying_revive(void *user, uint64_t number, double *theta, bool *dead) {
    dying *d = user;
    *dead = ++d->calls >= d->from && number <= d->enough;
    for (size_t i = 0; *dead && i < lg_mlp_parameters(&d->regression.net); i++)
        theta[i] = regression_start(&d->regression)[i] * (1.0 + 0.01 * (double)number);
    return LG_OK;
}

static lg_fit *dying_fit(dying *d, const lg_fit_options *o, double factor) {
    lg_fit_problem problem = regression_problem(&d->regression);
    double *theta = regression_start(&d->regression);
    problem.revive = dying_revive; /* `user` points to a dying, whose first member is the regression */
    for (size_t i = 0; i < problem.parameters; i++) theta[i] *= factor;
    return test_fit(NULL, &problem, o, theta);
}

static dying make_dying(uint64_t enough, int from) {
    return (dying){.regression = make_regression(), .enough = enough, .from = from};
}

TEST("a dead model starts again from epoch 0, as if it had started there") {
    for (int dtype = 0; dtype < 2; dtype++) {
        lg_fit_options o = rich_options((lg_dtype)dtype);
        dying d = make_dying(2, 0), alive = make_dying(0, 0);
        double theta[2][512];
        o.restarts = 7;
        lg_fit *fit = dying_fit(&d, &o, 1.0), *other = dying_fit(&alive, &o, 1.02);
        run_fit(fit);
        run_fit(other);
        assert_int_equal(lg_fit_restarts(fit), 2);
        assert_int_equal(lg_fit_restarts(other), 0);
        assert_int_equal(lg_fit_epochs_done(fit), o.epochs);
        assert_int_equal(lg_fit_best_epoch(fit), lg_fit_best_epoch(other));
        lg_fit_parameters(fit, theta[0]);
        lg_fit_parameters(other, theta[1]);
        const size_t n = lg_mlp_parameters(&d.regression.net);
        assert_memory_equal(theta[0], theta[1], n * sizeof **theta);
        assert_memory_equal(lg_fit_history(fit, LG_FIT_LOSS), lg_fit_history(other, LG_FIT_LOSS),
                            (size_t)o.epochs * sizeof(double));
    }
}

TEST("there are no more restarts than allowed, and none without the option") {
    for (uint32_t most = 0; most < 3; most++) {
        lg_fit_options o = options_of(6, 16);
        dying d = make_dying(100, 0);
        o.restarts = most;
        lg_fit *fit = dying_fit(&d, &o, 1.0);
        run_fit(fit);
        assert_int_equal(lg_fit_restarts(fit), most);
        assert_int_equal(lg_fit_epochs_done(fit), 6);
        assert_int_equal(d.calls, most);
    }
}

/* With this learning rate the parameters become very large after some epochs. */
TEST("a model that died after it had learned keeps its best epoch") {
    for (int keep = 0; keep < 2; keep++) {
        lg_fit_options o = options_of(12, 16);
        dying d = make_dying(1, 5);
        o.restarts = 3;
        o.keep_best = keep;
        o.schedule = (lg_schedule){.kind = LG_SCHEDULE_STEP, .every = 4, .gamma = 100.0};
        lg_fit *fit = dying_fit(&d, &o, 1.0);
        run_fit(fit);
        assert_int_equal(lg_fit_restarts(fit), !keep);
        assert_true(keep ? d.calls == 4 : d.calls > 4);
        assert_int_equal(lg_fit_epochs_done(fit), 12);
    }
}

/* sqrt(a^2) + b^2: at a = 0 the derivative by a alone is NaN. */
static lg_status kinked_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                             size_t batch, lg_var *loss) {
    (void)user, (void)samples, (void)count, (void)batch;
    const lg_var a = lg_slice(tape, theta, 0, 0, 1), b = lg_slice(tape, theta, 0, 1, 1);
    *loss = lg_sum(tape, lg_add(tape, lg_sqrt(tape, lg_square(tape, a)), lg_square(tape, b)));
    return LG_OK;
}

TEST("Newton's method says that one derivative is NaN, whatever the derivatives after it are") {
    const lg_fit_problem problem = {.parameters = 2, .samples = 1, .loss = kinked_loss};
    double theta[2] = {0, 1};
    assert_status(lg_fit_newton(NULL, &problem, theta, NULL), LG_NOT_FINITE);
    assert_true(theta[0] == 0 && theta[1] == 1);
}

TEST("a run with restarts, in parts, has the bytes of one run") {
    lg_fit_options o = rich_options(LG_F64);
    o.restarts = 3;
    o.epochs = 5;
    dying d = make_dying(2, 0);
    lg_fit *whole = dying_fit(&d, &o, 1.0);
    run_fit(whole);
    o.stop_after = 1;
    lg_fit *fit = dying_fit(&d, &o, 1.0);
    int parts = 0;
    for (; !lg_fit_finished(fit); parts++) {
        run_fit(fit);
        memory_archive archive = state_of(fit);
        fit = dying_fit(&d, &o, 1.0);
        load_state(fit, &archive);
    }
    assert_int_equal(parts, 7);
    assert_int_equal(lg_fit_restarts(fit), 2);
    assert_same_fits(whole, fit);

    o.seconds = 1000.0;
    o.stop_after = 2; /* the first epoch, and the epoch before the second restart */
    lg_fit *later = dying_fit(&d, &o, 1.0);
    run_fit(later);
    assert_int_equal(lg_fit_restarts(later), 2);
    assert_false(lg_fit_finished(later));
    memory_archive archive = state_of(later);
    const lg_archive_reader reader = memory_reader(&archive);
    lg_error error;
    *(double *)memory_find(&archive, "train/restart_seconds")->data = 1001.0;
    load_state(later, &archive);
    assert_int_equal(lg_fit_why_finished(later), LG_FIT_END_SECONDS);
    *(uint64_t *)memory_find(&archive, "train/restarts")->data = 4;
    assert_status(lg_fit_load(later, &reader, &error), LG_FORMAT);
    assert_message(&error, "train/restarts");
}
