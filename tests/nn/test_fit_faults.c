/* Training that cannot continue or must not start: NaN, failing memory, invalid options, invalid states. */
#include "nn_support.h"

#include "nn/fit_internal.h"

/* ---- values that are not finite ---- */

TEST("a loss that is NaN stops the fit before its batch, and the fit continues once the cause is gone") {
    regression r = make_regression();
    lg_fit_options o = options_of(5, 10);
    o.shuffle = false;
    o.stop_after = 1;
    lg_fit *fit = regression_fit(NULL, &r, &o);
    run_fit(fit);
    r.poison = 29;
    lg_error error;
    assert_status(lg_fit_run(fit, &error), LG_NOT_FINITE);
    assert_int_equal(error.status, LG_NOT_FINITE);
    assert_message(&error, "epoch 2, batch 3");
    assert_message(&error, "the loss is NaN");
    assert_int_equal(fit->state.position, 20);
    assert_int_equal(lg_fit_steps_done(fit), 8);
    double theta[512], again[512];
    const size_t n = lg_mlp_parameters(&r.net);
    lg_fit_parameters(fit, theta);
    for (size_t i = 0; i < n; i++) assert_true(isfinite(theta[i]));
    assert_status(lg_fit_run(fit, &error), LG_NOT_FINITE);
    lg_fit_parameters(fit, again);
    assert_memory_equal(theta, again, n * sizeof *theta);

    /* Without the cause the fit continues as if nothing had happened. */
    r.poison = -1;
    o.stop_after = 0;
    lg_fit *whole = regression_fit(NULL, &r, &o);
    assert_ok(lg_fit_run(whole, NULL));
    while (!lg_fit_finished(fit)) assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, theta);
    lg_fit_parameters(whole, again);
    assert_memory_equal(theta, again, n * sizeof *theta);
}

/* theta = (W (SIDE, SIDE), b (SIDE)). The loss of a sample is right sum(x W) + root sum(sqrt(b - shift)) with
 * x = (left, ..., left). So the gradient is left right in W and root / (2 sqrt(b - shift)) in b. */
enum { SIDE = 24, STEEP = SIDE * SIDE + SIDE };
typedef struct steep {
    double left, right, root, shift;
    /* the only sample with these numbers; the others have left = right = root = 1, shift = 0 */
    uint32_t sample;
} steep;

static lg_status steep_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const steep *s = user;
    const lg_var w = lg_reshape(tape, lg_slice(tape, theta, 0, 0, SIDE * SIDE), lg_shape2(SIDE, SIDE));
    const lg_var b = lg_slice(tape, theta, 0, SIDE * SIDE, SIDE);
    lg_var sum = LG_NONE;
    for (size_t i = 0; i < count; i++) {
        const bool it = samples[i] == s->sample;
        const lg_var x = lg_full(tape, lg_shape2(1, SIDE), it ? s->left : 1.0);
        const lg_var flat = lg_scale(tape, lg_sum(tape, lg_matmul(tape, x, w)), it ? s->right : 1.0);
        const lg_var roots = lg_sum(tape, lg_sqrt(tape, lg_add_scalar(tape, b, it ? -s->shift : 0.0)));
        const lg_var one = lg_add(tape, flat, lg_scale(tape, roots, it ? s->root : 1.0));
        sum = lg_is_none(sum) ? one : lg_add(tape, sum, one);
    }
    *loss = lg_scale(tape, sum, 1.0 / (double)batch);
    return lg_tape_status(tape);
}

/* Runs one good epoch, then one with `bad`. The rate is so small that W stays near 0 and b near 1/4. On
 * failure the state must be that after the good epoch. */
static lg_status run_steep(const steep *bad, lg_dtype dtype, uint32_t shards, size_t chunk, lg_error *error) {
    steep now = {1.0, 1.0, 1.0, 0.0, UINT32_MAX};
    const lg_fit_problem problem = {
        .parameters = STEEP, .samples = 3, .loss = steep_loss, .user = &now, .chunk = chunk};
    static double start[STEEP], before[STEEP], after[STEEP];
    for (int i = 0; i < STEEP; i++) start[i] = i < SIDE * SIDE ? 0.0 : 0.25;
    lg_fit_options o = options_of(2, 0);
    o.dtype = dtype;
    o.shards = shards;
    o.stop_after = 1;
    o.shuffle = false;
    o.adam.lr = 1e-300;
    lg_fit *fit = test_fit(NULL, &problem, &o, start);
    assert_ok(lg_fit_run(fit, error));
    const memory_archive kept = state_of(fit);
    lg_fit_current_parameters(fit, before);
    now = *bad;
    const lg_status status = lg_fit_run(fit, error);
    lg_fit_current_parameters(fit, after);
    assert_int_equal(lg_fit_steps_done(fit), status == LG_OK ? 2 : 1);
    if (status != LG_OK) {
        assert_memory_equal(before, after, sizeof before);
        const memory_archive found = state_of(fit);
        for (size_t i = 0; i < kept.count; i++)
            if (strncmp(kept.items[i].path, "optimizer/", 10) == 0)
                assert_memory_equal(kept.items[i].data, found.items[i].data, kept.items[i].bytes);
    }
    return status;
}

TEST("gradients that overflow are found, however they are divided into shards and chunks") {
    lg_error error;
    for (int dtype = 0; dtype < 2; dtype++)
        for (uint32_t shards = 1; shards <= 2; shards++)
            for (size_t chunk = 1; chunk <= 3; chunk++) {
                const bool f32 = (lg_dtype)dtype == LG_F32;
                const double large = f32 ? 1e25 : 1e200, huge = f32 ? 1e25 : 1e155;
                const struct {
                    steep bad;
                    const char *words; /* NULL: the epoch succeeds */
                } cases[] = {
                    {{large, large, 1.0, 0.0, 1}, "epoch 2, batch 1: the gradient of parameter 0 is inf"},
                    {{1.0, 1.0, 1.0, 0.25, 1}, "the gradient of parameter 576 is inf"},
                    {{1.0, 1.0, 0.0, 0.25, 1}, "the gradient of parameter 576 is "}, /* 0 / 0 */
                    {{large, 1.0 / large, 1.0, 0.0, 1}, NULL},
                    {{huge, 1.0, 1.0, 0.0, 1},
                     f32 ? "second moment of parameter 0" : "the norm of the gradient"},
                };
                for (size_t i = 0; i < LG_COUNT(cases); i++) {
                    const lg_status status = run_steep(&cases[i].bad, (lg_dtype)dtype, shards, chunk, &error);
                    assert_status(status, cases[i].words == NULL ? LG_OK : LG_NOT_FINITE);
                    if (cases[i].words != NULL) assert_message(&error, cases[i].words);
                }
            }
}

/* r_s = x_s sqrt(theta_0) + c theta_1 - 1. At theta_0 = 0 its derivative is infinite; with c = 1e160 the
 * matrix J^T J overflows. */
static lg_status root_residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                size_t count, size_t batch, lg_var *r) {
    double *x = TEST_ARRAY(double, count);
    (void)batch;
    for (size_t i = 0; i < count; i++) x[i] = 1.0 + samples[i];
    const lg_var root = lg_sqrt(tape, lg_slice(tape, theta, 0, 0, 1)),
                 c = lg_scale(tape, lg_slice(tape, theta, 0, 1, 1), *(const double *)user);
    const lg_var line = lg_mul(tape, lg_input_f64(tape, lg_shape1((uint32_t)count), x), root);
    *r = lg_add_scalar(tape, lg_add(tape, line, c), -1.0);
    return lg_tape_status(tape);
}

TEST("derivatives that are infinite at the start are an error of every method") {
    double c = 1.0;
    const lg_fit_problem problem = {.parameters = 2, .samples = 4, .residuals = root_residuals, .user = &c};
    for (int method = 0; lg_fit_method_name((lg_fit_method)method) != NULL; method++) {
        lg_error error;
        lg_fit_options o = options_of(20, 0);
        assert_told(lg_fit_plan_parse(lg_fit_method_name((lg_fit_method)method), true, &o.plan, &told));
        lg_fit *fit = test_fit(NULL, &problem, &o, (const double[2]){0.0, 0.5});
        for (int again = 0; again < 2; again++) {
            assert_status(lg_fit_run(fit, &error), LG_NOT_FINITE);
            assert_message(&error, "the gradient of parameter 0 is -inf");
        }
        assert_int_equal(lg_fit_epochs_done(fit), 0);
    }
    lg_error error;
    lg_fit_options o = options_of(20, 0);
    assert_told(lg_fit_plan_parse("lm", true, &o.plan, &told));
    c = 1e160;
    assert_status(lg_fit_run(test_fit(NULL, &problem, &o, (const double[2]){1.0, 0.0}), &error),
                  LG_NOT_FINITE);
    assert_message(&error, "Gauss-Newton matrix overflows");
}

TEST("a validation loss that is NaN is reported") {
    regression r = make_regression();
    lg_fit_options o = options_of(5, 10);
    o.validation = 0.2;
    lg_fit *fit = regression_fit(NULL, &r, &o);
    memory_archive archive = state_of(fit);
    r.poison = (int)((uint32_t *)memory_find(&archive, "train/permutation")->data)[52];
    lg_error error;
    assert_status(lg_fit_run(fit, &error), LG_NOT_FINITE);
    assert_message(&error, "epoch 1, validation");
    r.poison = -1;
    assert_ok(lg_fit_run(fit, &error));
}

/* ---- failures in the caller's loss ---- */
typedef enum fault { LARGE_LOSS, SHAPES, NO_LOSS, STATUS } fault;

static lg_status faulty_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                             size_t batch, lg_var *loss) {
    const fault kind = *(fault *)user;
    (void)samples, (void)count, (void)batch;
    if (kind == LARGE_LOSS) *loss = theta; /* more than one element */
    if (kind == SHAPES) *loss = lg_add(tape, theta, lg_full(tape, lg_shape1(7), 1.0));
    if (kind == STATUS) *loss = lg_sum(tape, theta);
    return kind == STATUS ? LG_CHECK_FAILED : LG_OK;
}

TEST("a loss that fails or is not a scalar stops the fit") {
    static const lg_status expected[] = {LG_SHAPE, LG_SHAPE, LG_STALE_HANDLE, LG_CHECK_FAILED};
    for (fault kind = LARGE_LOSS; kind <= STATUS; kind++) {
        const lg_fit_problem problem = {.parameters = 3, .samples = 2, .loss = faulty_loss, .user = &kind};
        const double start[3] = {1.0, 2.0, 3.0};
        lg_error error;
        lg_fit *fit = test_fit(NULL, &problem, NULL, start);
        assert_status(lg_fit_run(fit, &error), expected[kind]);
        assert_message(&error, "epoch 1, batch 1");
        if (kind == STATUS) assert_message(&error, "epoch 1, batch 1, shard 0");
        assert_int_equal(lg_fit_steps_done(fit), 0);
    }
}

TEST("a tape beyond max_tape_size returns LG_OUT_OF_MEMORY") {
    regression r = make_regression();
    lg_fit_options o = options_of(2, 0);
    o.max_tape_size = 1000;
    assert_status(lg_fit_run(regression_fit(NULL, &r, &o), NULL), LG_OUT_OF_MEMORY);
}

/* Creates, runs and loads a fit. An error must be reported; if a fit cannot be made, `fit` must stay
 * unchanged. */
static lg_status create_run_load(const lg_context *context, regression *r, const double *theta,
                                 memory_archive *archive) {
    const lg_fit_problem problem = regression_problem(r);
    const lg_archive_reader reader = memory_reader(archive);
    lg_fit_options o = options_of(2, 20);
    lg_fit *const sentinel = (lg_fit *)(void *)archive;
    lg_fit *fit = sentinel;
    lg_error error;
    o.threads = 2;
    o.validation = 0.2;
    lg_status status = lg_fit_create(context, &problem, &o, theta, &fit, &error);
    const bool created = status == LG_OK;
    if (!created) assert_ptr_equal(fit, sentinel);
    if (created) status = lg_fit_run(fit, &error);
    if (status == LG_OK) status = lg_fit_load(fit, &reader, &error);
    if (status != LG_OK) assert_true(strlen(error.message) > 0);
    if (created) lg_fit_destroy(fit);
    return status;
}

TEST("every allocation may fail, and nothing leaks") {
    regression r = make_regression();
    const double *theta = regression_start(&r);
    lg_fit_options o = options_of(2, 20);
    o.validation = 0.2;
    memory_archive archive = state_of(regression_fit(NULL, &r, &o));
    EVERY_ALLOCATION_FAILS(context, 10, { status = create_run_load(context, &r, theta, &archive); });
}

/* ---- options ---- */
#define BAD(change)                                                                                          \
    do {                                                                                                     \
        lg_fit_options o = options_of(5, 10);                                                                \
        change;                                                                                              \
        lg_fit *fit = NULL;                                                                                  \
        lg_error error = {0};                                                                                \
        assert_status(lg_fit_create(NULL, &problem, &o, theta, &fit, &error), LG_INVALID_ARGUMENT);          \
        assert_null(fit);                                                                                    \
        assert_true(strlen(error.message) > 0);                                                              \
    } while (0)

TEST("invalid options and problems are refused") {
    regression r = make_regression();
    lg_fit_problem problem = regression_problem(&r);
    double *theta = regression_start(&r);
    BAD(o.size = 8);
    BAD(o.dtype = (lg_dtype)7);
    BAD(o.epochs = 0);
    BAD(o.shards = 1025);
    BAD(o.threads = 0);
    BAD(o.threads = -1);
    BAD(o.adam.lr = 0.0);
    BAD(o.adam.lr = NAN);
    BAD(o.adam.beta1 = 1.0);
    BAD(o.adam.beta2 = NAN);
    BAD(o.adam.eps = 0.0);
    BAD(o.adam.weight_decay = -1.0);
    BAD(o.schedule.kind = (lg_schedule_kind)LG_SCHEDULE_COUNT);
    BAD((o.schedule = (lg_schedule){.kind = LG_SCHEDULE_STEP, .every = 0, .gamma = 0.5}));
    BAD((o.schedule = (lg_schedule){.kind = LG_SCHEDULE_STEP, .every = 1, .gamma = 0.0}));
    BAD((o.schedule = (lg_schedule){.kind = LG_SCHEDULE_COSINE, .floor = 2.0}));
    BAD(o.clip_norm = -1.0);
    BAD(o.plan.phases = LG_FIT_MAX_PHASES + 1);
    BAD((o.plan.phases = 1, o.plan.phase[0].method = 99));
    BAD((o.plan.phases = 2, o.plan.phase[0].epochs = 0));
    BAD(o.validation = 1.0);
    BAD(o.validation = NAN);
    BAD(problem.parameters = 0);
    problem = regression_problem(&r);
    BAD(problem.samples = 0);
    problem = regression_problem(&r);
    BAD((problem.samples = 1, o.validation = 0.5));
    problem = regression_problem(&r);
    BAD((problem.loss = NULL, problem.residuals = NULL));
    problem = regression_problem(&r);
    lg_fit *fit = NULL;
    theta[3] = INFINITY;
    assert_status(lg_fit_create(NULL, &problem, NULL, theta, &fit, NULL), LG_NOT_FINITE);
    theta[3] = 1e300; /* finite, but too large for a float */
    lg_fit_options o = options_of(1, 0);
    o.dtype = LG_F32;
    assert_status(lg_fit_create(NULL, &problem, &o, theta, &fit, NULL), LG_NOT_FINITE);
    assert_null(fit);
    lg_fit_destroy(NULL);
    for (int row = 0; row < 6; row++) {
        problem = regression_problem(&r);
        if (row == 0) problem.loss = NULL, problem.residuals = NULL;
        if (row == 1) problem.samples = 0;
        if (row == 2) problem.parameters = 0;
        if (row == 3) problem.samples = SIZE_MAX;
        if (row == 4) problem.parameters = (size_t)LG_NEWTON_MAX_PARAMETERS + 1;
        assert_status(lg_fit_newton(NULL, row == 5 ? NULL : &problem, theta, NULL), LG_INVALID_ARGUMENT);
    }
}

/* ---- states of other fits, and invalid states ---- */
typedef struct saved {
    regression r;
    lg_fit_options options;
    lg_fit *fit; /* has run further than the state in the archive */
    memory_archive archive;
} saved;

static void save_state(saved *s) {
    s->r = make_regression();
    s->options = options_of(6, 10);
    s->options.validation = 0.2;
    s->options.stop_after = 2;
    s->fit = regression_fit(NULL, &s->r, &s->options);
    run_fit(s->fit);
    s->archive = state_of(s->fit);
    run_fit(s->fit);
}

/* Loading must fail with this status and these words, and leave the fit unchanged. */
static void assert_refused(saved *s, lg_fit *fit, lg_status expected, const char *words) {
    const memory_archive before = state_of(fit);
    const lg_archive_reader reader = memory_reader(&s->archive);
    lg_error error;
    const lg_status status = lg_fit_load(fit, &reader, &error);
    if (status != expected) fail_msg("%s: %s", words, lg_status_name(status));
    assert_message(&error, words);
    const memory_archive after = state_of(fit);
    assert_same_state(&before, &after);
}

TEST("a state with other hyperparameters is refused with their names") {
    saved s;
    save_state(&s);
#define DIFFERS(change, name)                                                                                \
    do {                                                                                                     \
        lg_fit_options o = s.options;                                                                        \
        change;                                                                                              \
        assert_refused(&s, regression_fit(NULL, &s.r, &o), LG_INVALID_ARGUMENT, "train/options/" name);      \
    } while (0)
    DIFFERS(o.epochs = 7, "epochs");
    DIFFERS(o.batch = 11, "batch");
    DIFFERS(o.shards = 3, "shards");
    DIFFERS(o.shards = 0, "shards_by_work");
    DIFFERS(o.dtype = LG_F32, "dtype");
    DIFFERS(o.seed = 2, "seed");
    DIFFERS(o.shuffle = false, "shuffle");
    DIFFERS(o.keep_best = true, "keep_best");
    DIFFERS(o.patience = 9, "patience");
    DIFFERS(o.adam.lr = 2e-3, "lr");
    DIFFERS(o.adam.beta1 = 0.8, "beta1");
    DIFFERS(o.adam.beta2 = 0.99, "beta2");
    DIFFERS(o.adam.eps = 1e-7, "eps");
    DIFFERS(o.adam.weight_decay = 0.1, "weight_decay");
    DIFFERS(o.adam.decoupled = true, "decoupled");
    DIFFERS(o.schedule.kind = LG_SCHEDULE_COSINE, "schedule");
    DIFFERS(o.schedule.every = 3, "schedule_every");
    DIFFERS(o.schedule.gamma = 0.3, "schedule_gamma");
    DIFFERS(o.schedule.floor = 0.3, "schedule_floor");
    DIFFERS(o.clip_norm = 1.0, "clip_norm");
    DIFFERS(o.validation = 0.21, "validation");
    /* These may differ. */
    lg_fit_options o = s.options;
    o.threads = 2;
    o.stop_after = 1;
    o.checkpoint_every = 5;
    o.max_tape_size = (size_t)1 << 30;
    load_state(regression_fit(NULL, &s.r, &o), &s.archive);
}

/* Sets an element. For integers, a negative value or one that is too large stands for the largest integer. */
static void set_element(memory_item *item, size_t at, double value) {
    const uint64_t whole = value >= 0 && value < 0x1p64 ? (uint64_t)value : UINT64_MAX;
    if (item->type == LG_ELEMENT_F64) ((double *)item->data)[at] = value;
    if (item->type == LG_ELEMENT_U64) ((uint64_t *)item->data)[at] = whole;
    if (item->type == LG_ELEMENT_U32) ((uint32_t *)item->data)[at] = (uint32_t)whole;
}

TEST("a damaged state is refused with the name of the array, and changes nothing") {
    static const struct {
        const char *path;
        size_t at;
        double value;
        const char *words; /* NULL: the path */
    } cases[] = {
        {"train/epoch", 0, 7, NULL},
        {"train/epoch", 0, -1, NULL}, /* the largest integer */
        {"train/epoch", 0, 1, ""},
        {"train/position", 0, 1000, NULL},
        {"train/position", 0, 7, NULL},
        {"train/position", 0, 10, "train/open"},
        {"train/open", 0, 2, NULL},
        {"train/best_epoch", 0, 3, NULL},
        {"train/best_epoch", 0, 0, NULL},
        {"optimizer/adam/step", 0, 3, NULL},
        {"train/running_loss", 0, NAN, NULL},
        {"train/running_seconds", 0, INFINITY, NULL},
        {"optimizer/parameters", 9, NAN, NULL},
        {"optimizer/best", 9, NAN, NULL},
        {"optimizer/adam/m", 0, INFINITY, NULL},
        {"optimizer/adam/v", 0, -1e-9, NULL},
        {"optimizer/adam/v", 0, NAN, NULL},
        {"train/position", 0, 42, "train/open"}, /* the end of the training part */
        {"train/history/loss", 1, NAN, NULL},
        {"train/history/validation", 1, NAN, NULL},
        {"train/permutation", 4, 53, NULL},
        {"train/permutation", 4, -1, NULL},
    };
    saved s;
    save_state(&s);
    const memory_archive good = s.archive;
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        memory_item *item = memory_find(&s.archive, cases[i].path);
        void *bad = lg_test_memory(item->bytes);
        memcpy(bad, item->data, item->bytes);
        item->data = bad;
        set_element(item, cases[i].at, cases[i].value);
        assert_refused(&s, s.fit, LG_FORMAT, cases[i].words != NULL ? cases[i].words : cases[i].path);
        s.archive = good;
    }
    double zeros[4] = {0};
    memory_find(&s.archive, "rng")->data = zeros;
    assert_refused(&s, s.fit, LG_FORMAT, "rng");
    s.archive = good;
    uint32_t *order = memory_find(&s.archive, "train/permutation")->data, kept = order[4];
    order[4] = order[5];
    assert_refused(&s, s.fit, LG_FORMAT, "train/permutation");
    order[4] = kept;
    memory_find(&s.archive, "optimizer/adam/v")->dims[0]--;
    assert_refused(&s, s.fit, LG_SHAPE, "optimizer/adam/v");
    s.archive = good;
    /* Leaves out each array in turn. */
    for (size_t i = 0; i < s.archive.count; i++) {
        char path[64];
        memcpy(path, s.archive.items[i].path, sizeof path);
        s.archive.items[i].path[0] = '#';
        assert_refused(&s, s.fit, LG_NOT_FOUND, path);
        s.archive.items[i].path[0] = path[0];
    }
    load_state(s.fit, &s.archive);
    assert_int_equal(lg_fit_epochs_done(s.fit), 2);
    /* A writer that fails at each array in turn. */
    for (size_t i = 1; i < s.archive.count; i++) {
        memory_archive full = {.fail_after = i};
        const lg_archive_writer writer = memory_writer(&full);
        lg_error error;
        assert_status(lg_fit_save(s.fit, &writer, &error), LG_FILE);
        assert_message(&error, s.archive.items[i].path);
    }
}
