/* Tables of checks beside those of the operations. */
#ifndef LG_GRADCHECK_TABLES_H
#define LG_GRADCHECK_TABLES_H

#include "liegrad/gradcheck.h"

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
/* Arguments of a row, as initialisers of lg_gradcheck_argument. */
#define INPUTS(...)                                                                                          \
    .inputs = (uint32_t)(sizeof((lg_gradcheck_argument[]){__VA_ARGS__}) / sizeof(lg_gradcheck_argument)),    \
    .arguments = (const lg_gradcheck_argument[]) {                                                           \
        __VA_ARGS__                                                                                          \
    }

const lg_gradcheck_case *layer_rows(size_t *count);
const lg_gradcheck_case *integrator_rows(size_t *count);
const lg_gradcheck_case *system_rows(size_t *count);
const lg_gradcheck_case *hamiltonian_rows(size_t *count);
const lg_gradcheck_case *surrogate_rows(size_t *count);
const lg_gradcheck_case *machine_rows(size_t *count);

#endif
