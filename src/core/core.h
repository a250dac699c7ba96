/* Internals shared by all rooms: memory through the context, messages, worker threads. */
#ifndef LG_CORE_H
#define LG_CORE_H

#include <errno.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "core/count.h"
#include "liegrad/core.h"

#define LG_ALIGNMENT 64

/* A sanitizer is in use. It reserves terabytes of address space and replaces malloc. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define LG_SANITIZED
#elif defined(__has_feature) /* clang */
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define LG_SANITIZED
#endif
#endif

/* Returns the status of `call` from the calling function if it is not LG_OK. */
#define LG_TRY(call)                                                                                         \
    do {                                                                                                     \
        lg_status lg_try_status_ = (call);                                                                   \
        if (lg_try_status_ != LG_OK) return lg_try_status_;                                                  \
    } while (0)

/* Sets `at`, of an enumeration, to its value below `count` with this name, or to `count`. */
#define LG_FIND_NAME(at, count, name_of, text)                                                               \
    for (at = 0; (unsigned)at < (count) && strcmp(name_of(at), text) != 0; at++) continue

/* Returns LG_INVALID_ARGUMENT from the calling function if one of the pointers is NULL, with a message in
 * `error` (may be NULL). */
#define LG_NEEDS(error, ...)                                                                                 \
    do {                                                                                                     \
        const void *const lg_needs_[] = {__VA_ARGS__};                                                       \
        for (size_t lg_i_ = 0; lg_i_ < LG_COUNT(lg_needs_); lg_i_++)                                         \
            if (lg_needs_[lg_i_] == NULL)                                                                    \
                return lg_fail(error, LG_INVALID_ARGUMENT, "one of these arguments is NULL: %s",             \
                               #__VA_ARGS__);                                                                \
    } while (0)

/* Returns zeroed memory, aligned to 64 bytes, or NULL on failure or if count * size overflows. If count *
 * size is 0, the pointer is valid. With a NULL context the C library's allocator is used. */
void *lg_alloc(const lg_context *context, uint64_t count, size_t size);
void lg_free(const lg_context *context, void *memory);
/* Allocates arrays of zeros one after the other, LG_ARRAY(pointer, count): LG_OUT_OF_MEMORY if one of them
 * cannot be; the pointers from this one on stay as they are. */
typedef struct lg_array {
    void *pointer; /* address of the pointer */
    uint64_t count;
    size_t size;
} lg_array;
#define LG_ARRAY(pointer_, count_)                                                                           \
    { &(pointer_), count_, sizeof *(pointer_) }
lg_status lg_alloc_list(const lg_context *context, const lg_array *list, size_t count);
#define LG_ALLOC_ALL(context, ...)                                                                           \
    lg_alloc_list(context, (const lg_array[]){__VA_ARGS__}, LG_COUNT(((const lg_array[]){__VA_ARGS__})))
/* Frees each of these blocks, in order; NULL is skipped. */
void lg_free_list(const lg_context *context, const void *const *list, size_t count);
#define LG_FREE_ALL(context, ...)                                                                            \
    lg_free_list(context, (const void *const[]){__VA_ARGS__}, LG_COUNT(((const void *const[]){__VA_ARGS__})))
char *lg_strdup(const lg_context *context, const char *text);

/* A context like this one (NULL: with the defaults), but without a log, for work whose messages no one
 * wants. */
lg_status lg_context_quiet(const lg_context *context, lg_context **out);

/* Each rank computed its part (lg_ranks_part) of `total` items of `item` bytes; all ranks get all of them.
 * Collective. Errors: LG_OUT_OF_MEMORY, the status of the exchange. */
lg_status lg_ranks_gather_parts(const lg_ranks *ranks, size_t total, size_t item, void *all);
/* Fills `error` (may be NULL) with the reason why an exchange failed with `status`, and returns `status`. */
lg_status lg_ranks_lost(const lg_ranks *ranks, lg_status status, lg_error *error);

bool lg_cancelled(const lg_context *context);
/* Calls `replace` of the context (lg_context_options) and returns its status; LG_OK if `replace` is NULL. */
lg_status lg_may_replace(const lg_context *context, const char *path, const void *data, size_t bytes,
                         lg_error *error);
void lg_log_message(const lg_context *context, lg_log_level level, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* LG_OUT_OF_MEMORY for the number ENOMEM of errno, LG_FILE for all others. */
static inline lg_status lg_status_of(int code) {
    return code == ENOMEM ? LG_OUT_OF_MEMORY : LG_FILE;
}

/* Fills `error` (may be NULL) and returns `status`, so that a function can fail in one statement. */
lg_status lg_fail(lg_error *error, lg_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* The same with the sentence of the first of `count` rules that does not hold; LG_OK if all hold. */
typedef struct lg_rule {
    bool good;
    const char *sentence;
} lg_rule;
lg_status lg_check_rules(const lg_rule *rules, size_t count, lg_status status, lg_error *error);
static inline lg_status lg_no_memory(lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s", lg_status_sentence(LG_OUT_OF_MEMORY));
}

/* These are snprintf, vsnprintf and strtod with a decimal point in every locale. The library formats and
 * reads real numbers with them. */
int lg_format(char *text, size_t size, const char *format, ...) __attribute__((format(printf, 3, 4)));
int lg_format_list(char *text, size_t size, const char *format, va_list arguments);
/* Adds to a text in a block of `size` bytes, as lg_format does. What has no room is cut. */
void lg_append(char *text, size_t size, const char *format, ...) __attribute__((format(printf, 3, 4)));
double lg_real(const char *text, char **end);
/* Writes the shortest text that reads back as the same double or, with `single`, as the same float; for
 * numbers that are not finite "nan", "inf" or "-inf". */
enum { LG_SHORTEST = 40 };
void lg_format_shortest(char text[LG_SHORTEST], double value, bool single);
/* True for [+-] digits [. digits] [e [+-] digits] with at least one digit before or after the point. */
bool lg_is_decimal(const char *text);
/* Compares two texts that lg_is_decimal accepts as numbers, exactly: less than, equal to or more than 0. */
int lg_decimal_compare(const char *a, const char *b);
/* True if the text, a decimal number whose nearest double is `value`, is a whole number in digits alone that
 * this double does not equal. Such a number is a count or a label, beyond 2^53, and its last digits would be
 * lost. */
bool lg_decimal_is_rounded(const char *text, double value);
/* The same for a whole number of this absolute value: no double equals it. */
static inline bool lg_whole_is_rounded(uint64_t magnitude) {
    const uint64_t lowest = magnitude & (~magnitude + 1); /* the lowest bit that is set */
    return magnitude > 0 && magnitude / lowest >> 53 != 0;
}

/* Seconds of a monotonic clock. */
double lg_seconds(void);

/* A pool of worker threads. lg_thread_pool_run runs task(user, i) for i in 0..count-1. Which thread runs
 * which i is not specified, so a task must not write to memory that other tasks use. The pool has threads - 1
 * workers, because the calling thread works too; fewer if no more threads can be started. */
typedef struct lg_thread_pool lg_thread_pool;
lg_status lg_thread_pool_create(const lg_context *context, int threads, lg_thread_pool **out);
void lg_thread_pool_destroy(lg_thread_pool *pool);
void lg_thread_pool_run(lg_thread_pool *pool, size_t count, void (*task)(void *user, size_t index),
                        void *user);

/* A list of jobs that may fail: job(user, i, error) for i in 0..count-1, on at most `threads` threads.
 * Returns the status, and in *error the sentence, of the first job in the list that failed, whatever the
 * number of threads. Jobs behind it may be left out, so a job that is cancelled ends the list. */
typedef lg_status lg_job(void *user, size_t index, lg_error *error);
lg_status lg_jobs_run(const lg_context *context, uint64_t threads, size_t count, lg_job *job, void *user,
                      lg_error *error);

/* Loads a shared library that few runs need, and finds functions in it. `function` is the address of a
 * function pointer. False: there is no such library, or a function is missing. */
typedef struct lg_plugin_function {
    const char *name;
    void *function;
} lg_plugin_function;
bool lg_plugin_load(const char *library, size_t count, const lg_plugin_function *functions);

/* Instruction sets: plain C, two sets of x86-64, one of arm64. The last one that a machine has is the
 * best. */
typedef enum lg_isa { LG_ISA_BASELINE, LG_ISA_AVX2, LG_ISA_AVX512, LG_ISA_NEON, LG_ISA_COUNT } lg_isa;
/* True if the library was compiled for the set and the machine has it. */
bool lg_isa_is_here(lg_isa isa);
/* X(NAME, name) for each set besides the baseline for which kernels are compiled. */
#if defined(__x86_64__)
#define LG_FASTER_SETS(X) X(AVX2, avx2) X(AVX512, avx512)
#elif defined(__aarch64__)
#define LG_FASTER_SETS(X) X(NEON, neon)
#else
#define LG_FASTER_SETS(X)
#endif
/* The set in use: the one that the environment variable LIEGRAD_ISA names if the machine has it, else the
 * machine's best. Constant during the process. */
lg_isa lg_isa_in_use(void);
const char *lg_isa_name(lg_isa isa);

#endif
