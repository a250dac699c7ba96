/* Polynomial Lyapunov functions by linear programming, for certificates (liegrad/certify.h). The library is
 * liegrad.
 *
 * The coefficients are the solution of a linear program at random points: V >= 1 on the boundary of the box,
 * V' <= -decay |q|^2 within it, and the mean of V is least, so that {V <= 1} is large. What holds at points
 * is a proposal; lg_certify proves it or finds the largest level for which it holds. */
#ifndef LIEGRAD_LYAPUNOV_H
#define LIEGRAD_LYAPUNOV_H

#include "liegrad/core.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

typedef struct lg_lyapunov_spec {
    size_t size;      /* sizeof(lg_lyapunov_spec) */
    const char *rate; /* a function of the program: the state (n) -> x' (n), n <= 6 */
    /* A function of the program: the state (n) -> coordinates q (n) in which V is a polynomial, 0 at the
     * goal; NULL: q = x - goal. */
    const char *map;
    const char *name;         /* of the new function */
    const double *goal;       /* (n); NULL: 0 */
    const double *low, *high; /* (n) the box */
    int degree;               /* even, 2 to 12; at most 500 monomials of degree 2 to `degree` */
    size_t points;            /* default 12000, of which a third lie on the boundary */
    double decay;             /* default 1e-3; q is divided by its largest size in the box here */
    uint64_t seed;            /* default 1 */
} lg_lyapunov_spec;

LG_API void lg_lyapunov_spec_init(lg_lyapunov_spec *spec);
/* Adds the function `name`, x (n) -> V, one number, with the coefficients as constants. Errors:
 * LG_INVALID_ARGUMENT, LG_NOT_FOUND, LG_NO_CONVERGENCE (no polynomial of this degree satisfies the
 * inequalities at the points), LG_OUT_OF_MEMORY. On failure the program is unchanged. */
LG_API lg_status lg_lyapunov_polynomial(lg_program *program, const lg_lyapunov_spec *spec, lg_error *error);

LG_END_DECLS

#endif
