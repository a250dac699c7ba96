/* Macros and data for the cases of operations. Each file holds one family of operations, with its build
 * functions and its table. */
#ifndef LG_GRADCHECK_ROWS_H
#define LG_GRADCHECK_ROWS_H

#include "gradcheck/table.h"
#include "autodiff/tape/tape_internal.h"

/* The parameters of a build function besides its inputs. */
typedef struct settings {
    int i[5];
    double c;
    lg_shape shape;
} settings;
#define WITH(...)                                                                                            \
    .user = &(const settings) {                                                                              \
        __VA_ARGS__                                                                                          \
    }

#define ROW(name_, op, build_, ...)                                                                          \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, __VA_ARGS__}, .operations = { op }                      \
    }
#define ROW_ZERO(name_, op, build_, ...)                                                                     \
    { .function = {.name = name_, .build = build_, __VA_ARGS__}, .operations = {op}, .zero = true }
#define ROW_STOPS(name_, op, build_, ...)                                                                    \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, .stops = true, __VA_ARGS__}, .operations = {op},        \
        .zero = true                                                                                         \
    }
#define ROW_TWO(name_, op, op2, build_, ...)                                                                 \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, __VA_ARGS__}, .operations = { op, op2 }                 \
    }
#define ROW_COMPOSED(name_, build_, ...)                                                                     \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, __VA_ARGS__ }                                           \
    }

/* Numbers at least 1/4 away from zero. Two numbers of one table differ by at least 1/2; a number of one table
 * differs from every number of the other table by at least 1/4. */
static const double apart[24] = {0.5,  -1.5, 3.0,  -2.5, 1.0,  5.5, -0.5, 2.0, -3.0, 4.5, -4.0, 1.5,
                                 -1.0, 6.0,  -5.5, 3.5,  -2.0, 2.5, -6.0, 4.0, -3.5, 5.0, -4.5, -5.0};
static const double between[24] = {-0.75, 2.25, -1.25, 0.75,  1.75, -5.25, 0.25,  4.25,
                                   -0.25, 3.25, 5.25,  -1.75, 2.75, -2.25, 6.25,  -3.25,
                                   1.25,  4.75, -2.75, -4.25, 3.75, -5.75, -3.75, 5.75};

/* For ReLU and leaky ReLU: with x from `apart`, W from `whole` and b from `quarters`, every element of x W +
 * b is at least 1/4 away from the kink at 0, because W consists of whole numbers. */
static const double whole[15] = {1, 0, -1, 2, 0, 0, 1, 1, -1, 2, -1, 1, 0, 0, 1};
static const double quarters[5] = {0.25, 0.25, -0.25, 0.25, -0.25};

#define BUILD(name) static lg_var name(const void *user, lg_tape *t, const lg_var *x)
#define SETTINGS    const settings *s = user
#define BUILD_BINARY(op)                                                                                     \
    BUILD(build_##op) {                                                                                      \
        (void)user;                                                                                          \
        return lg_##op(t, x[0], x[1]);                                                                       \
    }
#define BUILD_UNARY(op)                                                                                      \
    BUILD(build_##op) {                                                                                      \
        (void)user;                                                                                          \
        return lg_##op(t, x[0]);                                                                             \
    }

#define ANY(...)      IN(__VA_ARGS__)
#define POSITIVE(...) IN_RANGE(0.5, 2.0, __VA_ARGS__)
#define APART(...)    IN_VALUES(apart, __VA_ARGS__)
#define BETWEEN(...)  IN_VALUES(between, __VA_ARGS__)

#endif
