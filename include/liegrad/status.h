/* Statuses and sentences of failures.
 *
 * Every public function that can fail returns an lg_status. On failure pure outputs are untouched; in/out
 * arguments say in their own comment what happens to them. The library never exits, aborts or prints.
 *
 * NULL is fine for a context, an lg_error, what is to be destroyed, and where a comment says so. Functions
 * that return an lg_status refuse it elsewhere: LG_INVALID_ARGUMENT (tests/core/test_arguments.c calls them,
 * and names the few that it leaves out). Functions that return something else, or nothing, must not be given
 * NULL.
 */
#ifndef LIEGRAD_STATUS_H
#define LIEGRAD_STATUS_H

#include "liegrad/export.h"

LG_BEGIN_DECLS

/* X(code, value, sentence). Values are part of the interface and never reused. */
#define LG_STATUS_LIST(X)                                                                                    \
    X(OK, 0, "success")                                                                                      \
    X(INVALID_ARGUMENT, 1, "an argument is outside its documented range")                                    \
    X(SHAPE, 2, "shapes do not fit the operation")                                                           \
    X(STALE_HANDLE, 3, "a variable does not belong to this tape, or was rewound")                            \
    X(OUT_OF_MEMORY, 4, "an allocation failed or a memory limit was reached")                                \
    X(NOT_FINITE, 5, "a value is NaN or infinite")                                                           \
    X(NO_CONVERGENCE, 6, "an iteration did not converge")                                                    \
    X(STEP_TOO_SMALL, 7, "the step size fell below the resolution of time")                                  \
    X(TOO_MANY_STEPS, 8, "the limit on the number of steps was reached")                                     \
    X(NOT_DIFFERENTIABLE, 9, "a derivative of this order is not available")                                  \
    X(NOT_FOUND, 10, "no such file, key or name")                                                            \
    X(FILE, 11, "a file could not be opened, read or written")                                               \
    X(FORMAT, 12, "a file's content is not what its format asks for")                                        \
    X(VERSION, 13, "a file was written by a newer major version of the format")                              \
    X(UNSUPPORTED, 14, "the combination asked for is not supported")                                         \
    X(CANCELLED, 15, "the caller asked to stop")                                                             \
    X(CHECK_FAILED, 16, "a check did not hold")

typedef enum lg_status {
#define LG_STATUS_ENUM(code, value, sentence) LG_##code = value,
    LG_STATUS_LIST(LG_STATUS_ENUM)
#undef LG_STATUS_ENUM
} lg_status;

/* A status with a sentence about this very failure: file, key, line, shapes. Caller's memory; functions that
 * take an `lg_error *` accept NULL. The message is always terminated, empty after success. */
typedef struct lg_error {
    lg_status status;
    char message[512];
} lg_error;

/* "OK", "SHAPE", ...; "UNKNOWN" for a value outside the list. Static storage. */
LG_API const char *lg_status_name(lg_status status);

/* The sentence of the list. Static storage. */
LG_API const char *lg_status_sentence(lg_status status);

LG_END_DECLS

#endif
