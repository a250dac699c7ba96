/* Macros for tables of cases. Each family of operations has a file in this folder; rooms/ROOM.c has the
 * cases of functions that a room composes of operations. */
#ifndef LG_GRADCHECK_TABLE_H
#define LG_GRADCHECK_TABLE_H

#include "gradcheck/cases.h"
#include "core/count.h"

/* Memory for rows that are made at run time. It is zeroed, never NULL (the program exits instead), and never
 * freed. */
void *lg_gradcheck_alloc(size_t count, size_t size);

/* X(name) for each table lg_gradcheck_<name>. CMakeLists.txt defines LG_GRADCHECK_ROOMS as X(room) for each
 * file in the folder rooms. */
#define LG_GRADCHECK_OPERATIONS                                                                              \
    X(elementwise) X(products) X(convolutions) X(arrays) X(geometry) X(losses) X(custom)

#define X(name) const lg_gradcheck_case *lg_gradcheck_##name(size_t *count);
LG_GRADCHECK_OPERATIONS LG_GRADCHECK_ROOMS
#undef X

/* Must stand at the end of a file; the file's array `rows` becomes the table. */
#define FAMILY(name)                                                                                         \
    const lg_gradcheck_case *lg_gradcheck_##name(size_t *count) {                                            \
        *count = LG_COUNT(rows);                                                                             \
        return rows;                                                                                         \
    }

/* ---- shapes and arguments as initialisers; S2(3, 4) is the shape (3, 4) ---- */

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
