/* The continuous algebraic Riccati equation of a small system, for the set-up of a controller. */
#ifndef RICCATI_H
#define RICCATI_H

#include <stdbool.h>

enum { RICCATI_MAX = 8 };

/* Stabilising solution P (n, n) of A^T P + P A - P G P + Q = 0 for G = B R^-1 B^T; all row-major, G and Q
 * symmetric, n <= RICCATI_MAX. With it u = -R^-1 B^T P x minimises the integral of x^T Q x + u^T R u. False,
 * and P as it was, when there is none: an unstable mode that u does not reach, an undamped one that Q does
 * not see, NaN.
 *
 * The matrix sign function of the Hamiltonian [A, -G; -Q, -A^T] by scaled Newton iterations; P spans its
 * stable subspace, (sign + I) [I; P] = 0, in the least-squares sense (Roberts, Int. J. Control 32, 1980,
 * 677-687). */
bool riccati_solve(int n, const double *A, const double *G, const double *Q, double *P);

/* Largest entry of A^T P + P A - P G P + Q in size. */
double riccati_residual(int n, const double *A, const double *G, const double *Q, const double *P);

#endif
