/* Matrices, velocities and brackets on a tape; building blocks of rows. */
#include "mechanics/engine.h"

#include "core/numbers.h"

uint32_t lg_rows_of(lg_tape *tape, lg_var x) {
    return lg_var_shape(tape, x).dims[0];
}

/* ---- constant matrices ---- */

/* Constant diagonals, and `beyond` further above the main one. */
static lg_var matrix(lg_tape *tape, uint32_t n, double below, double main, double above, double beyond) {
    void *values = NULL;
    lg_var out = lg_input_buffer(tape, lg_shape3(1, n, n), &values);
    if (lg_is_none(out)) return out;
    const double diagonal[] = {0.0, below, main, above, beyond};
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            const size_t at = j + 1 < i ? 0 : j + 2 - i;
            lg_put_numbers(lg_tape_dtype(tape), values, i * n + j, &diagonal[at < 4 ? at : 4], 1);
        }
    return out;
}

lg_var lg_band_matrix(lg_tape *tape, uint32_t n, double below, double main, double above) {
    return matrix(tape, n, below, main, above, 0.0);
}

lg_var lg_unit_matrix(lg_tape *tape, uint32_t n) {
    return matrix(tape, n, 0.0, 1.0, 0.0, 0.0);
}

lg_var lg_upper_ones(lg_tape *tape, uint32_t n) {
    return matrix(tape, n, 0.0, 1.0, 1.0, 1.0);
}

/* ---- the field from the derivatives of H ---- */

lg_var lg_tied_velocity(lg_tape *tape, lg_var W, lg_var q, lg_var p, lg_var *lambda) {
    const lg_var along = lg_rowdot(tape, q, lg_matmul(tape, W, p));
    *lambda = lg_spd_solve(tape, lg_mul(tape, W, lg_matmul_nt(tape, q, q)), along);
    return lg_matmul(tape, W, lg_sub(tape, p, lg_mul(tape, *lambda, q)));
}

lg_var lg_tie_columns(lg_tape *tape, lg_var q, uint32_t first, uint32_t n) {
    const lg_shape shape = lg_var_shape(tape, q);
    const uint32_t rows = shape.dims[0], k = shape.dims[1];
    const lg_var one = lg_reshape(tape, lg_unit_matrix(tape, k), lg_shape4(1, k, 1, k)),
                 each = lg_mul(tape, lg_reshape(tape, q, lg_shape4(rows, k, 3, 1)), one);
    return lg_pad(tape, lg_reshape(tape, each, lg_shape3(rows, 3 * k, k)), 1, first, n - first - 3 * k);
}

lg_var lg_tied_velocities(lg_tape *tape, lg_var M, lg_var W, lg_var P, lg_var N, lg_var *lambda) {
    const lg_var both = lg_concat(tape, (lg_var[]){P, N}, 2, 2),
                 Z = lg_is_none(W) ? lg_spd_solve(tape, M, both) : lg_matmul(tape, W, both),
                 free = lg_slice(tape, Z, 2, 0, 1),
                 of_N = lg_slice(tape, Z, 2, 1, lg_var_shape(tape, N).dims[2]);
    *lambda = lg_spd_solve(tape, lg_matmul_tn(tape, N, of_N), lg_matmul_tn(tape, N, free));
    return lg_sub(tape, free, lg_matmul(tape, of_N, *lambda));
}

lg_var lg_columns_crossed(lg_tape *tape, lg_var a, lg_var b) {
    const uint32_t rows = lg_rows_of(tape, a), c = lg_var_shape(tape, a).dims[1];
    const lg_shape matrices = lg_shape3(rows * c, 3, 3);
    lg_var each = lg_cross(tape, lg_transpose(tape, lg_reshape(tape, a, matrices)),
                           lg_transpose(tape, lg_reshape(tape, b, matrices)));
    return lg_reshape(tape, lg_sum_axis(tape, each, 1, false), lg_shape2(rows, 3 * c));
}

lg_var lg_bracket_rate(lg_tape *tape, const lg_var *y, const lg_var *dH) {
    const lg_shape shape = lg_var_shape(tape, y[0]);
    if (shape.rank < 3) return dH[1];
    if (shape.dims[2] == 3) return lg_cross(tape, y[0], dH[1]);
    return lg_reshape(tape, dH[1], lg_shape3(shape.dims[0], shape.dims[1], 3));
}

lg_var lg_bracket_change(lg_tape *tape, const lg_var *y, const lg_var *dH) {
    const lg_shape shape = lg_var_shape(tape, y[0]), tall = lg_shape3(shape.dims[0], shape.dims[1], 3);
    if (shape.rank < 3) return lg_neg(tape, dH[0]);
    if (shape.dims[2] == 3) return lg_add(tape, lg_cross(tape, dH[0], y[0]), lg_cross(tape, dH[1], y[1]));
    lg_var carried = lg_cross(tape, lg_reshape(tape, dH[1], tall), lg_reshape(tape, y[1], tall));
    return lg_add(tape, lg_columns_crossed(tape, dH[0], y[0]),
                  lg_reshape(tape, carried, lg_var_shape(tape, y[1])));
}

/* ---- bodies ---- */

lg_var lg_row_matrices(lg_tape *tape, lg_var R) {
    const lg_shape shape = lg_var_shape(tape, R);
    return lg_reshape(tape, R, lg_shape3(shape.dims[0] * shape.dims[1], 3, 3));
}

lg_var lg_body_velocity(lg_tape *tape, lg_var inertia, lg_var R, lg_var pi) {
    const lg_shape line = lg_shape3(lg_rows_of(tape, pi), 1, 3);
    const lg_var body = lg_matmul(tape, lg_reshape(tape, pi, line), R);
    return lg_matmul_nt(tape, lg_div(tape, body, inertia), R);
}

/* ---- rows ---- */

const double lg_row_attitude[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};

lg_var lg_row_numbers(lg_tape *tape, const lg_at *at, uint32_t first, uint32_t count) {
    return lg_slice(tape, at->parameters, 0, first, count);
}

lg_var lg_row_number(lg_tape *tape, const lg_at *at, uint32_t place) {
    return lg_row_numbers(tape, at, place, 1);
}

lg_var lg_row_diagonal(lg_tape *tape, const lg_at *at) {
    const uint32_t n = at->size;
    return lg_mul(tape, lg_reshape(tape, lg_row_numbers(tape, at, 0, n), lg_shape3(1, 1, n)),
                  lg_unit_matrix(tape, n));
}

lg_var lg_row_times_matrix(lg_tape *tape, lg_var c, double a, double b, double d) {
    const uint32_t rows = (uint32_t)lg_shape_count(lg_var_shape(tape, c));
    const lg_var M = lg_input_f64(tape, lg_shape3(1, 2, 2), (const double[]){a, b, b, d});
    return lg_mul(tape, lg_reshape(tape, c, lg_shape3(rows, 1, 1)), M);
}
