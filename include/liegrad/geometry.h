/* Rotations and rigid motions in coordinates, plain doubles.
 *
 * Conventions. A vector u of R^3 is the element hat(u) of so(3), hat(u) b = u x b. An element of se(3) is
 * a = (u, v), angular part first, 6 numbers. An element of SE(3) is (R, r), R row-major 3 x 3. Groups act
 * from the left and algebra elements are spatial (right-trivialised): y1 = exp(a) . y0, and y' = a . y has
 * the solution exp(t a) . y0.
 *
 * Every coefficient is an analytic function of w = |u|^2, so nothing is lost near u = 0. With the Stumpff
 * functions c_k(w) = sum_j (-w)^j / (k + 2j)!: c_1 = sin x/x, c_2 = (1 - cos x)/x^2, c_3 = (x - sin x)/x^3 at
 * w = x^2.
 *
 * Errors of exp and dexp are those of rounding in u: 1e-16 (1 + |u|). An angle of 1e13 is known to 1e-3 rad,
 * and from 1e16 on rotations have no digit. From 1e154 on, where |u|^2 overflows, results are not finite (in
 * exported code of single precision from 1e19 on). dexp^-1 has poles at |u| = 2 pi, 4 pi, ...
 *
 * No function here fails, allocates or locks; NaN in gives NaN out. `out` may be the same array as an input,
 * a partial overlap is not allowed.
 */
#ifndef LIEGRAD_GEOMETRY_H
#define LIEGRAD_GEOMETRY_H

#include "liegrad/core.h"

LG_BEGIN_DECLS

LG_API double lg_dot3(const double a[3], const double b[3]);
LG_API void lg_cross3(const double a[3], const double b[3], double out[3]);

/* ---- SO(3) ----
 *
 * ad_u b = [u, b] = u x b is lg_cross3. Duals are taken with the dot product: (F^* mu) . b = mu . (F b).
 */

/* R = I + c_1 hat(u) + c_2 hat(u)^2 (Rodrigues) */
LG_API void lg_so3_exp(const double u[3], double R[9]);
/* exp(hat(u)) q = q + c_1 u x q + c_2 u x (u x q), without forming exp(hat(u)) */
LG_API void lg_so3_exp_act(const double u[3], const double q[3], double out[3]);
/* out = exp(hat(u)) R */
LG_API void lg_so3_exp_multiply(const double u[3], const double R[9], double out[9]);
/* u with exp(hat(u)) = R and |u| <= pi, to a few 1e-16 at every angle. It comes from the unit quaternion with
 * nonnegative scalar part, read from the row of 4 q q^T with the largest diagonal entry. At |u| = pi, where u
 * and -u are the same rotation, the component of u with the largest magnitude (the first of equals) is
 * positive. R need not be exactly orthogonal: rounding errors in R give errors of the same size in u. */
LG_API void lg_so3_log(const double R[9], double u[3]);
/* Ad_R b = R b and its dual Ad_R^* mu = R^T mu */
LG_API void lg_so3_adjoint(const double R[9], const double b[3], double out[3]);
LG_API void lg_so3_coadjoint(const double R[9], const double mu[3], double out[3]);
/* dexp_u(b) = b + c_2 u x b + c_3 u x (u x b): d/dt exp(u(t)) = hat(dexp_u(u')) exp(u) */
LG_API void lg_so3_dexp(const double u[3], const double b[3], double out[3]);
/* dexp_u^-1(b) = b - 1/2 u x b + g_2 u x (u x b), g_2 = (1 - (x/2) cot(x/2))/x^2. Accurate to |u| = pi and
 * beyond; the pole at |u| = 2 pi is a property of the map. */
LG_API void lg_so3_dexpinv(const double u[3], const double b[3], double out[3]);
/* Replaces R by the nearest rotation in the Frobenius norm (the orthogonal polar factor). The error is some
 * 1e-15 s_1/(s_2 + s_3), s_1 >= s_2 >= s_3 the singular values of R; entries may be of any size. Method near
 * rotations: R <- (R + R^-T)/2 (Higham 1986), else the eigenvector of a matrix of order 4 (Horn 1987).
 * The result is NaN when det R is not positive: such a matrix is not a rotation with rounding errors. Below
 * s_2 s_3 of some 1e-16 s_1^2 rounding decides the sign of det R, and the result may be NaN. It is NaN when
 * s_2 + s_3 is below some 1e-13 s_1: then rounding alone says what the rotation is. */
LG_API void lg_so3_project(double R[9]);

/* ---- SE(3) ---- */

/* (R, r) = (exp(hat(u)), dexp_u(v)) */
LG_API void lg_se3_exp(const double a[6], double R[9], double r[3]);
/* exp(u, v) (R, r) = (exp(hat(u)) R, exp(hat(u)) r + dexp_u(v)); out_R and out_r may be R and r */
LG_API void lg_se3_exp_multiply(const double a[6], const double R[9], const double r[3], double out_R[9],
                                double out_r[3]);
/* a = (u, v) with exp(a) = (R, r): u = log R with its branch at |u| = pi, v = dexp_u^-1(r) */
LG_API void lg_se3_log(const double R[9], const double r[3], double a[6]);
/* The action of SE(3) on T*S^2 and on TS^2, y = (q, p): exp(u, v) . (q, p) = (R q, R p + r x R q). It keeps
 * |q| and q.p. */
LG_API void lg_se3_exp_act(const double a[6], const double y[6], double out[6]);
/* Its infinitesimal generator: (u x q, u x p + v x q) */
LG_API void lg_se3_generator(const double a[6], const double y[6], double out[6]);
/* [(u1, v1), (u2, v2)] = ad_(u1, v1) (u2, v2) = (u1 x u2, u1 x v2 + v1 x u2) */
LG_API void lg_se3_bracket(const double a[6], const double b[6], double out[6]);
/* dexp_a(b) and dexp_a^-1(b) = sum_k B_k/k! ad_a^k b, closed forms. With phi(z) = (e^z - 1)/z, or its
 * inverse:
 *
 *   C = B + g1 A x B + g2 A x (A x B)
 *   c = b + g1 (a x B + A x b) + rho gt1 A x B + rho gt2 A x (A x B)
 *       + g2 (a x (A x B) + A x (a x B) + A x (A x b)),   rho = A.a, gt = 2 dg/dw,
 *
 * (A, a) the first and (B, b) the second argument; dexp: g1 = c_2, g2 = c_3; dexpinv: g1 = -1/2, g2 as for
 * SO(3). */
LG_API void lg_se3_dexp(const double a[6], const double b[6], double out[6]);
LG_API void lg_se3_dexpinv(const double a[6], const double b[6], double out[6]);

LG_END_DECLS

#endif
