/* Worker threads. An atomic counter hands out indices. After a run, a worker first polls for the next one,
 * which often comes within microseconds, and then sleeps. */
#include <pthread.h>
#include <stdatomic.h>

#include "core/core.h"

/* Number of polls before sleeping: about 20 microseconds. */
#define PATIENCE 2000

struct lg_thread_pool {
    const lg_context *context;
    int workers;
    pthread_t *threads;

    pthread_mutex_t mutex; /* held to enter a round and to sleep */
    pthread_cond_t start, done;
    /* open: workers may enter the round. stop: workers must end. waiting: the caller sleeps until active is
     * 0. */
    bool open, stop, waiting;
    atomic_uint round;
    atomic_int active; /* number of workers inside the round */

    /* These do not change while workers or the caller are inside a round, except `next`, which counts up. */
    void (*task)(void *, size_t);
    void *user;
    size_t count;
    atomic_size_t next;
};

static void relax(void) {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
}

static void work(lg_thread_pool *pool) {
    for (;;) {
        const size_t index = atomic_fetch_add_explicit(&pool->next, 1, memory_order_relaxed);
        if (index >= pool->count) return;
        pool->task(pool->user, index);
    }
}

/* Waits for a round other than `seen` and enters it if it is still open; `inside` says so. Returns false if
 * the worker must end. */
static bool enter(lg_thread_pool *pool, unsigned *seen, bool *inside) {
    for (int i = 0; i < PATIENCE && atomic_load_explicit(&pool->round, memory_order_relaxed) == *seen; i++)
        relax();
    pthread_mutex_lock(&pool->mutex);
    while (!pool->stop && atomic_load(&pool->round) == *seen) pthread_cond_wait(&pool->start, &pool->mutex);
    *seen = atomic_load(&pool->round);
    *inside = pool->open; /* the pool stops only between rounds */
    if (*inside) atomic_fetch_add(&pool->active, 1);
    const bool more = !pool->stop;
    pthread_mutex_unlock(&pool->mutex);
    return more;
}

static void leave(lg_thread_pool *pool) {
    if (atomic_fetch_sub(&pool->active, 1) != 1) return;
    pthread_mutex_lock(&pool->mutex);
    if (pool->waiting) pthread_cond_signal(&pool->done);
    pthread_mutex_unlock(&pool->mutex);
}

static void *worker(void *user) {
    lg_thread_pool *pool = user;
    unsigned seen = 0;
    bool inside;
    while (enter(pool, &seen, &inside)) {
        if (!inside) continue;
        work(pool);
        leave(pool);
    }
    return NULL;
}

lg_status lg_thread_pool_create(const lg_context *context, int threads, lg_thread_pool **out) {
    if (threads < 1 || threads > 1024) return LG_INVALID_ARGUMENT;
    lg_thread_pool *pool = lg_alloc(context, 1, sizeof *pool);
    if (pool == NULL) return LG_OUT_OF_MEMORY;
    pool->context = context;
    pthread_mutex_init(&pool->mutex, NULL);
    pthread_cond_init(&pool->start, NULL);
    pthread_cond_init(&pool->done, NULL);
    pool->threads = lg_alloc(context, (size_t)threads, sizeof *pool->threads);
    if (pool->threads == NULL) {
        lg_thread_pool_destroy(pool);
        return LG_OUT_OF_MEMORY;
    }
    while (pool->workers < threads - 1 &&
           pthread_create(&pool->threads[pool->workers], NULL, worker, pool) == 0)
        pool->workers++;
    *out = pool;
    return LG_OK;
}

void lg_thread_pool_destroy(lg_thread_pool *pool) {
    if (pool == NULL) return;
    pthread_mutex_lock(&pool->mutex);
    pool->stop = true;
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->mutex);
    for (int i = 0; i < pool->workers; i++) pthread_join(pool->threads[i], NULL);
    pthread_cond_destroy(&pool->done);
    pthread_cond_destroy(&pool->start);
    pthread_mutex_destroy(&pool->mutex);
    LG_FREE_ALL(pool->context, pool->threads, pool);
}

static void open_round(lg_thread_pool *pool) {
    pthread_mutex_lock(&pool->mutex);
    pool->open = true;
    atomic_fetch_add(&pool->round, 1);
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->mutex);
}

/* Lets no more workers enter, and waits until those inside have finished their tasks. */
static void close_round(lg_thread_pool *pool) {
    pthread_mutex_lock(&pool->mutex);
    pool->open = false;
    pthread_mutex_unlock(&pool->mutex);
    for (int i = 0; i < PATIENCE && atomic_load(&pool->active) != 0; i++) relax();
    pthread_mutex_lock(&pool->mutex);
    pool->waiting = true;
    while (atomic_load(&pool->active) != 0) pthread_cond_wait(&pool->done, &pool->mutex);
    pool->waiting = false;
    pthread_mutex_unlock(&pool->mutex);
}

void lg_thread_pool_run(lg_thread_pool *pool, size_t count, void (*task)(void *, size_t), void *user) {
    if (pool->workers == 0 || count < 2) {
        for (size_t i = 0; i < count; i++) task(user, i);
        return;
    }
    pool->task = task;
    pool->user = user;
    pool->count = count;
    atomic_store(&pool->next, 0);
    open_round(pool);
    work(pool);
    close_round(pool);
}

/* ---- jobs that may fail ---- */

typedef struct jobs {
    lg_job *job;
    void *user;
    pthread_mutex_t mutex;
    atomic_size_t failed; /* index of the first job that failed, so far; SIZE_MAX: none */
    lg_error error;
} jobs;

static void do_job(void *user, size_t index) {
    jobs *all = user;
    lg_error error = {LG_OK, ""};
    if (index > atomic_load(&all->failed)) return;
    error.status = all->job(all->user, index, &error);
    if (error.status == LG_OK) return;
    pthread_mutex_lock(&all->mutex);
    if (index < atomic_load(&all->failed)) {
        atomic_store(&all->failed, index);
        all->error = error;
    }
    pthread_mutex_unlock(&all->mutex);
}

lg_status lg_jobs_run(const lg_context *context, uint64_t threads, size_t count, lg_job *job, void *user,
                      lg_error *error) {
    jobs all = {.job = job, .user = user, .mutex = PTHREAD_MUTEX_INITIALIZER, .failed = SIZE_MAX};
    lg_thread_pool *pool = NULL;
    if (count == 0) return LG_OK;
    const int useful = (int)(threads < count ? threads : count);
    const lg_status made = lg_thread_pool_create(context, useful, &pool);
    if (made != LG_OK) return lg_fail(error, made, "no memory for a pool of %d threads", useful);
    lg_thread_pool_run(pool, count, do_job, &all);
    lg_thread_pool_destroy(pool);
    pthread_mutex_destroy(&all.mutex);
    if (all.error.status != LG_OK && error != NULL) *error = all.error;
    return all.error.status;
}
