#define _DEFAULT_SOURCE /* for madvise */
#include "core/core.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

struct lg_context {
    lg_context_options options;
};

/* For blocks of at least two large pages, the system is asked for large pages. Parameters, moments and
 * gradients are streamed, and with small pages half the time of a pass over them is spent on address
 * translation. */
#define LARGE_PAGE ((size_t)1 << 21)

static void *default_allocate(void *user, size_t bytes) {
    void *memory = NULL;
    const bool large = bytes >= 2 * LARGE_PAGE;
    if (posix_memalign(&memory, large ? LARGE_PAGE : LG_ALIGNMENT, bytes) != 0) return NULL;
#ifdef MADV_HUGEPAGE
    if (large) (void)madvise(memory, bytes, MADV_HUGEPAGE);
#endif
    return memory;
}

static void default_release(void *user, void *memory) {
    free(memory);
}

void lg_context_options_init(lg_context_options *options) {
    *options = (lg_context_options){.size = sizeof *options};
}

lg_status lg_context_create(const lg_context_options *options, lg_context **out) {
    LG_NEEDS(NULL, out);
    lg_context_options chosen;
    lg_context_options_init(&chosen);
    if (options != NULL) {
        if (options->size != sizeof *options) return LG_INVALID_ARGUMENT;
        if ((options->allocate == NULL) != (options->release == NULL)) return LG_INVALID_ARGUMENT;
        chosen = *options;
    }
    if (chosen.allocate == NULL) {
        chosen.allocate = default_allocate;
        chosen.release = default_release;
    }
    lg_context *context = chosen.allocate(chosen.allocator_user, sizeof *context);
    if (context == NULL) return LG_OUT_OF_MEMORY;
    context->options = chosen;
    *out = context;
    return LG_OK;
}

lg_status lg_context_quiet(const lg_context *context, lg_context **out) {
    lg_context_options options;
    lg_context_options_init(&options);
    if (context != NULL) options = context->options;
    options.log = NULL;
    return lg_context_create(&options, out);
}

void lg_context_destroy(lg_context *context) {
    if (context == NULL) return;
    lg_context_options options = context->options;
    options.release(options.allocator_user, context);
}

void *lg_alloc(const lg_context *context, uint64_t count, size_t size) {
    if (size != 0 && count > (SIZE_MAX - 2 * LG_ALIGNMENT) / size) return NULL;
    size_t bytes = (size_t)count * size;
    if (bytes == 0) bytes = 1;
    void *memory = context != NULL ? context->options.allocate(context->options.allocator_user, bytes)
                                   : default_allocate(NULL, bytes);
    if (memory != NULL) memset(memory, 0, bytes);
    return memory;
}

lg_status lg_alloc_list(const lg_context *context, const lg_array *list, size_t count) {
    for (size_t i = 0; i < count; i++) {
        void *const memory = lg_alloc(context, list[i].count, list[i].size);
        if (memory == NULL) return LG_OUT_OF_MEMORY;
        memcpy(list[i].pointer, &memory, sizeof memory);
    }
    return LG_OK;
}

void lg_free(const lg_context *context, void *memory) {
    if (memory == NULL) return;
    if (context != NULL)
        context->options.release(context->options.allocator_user, memory);
    else
        default_release(NULL, memory);
}

void lg_free_list(const lg_context *context, const void *const *list, size_t count) {
    for (size_t i = 0; i < count; i++) lg_free(context, (void *)list[i]);
}

char *lg_strdup(const lg_context *context, const char *text) {
    size_t bytes = strlen(text) + 1;
    char *copy = lg_alloc(context, bytes, 1);
    if (copy != NULL) memcpy(copy, text, bytes);
    return copy;
}

lg_status lg_may_replace(const lg_context *context, const char *path, const void *data, size_t bytes,
                         lg_error *error) {
    if (context == NULL || context->options.replace == NULL) return LG_OK;
    return context->options.replace(context->options.replace_user, path, data, bytes, error);
}

bool lg_cancelled(const lg_context *context) {
    return context != NULL && context->options.cancel != NULL && *context->options.cancel != 0;
}

void lg_log_message(const lg_context *context, lg_log_level level, const char *format, ...) {
    if (context == NULL || context->options.log == NULL) return;
    char message[512];
    va_list arguments;
    va_start(arguments, format);
    (void)lg_format_list(message, sizeof message, format, arguments);
    va_end(arguments);
    context->options.log(context->options.log_user, level, message);
}
