/* Errors, memory, numbers, clocks and threads. */
#include "common/app.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"

/* The only table that maps statuses to exit codes. */
static const int exit_codes[] = {[LG_OK] = APP_EXIT_OK,
                                 [LG_INVALID_ARGUMENT] = APP_EXIT_USAGE,
                                 [LG_SHAPE] = APP_EXIT_FILE,
                                 [LG_STALE_HANDLE] = APP_EXIT_CHECK,
                                 [LG_OUT_OF_MEMORY] = APP_EXIT_MEMORY,
                                 [LG_NOT_FINITE] = APP_EXIT_NUMERIC,
                                 [LG_NO_CONVERGENCE] = APP_EXIT_NUMERIC,
                                 [LG_STEP_TOO_SMALL] = APP_EXIT_NUMERIC,
                                 [LG_TOO_MANY_STEPS] = APP_EXIT_NUMERIC,
                                 [LG_NOT_DIFFERENTIABLE] = APP_EXIT_USAGE,
                                 [LG_NOT_FOUND] = APP_EXIT_FILE,
                                 [LG_FILE] = APP_EXIT_FILE,
                                 [LG_FORMAT] = APP_EXIT_FILE,
                                 [LG_VERSION] = APP_EXIT_FILE,
                                 [LG_UNSUPPORTED] = APP_EXIT_USAGE,
                                 [LG_CANCELLED] = APP_EXIT_INTERRUPTED,
                                 [LG_CHECK_FAILED] = APP_EXIT_CHECK};

const char *app_sentence(lg_status status, const lg_error *error) {
    return error != NULL && error->message[0] != '\0' ? error->message : lg_status_sentence(status);
}

static char last_failure[512];

const char *app_last_failure(void) {
    return last_failure;
}

int app_fail_words(const app *self, lg_status status, char *words) {
    (void)snprintf(last_failure, sizeof last_failure, "%s", words);
    app_note(self, "%s", words);
    free(words);
    /* A status without a row is a failure too. */
    const int code = (size_t)status < LG_COUNT(exit_codes) ? exit_codes[status] : APP_EXIT_OK;
    return code == APP_EXIT_OK && status != LG_OK ? APP_EXIT_CHECK : code;
}

static void stop_if_asked(const app *self, lg_status status) {
    if (status == LG_CANCELLED && app_interrupted()) app_stop(self, status, "stopped by %s", app_stopper());
}

void app_must(const app *self, lg_status status, const lg_error *error) {
    stop_if_asked(self, status);
    if (status != LG_OK) app_stop(self, status, "%s", app_sentence(status, error));
}

void app_must_file(const app *self, lg_status status, const lg_error *error, const char *path) {
    stop_if_asked(self, status);
    if (status != LG_OK) app_end(app_fail_file(self, status, error, path));
}

int app_fail_file(const app *self, lg_status status, const lg_error *error, const char *path) {
    const char *sentence = app_sentence(status, error);
    const bool named = strstr(sentence, path) != NULL;
    const int code = app_fail(self, status, "%s%s%s", named ? "" : path, named ? "" : ": ", sentence);
    return code == APP_EXIT_MEMORY || code == APP_EXIT_INTERRUPTED ? code : APP_EXIT_FILE;
}

int app_usage_words(const app *self, char *words) {
    (void)app_fail_words(self, LG_INVALID_ARGUMENT, words);
    (void)fprintf(stderr, "Try `%s --help' or `%s --usage' for more information.\n", self->title,
                  self->title);
    return APP_EXIT_USAGE;
}

void *app_try_alloc(uint64_t count, size_t size) {
    void *memory = NULL;
    if (count == 0 || size == 0) count = size = 1;
    if (count > SIZE_MAX / size || posix_memalign(&memory, 64, (size_t)count * size) != 0) return NULL;
    memset(memory, 0, (size_t)count * size);
    return memory;
}

void app_free(void *pointer) {
    void *memory;
    memcpy(&memory, pointer, sizeof memory);
    free(memory);
}

void *app_alloc(uint64_t count, size_t size) {
    void *memory = app_try_alloc(count, size);
    if (memory == NULL) app_out_of_memory();
    return memory;
}

typedef struct kept {
    _Alignas(64) struct kept *next;
} kept;

static kept *_Atomic kept_memory;

void *app_keep(uint64_t count, size_t size) {
    if (size > 0 && count > (SIZE_MAX - sizeof(kept)) / size) app_out_of_memory();
    kept *memory = app_alloc(1, sizeof *memory + (size_t)count * size), *next = kept_memory;
    do memory->next = next;
    while (!atomic_compare_exchange_weak(&kept_memory, &next, memory));
    return memory + 1;
}

void app_free_kept(void) {
    for (kept *next; kept_memory != NULL; kept_memory = next) {
        next = kept_memory->next;
        free(kept_memory);
    }
}

static void *take(void *user, size_t bytes) {
    return app_alloc(bytes, 1);
}

static void release(void *user, void *memory) {
    free(memory);
}

lg_text app_text(void) {
    static lg_context *memory;
    lg_context_options options;
    lg_context_options_init(&options);
    options.allocate = take;
    options.release = release;
    if (memory == NULL) (void)app_had_memory(lg_context_create(&options, &memory));
    return (lg_text){.context = memory};
}

lg_status app_had_memory(lg_status status) {
    if (status == LG_OUT_OF_MEMORY) app_out_of_memory();
    return status;
}

char *app_quote(const char *word) {
    lg_text out = app_text();
    lg_text_add_word(&out, word);
    return out.data;
}

double app_seconds(void) {
    return lg_seconds();
}

/* ---- threads ---- */

void app_parallel(uint64_t threads, size_t count, void (*task)(void *user, size_t index), void *user) {
    lg_thread_pool *pool = NULL;
    if (threads > count) threads = count;
    /* Without memory for a pool the calling thread does all the work. */
    if (lg_thread_pool_create(NULL, threads > 1 ? (int)threads : 1, &pool) == LG_OK)
        lg_thread_pool_run(pool, count, task, user);
    else
        for (size_t i = 0; i < count; i++) task(user, i);
    lg_thread_pool_destroy(pool);
}
