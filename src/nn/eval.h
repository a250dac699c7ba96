/* Dense layers without a tape, in the caller's memory: shared by the networks' untaped functions. */
#ifndef LG_NN_EVAL_H
#define LG_NN_EVAL_H

#include "kernels/kernels.h"
#include "core/core.h"
#include "liegrad/ops.h"

static inline size_t eval_padded(size_t bytes) {
    return (bytes + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT;
}

/* Cuts a piece off the caller's memory. With *work NULL only its size is counted, in *bytes. */
static inline char *eval_take(char **work, size_t *bytes, size_t wanted) {
    char *piece = *work;
    *bytes += eval_padded(wanted);
    if (piece != NULL) *work += eval_padded(wanted);
    return piece;
}

/* y (rows, out) = [y +] a (rows, in) W */
static inline void eval_multiply(const lg_kernels *k, size_t rows, size_t in, size_t out, const void *a,
                                 const void *w, void *y, bool accumulate) {
    k->gemm(rows, out, in, a, in, 1, w, out, y, out, accumulate);
}

/* y (rows, in) = [y +] g (rows, out) W^T. One row: W times a column. One output: W^T lies in memory as W
 * does. Else W^T is formed in `transposed`. */
static inline void eval_multiply_transposed(const lg_kernels *k, size_t rows, size_t in, size_t out,
                                            const void *g, const void *w, void *transposed, void *y,
                                            bool accumulate) {
    if (out == 1) {
        k->gemm(rows, in, 1, g, 1, 1, w, in, y, in, accumulate);
    } else if (rows == 1) {
        k->matvec(in, out, w, g, y, accumulate);
    } else {
        k->transpose(in, out, w, transposed);
        k->gemm(rows, in, out, g, out, 1, transposed, in, y, in, accumulate);
    }
}

#endif
