/* Shared by the tests of src/nn: fits that the running test owns, their states, a small regression. */
#ifndef LG_NN_SUPPORT_H
#define LG_NN_SUPPORT_H

#include "support/fixtures.h"

#include "liegrad/fit.h"
#include "liegrad/networks.h"
#include "liegrad/ops.h"
#include "support/memory_archive.h"

/* A context that is cancelled when the flag is set. The running test owns it. */
static inline lg_context *cancelled_by(const volatile int *cancel) {
    lg_context_options options;
    lg_context *context = NULL;
    lg_context_options_init(&options);
    options.cancel = cancel;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    return context;
}

/* ---- fits ---- */

RELEASES(release_fit, lg_fit_destroy)

static inline lg_fit *test_fit(const lg_context *context, const lg_fit_problem *problem,
                               const lg_fit_options *options, const double *theta) {
    lg_fit *fit = NULL;
    assert_told(lg_fit_create(context, problem, options, theta, &fit, &told));
    lg_test_owns(fit, release_fit);
    return fit;
}

static inline lg_fit_options options_of(uint64_t epochs, size_t batch) {
    lg_fit_options o;
    lg_fit_options_init(&o);
    o.shards = 4;
    o.epochs = epochs;
    o.batch = batch;
    o.adam.lr = 1e-2;
    return o;
}

static inline void run_fit(lg_fit *fit) {
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_fit_run(fit, &error);
    assert_string_equal(error.message, "");
    assert_int_equal(status, LG_OK);
}

static inline void assert_message(const lg_error *error, const char *part) {
    if (strstr(error->message, part) == NULL) fail_msg("\"%s\" does not say \"%s\"", error->message, part);
}

/* ---- stored states of fits ---- */

static inline memory_archive state_of(const lg_fit *fit) {
    memory_archive archive = {.count = 0};
    const lg_archive_writer writer = memory_writer(&archive);
    assert_ok(lg_fit_save(fit, &writer, NULL));
    return archive;
}

static inline void load_state(lg_fit *fit, memory_archive *archive) {
    const lg_archive_reader reader = memory_reader(archive);
    assert_told(lg_fit_load(fit, &reader, &told));
}

/* All stored arrays must be the same, except the seconds. */
static inline void assert_same_state(const memory_archive *x, const memory_archive *y) {
    assert_int_equal(x->count, y->count);
    for (size_t i = 0; i < x->count; i++) {
        if (strstr(x->items[i].path, "seconds") != NULL) continue;
        const memory_item *other = memory_find(y, x->items[i].path);
        assert_non_null(other);
        assert_int_equal(x->items[i].bytes, other->bytes);
        if (memcmp(x->items[i].data, other->data, other->bytes) != 0) fail_msg("%s differs", other->path);
    }
}

static inline void assert_same_fits(const lg_fit *a, const lg_fit *b) {
    const memory_archive x = state_of(a), y = state_of(b);
    assert_same_state(&x, &y);
}

/* ---- regression t = sin(2 x) + x^2/2 on [-1, 1] by an MLP; mean squared error ---- */
#define REGRESSION_SAMPLES 53

typedef struct regression {
    lg_mlp net;
    double x[REGRESSION_SAMPLES], t[REGRESSION_SAMPLES];
    size_t validation; /* number of samples in the problem's own validation part */
    int poison;        /* index of a sample whose target is NaN, or -1 */
    int *cancel_at;    /* decreases with each call of the loss; at 0 it raises `cancel`. NULL: never */
    volatile int *cancel;
} regression;

static inline regression make_regression(void) {
    regression r = {.poison = -1};
    const uint32_t hidden[2] = {12, 12};
    assert_ok(lg_mlp_init(&r.net, 1, hidden, 2, 1, LG_TANH, true));
    for (int i = 0; i < REGRESSION_SAMPLES; i++) {
        r.x[i] = -1.0 + 2.0 * i / (REGRESSION_SAMPLES - 1.0);
        r.t[i] = sin(2.0 * r.x[i]) + 0.5 * r.x[i] * r.x[i];
    }
    return r;
}

/* Predicted minus given value, (count, 1). */
static lg_status regression_difference(const regression *r, lg_tape *tape, lg_var theta,
                                       const uint32_t *samples, size_t count, lg_var *d) {
    double x[REGRESSION_SAMPLES], t[REGRESSION_SAMPLES];
    if (count == 0 || count > REGRESSION_SAMPLES) return LG_CHECK_FAILED;
    for (size_t i = 0; i < count; i++) {
        x[i] = r->x[samples[i]];
        t[i] = (int)samples[i] == r->poison ? NAN : r->t[samples[i]];
    }
    if (r->cancel_at != NULL && --*r->cancel_at == 0) *r->cancel = 1;
    const lg_shape shape = lg_shape2((uint32_t)count, 1);
    const lg_var y = lg_mlp_record(tape, &r->net, theta, 0, lg_input_f64(tape, shape, x));
    *d = lg_sub(tape, y, lg_input_f64(tape, shape, t));
    return LG_OK;
}

static lg_status regression_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                 size_t count, size_t batch, lg_var *loss) {
    lg_var d = LG_NONE;
    const lg_status status = regression_difference(user, tape, theta, samples, count, &d);
    if (status != LG_OK) return status;
    *loss = lg_scale(tape, lg_sum(tape, lg_square(tape, d)), 1.0 / (double)batch);
    return LG_OK;
}

static lg_status regression_residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                      size_t count, size_t batch, lg_var *residuals) {
    lg_var d = LG_NONE;
    const lg_status status = regression_difference(user, tape, theta, samples, count, &d);
    if (status != LG_OK) return status;
    *residuals = lg_scale(tape, d, 1.0 / sqrt((double)batch));
    return LG_OK;
}

static inline lg_fit_problem regression_problem(regression *r) {
    return (lg_fit_problem){.parameters = lg_mlp_parameters(&r->net),
                            .samples = REGRESSION_SAMPLES,
                            .validation = r->validation,
                            .loss = regression_loss,
                            .residuals = regression_residuals,
                            .user = r};
}

/* The parameters that the tests start from. */
static inline double *regression_start(const regression *r) {
    double *theta = TEST_ARRAY(double, lg_mlp_parameters(&r->net));
    lg_rng rng = test_rng(3, 0);
    lg_mlp_initialise(&r->net, &rng, theta);
    return theta;
}

static inline lg_fit *regression_fit(const lg_context *context, regression *r, const lg_fit_options *o) {
    const lg_fit_problem problem = regression_problem(r);
    return test_fit(context, &problem, o, regression_start(r));
}

#endif
