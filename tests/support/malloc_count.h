/* Counts the allocations, releases and locks in a region of a test, over all threads, including OpenBLAS.
 * After lg_count_begin_here only the calling thread is counted: OpenBLAS starts its threads while it is
 * loaded, and they may still take locks.
 *
 *     lg_count_begin();
 *     ... the region ...
 *     const lg_counts used = lg_count_end();
 *     assert_int_equal(used.allocations, 0);
 *
 * A test file that includes this header is linked with malloc_count.c, which replaces the C library's malloc,
 * calloc, realloc, posix_memalign, aligned_alloc, memalign, free and pthread_mutex_lock,
 * pthread_mutex_trylock, pthread_rwlock_rdlock, pthread_rwlock_wrlock. Sanitizers replace these functions
 * themselves: then lg_count_available() is false and the test must skip(). Regions must not nest. */
#ifndef LG_MALLOC_COUNT_H
#define LG_MALLOC_COUNT_H

#include <stdbool.h>

typedef struct lg_counts {
    unsigned long allocations; /* malloc, calloc, realloc, posix_memalign, aligned_alloc, memalign */
    unsigned long releases;    /* calls of free with a pointer other than NULL */
    unsigned long locks;       /* calls that lock a mutex or a read-write lock, or try to */
} lg_counts;

bool lg_count_available(void);
void lg_count_begin(void);
void lg_count_begin_here(void);
lg_counts lg_count_end(void);

/* Runs `statement`. assert_no_malloc fails the test if any thread allocated or released memory. The second
 * macro counts the calling thread only, and also fails if it took a lock. */
#define assert_no_malloc(statement)                                                                          \
    do {                                                                                                     \
        lg_count_begin();                                                                                    \
        statement;                                                                                           \
        const lg_counts lg_used_ = lg_count_end();                                                           \
        if (lg_used_.allocations != 0 || lg_used_.releases != 0)                                             \
            fail_msg("%s: %lu allocations, %lu releases", #statement, lg_used_.allocations,                  \
                     lg_used_.releases);                                                                     \
    } while (0)

#define assert_no_malloc_no_lock(statement)                                                                  \
    do {                                                                                                     \
        lg_count_begin_here();                                                                               \
        statement;                                                                                           \
        const lg_counts lg_used_ = lg_count_end();                                                           \
        if (lg_used_.allocations != 0 || lg_used_.releases != 0 || lg_used_.locks != 0)                      \
            fail_msg("%s: %lu allocations, %lu releases, %lu locks", #statement, lg_used_.allocations,       \
                     lg_used_.releases, lg_used_.locks);                                                     \
    } while (0)

#endif
