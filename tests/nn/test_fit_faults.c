/* Training that cannot go on, or should not start: NaN, failing memory, bad options, states that are not one.
 */
#include "nn_support.h"
#include "liegrad/ops.h"

static lg_fit_options options_of(uint64_t epochs, size_t batch) {
    lg_fit_options o;
    lg_fit_options_init(&o);
    o.epochs = epochs;
    o.batch = batch;
    return o;
}

static lg_fit *fit_of(const lg_context *context, regression *r, const lg_fit_options *o) {
    const lg_fit_problem problem = regression_problem(r);
    double *theta = regression_start(r);
    lg_fit *fit = NULL;
    assert_ok(lg_fit_create(context, &problem, o, theta, &fit, NULL));
    free(theta);
    return fit;
}

static void save(const lg_fit *fit, memory_archive *archive) {
    const lg_archive_writer writer = memory_writer(archive);
    assert_ok(lg_fit_save(fit, &writer, NULL));
}

static void assert_message(const lg_error *error, const char *part) {
    if (strstr(error->message, part) == NULL) fail_msg("\"%s\" does not say \"%s\"", error->message, part);
}

/* ---- values that are not finite ---- */

/* Sample 29 of 53 in order is in batch 3 of 10 samples. */
static void test_nan_loss(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    lg_fit_options o = options_of(5, 10);
    o.shuffle = false;
    o.stop_after = 1;
    lg_fit *fit = fit_of(NULL, &r, &o);
    assert_ok(lg_fit_run(fit, NULL));
    r.poison = 29;
    lg_error error;
    assert_status(lg_fit_run(fit, &error), LG_NOT_FINITE);
    assert_int_equal(error.status, LG_NOT_FINITE);
    assert_message(&error, "epoch 2, batch 3");
    assert_message(&error, "loss");
    assert_int_equal(lg_fit_position(fit), 20);
    assert_int_equal(lg_fit_steps_done(fit), 8);
    double theta[512], again[512];
    const size_t n = lg_mlp_parameters(&r.net);
    lg_fit_parameters(fit, theta);
    for (size_t i = 0; i < n; i++) assert_true(isfinite(theta[i]));
    assert_status(lg_fit_run(fit, &error), LG_NOT_FINITE);
    lg_fit_parameters(fit, again);
    assert_memory_equal(theta, again, n * sizeof *theta);

    /* with the cause gone it goes on as if nothing had been */
    r.poison = -1;
    o.stop_after = 0;
    lg_fit *whole = fit_of(NULL, &r, &o);
    assert_ok(lg_fit_run(whole, NULL));
    while (!lg_fit_finished(fit)) assert_ok(lg_fit_run(fit, NULL));
    lg_fit_parameters(fit, theta);
    lg_fit_parameters(whole, again);
    assert_memory_equal(theta, again, n * sizeof *theta);
    lg_fit_destroy(whole);
    lg_fit_destroy(fit);
}

/* loss = c sqrt(theta_1) + theta_0: its gradient is infinite at theta_1 = 0 while the loss is not. */
typedef struct trap {
    double factor;
    lg_status status;
} trap;

static lg_status trap_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *loss) {
    const trap *t = user;
    (void)samples;
    const lg_var root = lg_sqrt(tape, lg_slice(tape, theta, 0, 1, 1));
    const lg_var sum = lg_add(tape, lg_scale(tape, root, t->factor), lg_slice(tape, theta, 0, 0, 1));
    *loss = lg_scale(tape, sum, (double)count / (double)batch);
    return t->status;
}

static lg_status run_trap(trap *t, lg_dtype dtype, double second, double theta[2], lg_error *error) {
    const lg_fit_problem problem = {.parameters = 2, .samples = 3, .loss = trap_loss, .user = t};
    const double start[2] = {0.5, second};
    lg_fit_options o = options_of(3, 0);
    o.dtype = dtype;
    lg_fit *fit = NULL;
    assert_ok(lg_fit_create(NULL, &problem, &o, start, &fit, NULL));
    const lg_status status = lg_fit_run(fit, error);
    lg_fit_parameters(fit, theta);
    lg_fit_destroy(fit);
    return status;
}

static void test_infinite_gradient(void **state) {
    (void)state;
    trap t = {.factor = 1.0};
    double theta[2];
    lg_error error;
    assert_status(run_trap(&t, LG_F64, 0.0, theta, &error), LG_NOT_FINITE);
    assert_message(&error, "epoch 1, batch 1: the gradient of parameter 1 is inf");
    assert_close(theta[0], 0.5, 0.0, 0.0);
    assert_close(theta[1], 0.0, 0.0, 0.0);
}

/* A finite gradient whose square is not: without the check its second moment would stay infinite for ever. */
static void test_overflowing_moment(void **state) {
    (void)state;
    trap t = {.factor = 1e25};
    double theta[2];
    lg_error error;
    assert_status(run_trap(&t, LG_F32, 0.25, theta, &error), LG_NOT_FINITE);
    assert_message(&error, "second moment of parameter 1");
    assert_close(theta[0], 0.5, 0.0, 0.0);
    assert_close(theta[1], 0.25, 0.0, 0.0);
    t.factor = 1e200;
    assert_status(run_trap(&t, LG_F64, 0.25, theta, &error), LG_NOT_FINITE);
    assert_message(&error, "norm of the gradient");
    assert_close(theta[1], 0.25, 0.0, 0.0);
}

/* theta = (W (SIDE, SIDE), b (SIDE)). A sample's loss is right sum(x W) + root sum(sqrt(b - shift)) with
 * x = (left, ..., left), so that the gradient is left right in W and root / (2 sqrt(b - shift)) in b. */
enum { SIDE = 24, STEEP = SIDE * SIDE + SIDE };
typedef struct steep {
    double left, right, root, shift;
    uint32_t sample; /* the only one that is so; the others have left = right = root = 1, shift = 0 */
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

/* One good epoch, then one as told; the rate is so small that W stays near 0 and b = 1/4. On failure the
 * state must be that after the good epoch. */
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
    lg_fit *fit = NULL;
    assert_ok(lg_fit_create(NULL, &problem, &o, start, &fit, NULL));
    assert_ok(lg_fit_run(fit, error));
    memory_archive kept = {0}, found = {0};
    save(fit, &kept);
    lg_fit_current_parameters(fit, before);
    now = *bad;
    const lg_status status = lg_fit_run(fit, error);
    lg_fit_current_parameters(fit, after);
    assert_int_equal(lg_fit_steps_done(fit), status == LG_OK ? 2 : 1);
    if (status != LG_OK) {
        assert_memory_equal(before, after, sizeof before);
        save(fit, &found);
        for (size_t i = 0; i < kept.count; i++)
            if (strncmp(kept.items[i].path, "optimizer/", 10) == 0)
                assert_memory_equal(kept.items[i].data, found.items[i].data, kept.items[i].bytes);
        memory_clear(&found);
    }
    memory_clear(&kept);
    lg_fit_destroy(fit);
    return status;
}

/* Whatever the way in which the gradient is cut into pieces, and how its norm is known: in a weight, where it
 * is a product that overflows; in a bias; in one chunk of several. */
static void test_gradients_of_layers(void **state) {
    (void)state;
    lg_error error;
    for (int dtype = 0; dtype < 2; dtype++)
        for (uint32_t shards = 1; shards <= 2; shards++)
            for (size_t chunk = 1; chunk <= 3; chunk++) {
                const bool f32 = (lg_dtype)dtype == LG_F32;
                const double large = f32 ? 1e25 : 1e200, huge = f32 ? 1e25 : 1e155;
                const struct {
                    steep bad;
                    const char *words; /* NULL: nothing is wrong */
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

static void test_nan_validation(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    lg_fit_options o = options_of(5, 10);
    o.validation = 0.2;
    lg_fit *fit = fit_of(NULL, &r, &o);
    memory_archive archive = {0};
    save(fit, &archive);
    r.poison = (int)((uint32_t *)memory_find(&archive, "train/permutation")->data)[52];
    lg_error error;
    assert_status(lg_fit_run(fit, &error), LG_NOT_FINITE);
    assert_message(&error, "epoch 1, validation");
    memory_clear(&archive);
    r.poison = -1;
    assert_ok(lg_fit_run(fit, &error));
    lg_fit_destroy(fit);
}

/* ---- the caller's failures ---- */
static lg_status bad_shape_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                size_t count, size_t batch, lg_var *loss) {
    (void)samples, (void)count, (void)batch;
    if (*(int *)user == 0) *loss = theta; /* more than one element */
    if (*(int *)user == 1)
        *loss = lg_add(tape, theta, lg_full(tape, lg_shape1(7), 1.0)); /* shapes do not fit */
    return LG_OK;                                                      /* 2: no loss at all */
}

static void test_failing_loss(void **state) {
    (void)state;
    trap t = {.factor = 1.0, .status = LG_CHECK_FAILED};
    double theta[2];
    lg_error error;
    assert_status(run_trap(&t, LG_F64, 1.0, theta, &error), LG_CHECK_FAILED);
    assert_message(&error, "epoch 1, batch 1, shard 0");
    for (int kind = 0; kind < 3; kind++) {
        const lg_fit_problem problem = {.parameters = 3, .samples = 2, .loss = bad_shape_loss, .user = &kind};
        const double start[3] = {1.0, 2.0, 3.0};
        lg_fit *fit = NULL;
        assert_ok(lg_fit_create(NULL, &problem, NULL, start, &fit, NULL));
        assert_status(lg_fit_run(fit, &error), kind == 2 ? LG_STALE_HANDLE : LG_SHAPE);
        assert_int_equal(lg_fit_steps_done(fit), 0);
        lg_fit_destroy(fit);
    }
}

static void test_tape_limit(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    lg_fit_options o = options_of(2, 0);
    o.max_tape_bytes = 1000;
    lg_error error;
    const lg_fit_problem problem = regression_problem(&r);
    double *theta = regression_start(&r);
    lg_fit *fit = NULL;
    lg_status status = lg_fit_create(NULL, &problem, &o, theta, &fit, &error);
    if (status == LG_OK) status = lg_fit_run(fit, &error);
    assert_status(status, LG_OUT_OF_MEMORY);
    lg_fit_destroy(fit);
    free(theta);
}

/* Every allocation in turn fails: a status, an untouched output, nothing left behind. */
static lg_status create_run_load(const lg_context *context, regression *r, const double *theta,
                                 memory_archive *archive, bool *created) {
    const lg_fit_problem problem = regression_problem(r);
    lg_fit_options o = options_of(2, 20);
    o.threads = 2;
    o.validation = 0.2;
    lg_fit *const sentinel = (lg_fit *)(void *)archive;
    lg_fit *fit = sentinel;
    lg_error error;
    lg_status status = lg_fit_create(context, &problem, &o, theta, &fit, &error);
    *created = status == LG_OK;
    if (status != LG_OK) {
        assert_ptr_equal(fit, sentinel);
        assert_true(strlen(error.message) > 0);
        return status;
    }
    status = lg_fit_run(fit, &error);
    if (status == LG_OK) {
        const lg_archive_reader reader = memory_reader(archive);
        status = lg_fit_load(fit, &reader, &error);
    }
    if (status != LG_OK) assert_true(strlen(error.message) > 0);
    lg_fit_destroy(fit);
    return status;
}

static void test_failing_memory(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    double *theta = regression_start(&r);
    lg_fit_options o = options_of(2, 20);
    o.validation = 0.2;
    lg_fit *fit = fit_of(NULL, &r, &o);
    memory_archive archive = {0};
    save(fit, &archive);
    lg_fit_destroy(fit);
    bool created = false;
    int before = 0, after = 0;
    for (long fail_at = 0;; fail_at++) {
        counter c;
        lg_context *context = counter_context(&c, fail_at, NULL);
        const lg_status status = create_run_load(context, &r, theta, &archive, &created);
        const long calls = c.calls;
        lg_context_destroy(context);
        assert_int_equal(c.live, 0);
        if (calls <= fail_at) {
            assert_status(status, LG_OK);
            break;
        }
        assert_status(status, LG_OUT_OF_MEMORY);
        before += !created;
        after += created;
    }
    assert_true(before >= 8);
    assert_true(after >= 2);
    memory_clear(&archive);
    free(theta);
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

static void test_bad_options(void **state) {
    (void)state;
    regression r;
    regression_init(&r);
    lg_fit_problem problem = regression_problem(&r);
    double *theta = regression_start(&r);
    BAD(o.size = 8);
    BAD(o.dtype = (lg_dtype)7);
    BAD(o.epochs = 0);
    BAD(o.shards = 0);
    BAD(o.shards = 5000);
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
    BAD(o.validation = 1.0);
    BAD(o.validation = NAN);
    BAD(problem.parameters = 0);
    problem = regression_problem(&r);
    BAD(problem.samples = 0);
    problem = regression_problem(&r);
    BAD((problem.samples = 1, o.validation = 0.5));
    problem = regression_problem(&r);
    BAD(problem.loss = NULL);
    problem = regression_problem(&r);
    lg_fit *fit = NULL;
    assert_status(lg_fit_create(NULL, &problem, NULL, NULL, &fit, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_fit_create(NULL, NULL, NULL, theta, &fit, NULL), LG_INVALID_ARGUMENT);
    theta[3] = INFINITY;
    assert_status(lg_fit_create(NULL, &problem, NULL, theta, &fit, NULL), LG_NOT_FINITE);
    theta[3] = 1e300; /* finite, but not as a float */
    lg_fit_options o = options_of(1, 0);
    o.dtype = LG_F32;
    assert_status(lg_fit_create(NULL, &problem, &o, theta, &fit, NULL), LG_NOT_FINITE);
    assert_null(fit);
    lg_fit_destroy(NULL);
    free(theta);
}

/* ---- states that do not belong, or are none ---- */
typedef struct saved {
    regression r;
    lg_fit_options options;
    lg_fit *fit;
    memory_archive archive;
} saved;

static void saved_init(saved *s) {
    regression_init(&s->r);
    s->options = options_of(6, 10);
    s->options.validation = 0.2;
    s->options.stop_after = 2;
    s->archive = (memory_archive){0};
    s->fit = fit_of(NULL, &s->r, &s->options);
    assert_ok(lg_fit_run(s->fit, NULL));
    save(s->fit, &s->archive);
    assert_ok(lg_fit_run(s->fit, NULL)); /* the object is now further than the archive */
}

static void saved_clear(saved *s) {
    memory_clear(&s->archive);
    lg_fit_destroy(s->fit);
}

/* A failing load: status, words, and the state as before. */
static void assert_refused(saved *s, lg_fit *fit, lg_status expected, const char *words) {
    memory_archive before = {0}, after = {0};
    save(fit, &before);
    const lg_archive_reader reader = memory_reader(&s->archive);
    lg_error error;
    const lg_status status = lg_fit_load(fit, &reader, &error);
    if (status != expected) fail_msg("%s: %s", words, lg_status_name(status));
    assert_message(&error, words);
    save(fit, &after);
    assert_int_equal(before.count, after.count);
    for (size_t i = 0; i < before.count; i++)
        assert_memory_equal(before.items[i].data, after.items[i].data, before.items[i].bytes);
    memory_clear(&before);
    memory_clear(&after);
}

static void test_other_hyperparameters(void **state) {
    (void)state;
    saved s;
    saved_init(&s);
#define DIFFERS(change, name)                                                                                \
    do {                                                                                                     \
        lg_fit_options o = s.options;                                                                        \
        change;                                                                                              \
        lg_fit *fit = fit_of(NULL, &s.r, &o);                                                                \
        assert_refused(&s, fit, LG_INVALID_ARGUMENT, "train/options/" name);                                 \
        lg_fit_destroy(fit);                                                                                 \
    } while (0)
    DIFFERS(o.epochs = 7, "epochs");
    DIFFERS(o.batch = 11, "batch");
    DIFFERS(o.shards = 3, "shards");
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
#undef DIFFERS
    /* these may differ */
    lg_fit_options o = s.options;
    o.threads = 2;
    o.stop_after = 1;
    o.checkpoint_every = 5;
    o.max_tape_bytes = (size_t)1 << 30;
    lg_fit *fit = fit_of(NULL, &s.r, &o);
    const lg_archive_reader reader = memory_reader(&s.archive);
    assert_ok(lg_fit_load(fit, &reader, NULL));
    lg_fit_destroy(fit);
    saved_clear(&s);
}

static void set_u64(saved *s, const char *path, uint64_t value) {
    memcpy(memory_find(&s->archive, path)->data, &value, sizeof value);
}

static void set_f64(saved *s, const char *path, size_t index, double value) {
    ((double *)memory_find(&s->archive, path)->data)[index] = value;
}

static void test_damaged_states(void **state) {
    (void)state;
#define DAMAGED(damage, status, words)                                                                       \
    do {                                                                                                     \
        saved s;                                                                                             \
        saved_init(&s);                                                                                      \
        damage;                                                                                              \
        assert_refused(&s, s.fit, status, words);                                                            \
        saved_clear(&s);                                                                                     \
    } while (0)
    DAMAGED(set_u64(&s, "train/epoch", 7), LG_FORMAT, "train/epoch");
    DAMAGED(set_u64(&s, "train/epoch", UINT64_MAX), LG_FORMAT, "train/epoch");
    DAMAGED(set_u64(&s, "train/epoch", 1), LG_FORMAT, "");
    DAMAGED(set_u64(&s, "train/position", 1000), LG_FORMAT, "train/position");
    DAMAGED(set_u64(&s, "train/position", 7), LG_FORMAT, "train/position");
    DAMAGED(set_u64(&s, "train/position", 10), LG_FORMAT, "train/open");
    DAMAGED(set_u64(&s, "train/open", 2), LG_FORMAT, "train/open");
    DAMAGED(set_u64(&s, "train/best_epoch", 3), LG_FORMAT, "train/best_epoch");
    DAMAGED(set_u64(&s, "train/best_epoch", 0), LG_FORMAT, "train/best_epoch");
    DAMAGED(set_u64(&s, "optimizer/adam/step", 3), LG_FORMAT, "optimizer/adam/step");
    DAMAGED(set_f64(&s, "train/running_loss", 0, NAN), LG_FORMAT, "train/running_loss");
    DAMAGED(set_f64(&s, "train/running_seconds", 0, INFINITY), LG_FORMAT, "train/running_seconds");
    DAMAGED(set_f64(&s, "optimizer/parameters", 9, NAN), LG_FORMAT, "optimizer/parameters");
    DAMAGED(set_f64(&s, "optimizer/best", 9, NAN), LG_FORMAT, "optimizer/best");
    DAMAGED(set_f64(&s, "optimizer/adam/m", 0, INFINITY), LG_FORMAT, "optimizer/adam/m");
    DAMAGED(set_f64(&s, "optimizer/adam/v", 0, -1e-9), LG_FORMAT, "optimizer/adam/v");
    DAMAGED(set_f64(&s, "train/history/loss", 1, NAN), LG_FORMAT, "train/history/loss");
    DAMAGED(set_f64(&s, "train/history/validation", 1, NAN), LG_FORMAT, "train/history/validation");
    DAMAGED(memset(memory_find(&s.archive, "rng")->data, 0, 32), LG_FORMAT, "rng");
    DAMAGED(((uint32_t *)memory_find(&s.archive, "train/permutation")->data)[4] = 53, LG_FORMAT,
            "train/permutation");
    DAMAGED(((uint32_t *)memory_find(&s.archive, "train/permutation")->data)[4] = UINT32_MAX, LG_FORMAT,
            "train/permutation");
    DAMAGED(((uint32_t *)memory_find(&s.archive, "train/permutation")->data)[4] =
                ((uint32_t *)memory_find(&s.archive, "train/permutation")->data)[5],
            LG_FORMAT, "train/permutation");
    DAMAGED(memory_find(&s.archive, "optimizer/adam/v")->dims[0]--, LG_SHAPE, "optimizer/adam/v");
#undef DAMAGED
    /* each array missing in turn */
    saved s;
    saved_init(&s);
    for (size_t i = 0; i < s.archive.count; i++) {
        char path[64];
        memcpy(path, s.archive.items[i].path, sizeof path);
        s.archive.items[i].path[0] = '#';
        assert_refused(&s, s.fit, LG_NOT_FOUND, path);
        s.archive.items[i].path[0] = path[0];
    }
    const lg_archive_reader reader = memory_reader(&s.archive);
    assert_ok(lg_fit_load(s.fit, &reader, NULL));
    assert_int_equal(lg_fit_epochs_done(s.fit), 2);
    /* a writer that fails at each array in turn */
    for (size_t i = 1; i < s.archive.count; i++) {
        memory_archive full = {.fail_after = i};
        const lg_archive_writer writer = memory_writer(&full);
        lg_error error;
        assert_status(lg_fit_save(s.fit, &writer, &error), LG_FILE);
        assert_message(&error, s.archive.items[i].path);
        memory_clear(&full);
    }
    saved_clear(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nan_loss),           cmocka_unit_test(test_infinite_gradient),
        cmocka_unit_test(test_overflowing_moment), cmocka_unit_test(test_gradients_of_layers),
        cmocka_unit_test(test_nan_validation),     cmocka_unit_test(test_failing_loss),
        cmocka_unit_test(test_tape_limit),         cmocka_unit_test(test_failing_memory),
        cmocka_unit_test(test_bad_options),        cmocka_unit_test(test_other_hyperparameters),
        cmocka_unit_test(test_damaged_states),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
