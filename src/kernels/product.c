/* Dense products C = [C +] op(A) op(B): chooses the form of the computation, the kernel and the split among
 * threads. "nn", "nt" and "tn" say which of A and B is transposed.
 *
 * nn and tn call the library's gemm kernel, which reads A through strides. nt with a single row of A is B
 * times a vector. Otherwise nt needs the rows of B^T. For small B, B^T is computed once and kept with the
 * node, because a weight is used many times in a step. For large B and few rows, the transposed product C^T =
 * B A^T is formed instead, which only transposes A and C.
 *
 * All forms except the single row sum over the inner index in the same order and in the same blocks, so that
 * they agree to the last bit unless the product is added to C. All ways of splitting a product among threads
 * agree to the last bit. Without a crew, as in plans, nn in f64 is one call of the kernel with the whole
 * inner sum. OpenBLAS takes over large products, where its cache blocking outweighs its lock and its packing.
 * The form depends on the shapes and on what the tape has kept, never on threads.
 */
#include "kernels/product.h"

#include <cblas.h>

/* Limits in multiplications, m n k: above the first, OpenBLAS is used; below the second, one thread works. */
#define OWN_KERNEL_LIMIT 1e9
#define SPLIT_LIMIT      4e5
/* Inner sums much longer than INNER_BLOCK are computed in blocks of that length. Each block's sum is added to
 * C, so that rounding errors do not grow with the batch. */
#define INNER_BLOCK 128
/* B^T is computed and kept if B has at most KEPT_TRANSPOSE elements. For a larger B it is computed if A has
 * at least MANY_ROWS rows. */
#define KEPT_TRANSPOSE 65536
#define MANY_ROWS      96
/* If C is a single row with fewer columns than this, dot products with the rows of B are used and B^T is
 * not. */
#define FEW_COLUMNS 12

static void blas(lg_dtype dtype, uint32_t variant, size_t m, size_t n, size_t k, const void *a, const void *b,
                 void *c, bool accumulate) {
    const enum CBLAS_TRANSPOSE ta = variant == LG_TN ? CblasTrans : CblasNoTrans;
    const enum CBLAS_TRANSPOSE tb = variant == LG_NT ? CblasTrans : CblasNoTrans;
    const int lda = (int)(variant == LG_TN ? m : k), ldb = (int)(variant == LG_NT ? k : n);
    const double beta = accumulate ? 1.0 : 0.0;
    if (dtype == LG_F64)
        cblas_dgemm(CblasRowMajor, ta, tb, (int)m, (int)n, (int)k, 1.0, a, lda, b, ldb, beta, c, (int)n);
    else
        cblas_sgemm(CblasRowMajor, ta, tb, (int)m, (int)n, (int)k, 1.0f, a, lda, b, ldb, (float)beta, c,
                    (int)n);
}

/* ---- the gemm kernel, split over columns or rows of C and over the inner index ---- */

typedef struct product {
    const lg_kernels *kernels;
    size_t m, n, k, ra, ca; /* element (i, l) of op(A) is at a[i ra + l ca]; B and C have n columns */
    const unsigned char *a, *b;
    unsigned char *c;
    bool accumulate, by_rows;
    size_t piece; /* number of columns or rows per piece */
} product;

/* Computes rows i0, i0 + 1, ... and columns j0, j0 + 1, ... of the product. */
static void run_block(const product *p, size_t i0, size_t rows, size_t j0, size_t columns) {
    const size_t size = p->kernels->size;
    const unsigned char *a = p->a + i0 * p->ra * size, *b = p->b + j0 * size;
    unsigned char *c = p->c + (i0 * p->n + j0) * size;
    size_t l = 0;
    do {
        const size_t rest = p->k - l, length = rest > INNER_BLOCK + INNER_BLOCK / 2 ? INNER_BLOCK : rest;
        p->kernels->gemm(rows, columns, length, a + l * p->ca * size, p->ra, p->ca, b + l * p->n * size, p->n,
                         c, p->n, p->accumulate || l > 0);
        l += length;
    } while (l < p->k);
}

static void run_piece(void *user, size_t index) {
    const product *p = user;
    const size_t start = index * p->piece, whole = p->by_rows ? p->m : p->n;
    const size_t length = start + p->piece < whole ? p->piece : whole - start;
    if (p->by_rows)
        run_block(p, start, length, 0, p->n);
    else
        run_block(p, 0, p->m, start, length);
}

static void run(const lg_crew *crew, product *p) {
    if (crew == NULL || crew->workers == NULL || (double)p->m * (double)p->n * (double)p->k < SPLIT_LIMIT) {
        run_block(p, 0, p->m, 0, p->n);
        return;
    }
    p->by_rows = p->m > p->n;
    const size_t whole = p->by_rows ? p->m : p->n, unit = p->by_rows ? 8 : 16;
    const size_t pieces = 2 * (size_t)crew->threads;
    p->piece = (whole + pieces * unit - 1) / (pieces * unit) * unit;
    lg_thread_pool_run(crew->workers, (whole + p->piece - 1) / p->piece, run_piece, p);
}

/* ---- nt, B transposed ---- */

/* C^T = B A^T, then C = [C +] (C^T)^T. scratch holds C^T, then (C^T)^T if it is to be added, then A^T. */
static void run_transposed(const lg_kernels *kernels, const lg_crew *crew, const lg_product_size *s,
                           const void *a, const void *b, void *c, bool accumulate, void *scratch) {
    const size_t size = kernels->size;
    unsigned char *ct = scratch, *back = ct + s->m * s->n * size, *at = back + s->m * s->n * size;
    product p = {
        .kernels = kernels, .m = s->n, .n = s->m, .k = s->k, .ra = s->k, .ca = 1, .a = b, .b = at, .c = ct};
    kernels->transpose(s->m, s->k, a, at);
    run(crew, &p);
    kernels->transpose(s->n, s->m, ct, accumulate ? back : c);
    if (accumulate) kernels->axpy(s->m * s->n, 1.0, back, c);
}

static bool by_blas(const lg_product_size *s, const lg_crew *crew) {
    const size_t largest = (size_t)1 << 30;
    return crew != NULL && (double)s->m * (double)s->n * (double)s->k > OWN_KERNEL_LIMIT && s->m < largest &&
           s->n < largest && s->k < largest;
}

lg_transpose_use lg_product_transpose(const lg_product_size *s, const lg_crew *crew) {
    if (s->variant != LG_NT || by_blas(s, crew)) return LG_TRANSPOSE_NONE;
    if (s->m == 1)
        return s->n >= FEW_COLUMNS && s->n * s->k <= KEPT_TRANSPOSE ? LG_TRANSPOSE_FIXED : LG_TRANSPOSE_NONE;
    return s->n * s->k > KEPT_TRANSPOSE && s->m < MANY_ROWS ? LG_TRANSPOSE_IF_KEPT : LG_TRANSPOSE_MAKE;
}

size_t lg_product_scratch(const lg_kernels *k, const lg_product_size *s, const lg_crew *crew) {
    const bool needed = s->m > 1 && lg_product_transpose(s, crew) != LG_TRANSPOSE_NONE;
    return needed ? (s->m * s->k + 2 * s->m * s->n) * k->size : 0;
}

void lg_product(const lg_kernels *k, const lg_crew *crew, const lg_product_size *s, const void *a,
                const void *b, const void *transposed, void *c, bool accumulate, void *scratch) {
    if (crew == NULL && s->variant == LG_NN && k->dtype == LG_F64) {
        k->gemm(s->m, s->n, s->k, a, s->k, 1, b, s->n, c, s->n, accumulate);
        return;
    }
    if (by_blas(s, crew)) {
        blas(k->dtype, s->variant, s->m, s->n, s->k, a, b, c, accumulate);
        return;
    }
    if (s->variant == LG_NT && s->m == 1 &&
        transposed == NULL) { /* a row has the same layout as a column: computes c^T = B a^T */
        k->matvec(s->n, s->k, b, a, c, accumulate);
        return;
    }
    if (s->variant == LG_NT && transposed == NULL) {
        run_transposed(k, crew, s, a, b, c, accumulate, scratch);
        return;
    }
    product p = {.kernels = k,
                 .m = s->m,
                 .n = s->n,
                 .k = s->k,
                 .ra = s->variant == LG_TN ? 1 : s->k,
                 .ca = s->variant == LG_TN ? s->m : 1,
                 .a = a,
                 .b = s->variant == LG_NT ? transposed : b,
                 .c = c,
                 .accumulate = accumulate};
    run(crew, &p);
}
