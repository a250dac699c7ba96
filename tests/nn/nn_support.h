/* Shared by the tests of src/nn: an allocator that counts and can fail, an archive in memory, a small
 * regression. */
#ifndef LG_NN_SUPPORT_H
#define LG_NN_SUPPORT_H

#include "test_support.h"

#include <pthread.h>

#include "liegrad/nn.h"
#include "liegrad/ops.h"

/* ---- allocator: counts live blocks and calls; call number fail_at (from 0) gives NULL ---- */
typedef struct counter {
    pthread_mutex_t mutex;
    long calls, live, fail_at;
} counter;

static void *counter_allocate(void *user, size_t bytes) {
    counter *c = user;
    void *memory = NULL;
    pthread_mutex_lock(&c->mutex);
    if (c->calls++ != c->fail_at && posix_memalign(&memory, 64, bytes) == 0) c->live++;
    pthread_mutex_unlock(&c->mutex);
    return memory;
}

static void counter_release(void *user, void *memory) {
    counter *c = user;
    pthread_mutex_lock(&c->mutex);
    c->live--;
    pthread_mutex_unlock(&c->mutex);
    free(memory);
}

static inline lg_context *counter_context(counter *c, long fail_at, const volatile int *cancel) {
    *c = (counter){.fail_at = -1};
    pthread_mutex_init(&c->mutex, NULL);
    lg_context_options options;
    lg_context_options_init(&options);
    options.allocate = counter_allocate;
    options.release = counter_release;
    options.allocator_user = c;
    options.cancel = cancel;
    lg_context *context = NULL;
    assert_ok(lg_context_create(&options, &context));
    c->calls = 0;
    c->fail_at = fail_at;
    return context;
}

/* ---- archive in memory ---- */
typedef struct memory_item {
    char path[64];
    lg_element type;
    uint32_t rank;
    uint64_t dims[4];
    size_t bytes;
    void *data;
} memory_item;

typedef struct memory_archive {
    memory_item items[64];
    size_t count;
    size_t fail_after; /* writes that succeed; 0: all */
} memory_archive;

static inline size_t element_size(lg_element type) {
    return type == LG_ELEMENT_F32 || type == LG_ELEMENT_U32 ? 4 : 8;
}

static inline memory_item *memory_find(memory_archive *archive, const char *path) {
    for (size_t i = 0; i < archive->count; i++)
        if (strcmp(archive->items[i].path, path) == 0) return &archive->items[i];
    return NULL;
}

static lg_status memory_write(void *user, const char *path, lg_element type, uint32_t rank,
                              const uint64_t *dims, const void *data) {
    memory_archive *archive = user;
    if (archive->fail_after > 0 && archive->count >= archive->fail_after) return LG_FILE;
    assert_null(memory_find(archive, path));
    assert_true(archive->count < LG_COUNT(archive->items));
    memory_item *item = &archive->items[archive->count++];
    (void)snprintf(item->path, sizeof item->path, "%s", path);
    item->type = type;
    item->rank = rank;
    item->bytes = element_size(type);
    for (uint32_t i = 0; i < rank; i++) {
        item->dims[i] = dims[i];
        item->bytes *= dims[i];
    }
    item->data = malloc(item->bytes);
    assert_non_null(item->data);
    memcpy(item->data, data, item->bytes);
    return LG_OK;
}

static lg_status memory_read(void *user, const char *path, lg_element type, uint32_t rank,
                             const uint64_t *dims, void *out) {
    const memory_item *item = memory_find(user, path);
    if (item == NULL) return LG_NOT_FOUND;
    if (item->rank != rank) return LG_SHAPE;
    for (uint32_t i = 0; i < rank; i++)
        if (item->dims[i] != dims[i]) return LG_SHAPE;
    if (item->type != type) return LG_FORMAT;
    memcpy(out, item->data, item->bytes);
    return LG_OK;
}

static inline lg_archive_writer memory_writer(memory_archive *archive) {
    return (lg_archive_writer){.user = archive, .array = memory_write};
}

static inline lg_archive_reader memory_reader(memory_archive *archive) {
    return (lg_archive_reader){.user = archive, .array = memory_read};
}

static inline void memory_clear(memory_archive *archive) {
    for (size_t i = 0; i < archive->count; i++) free(archive->items[i].data);
    *archive = (memory_archive){0};
}

/* ---- regression t = sin(2 x) + x^2/2 on [-1, 1] by an MLP; mean squared error ---- */
#define REGRESSION_SAMPLES 53

typedef struct regression {
    lg_mlp net;
    double x[REGRESSION_SAMPLES], t[REGRESSION_SAMPLES];
    int poison;     /* a sample whose target is NaN, or -1 */
    int *cancel_at; /* counts down with each call of the loss; at 0 raises `cancel`. NULL: never */
    volatile int *cancel;
} regression;

static inline void regression_init(regression *r) {
    *r = (regression){.poison = -1};
    const uint32_t hidden[2] = {12, 12};
    assert_ok(lg_mlp_init(&r->net, 1, hidden, 2, 1, LG_TANH, true));
    for (int i = 0; i < REGRESSION_SAMPLES; i++) {
        r->x[i] = -1.0 + 2.0 * i / (REGRESSION_SAMPLES - 1.0);
        r->t[i] = sin(2.0 * r->x[i]) + 0.5 * r->x[i] * r->x[i];
    }
}

static lg_status regression_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                 size_t count, size_t batch, lg_var *loss) {
    const regression *r = user;
    double x[REGRESSION_SAMPLES], t[REGRESSION_SAMPLES];
    if (count == 0 || count > REGRESSION_SAMPLES) return LG_CHECK_FAILED;
    for (size_t i = 0; i < count; i++) {
        x[i] = r->x[samples[i]];
        t[i] = (int)samples[i] == r->poison ? NAN : r->t[samples[i]];
    }
    if (r->cancel_at != NULL && --*r->cancel_at == 0) *r->cancel = 1;
    const lg_shape shape = lg_shape2((uint32_t)count, 1);
    const lg_var y = lg_mlp_record(tape, &r->net, theta, 0, lg_input_f64(tape, shape, x));
    const lg_var d = lg_sub(tape, y, lg_input_f64(tape, shape, t));
    *loss = lg_scale(tape, lg_sum(tape, lg_square(tape, d)), 1.0 / (double)batch);
    return LG_OK;
}

static inline lg_fit_problem regression_problem(regression *r) {
    return (lg_fit_problem){.parameters = lg_mlp_parameters(&r->net),
                            .samples = REGRESSION_SAMPLES,
                            .loss = regression_loss,
                            .user = r};
}

/* Where the tests start from. Caller frees. */
static inline double *regression_start(const regression *r) {
    lg_rng rng;
    lg_rng_seed(&rng, 3, 0);
    double *theta = malloc(lg_mlp_parameters(&r->net) * sizeof *theta);
    assert_non_null(theta);
    lg_mlp_initialise(&r->net, &rng, theta);
    return theta;
}

#endif
