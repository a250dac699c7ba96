/* Unconstrained minimisation of f(x) from values and gradients, for smooth functions of some thousand
 * variables.
 *
 *   static lg_status bowl(void *user, const double *x, double *value, double *gradient) {
 *       *value = x[0] * x[0] + 10 * x[1] * x[1], gradient[0] = 2 * x[0], gradient[1] = 20 * x[1];
 *       return LG_OK;
 *   }
 *   double x[2] = {3, 1};
 *   lg_minimise_result result;
 *   lg_status status = lg_minimise(NULL, 2, bowl, NULL, NULL, x, &result, &error);
 *
 * All arithmetic is in double, on the caller's thread, in a fixed order: an objective with the same bits
 * gives the same path. SSBroyden and L-BFGS take a direction d = -H g and a step x + alpha d that satisfies
 * the weak Wolfe conditions
 *   f(x + alpha d) <= f(x) + 1e-4 alpha g.d,   g(x + alpha d).d >= 0.9 g.d,
 * found by cubic interpolation. A failing search restarts from H = 1.
 *
 * lg_minimise and lg_least_squares measure x by its start, |x_i|, and f by its gradient there: units do
 * not matter. (A variable that starts at 0 is measured by what f and its derivative say; where the
 * derivative is zero too, it counts as large as the largest of the others.) Where no step lowers f, or
 * many lower it by little, they look at the Hessian (n up to 200, L-BFGS about 2 memory) by differences of g
 * to both sides, 2 n evaluations. Where g is zero, differences to one side, n + 1 evaluations, are enough if
 * they foretell g on the other side, and show eigenvalues all above 1e-4 or one below -1e-4 of the diagonal.
 * The search then goes on along the Newton step or, from a saddle, down along the lowest eigenvector.
 * LG_MINIMISE_GRADIENT and LG_MINIMISE_ROUNDING then mean a minimum: the Hessian is positive semidefinite to
 * 1e-9 of its diagonal, and the Newton step lowers f by less than 1e-8 of it or than rounding of x changes f,
 * or moves x by less than 1e-8 of it. A plateau counts as a minimum: where the curvature changes f by less
 * than 1e-12 of it while x changes by its size, |x| and |x| at the start.
 *
 * Of more variables Lanczos' method looks for a way down, at most 30 evaluations each time. It finds negative
 * curvature that 30 steps from a random direction show: more than 1e-4 of the largest curvature, of
 * variables divided by 1 + |x_i|, and surely from about a hundredth on. A saddle that is flatter than that
 * still counts as a minimum.
 */
#ifndef LIEGRAD_MINIMISE_H
#define LIEGRAD_MINIMISE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"

LG_BEGIN_DECLS

typedef enum lg_minimise_method {
    /* Self-scaled Broyden family (Al-Baali; Urban, Stefanou, Pons, J. Comput. Phys. 523 (2025) 113656). H is
     * dense: 8 n^2 bytes, and about 3 n^2 multiplications an iteration. */
    LG_MINIMISE_SSBROYDEN,
    /* Limited memory BFGS (Nocedal 1980; Liu & Nocedal 1989): 16 n bytes for each pair remembered. */
    LG_MINIMISE_LBFGS,
    /* Levenberg-Marquardt for sums of squares (Marquardt 1963; damping after Nielsen 1999): the step solves
     * (A + mu D) d = -g with the Gauss-Newton matrix A and the largest diagonal D that A has had (More
     * 1978). For lg_least_squares. */
    LG_MINIMISE_LM
} lg_minimise_method;
#define LG_MINIMISE_METHOD_COUNT 3

/* Why a run ended. */
typedef enum lg_minimise_end {
    LG_MINIMISE_RUNNING,
    LG_MINIMISE_EVALUATIONS, /* options.evaluations */
    LG_MINIMISE_SECONDS,     /* options.seconds */
    LG_MINIMISE_GRADIENT,    /* max |g_i| <= options.gradient_tolerance */
    LG_MINIMISE_SLOW,        /* 200 iterations (LM: 20) lowered f by less than 1e-4 of it */
    LG_MINIMISE_ROUNDING,    /* no step lowers f, g agrees with f and the Hessian with a minimum; LM: a step
                                 * would lower f by less than 1e-16 of it */
    LG_MINIMISE_CANCELLED,   /* the context's flag, or the objective's LG_CANCELLED */
    LG_MINIMISE_UNBOUNDED,   /* f falls without end along a direction */
    LG_MINIMISE_NOT_FINITE,  /* f or g is NaN or infinite at the start */
    LG_MINIMISE_WRONG_GRADIENT, /* g disagrees with differences of f */
    LG_MINIMISE_WRONG_JACOBIAN, /* lg_least_squares: J disagrees with differences of r */
    LG_MINIMISE_BARRIER,        /* no step lowers f, which is not finite beyond x */
    LG_MINIMISE_STUCK,          /* no step lowers f, and the Hessian does not show a minimum */
    LG_MINIMISE_LIMIT           /* 10000 evaluations without another end; options.evaluations is 0 */
} lg_minimise_end;
#define LG_MINIMISE_END_COUNT 14
LG_API const char *lg_minimise_end_sentence(lg_minimise_end end); /* without a full stop; "" while running */
/* LG_OK for ends that leave a usable x; else LG_CANCELLED, LG_NO_CONVERGENCE (unbounded, stuck, limit),
 * LG_NOT_FINITE, LG_CHECK_FAILED (wrong gradient or Jacobian). */
LG_API lg_status lg_minimise_end_status(lg_minimise_end end);

typedef struct lg_minimise_options {
    size_t size;               /* sizeof(lg_minimise_options) */
    lg_minimise_method method; /* LG_MINIMISE_SSBROYDEN */
    uint32_t memory;           /* L-BFGS: 50 pairs, 1..1000 */
    double gradient_tolerance; /* 0: only an exact zero */
    /* true: g is compared with f along a line, at the start and where no step lowers f: 4 evaluations each,
     * up to 16 where f is rough or before g is called wrong; the Hessian, or 30 products with it, verifies a
     * minimum. Of
     * lg_least_squares: J with r along a line at the start, 2 evaluations, 8 before it is called wrong. */
    bool check;
    bool slow; /* true: LG_MINIMISE_SLOW ends; false */
    /* Levenberg-Marquardt: the last blocks x block variables are blocks of `block` of which no two meet in a
     * residual. They are eliminated: the cost grows with their number, not its cube. 0, 0. */
    size_t blocks, block;
    /* NULL: alone; else ranks that minimise together (liegrad/ranks.h): SSBroyden's H is divided over them by
     * rows, all else is done by each. Every rank tells the same f and g. */
    const lg_ranks *ranks;
    /* Of lg_minimise alone. */
    uint64_t evaluations; /* 0: at most 10000, and to use them up is a failure, LG_MINIMISE_LIMIT */
    double seconds;       /* 0: no limit */
} lg_minimise_options;
LG_API void lg_minimise_options_init(lg_minimise_options *options);

typedef struct lg_minimise_result {
    lg_minimise_end end;
    uint64_t evaluations, iterations; /* values and gradients taken; steps accepted */
    double value, gradient;           /* f and max |g_i| at x */
} lg_minimise_result;

/* f and its gradient (n) at x (n). A value or gradient that is not finite makes the search shorten its step;
 * so does a return of LG_NOT_FINITE. Other statuses stop the run and are returned. */
typedef lg_status (*lg_objective)(void *user, const double *x, double *value, double *gradient);

/* Minimises from x (n doubles, in/out): on return x is the best point, also after an error. `options` NULL:
 * defaults; `result` may be NULL. Returns lg_minimise_end_status of the end, with its sentence in `error`, or
 * LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY, the objective's status. */
LG_API lg_status lg_minimise(const lg_context *context, size_t n, lg_objective objective, void *user,
                             const lg_minimise_options *options, double *x, lg_minimise_result *result,
                             lg_error *error);

/* ---- least squares ---- */

/* r (m), and dr_i/dx_j at jacobian[i n + j], at x (n). As lg_objective otherwise. */
typedef lg_status (*lg_residuals)(void *user, const double *x, double *r, double *jacobian);

/* Minimises f = |r|^2 from x (n, in/out; n <= m) by Levenberg-Marquardt, with a QR decomposition of J: the
 * error of a step grows with the condition of J, not its square. options->method is not read; an evaluation
 * is one of r with its Jacobian. covariance (n, n), NULL or the covariance of x for independent residuals of
 * equal, unknown variance: |r|^2/(m - n) (J^T J)^-1; NaN where m = n or J^T J is singular to rounding (a
 * combination of the x cannot be identified). Errors: those of lg_minimise. */
LG_API lg_status lg_least_squares(const lg_context *context, size_t n, size_t m, lg_residuals residuals,
                                  void *user, const lg_minimise_options *options, double *x,
                                  double *covariance, lg_minimise_result *result, lg_error *error);

/* The least |A x - y|^2 for each of `columns` vectors y at once, from sums over rows: the lower triangle of
 * matrix = A^T A (n, n), which is overwritten, and right = A^T y (columns, n), which becomes x. The diagonal
 * is first raised by `ridge` times itself, 1e-12 or more: columns of A that are combinations of others to
 * rounding share what is theirs, one of zeros gets 0. LG_CHECK_FAILED: the matrix is not positive definite
 * (NaN is not either); both are overwritten. */
LG_API lg_status lg_normal_equations(size_t n, size_t columns, double ridge, double *matrix, double *right);

/* ---- ask and tell: the caller evaluates, and may save the state between any two evaluations ---- */

typedef struct lg_minimiser lg_minimiser;

/* x (n) is copied. The context must outlive the minimiser. Errors: LG_INVALID_ARGUMENT, LG_NOT_FINITE (x),
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_minimiser_create(const lg_context *context, size_t n, const lg_minimise_options *options,
                                     const double *x, lg_minimiser **out, lg_error *error);
LG_API void lg_minimiser_destroy(lg_minimiser *minimiser); /* NULL is fine */
/* Where f and g are wanted next (n); borrowed until the next call. After an end: the best point. */
LG_API const double *lg_minimiser_point(const lg_minimiser *minimiser);
/* Takes f and g (n, copied) at that point. Returns whether x was replaced by this point. */
LG_API bool lg_minimiser_tell(lg_minimiser *minimiser, double value, const double *gradient);
/* The same for LG_MINIMISE_LM, with the Gauss-Newton matrix 2 J^T J of f. With blocks: its first p = n -
 * blocks block rows and columns (p, p), the rows of the others in the first columns (blocks block, p), the
 * blocks (blocks, block, block), one after the other: lg_minimise_matrix_length numbers. */
LG_API size_t lg_minimise_matrix_length(size_t n, const lg_minimise_options *options);
LG_API bool lg_minimiser_tell_squares(lg_minimiser *minimiser, double value, const double *gradient,
                                      const double *matrix);
/* LG_OK, or why ranks could not exchange what a step needs: the minimiser is of no use any more. */
LG_API lg_status lg_minimiser_status(const lg_minimiser *minimiser);
/* The lowest point accepted so far (n), borrowed. */
LG_API const double *lg_minimiser_best(const lg_minimiser *minimiser);
/* g at the best point (n), borrowed. */
LG_API const double *lg_minimiser_gradient(const lg_minimiser *minimiser);
/* The objective has changed a little: f and g (n, copied) at the best point are these from now on. H stays,
 * and the next point is one of a new search. Nothing happens before the first step and after an end. */
LG_API void lg_minimiser_change(lg_minimiser *minimiser, double value, const double *gradient);
/* end, evaluations, iterations, and value and gradient at the best point. */
LG_API lg_minimise_result lg_minimiser_result(const lg_minimiser *minimiser);

/* Ranks, all of them before rank 0 saves: it gets what is divided, and gives it back by lg_minimiser_scatter.
 * Alone they do nothing. Errors: LG_OUT_OF_MEMORY, those of the exchange. */
LG_API lg_status lg_minimiser_collect(lg_minimiser *minimiser, lg_error *error);
LG_API void lg_minimiser_scatter(lg_minimiser *minimiser);
/* Saves the whole state as minimise/{x,point,gradient,direction,curvature,counts,numbers}. Errors: the
 * writer's, LG_UNSUPPORTED on ranks that do not have all. */
LG_API lg_status lg_minimiser_save(const lg_minimiser *minimiser, const lg_archive_writer *writer,
                                   lg_error *error);
/* Replaces the state by one of the same n and options; as before on failure. Errors: the reader's, LG_FORMAT
 * for an impossible state, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_minimiser_load(lg_minimiser *minimiser, const lg_archive_reader *reader, lg_error *error);

LG_END_DECLS

#endif
