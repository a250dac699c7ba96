/* What systems, learned Hamiltonians and machines have in common on a tape: constant matrices, velocities and
 * brackets, and the rows of mass matrices and potentials (lg_energy_row). Errors stick to the tape. */
#ifndef LG_ENGINE_H
#define LG_ENGINE_H

#include "liegrad/mechanics.h"
#include "liegrad/ops.h"

/* The length of x's first axis. */
uint32_t lg_rows_of(lg_tape *tape, lg_var x);

/* ---- constant matrices (1, n, n) ---- */

/* A tridiagonal matrix with constant diagonals `below`, `main` and `above`. */
lg_var lg_band_matrix(lg_tape *tape, uint32_t n, double below, double main, double above);
lg_var lg_unit_matrix(lg_tape *tape, uint32_t n);
/* 1 on and above the diagonal, 0 below. */
lg_var lg_upper_ones(lg_tape *tape, uint32_t n);

/* ---- the field from the derivatives of H ---- */

/* The velocities v = W (p - lambda q) of directions that the mass matrix W^-1 couples, q and p (B, k, 3), W
 * (1, k, k). The multipliers lambda (B, k, 1) solve (W o q q^T) lambda = q.(W p), where W o q q^T has the
 * elements W_ij q_i.q_j, so that q_i.v_i = 0. */
lg_var lg_tied_velocity(lg_tape *tape, lg_var W, lg_var q, lg_var p, lg_var *lambda);
/* The ties q_i.v_i = 0 of directions q (B, k, 3) as the columns of N (B, n, k): N^T v = 0 for the n
 * velocities v, where those of the directions begin at `first`. */
lg_var lg_tie_columns(lg_tape *tape, lg_var q, uint32_t first, uint32_t n);
/* v (B, n, 1) and the multipliers lambda (B, k, 1) of M v + N lambda = P, N^T v = 0, with P (B, n, 1) and M
 * (B, n, n). W: M^-1 (1, n, n), or LG_NONE; it replaces M. */
lg_var lg_tied_velocities(lg_tape *tape, lg_var M, lg_var W, lg_var P, lg_var N, lg_var *lambda);

/* The field of a position y[0] and its momentum y[1] as an algebra element: that of the position (rate) and
 * that of the momentum (change), with g = dH[0], v = dH[1].
 *   lines       (B, n)     v; -g
 *   directions  (B, k, 3)  q x v; g x q + v x p
 *   rotations   (B, c, 9)  omega = v; omega x pi - sum_j r_j x g_j, with the spatial momenta pi (B, 3 c) and
 *               the columns r_j of R and g_j of g */
lg_var lg_bracket_rate(lg_tape *tape, const lg_var *y, const lg_var *dH);
lg_var lg_bracket_change(lg_tape *tape, const lg_var *y, const lg_var *dH);
/* sum_j a_j x b_j over the columns of matrices a and b (B, c, 9), as (B, 3 c). */
lg_var lg_columns_crossed(lg_tape *tape, lg_var a, lg_var b);

/* ---- bodies ---- */

/* Rotations (B, c, 9) as matrices (B c, 3, 3). */
lg_var lg_row_matrices(lg_tape *tape, lg_var R);
/* R I^-1 R^T pi, (B, 1, 3), of the momenta pi (B, 1, 3) or (B, 3) in the inertial frame, with R (B, 3, 3) and
 * the principal moments of inertia I (3). */
lg_var lg_body_velocity(lg_tape *tape, lg_var inertia, lg_var R, lg_var pi);

/* ---- rows ---- */

/* The table of rows (mechanics/system.c), ended by NULL. */
extern const lg_energy_row *const lg_energy_rows[];

extern const double lg_row_attitude[9]; /* the unit matrix, a default of attitudes */
/* Sets the members `count` and `coordinates` of a row with two coordinates. */
#define LG_TWO(first, second)                                                                                \
    2, {                                                                                                     \
        LG_COORDINATE_##first, LG_COORDINATE_##second                                                        \
    }
/* Record a slice (count) of at->parameters, from `first` on, or the one parameter `place`, (1). */
lg_var lg_row_numbers(lg_tape *tape, const lg_at *at, uint32_t first, uint32_t count);
lg_var lg_row_number(lg_tape *tape, const lg_at *at, uint32_t place);
/* M = diag(parameters 0 .. n - 1). */
lg_var lg_row_diagonal(lg_tape *tape, const lg_at *at);
/* The matrix [a b; b d] times c; c is one number or (B, 1). */
lg_var lg_row_times_matrix(lg_tape *tape, lg_var c, double a, double b, double d);

#endif
