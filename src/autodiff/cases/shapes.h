/* Shapes and arguments of a case of the gradient check, as initialisers: S2(3, 4) is a matrix (3, 4). */
#ifndef LG_GRADCHECK_SHAPES_H
#define LG_GRADCHECK_SHAPES_H

#include "liegrad/gradcheck.h"

#define S0                                                                                                   \
    {                                                                                                        \
        0, {                                                                                                 \
            0, 0, 0, 0                                                                                       \
        }                                                                                                    \
    }
#define S1(a)                                                                                                \
    {                                                                                                        \
        1, {                                                                                                 \
            a, 0, 0, 0                                                                                       \
        }                                                                                                    \
    }
#define S2(a, b)                                                                                             \
    {                                                                                                        \
        2, {                                                                                                 \
            a, b, 0, 0                                                                                       \
        }                                                                                                    \
    }
#define S3(a, b, c)                                                                                          \
    {                                                                                                        \
        3, {                                                                                                 \
            a, b, c, 0                                                                                       \
        }                                                                                                    \
    }
#define S4(a, b, c, d)                                                                                       \
    {                                                                                                        \
        4, {                                                                                                 \
            a, b, c, d                                                                                       \
        }                                                                                                    \
    }

#define IN(...)                                                                                              \
    { .shape = __VA_ARGS__ }
#define IN_RANGE(a, b, ...)                                                                                  \
    { .shape = __VA_ARGS__, .low = a, .high = b }
#define IN_VALUES(v, ...)                                                                                    \
    { .shape = __VA_ARGS__, .values = v }
#define INPUTS(...)                                                                                          \
    .inputs = (uint32_t)(sizeof((lg_gradcheck_argument[]){__VA_ARGS__}) / sizeof(lg_gradcheck_argument)),    \
    .arguments = (const lg_gradcheck_argument[]) {                                                           \
        __VA_ARGS__                                                                                          \
    }

#endif
