/* Dense products C = [C +] op(A) op(B): which form, which kernel, how many threads.
 *
 * nn and tn go straight to the own kernel, which reads A through strides. nt of a single row is B times a
 * vector. Otherwise nt needs rows of B^T: for small B its transpose is made once and kept with the node (a
 * weight is used many times in a step); for large B and few rows the transposed product C^T = B A^T is formed
 * instead, which only transposes A and C. Every form but that of a single row sums over the inner index in
 * the same order, in the same blocks; they agree to the last bit where nothing is added to. All ways of
 * splitting a product among threads agree to the last bit. OpenBLAS takes over where its cache blocking pays
 * for its lock and its packing. The form depends on shapes and on what the tape has kept, never on threads.
 */
#include <cblas.h>

#include "autodiff/tape_internal.h"

/* In multiplications m n k. */
#define OWN_KERNEL_LIMIT 1e9
#define SPLIT_LIMIT      2e5
/* Longer inner sums are taken in blocks of so many, each added to C: rounding does not grow with the batch.
 */
#define INNER_BLOCK 256
/* Elements of B up to which its transpose is kept, and rows of A from which it is made anyway. */
#define KEPT_TRANSPOSE 65536
#define MANY_ROWS      96

enum { NN, NT, TN };

static void blas(lg_dtype dtype, uint32_t variant, size_t m, size_t n, size_t k, const void *a, const void *b,
                 void *c, bool accumulate) {
    const enum CBLAS_TRANSPOSE ta = variant == TN ? CblasTrans : CblasNoTrans;
    const enum CBLAS_TRANSPOSE tb = variant == NT ? CblasTrans : CblasNoTrans;
    const int lda = (int)(variant == TN ? m : k), ldb = (int)(variant == NT ? k : n);
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

static void run(lg_tape *tape, product *p) {
    if (tape->workers == NULL || (double)p->m * (double)p->n * (double)p->k < SPLIT_LIMIT) {
        run_block(p, 0, p->m, 0, p->n);
        return;
    }
    p->by_rows = p->m > p->n;
    const size_t whole = p->by_rows ? p->m : p->n, unit = p->by_rows ? 8 : 16;
    const size_t pieces = 2 * (size_t)tape->options.threads;
    p->piece = (whole + pieces * unit - 1) / (pieces * unit) * unit;
    lg_pool_run(tape->workers, (whole + p->piece - 1) / p->piece, run_piece, p);
}

/* ---- nt ---- */

static const void *kept_transpose(lg_tape *tape, size_t m, size_t n, size_t k, const void *b,
                                  uint32_t b_node) {
    const lg_node *node = &tape->nodes[b_node];
    if (b != node->value || node->shape.rank != 2) return NULL;
    if (node->transposed == NULL && n * k > KEPT_TRANSPOSE && m < MANY_ROWS) return NULL;
    return lg_transposed(tape, b_node);
}

/* C^T = B A^T, then C = [C +] (C^T)^T. */
static void run_transposed(lg_tape *tape, size_t m, size_t n, size_t k, const void *a, const void *b, void *c,
                           bool accumulate) {
    const lg_kernels *kernels = tape->k;
    const size_t a_bytes = m * k * kernels->size, c_bytes = m * n * kernels->size;
    unsigned char *at = lg_pool_take(tape, a_bytes), *ct = lg_pool_take(tape, 2 * c_bytes);
    if (at != NULL && ct != NULL) {
        product p = {.kernels = kernels, .m = n, .n = m, .k = k, .ra = k, .ca = 1, .a = b, .b = at, .c = ct};
        kernels->transpose(m, k, a, at);
        run(tape, &p);
        kernels->transpose(n, m, ct, accumulate ? ct + c_bytes : c);
        if (accumulate) kernels->axpy(m * n, 1.0, ct + c_bytes, c);
    }
    if (at != NULL) lg_pool_give(tape, at, a_bytes);
    if (ct != NULL) lg_pool_give(tape, ct, 2 * c_bytes);
}

void lg_gemm(lg_tape *tape, uint32_t variant, size_t m, size_t n, size_t k, const void *a, const void *b,
             uint32_t b_node, void *c, bool accumulate) {
    const size_t largest = (size_t)1 << 30;
    if ((double)m * (double)n * (double)k > OWN_KERNEL_LIMIT && m < largest && n < largest && k < largest) {
        blas(tape->k->dtype, variant, m, n, k, a, b, c, accumulate);
        return;
    }
    if (variant == NT && m == 1) { /* a row lies in memory as a column does: c^T = B a^T */
        tape->k->matvec(n, k, b, a, c, accumulate);
        return;
    }
    product p = {.kernels = tape->k,
                 .m = m,
                 .n = n,
                 .k = k,
                 .ra = k,
                 .ca = 1,
                 .a = a,
                 .b = b,
                 .c = c,
                 .accumulate = accumulate};
    if (variant == TN) {
        p.ra = 1;
        p.ca = m;
    } else if (variant == NT) {
        p.b = kept_transpose(tape, m, n, k, b, b_node);
        if (tape->status != LG_OK) return;
        if (p.b == NULL) {
            run_transposed(tape, m, n, k, a, b, c, accumulate);
            return;
        }
    }
    run(tape, &p);
}
