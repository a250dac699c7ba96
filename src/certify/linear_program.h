/* Linear programs with few unknowns and many inequalities. */
#ifndef LG_LINEAR_PROGRAM_H
#define LG_LINEAR_PROGRAM_H

#include "core/core.h"

/* Finds x (n) with the least c^T x among those with A x >= b; A (m, n). A primal-dual method of interior
 * points with Mehrotra's steps (1992): some 20 to 50 factorisations of n x n matrices. The columns of A
 * should be orthonormal, or nearly so. LG_NO_CONVERGENCE: there is no such x, no least one, or double
 * precision does not suffice. */
lg_status lg_linear_program(const lg_context *context, size_t m, size_t n, const double *A, const double *b,
                            const double *c, double *x);

#endif
