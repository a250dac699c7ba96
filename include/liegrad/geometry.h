/* Rotations SO(3) and rigid motions SE(3): exponential maps, logarithms, brackets, actions and dexp. Plain
 * functions of doubles, in the library liegrad.
 *
 * Conventions. A vector u of R^3 stands for the element hat(u) of so(3), hat(u) b = u x b; |u| is the angle
 * in radians. An element of se(3) is a = (u, v), 6 numbers, angular part first. An element of SE(3) is (R,
 * r), where R is a 3 x 3 matrix, row-major, and r a vector. Groups act from the left, and elements of the
 * algebra are spatial (right-trivialised): one step is y1 = exp(a) . y0, and y' = a . y has the solution
 * exp(t a) . y0.
 *
 * All coefficients are analytic functions of w = |u|^2, so no digits are lost near u = 0. They are the
 * Stumpff functions c_k(w) = sum_j (-w)^j / (k + 2j)!. With w = x^2: c_1 = sin x/x, c_2 = (1 - cos x)/x^2,
 * c_3 = (x - sin x)/x^3.
 *
 * Errors of exp and dexp are as large as rounding errors of u make them: about 1e-16 (1 + |u|). So for |u| =
 * 1e13 the rotation is known to 1e-3 rad, and from |u| = 1e16 on no digit is right. From |u| = 1e154 on,
 * |u|^2 overflows and results are not finite (in exported C code of single precision from 1e19 on). dexp^-1
 * has poles at |u| = 2 pi, 4 pi, ...
 *
 * Rules for all functions: they cannot fail, allocate nothing and take no lock; several threads may call
 * them. If an input is NaN, so is the result. `out` may be the same array as an input, but must not overlap
 * it in part. No argument may be NULL.
 */
#ifndef LIEGRAD_GEOMETRY_H
#define LIEGRAD_GEOMETRY_H

#include "liegrad/core.h"

LG_BEGIN_DECLS

LG_API double lg_dot3(const double a[3], const double b[3]);                /* a . b */
LG_API void lg_cross3(const double a[3], const double b[3], double out[3]); /* out = a x b */

/* ---- SO(3) ----
 *
 * The bracket ad_u b = [u, b] = u x b is lg_cross3. The dual F^* of a map F is taken with the dot product:
 * (F^* mu) . b = mu . (F b).
 */

/* R = exp(hat(u)) = I + c_1 hat(u) + c_2 hat(u)^2 (Rodrigues) */
LG_API void lg_so3_exp(const double u[3], double R[9]);
/* out = exp(hat(u)) q = q + c_1 u x q + c_2 u x (u x q), without computing exp(hat(u)) */
LG_API void lg_so3_exp_act(const double u[3], const double q[3], double out[3]);
/* out = exp(hat(u)) R */
LG_API void lg_so3_exp_multiply(const double u[3], const double R[9], double out[9]);
/* Logarithm: the u with exp(hat(u)) = R and |u| <= pi. The error is a few 1e-16 at every angle. At |u| = pi,
 * where u and -u are the same rotation, the component of u with the largest magnitude (the first one, if
 * several are equal) is positive. R need not be exactly orthogonal: rounding errors in R cause errors of the
 * same size in u. Method: the unit quaternion q with nonnegative scalar part, read from the row of 4 q q^T
 * that has the largest diagonal entry. */
LG_API void lg_so3_log(const double R[9], double u[3]);
/* out = Ad_R b = R b */
LG_API void lg_so3_adjoint(const double R[9], const double b[3], double out[3]);
/* out = Ad_R^* mu = R^T mu, the dual of Ad_R */
LG_API void lg_so3_coadjoint(const double R[9], const double mu[3], double out[3]);
/* out = dexp_u(b) = b + c_2 u x b + c_3 u x (u x b). It is the derivative of exp: d/dt exp(hat(u(t))) =
 * hat(dexp_u(u')) exp(hat(u)). */
LG_API void lg_so3_dexp(const double u[3], const double b[3], double out[3]);
/* out = dexp_u^-1(b) = b - 1/2 u x b + g_2 u x (u x b), where g_2 = (1 - (x/2) cot(x/2))/x^2 and x = |u|. It
 * is accurate up to |u| = pi and beyond; at |u| = 2 pi the map itself has a pole. */
LG_API void lg_so3_dexpinv(const double u[3], const double b[3], double out[3]);
/* Replaces R by the nearest rotation in the Frobenius norm, the orthogonal polar factor. The entries of R may
 * be of any size. Let s_1 >= s_2 >= s_3 be the singular values of R. The error is about 1e-15 * s_1/(s_2 +
 * s_3).
 *
 * The result is NaN if det R is not positive, because such a matrix is no rotation with rounding errors. If
 * s_2 s_3 is below about 1e-16 s_1^2, the sign of the computed det R is decided by rounding, so the result
 * may be NaN. If s_2 + s_3 is below about 1e-13 s_1, the result is NaN, because the nearest rotation would be
 * decided by rounding.
 *
 * Method: near rotations R <- (R + R^-T)/2, repeated (Higham 1986); otherwise the quaternion that is the
 * eigenvector of a 4 x 4 matrix (Horn 1987). */
LG_API void lg_so3_project(double R[9]);

/* ---- SE(3) ---- */

/* (R, r) = exp(a) = (exp(hat(u)), dexp_u(v)) for a = (u, v) */
LG_API void lg_se3_exp(const double a[6], double R[9], double r[3]);
/* Logarithm: a = (u, v) with exp(a) = (R, r). u is the result of lg_so3_log, and v = dexp_u^-1(r). */
LG_API void lg_se3_log(const double R[9], const double r[3], double a[6]);
/* The action of SE(3) on TS^2 and T*S^2: out = exp(a) . y = (R q, R p + r x R q) for y = (q, p) and (R, r) =
 * exp(a). It preserves |q| and q . p. */
LG_API void lg_se3_exp_act(const double a[6], const double y[6], double out[6]);
/* The infinitesimal generator of this action: out = (u x q, u x p + v x q) for a = (u, v) and y = (q, p). */
LG_API void lg_se3_generator(const double a[6], const double y[6], double out[6]);
/* The bracket: out = [a, b] = ad_a b = (u1 x u2, u1 x v2 + v1 x u2) for a = (u1, v1) and b = (u2, v2). */
LG_API void lg_se3_bracket(const double a[6], const double b[6], double out[6]);
/* out = dexp_a(b) and out = dexp_a^-1(b) = sum_k B_k/k! ad_a^k b (B_k: Bernoulli numbers), in closed form.
 * Let the first argument be (A, a) and the second one (B, b), angular parts first, and out = (C, c). Then
 *
 *   C = B + g1 A x B + g2 A x (A x B)
 *   c = b + g1 (a x B + A x b) + rho gt1 A x B + rho gt2 A x (A x B)
 *       + g2 (a x (A x B) + A x (a x B) + A x (A x b)),
 *   rho = A.a, gt1 = 2 dg1/dw, gt2 = 2 dg2/dw, w = |A|^2.
 *
 * For dexp, g1 = c_2 and g2 = c_3. For dexp^-1, g1 = -1/2 and g2 is g_2 of lg_so3_dexpinv. */
LG_API void lg_se3_dexp(const double a[6], const double b[6], double out[6]);
LG_API void lg_se3_dexpinv(const double a[6], const double b[6], double out[6]);

LG_END_DECLS

#endif
