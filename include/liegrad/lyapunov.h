/* Searches for Lyapunov functions, for certificates (liegrad/certify.h). The library is liegrad. The
 * searches look at points only, so a result is a proposal. lg_certify proves it, or finds the largest level
 * for which it holds.
 *
 * Polynomials, by linear programming. The coefficients are the solution of a linear program at random
 * points: V >= 1 on the boundary of the box, V' <= -decay |q|^2 within it, and the mean of V is least, so
 * that {V <= 1} is large. */
#ifndef LIEGRAD_LYAPUNOV_H
#define LIEGRAD_LYAPUNOV_H

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
 * inequalities at the points). On failure the program is unchanged. */
LG_API lg_status lg_lyapunov_polynomial(lg_program *program, const lg_lyapunov_spec *spec, lg_error *error);

typedef struct lg_lyapunov_search {
    size_t size; /* sizeof(lg_lyapunov_search) */
    /* A function of the program: x (n) -> x' (n), or the next state if `step`; n <= 16. With a second, shared
     * input K (m, n) the gains are searched as well: u = -K x + ... */
    const char *rate;
    bool step;
    const double *goal;       /* (n), an equilibrium; NULL: 0 */
    const double *low, *high; /* (n) the box; sides may be infinite */
    const double *scale;      /* (n) sizes of x - goal, all above 0; NULL: the sides of the box, all finite */
    /* (n) bounds of |error of rate|; NULL: 0. They count where V is above .3 of its level. */
    const double *model_error;
    size_t generations; /* of 8 to 20 proposals; 0 (default): 100 for each number of P's half and of K */
    size_t directions;  /* of the sample; default 400 */
    uint64_t seed;      /* default 1 */
    int threads;        /* default 1; results are the same for any number */
} lg_lyapunov_search;

LG_API void lg_lyapunov_search_init(lg_lyapunov_search *search);
/* Finds P (n, n), symmetric, and K (m, n) (not touched, may be NULL, if `rate` has no K). {V <= 1} is the
 * proposal; *volume (may be NULL) is its volume. The search starts from solutions of Riccati equations with
 * random weights; without K from solutions of Lyapunov equations. Errors: LG_INVALID_ARGUMENT,
 * LG_NOT_FOUND (no such function), LG_CHECK_FAILED (no quadratic form falls near the goal), LG_CANCELLED;
 * outputs are then untouched. */
LG_API lg_status lg_lyapunov_quadratic(const lg_context *context, const lg_program *program,
                                       const lg_lyapunov_search *search, double *P, double *K, double *volume,
                                       lg_error *error);

LG_END_DECLS

#endif
