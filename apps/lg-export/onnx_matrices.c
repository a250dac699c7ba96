/* Factorisation of small symmetric matrices (..., n, n) in ONNX, and systems of equations with them, written
 * out element by element. */
#include "lg-export/onnx.h"

enum { MOST_SPD = 6 };

/* Element (r, c) of each matrix, as (..., 1). */
static onnx_name element(onnx_job *j, onnx_name x, int64_t r, int64_t c) {
    const onnx_name row = onnx_take(j, x, (int64_t[]){r}, 1, -2),
                    one = onnx_take(j, row, (int64_t[]){c}, 1, -1);
    return onnx_binary(j, "Squeeze", one, onnx_wholes(j, (int64_t[]){-2}, 1));
}

/* Returns x minus the sum of all a[k] b[k]. */
static onnx_name less_products(onnx_job *j, onnx_name x, const onnx_name *a, const onnx_name *b,
                               size_t count) {
    for (size_t k = 0; k < count; k++) x = onnx_binary(j, "Sub", x, onnx_binary(j, "Mul", a[k], b[k]));
    return x;
}

static uint32_t order_of(const onnx_operation *o) {
    const lg_operation *matrix = &o->j->g->nodes[o->op->inputs[0]].op;
    return (uint32_t)matrix->shape[matrix->rank - 1].base;
}

/* Cholesky factor of (x + x^T)/2, row by row. */
bool onnx_factor(const onnx_operation *o) {
    onnx_job *j = o->j;
    const uint32_t n = order_of(o);
    onnx_name L[MOST_SPD][MOST_SPD], rows_of[MOST_SPD];
    if (n > MOST_SPD) return false;
    const onnx_name zero = onnx_number(j, 0), half = onnx_number(j, 0.5);
    for (uint32_t r = 0; r < n; r++) {
        onnx_name row[MOST_SPD];
        for (uint32_t c = 0; c <= r; c++) {
            const onnx_name a = onnx_binary(
                j, "Mul", half, onnx_binary(j, "Add", element(j, o->x[0], r, c), element(j, o->x[0], c, r)));
            const onnx_name rest = less_products(j, a, L[r], L[c], c);
            L[r][c] = c == r ? onnx_unary(j, "Sqrt", rest) : onnx_binary(j, "Div", rest, L[c][c]);
        }
        for (uint32_t c = 0; c < n; c++) row[c] = c <= r ? L[r][c] : onnx_binary(j, "Mul", zero, L[r][0]);
        rows_of[r] =
            onnx_binary(j, "Unsqueeze", onnx_join(j, row, n, -1), onnx_wholes(j, (int64_t[]){-2}, 1));
    }
    return onnx_give(o, onnx_join(j, rows_of, n, -2));
}

/* Solves L L^T y = b, where b is (..., n, m): forward substitution, then back substitution, on rows (..., m)
 * of b. */
bool onnx_solve(const onnx_operation *o) {
    onnx_job *j = o->j;
    const uint32_t n = order_of(o);
    onnx_name L[MOST_SPD][MOST_SPD], y[MOST_SPD];
    if (n > MOST_SPD || onnx_rank_of(o, 1) != onnx_rank_of(o, 0)) return false;
    for (uint32_t r = 0; r < n; r++)
        for (uint32_t c = 0; c <= r; c++) L[r][c] = element(j, o->x[2], r, c);
    for (uint32_t r = 0; r < n; r++) {
        const onnx_name b = onnx_binary(j, "Squeeze", onnx_take(j, o->x[1], (int64_t[]){r}, 1, -2),
                                        onnx_wholes(j, (int64_t[]){-2}, 1));
        y[r] = onnx_binary(j, "Div", less_products(j, b, L[r], y, r), L[r][r]);
    }
    for (uint32_t r = n; r-- > 0;) {
        onnx_name column[MOST_SPD];
        for (uint32_t k = r + 1; k < n; k++) column[k - r - 1] = L[k][r];
        y[r] = onnx_binary(j, "Div", less_products(j, y[r], column, y + r + 1, n - 1 - r), L[r][r]);
    }
    for (uint32_t r = 0; r < n; r++)
        y[r] = onnx_binary(j, "Unsqueeze", y[r], onnx_wholes(j, (int64_t[]){-2}, 1));
    return onnx_give(o, onnx_join(j, y, n, -2));
}
