/* Dense products C = [C +] op(A) op(B): which form, which kernel, how many threads.
 *
 * nn and tn go straight to the own kernel, which reads A through strides. nt of a single row is B times a
 * vector. Otherwise nt needs rows of B^T: for small B its transpose is made once and kept with the node (a
 * weight is used many times in a step); for large B and few rows the transposed product C^T = B A^T is formed
 * instead, which only transposes A and C. Every form but that of a single row sums over the inner index in
 * the same order, in the same blocks; they agree to the last bit where nothing is added to. All ways of
 * splitting a product among threads agree to the last bit. Without a crew, as in plans, nn is one call of
 * the kernel with the whole inner sum. OpenBLAS takes over where its cache blocking pays
 * for its lock and its packing. The form depends on shapes and on what the tape has kept, never on threads.
 */
#include "kernels/product.h"

#include <cblas.h>

/* In multiplications m n k. */
#define OWN_KERNEL_LIMIT 1e9
#define SPLIT_LIMIT      4e5
/* Longer inner sums are taken in blocks of so many, each added to C: rounding does not grow with the batch.
 */
#define INNER_BLOCK 256
/* Elements of B up to which its transpose is kept, and rows of A from which it is made anyway. */
#define KEPT_TRANSPOSE 65536
#define MANY_ROWS      96
/* Columns of the result up to which a row times W^T is dot products with the rows of W. */
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

/* ---- the own kernel, split over columns or rows of C and over the inner index ---- */

typedef struct product {
    const lg_kernels *kernels;
    size_t m, n, k, ra, ca; /* element (i, l) of op(A) at a[i ra + l ca]; B and C with n columns */
    const unsigned char *a, *b;
    unsigned char *c;
    bool accumulate, by_rows;
    size_t piece; /* columns or rows of a piece */
} product;

/* Rows i0.. and columns j0.. of the product. */
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

/* ---- nt ---- */

/* C^T = B A^T, then C = [C +] (C^T)^T. Scratch: A^T, C^T and, to add, its transpose. */
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
    if (crew == NULL && s->variant == LG_NN) {
        k->gemm(s->m, s->n, s->k, a, s->k, 1, b, s->n, c, s->n, accumulate);
        return;
    }
    if (by_blas(s, crew)) {
        blas(k->dtype, s->variant, s->m, s->n, s->k, a, b, c, accumulate);
        return;
    }
    if (s->variant == LG_NT && s->m == 1 &&
        transposed == NULL) { /* a row lies in memory as a column does: c^T = B a^T */
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
