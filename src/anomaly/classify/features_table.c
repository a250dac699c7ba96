/* Features of all windows of a series, computed by several threads. */
#include "anomaly/classify/features.h"

typedef struct table_job {
    const lg_context *context;
    const lg_features *features;
    const lg_series *series;
    const lg_windows *windows;
    double *out;
    /* parts: number of tasks; work: doubles of memory per task, for the features' work and one window. */
    size_t parts, work;
    double *memory;    /* (parts, work) */
    lg_status *status; /* (parts) result of each task */
    size_t *failed;    /* (parts) index of the window that failed */
} table_job;

static size_t window_doubles(const lg_features *f) {
    return ((size_t)f->channels * f->length + 1) / 2;
}

static void table_part(void *user, size_t part) {
    const table_job *job = user;
    const size_t n = job->windows->count;
    double *work = job->memory + part * job->work;
    float *x = (float *)(void *)(work + lg_features_work_doubles(job->features));
    for (size_t i = n * part / job->parts; i < n * (part + 1) / job->parts; i++) {
        lg_windows_copy(job->series, job->windows, i, x);
        lg_status status = lg_features_compute(job->features, x, job->out + i * job->features->count, work);
        if (status == LG_OK && lg_cancelled(job->context)) status = LG_CANCELLED;
        if (status == LG_OK) continue;
        job->status[part] = status;
        job->failed[part] = i;
        return;
    }
}

static lg_status run_table(table_job *job, int threads, lg_error *error) {
    lg_thread_pool *pool = NULL;
    const lg_status made = lg_thread_pool_create(job->context, threads, &pool);
    if (made != LG_OK) return lg_fail(error, made, "%d threads could not be started", threads);
    lg_thread_pool_run(pool, job->parts, table_part, job);
    lg_thread_pool_destroy(pool);
    for (size_t i = 0; i < job->parts; i++)
        if (job->status[i] != LG_OK)
            return lg_fail(error, job->status[i], "features of window %zu: %s", job->failed[i],
                           lg_status_sentence(job->status[i]));
    return LG_OK;
}

lg_status lg_features_table(const lg_context *context, const lg_features *features, const lg_series *series,
                            const lg_windows *windows, int threads, double *out, lg_error *error) {
    (void)lg_fail(error, LG_OK, "%s", "");
    if (features == NULL || series == NULL || windows == NULL || out == NULL || threads < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "an argument is NULL, or there is less than one thread");
    if (series->channels != features->channels || windows->length != features->length)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the features are for windows of %u channels and %u samples, but these windows have %u and %u",
            features->channels, features->length, series->channels, windows->length);
    if (windows->count == 0) return LG_OK;
    table_job job = {context, features, series, windows, out, 0, 0, NULL, NULL, NULL};
    job.parts = (size_t)threads < windows->count ? (size_t)threads : windows->count;
    job.work = (lg_features_work_doubles(features) + window_doubles(features) + 7) / 8 * 8;
    job.memory = lg_alloc(context, job.parts, job.work * sizeof *job.memory);
    job.status = lg_alloc(context, job.parts, sizeof *job.status);
    job.failed = lg_alloc(context, job.parts, sizeof *job.failed);
    lg_status status = LG_OUT_OF_MEMORY;
    if (job.memory == NULL || job.status == NULL || job.failed == NULL)
        (void)lg_fail(error, status, "no memory for features by %d threads", threads);
    else
        status = run_table(&job, (int)job.parts, error);
    LG_FREE_ALL(context, job.memory, job.status, job.failed);
    return status;
}
