/* The training loop: one step after the other against plain loops, convergence, the same bytes whatever the
 * threads and however often interrupted, validation and best epoch, and what stops it. */
#include "nn_support.h"
#include "liegrad/ops.h"

static lg_fit_options options_of(uint64_t epochs, size_t batch) {
    lg_fit_options o;
    lg_fit_options_init(&o);
    o.epochs = epochs;
    o.batch = batch;
    o.adam.lr = 1e-2;
    return o;
}

static lg_fit *fit_of(const lg_context *context, regression *r, const lg_fit_options *o) {
    const lg_fit_problem problem = regression_problem(r);
    double *theta = regression_start(r);
    lg_fit *fit = NULL;
    lg_error error;
    if (lg_fit_create(context, &problem, o, theta, &fit, &error) != LG_OK) fail_msg("%s", error.message);
    free(theta);
    return fit;
}

static void run_ok(lg_fit *fit) {
    lg_error error;
    if (lg_fit_run(fit, &error) != LG_OK) fail_msg("%s", error.message);
    assert_string_equal(error.message, "");
}

/* All that a resumed run must share with an uninterrupted one: every stored array but the seconds. */
static void save(const lg_fit *fit, memory_archive *archive) {
    memory_clear(archive);
    const lg_archive_writer writer = memory_writer(archive);
    assert_ok(lg_fit_save(fit, &writer, NULL));
}

static void assert_same(const lg_fit *a, const lg_fit *b) {
    memory_archive x = {0}, y = {0};
    save(a, &x);
    save(b, &y);
    assert_int_equal(x.count, y.count);
    for (size_t i = 0; i < x.count; i++) {
        if (strstr(x.items[i].path, "seconds") != NULL) continue;
        const memory_item *other = memory_find(&y, x.items[i].path);
        assert_non_null(other);
        assert_int_equal(x.items[i].bytes, other->bytes);
        if (memcmp(x.items[i].data, other->data, other->bytes) != 0) fail_msg("%s differs", other->path);
    }
    memory_clear(&x);
    memory_clear(&y);
}

/* ---- against plain loops: line a x + b through 7 points, batches of 3, 3 and 1 ---- */
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

/* Adam with clipping and a step schedule by hand; returns the last epoch's loss. */
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
    lg_fit *fit = NULL;
    assert_ok(lg_fit_create(NULL, &problem, &o, start, &fit, NULL));
    assert_true(isnan(lg_fit_loss(fit)));
    run_ok(fit);
    const double loss = line_reference(5, batch == 0 ? 7 : batch, 1.5, expected);
    lg_fit_parameters(fit, theta);
    for (int i = 0; i < 2; i++) assert_close(theta[i], expected[i], 1e-12, 1e-13);
    assert_close(lg_fit_loss(fit), loss, 1e-12, 0.0);
    assert_close(lg_fit_history(fit, LG_FIT_RATE)[4], 0.025, 1e-15, 0.0);
    assert_int_equal(lg_fit_steps_done(fit), batch == 0 ? 5 : 5 * ((7 + batch - 1) / batch));
    assert_true(lg_fit_finished(fit));
    lg_fit_destroy(fit);
}

/* Partial last batches (3 + 3 + 1), batches of one sample, all samples, more shards than samples. */
static void test_steps(void **state) {
    (void)state;
    const size_t batches[] = {3, 1, 0, 7, 100, 4};
    const uint32_t shards[] = {1, 2, 4, 5, 64};
    for (size_t i = 0; i < LG_COUNT(batches); i++)
        for (size_t j = 0; j < LG_COUNT(shards); j++) check_line(batches[i], shards[j]);
}

/* The mean squared error of these samples. */
static double error_of(regression *r, const double *theta, const uint32_t *samples, size_t count) {
    lg_tape *tape = NULL;
    lg_var loss;
    double error;
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_var at = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&r->net)), theta);
    assert_ok(regression_loss(r, tape, at, samples, count, count, &loss));
    assert_ok(lg_read(tape, loss, &error, 1));
    lg_tape_destroy(tape);
    return error;
}

/* ---- convergence: a separate implementation of the same protocol, with seven other starts, ends
 * between 1.4e-6 and 1.8e-5 after 1500 epochs, and at 0.7e-4 to 1.7e-4 after 400 ---- */
static void converge(lg_dtype dtype, double bound) {
    regression r;
    regression_init(&r);
    lg_fit_options o = options_of(1500, 16);
    o.dtype = dtype;
    o.schedule = (lg_schedule){.kind = LG_SCHEDULE_COSINE, .floor = 0.01};
    lg_fit *fit = fit_of(NULL, &r, &o);
    run_ok(fit);
    const double *loss = lg_fit_history(fit, LG_FIT_LOSS);
    assert_true(loss[0] > 0.05);
    printf("regression: loss %.3g -> %.3g\n", loss[0], lg_fit_loss(fit));
    assert_true(lg_fit_loss(fit) < bound);
    assert_close(lg_fit_loss(fit), loss[1499], 0.0, 0.0);
    assert_true(isnan(lg_fit_history(fit, LG_FIT_VALIDATION)[0]));
    assert_true(lg_fit_seconds_per_epoch(fit) > 0.0);
    assert_true(lg_fit_tape_bytes(fit) > 0);
    /* the parameters handed out are those of the loss */
    double theta[512];
    uint32_t all[REGRESSION_SAMPLES];
    for (uint32_t i = 0; i < REGRESSION_SAMPLES; i++) all[i] = i;
    lg_fit_parameters(fit, theta);
    assert_true(error_of(&r, theta, all, REGRESSION_SAMPLES) < bound);
    lg_fit_destroy(fit);
}

static void test_convergence(void **state) {
    (void)state;
    converge(LG_F64, 1e-4);
    converge(LG_F32, 1e-4);
}

/* ---- the same bytes ---- */
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

static void test_threads(void **state) {
    (void)state;
    for (int dtype = 0; dtype < 2; dtype++) {
        regression r;
        regression_init(&r);
        lg_fit_options o = rich_options((lg_dtype)dtype);
        lg_fit *one = fit_of(NULL, &r, &o);
        run_ok(one);
        for (int threads = 1; threads <= 3; threads++) {
            o.threads = threads;
            lg_fit *other = fit_of(NULL, &r, &o);
            run_ok(other);
            assert_same(one, other);
            lg_fit_destroy(other);
        }
        /* another seed, or another number of shards, must show */
        o.seed = 2;
        lg_fit *other = fit_of(NULL, &r, &o);
        run_ok(other);
        double a[512], b[512];
        lg_fit_current_parameters(one, a);
        lg_fit_current_parameters(other, b);
        assert_memory_not_equal(a, b, lg_mlp_parameters(&r.net) * sizeof *a);
        lg_fit_destroy(other);
        lg_fit_destroy(one);
    }
}

/* Many parameters: the reduction and Adam run over blocks on threads. */
static void test_threads_many_blocks(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    const uint32_t wide[2] = {320, 320};
    assert_ok(lg_mlp_init(&r.net, 1, wide, 2, 1, LG_TANH, true));
    lg_fit_options o = options_of(2, 16);
    o.clip_norm = 0.1;
    lg_fit *one = fit_of(NULL, &r, &o);
    run_ok(one);
    o.threads = 3;
    lg_fit *three = fit_of(NULL, &r, &o);
    run_ok(three);
    assert_same(one, three);
    lg_fit_destroy(three);
    lg_fit_destroy(one);
}

static void load(lg_fit *fit, memory_archive *archive) {
    const lg_archive_reader reader = memory_reader(archive);
    lg_error error;
    if (lg_fit_load(fit, &reader, &error) != LG_OK) fail_msg("%s", error.message);
}

static void test_resume(void **state) {
    (void)state;
    for (int dtype = 0; dtype < 2; dtype++) {
        regression r;
        regression_init(&r);
        lg_fit_options o = rich_options((lg_dtype)dtype);
        lg_fit *whole = fit_of(NULL, &r, &o);
        run_ok(whole);
        o.stop_after = 20;
        memory_archive archive = {0};
        lg_fit *half = fit_of(NULL, &r, &o);
        save(half, &archive); /* a state before the first epoch loads too */
        load(half, &archive);
        run_ok(half);
        assert_int_equal(lg_fit_epochs_done(half), 20);
        assert_false(lg_fit_finished(half));
        save(half, &archive);
        lg_fit_destroy(half);
        o.threads = 2;
        lg_fit *rest = fit_of(NULL, &r, &o);
        load(rest, &archive);
        assert_int_equal(lg_fit_epochs_done(rest), 20);
        run_ok(rest);
        assert_true(lg_fit_finished(rest));
        assert_same(whole, rest);
        run_ok(rest); /* nothing left to do */
        assert_same(whole, rest);
        memory_clear(&archive);
        lg_fit_destroy(rest);
        lg_fit_destroy(whole);
    }
}

/* The cancel flag goes up somewhere in an epoch, again and again; each time the state is saved and a new
 * object goes on. */
static void test_cancel(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    lg_fit_options o = rich_options(LG_F64);
    lg_fit *whole = fit_of(NULL, &r, &o);
    run_ok(whole);

    volatile int cancel = 0;
    int countdown = 0, stops = 0, inside = 0;
    counter c;
    lg_context *context = counter_context(&c, -1, &cancel);
    r.cancel = &cancel;
    r.cancel_at = &countdown;
    memory_archive archive = {0};
    lg_fit *fit = fit_of(context, &r, &o);
    for (;;) {
        countdown = 131;
        cancel = 0;
        lg_error error;
        const lg_status status = lg_fit_run(fit, &error);
        if (status == LG_OK) break;
        assert_status(status, LG_CANCELLED);
        assert_non_null(strstr(error.message, "epoch"));
        stops++;
        inside += lg_fit_position(fit) > 0;
        save(fit, &archive);
        lg_fit_destroy(fit);
        fit = fit_of(context, &r, &o);
        load(fit, &archive);
    }
    assert_true(stops >= 5);
    assert_true(inside >= 3);
    assert_same(whole, fit);
    memory_clear(&archive);
    lg_fit_destroy(fit);
    lg_fit_destroy(whole);
    lg_context_destroy(context);
    assert_int_equal(c.live, 0);
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
    w->saved_position = lg_fit_position(fit);
    return w->save_status;
}

/* The mean squared error of the samples in [from, to) of the saved permutation. */
static double part_loss(const lg_fit *fit, regression *r, const double *theta, size_t from, size_t to) {
    memory_archive archive = {0};
    save(fit, &archive);
    const uint32_t *order = memory_find(&archive, "train/permutation")->data;
    const double error = error_of(r, theta, order + from, to - from);
    memory_clear(&archive);
    return error;
}

static void test_validation(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    watcher w = {.stop_at = -1};
    lg_fit_options o = options_of(60, 5);
    o.adam.lr = 0.05; /* rough: the last epoch is not the best one */
    o.validation = 0.2;
    o.keep_best = true;
    o.on_epoch = watch_epoch;
    o.user = &w;
    lg_fit *fit = fit_of(NULL, &r, &o);
    run_ok(fit);
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
    lg_fit_destroy(fit);
}

/* ---- a validation part of the problem's own ---- */
enum { OWN = 11 }; /* the last samples */

static lg_fit_options own_options(void) {
    lg_fit_options o = rich_options(LG_F64);
    o.validation = 0.0;
    return o;
}

static lg_fit *own_fit(regression *r, const lg_fit_options *o, size_t validation) {
    lg_fit_problem problem = regression_problem(r);
    double *theta = regression_start(r);
    lg_fit *fit = NULL;
    lg_error error;
    problem.validation = validation;
    if (lg_fit_create(NULL, &problem, o, theta, &fit, &error) != LG_OK) fail_msg("%s", error.message);
    free(theta);
    return fit;
}

/* The last samples validate, in their order; the others train, all of them, in a new order. */
static void test_own_validation(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    watcher w = {.stop_at = -1};
    lg_fit_options o = own_options();
    o.on_epoch = watch_epoch;
    o.user = &w;
    lg_fit *fit = own_fit(&r, &o, OWN);
    run_ok(fit);
    memory_archive archive = {0};
    save(fit, &archive);
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
    memory_clear(&archive);
    double theta[512];
    lg_fit_parameters(fit, theta);
    assert_close(part_loss(fit, &r, theta, REGRESSION_SAMPLES - OWN, REGRESSION_SAMPLES), w.best.validation,
                 1e-10, 0.0);
    assert_int_equal(lg_fit_best_epoch(fit), w.best.epoch);
    lg_fit_destroy(fit);
}

/* Trained on the first samples, with or without others behind them that validate: the same steps. */
static void test_own_validation_does_not_train(void **state) {
    (void)state;
    regression r, fewer;
    regression_init(&r);
    regression_init(&fewer);
    lg_fit_options o = own_options();
    o.keep_best = false;
    lg_fit *fit = own_fit(&r, &o, OWN), *alone = NULL;
    lg_fit_problem problem = regression_problem(&fewer);
    problem.samples -= OWN;
    double *theta = regression_start(&fewer), x[512], y[512];
    assert_ok(lg_fit_create(NULL, &problem, &o, theta, &alone, NULL));
    for (int i = REGRESSION_SAMPLES - OWN; i < REGRESSION_SAMPLES; i++) fewer.t[i] = NAN;
    free(theta);
    run_ok(fit);
    run_ok(alone);
    lg_fit_parameters(fit, x);
    lg_fit_parameters(alone, y);
    assert_memory_equal(x, y, lg_mlp_parameters(&r.net) * sizeof *x);
    lg_fit_destroy(fit);
    lg_fit_destroy(alone);
}

static void test_own_validation_resumed(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    lg_fit_options o = own_options();
    lg_fit *whole = own_fit(&r, &o, OWN);
    run_ok(whole);
    o.threads = 2;
    lg_fit *threaded = own_fit(&r, &o, OWN);
    run_ok(threaded);
    assert_same(whole, threaded);
    lg_fit_destroy(threaded);
    o.threads = 1;
    o.stop_after = 13;
    memory_archive archive = {0};
    lg_fit *fit = own_fit(&r, &o, OWN);
    while (!lg_fit_finished(fit)) {
        run_ok(fit);
        save(fit, &archive);
        lg_fit_destroy(fit);
        fit = own_fit(&r, &o, OWN);
        load(fit, &archive);
    }
    assert_same(whole, fit);

    /* another part, none, or one drawn by the seed: another run */
    const lg_archive_reader reader = memory_reader(&archive);
    lg_error error;
    for (size_t validation = 0; validation < OWN; validation += OWN - 1) {
        lg_fit *other = own_fit(&r, &o, validation);
        assert_status(lg_fit_load(other, &reader, &error), LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, "validation_samples was 11"));
        lg_fit_destroy(other);
    }
    uint32_t *order = memory_find(&archive, "train/permutation")->data;
    order[REGRESSION_SAMPLES - 1] = order[0];
    order[0] = REGRESSION_SAMPLES - 1;
    assert_status(lg_fit_load(fit, &reader, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "validation part"));
    assert_same(whole, fit);
    lg_fit_destroy(fit);

    /* without such a part, its number is not there at all: states are as they always were */
    o.stop_after = 13;
    fit = own_fit(&r, &o, 0);
    run_ok(fit);
    save(fit, &archive);
    assert_null(memory_find(&archive, "train/options/validation_samples"));
    lg_fit *old = own_fit(&r, &o, 0);
    load(old, &archive);
    lg_fit *with_part = own_fit(&r, &o, OWN);
    assert_status(lg_fit_load(with_part, &reader, &error), LG_INVALID_ARGUMENT);
    run_ok(fit);
    run_ok(old);
    assert_same(fit, old);
    lg_fit_destroy(fit);
    lg_fit_destroy(old);
    lg_fit_destroy(with_part);
    lg_fit_destroy(whole);
    memory_clear(&archive);
}

static void test_own_validation_refused(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
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
    assert_non_null(strstr(error.message, "part of its own"));
    assert_null(fit);
    free(theta);
}

/* One unit for each sample, whatever the parameter. */
static lg_status unit_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *loss) {
    (void)user, (void)samples;
    const lg_var ones = lg_input_f64(tape, lg_shape0(), (const double[1]){(double)count / (double)batch});
    *loss = lg_add(tape, lg_scale(tape, lg_sum(tape, theta), 0.0), ones);
    return LG_OK;
}

/* The losses of an epoch are means over the training part and over the validation part, each by itself. */
static void test_epoch_losses_are_means(void **state) {
    (void)state;
    const double start[1] = {0.5};
    const lg_fit_problem problem = {.parameters = 1, .samples = 53, .loss = unit_loss};
    for (size_t batch = 0; batch <= 10; batch += 5) {
        lg_fit_options o = options_of(2, batch);
        o.validation = 0.2;
        lg_fit *fit = NULL;
        assert_ok(lg_fit_create(NULL, &problem, &o, start, &fit, NULL));
        run_ok(fit);
        for (int i = 0; i < 2; i++) {
            assert_close(lg_fit_history(fit, LG_FIT_LOSS)[i], 1.0, 1e-13, 0.0);
            assert_close(lg_fit_history(fit, LG_FIT_VALIDATION)[i], 1.0, 1e-13, 0.0);
        }
        lg_fit_destroy(fit);
    }
}

static void test_patience(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    lg_fit_options o = options_of(1000, 5);
    o.adam.lr = 0.05;
    o.validation = 0.2;
    o.patience = 3;
    lg_fit *fit = fit_of(NULL, &r, &o);
    run_ok(fit);
    assert_true(lg_fit_finished(fit));
    assert_true(lg_fit_epochs_done(fit) < 1000);
    assert_int_equal(lg_fit_epochs_done(fit), lg_fit_best_epoch(fit) + 3);
    lg_fit_destroy(fit);
}

/* ---- callbacks ---- */
static void test_checkpoints(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    watcher w = {.stop_at = 7};
    lg_fit_options o = options_of(20, 16);
    o.validation = 0.2;
    o.checkpoint_every = 3;
    o.checkpoint = watch_checkpoint;
    o.on_epoch = watch_epoch;
    o.user = &w;
    lg_fit *fit = fit_of(NULL, &r, &o);
    lg_error error;
    assert_status(lg_fit_run(fit, &error), LG_CANCELLED);
    assert_int_equal(w.epochs, 7);
    assert_int_equal(w.saves, 3); /* after 3, 6 and when stopped */
    assert_int_equal(w.saved_epoch, 7);
    w.save_status = LG_FILE;
    assert_status(lg_fit_run(fit, &error), LG_FILE);
    assert_non_null(strstr(error.message, "checkpoint"));
    assert_int_equal(lg_fit_epochs_done(fit), 9);
    w.save_status = LG_OK;
    run_ok(fit);
    assert_int_equal(lg_fit_epochs_done(fit), 20);
    lg_fit_destroy(fit);

    volatile int cancel = 1;
    counter c;
    lg_context *context = counter_context(&c, -1, &cancel);
    w = (watcher){.stop_at = -1};
    fit = fit_of(context, &r, &o);
    assert_status(lg_fit_run(fit, &error), LG_CANCELLED);
    assert_int_equal(w.saves, 1);
    assert_int_equal(lg_fit_steps_done(fit), 0);
    lg_fit_destroy(fit);
    lg_context_destroy(context);
}

/* ---- memory ---- */
static long calls_in_epoch_3;
static int count_calls(void *user, const lg_fit_epoch *report) {
    if (report->epoch == 3) calls_in_epoch_3 = ((counter *)user)->calls;
    return 0;
}

static void test_no_allocation(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    counter c;
    lg_context *context = counter_context(&c, -1, NULL);
    lg_fit_options o = options_of(30, 10);
    o.threads = 2;
    o.validation = 0.1;
    o.on_epoch = count_calls;
    o.user = &c;
    lg_fit *fit = fit_of(context, &r, &o);
    run_ok(fit);
    assert_int_equal(c.calls, calls_in_epoch_3);
    lg_fit_destroy(fit);
    lg_context_destroy(context);
    assert_int_equal(c.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steps),
        cmocka_unit_test(test_convergence),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_threads_many_blocks),
        cmocka_unit_test(test_resume),
        cmocka_unit_test(test_cancel),
        cmocka_unit_test(test_validation),
        cmocka_unit_test(test_own_validation),
        cmocka_unit_test(test_own_validation_does_not_train),
        cmocka_unit_test(test_own_validation_resumed),
        cmocka_unit_test(test_own_validation_refused),
        cmocka_unit_test(test_patience),
        cmocka_unit_test(test_epoch_losses_are_means),
        cmocka_unit_test(test_checkpoints),
        cmocka_unit_test(test_no_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
