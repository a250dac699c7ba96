/* Dense products of plain memory: C = [C +] op(A) op(B). */
#ifndef LG_PRODUCT_H
#define LG_PRODUCT_H

#include "kernels/kernels.h"

enum { LG_NN, LG_NT, LG_TN };

/* Who shares the work of a large product: threads, and OpenBLAS where its packing pays. */
typedef struct lg_crew {
    lg_thread_pool *workers; /* NULL: one thread */
    int threads;
} lg_crew;

typedef enum lg_transpose_use {
    LG_TRANSPOSE_NONE,    /* of no use */
    LG_TRANSPOSE_FIXED,   /* worth making once for an input that never changes */
    LG_TRANSPOSE_IF_KEPT, /* of use if it is there already */
    LG_TRANSPOSE_MAKE     /* worth making for an input that stays */
} lg_transpose_use;

/* op(A) (m, k), op(B) (k, n), C (m, n), row-major. */
typedef struct lg_product_size {
    uint32_t variant;
    size_t m, n, k;
} lg_product_size;

/* What B^T (k, n) of the nt form is worth. */
lg_transpose_use lg_product_transpose(const lg_product_size *size, const lg_crew *crew);
/* Bytes of scratch memory that are needed without B^T. */
size_t lg_product_scratch(const lg_kernels *k, const lg_product_size *size, const lg_crew *crew);
/* `transposed`: B^T, or NULL: then `scratch` is there. Without a crew no lock is taken. */
void lg_product(const lg_kernels *k, const lg_crew *crew, const lg_product_size *size, const void *a,
                const void *b, const void *transposed, void *c, bool accumulate, void *scratch);

#endif
