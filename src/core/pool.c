#include "core/core.h"

#include <pthread.h>

struct lg_pool {
    const lg_context *context;
    pthread_mutex_t mutex;
    pthread_cond_t start, done;
    int workers;
    pthread_t *threads;
    void (*task)(void *, size_t);
    void *user;
    size_t count, next, finished;
    uint64_t round;
    bool stop;
};

/* Takes indices under the lock until none is left. Called and returns with the mutex held. */
static void work(lg_pool *pool) {
    while (pool->next < pool->count) {
        size_t index = pool->next++;
        pthread_mutex_unlock(&pool->mutex);
        pool->task(pool->user, index);
        pthread_mutex_lock(&pool->mutex);
        if (++pool->finished == pool->count) pthread_cond_signal(&pool->done);
    }
}

static void *worker(void *user) {
    lg_pool *pool = user;
    uint64_t seen = 0;
    pthread_mutex_lock(&pool->mutex);
    for (;;) {
        while (!pool->stop && pool->round == seen) pthread_cond_wait(&pool->start, &pool->mutex);
        if (pool->stop) break;
        seen = pool->round;
        work(pool);
    }
    pthread_mutex_unlock(&pool->mutex);
    return NULL;
}

lg_status lg_pool_create(const lg_context *context, int threads, lg_pool **out) {
    if (threads < 1 || threads > 1024) return LG_INVALID_ARGUMENT;
    lg_pool *pool = lg_alloc(context, 1, sizeof *pool);
    if (pool == NULL) return LG_OUT_OF_MEMORY;
    pool->context = context;
    pthread_mutex_init(&pool->mutex, NULL);
    pthread_cond_init(&pool->start, NULL);
    pthread_cond_init(&pool->done, NULL);
    pool->threads = lg_alloc(context, (size_t)threads, sizeof *pool->threads);
    if (pool->threads == NULL) {
        lg_pool_destroy(pool);
        return LG_OUT_OF_MEMORY;
    }
    for (int i = 0; i < threads - 1; i++) {
        if (pthread_create(&pool->threads[i], NULL, worker, pool) != 0) {
            lg_pool_destroy(pool);
            return LG_OUT_OF_MEMORY;
        }
        pool->workers++;
    }
    *out = pool;
    return LG_OK;
}

void lg_pool_destroy(lg_pool *pool) {
    if (pool == NULL) return;
    pthread_mutex_lock(&pool->mutex);
    pool->stop = true;
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->mutex);
    for (int i = 0; i < pool->workers; i++) pthread_join(pool->threads[i], NULL);
    pthread_cond_destroy(&pool->done);
    pthread_cond_destroy(&pool->start);
    pthread_mutex_destroy(&pool->mutex);
    lg_free(pool->context, pool->threads);
    lg_free(pool->context, pool);
}

void lg_pool_run(lg_pool *pool, size_t count, void (*task)(void *, size_t), void *user) {
    if (pool->workers == 0 || count < 2) {
        for (size_t i = 0; i < count; i++) task(user, i);
        return;
    }
    pthread_mutex_lock(&pool->mutex);
    pool->task = task;
    pool->user = user;
    pool->count = count;
    pool->next = pool->finished = 0;
    pool->round++;
    pthread_cond_broadcast(&pool->start);
    work(pool);
    while (pool->finished < count) pthread_cond_wait(&pool->done, &pool->mutex);
    pthread_mutex_unlock(&pool->mutex);
}
