/* Runs a test of kernels for both types and for every instruction set of this machine. */
#ifndef LG_KERNEL_TABLES_H
#define LG_KERNEL_TABLES_H

#include "test_support.h"

#include "kernels/kernels.h"

static inline void every_table(void (*test)(const lg_kernels *)) {
    for (int dtype = 0; dtype < 2; dtype++)
        for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
            const lg_kernels *k = lg_kernels_of((lg_dtype)dtype, (lg_isa)isa);
            const size_t mark = lg_test_owned();
            if (k != NULL) test(k);
            lg_test_give_back(mark);
        }
}

/* TEST_EVERY_TABLE("claim", k) { ... } runs for every table k of kernels. */
#define TEST_EVERY_TABLE(claim, k)        LG_EVERY_TABLE_AT(claim, k, __LINE__)
#define LG_EVERY_TABLE_AT(claim, k, line) LG_EVERY_TABLE_NAMED(claim, k, line)
#define LG_EVERY_TABLE_NAMED(claim, k, line)                                                                 \
    static void lg_every_table_##line(const lg_kernels *k);                                                  \
    TEST(claim) {                                                                                            \
        every_table(lg_every_table_##line);                                                                  \
    }                                                                                                        \
    static void lg_every_table_##line(const lg_kernels *k)

#endif
