/* Dense products of arrays in memory: C = [C +] op(A) op(B). */
#ifndef LG_PRODUCT_H
#define LG_PRODUCT_H

#include "kernels/kernels.h"

enum { LG_NN, LG_NT, LG_TN };

/* What may share the work of a large product: worker threads, and OpenBLAS where its packing pays. */
typedef struct lg_crew {
    lg_thread_pool *workers; /* NULL: a single thread */
    int threads;
} lg_crew;

typedef enum lg_transpose_use {
    LG_TRANSPOSE_NONE,    /* B^T does not help */
    LG_TRANSPOSE_FIXED,   /* worth computing once if B never changes */
    LG_TRANSPOSE_IF_KEPT, /* helps if it exists already */
    LG_TRANSPOSE_MAKE     /* worth computing if B stays in memory */
} lg_transpose_use;

/* op(A) (m, k), op(B) (k, n), C (m, n), row-major. */
typedef struct lg_product_size {
    uint32_t variant;
    size_t m, n, k;
} lg_product_size;

/* Says whether B^T (k, n) helps a product of the nt form. */
lg_transpose_use lg_product_transpose(const lg_product_size *size, const lg_crew *crew);
/* Number of bytes of scratch memory that lg_product needs if `transposed` is NULL. */
size_t lg_product_scratch(const lg_kernels *k, const lg_product_size *size, const lg_crew *crew);
/* `transposed` is B^T or NULL; if it is NULL, `scratch` must be given. Without a crew no lock is taken. */
void lg_product(const lg_kernels *k, const lg_crew *crew, const lg_product_size *size, const void *a,
                const void *b, const void *transposed, void *c, bool accumulate, void *scratch);

#endif
