/* Unconstrained minimisation of a smooth function f(x) of up to some thousand variables, from its values and
 * gradients; nonlinear least squares; linear least squares from sums over rows. Library liegrad.
 *
 *   static lg_status bowl(void *user, const double *x, double *value, double *gradient) {
 *       *value = x[0] * x[0] + 10 * x[1] * x[1], gradient[0] = 2 * x[0], gradient[1] = 20 * x[1];
 *       return LG_OK;
 *   }
 *   double x[2] = {3, 1};
 *   lg_minimise_result result;
 *   lg_status status = lg_minimise(NULL, 2, bowl, NULL, NULL, x, &result, &error);
 *
 * In all comments n is the number of variables and g the gradient of f. All arithmetic is in double
 * precision, on the caller's thread and in a fixed order: if the objective returns the same bits, the run
 * takes the same path.
 *
 * Search. LG_MINIMISE_SSBROYDEN and LG_MINIMISE_LBFGS keep an approximation H of the inverse Hessian. They
 * step along d = -H g, to x + alpha d. The step length alpha satisfies the weak Wolfe conditions
 *   f(x + alpha d) <= f(x) + 1e-4 alpha g.d,   g(x + alpha d).d >= 0.9 g.d,
 * and is found by cubic interpolation. If a line search fails, the method starts again with H = 1, unless
 * the predicted fall is smaller than the change of f by rounding of f and x.
 *
 * Units. lg_minimise and lg_least_squares scale the problem, so that the result does not depend on the units
 * of x and f: each x_i is divided by its start value |x_i|, and f by the size of its gradient at the start. A
 * variable that starts at 0 gets a unit that changes f (in lg_least_squares: r) by about its own size, as its
 * derivative tells. If that derivative is zero too, it gets the unit of the largest of the other variables. A
 * start value below 1e-15, in its own unit, counts as 0 if its product with the derivative is at most 1e-15
 * of f (or r). If all variables start at 0 and all derivatives are zero, the units are 1; the method then
 * leaves a maximum only if the length over which f changes is between 1e-9 and 1e9.
 *
 * Verification of a minimum. It is done with options.check and without ranks, when no step lowers f, when
 * many steps have lowered it only little, or when g is zero. For n <= 200 (L-BFGS: n up to about 2 memory) it
 * computes the Hessian from differences of g. Those to one side, n + 1 evaluations, are enough if they
 * predict g on the other side, and if all eigenvalues are above 1e-4 of the diagonal or one is below -1e-4
 * of it; otherwise there are 2 n + 1 to both sides. Then the run ends, or goes on: along the Newton
 * step, or from a saddle along the eigenvector of the lowest eigenvalue, downhill. So LG_MINIMISE_GRADIENT
 * and LG_MINIMISE_ROUNDING mean a minimum: the Hessian is positive semidefinite to 1e-9 of its diagonal. In
 * addition the Newton step would lower f by less than 1e-8 of f, or by less than rounding of x changes f, or
 * it would move x by less than 1e-8 of x. A plateau counts as a minimum too: that is a point where the
 * curvature changes f by less than 1e-12 of f when a variable changes by its magnitude plus its magnitude at
 * the start.
 *
 * For more variables, Lanczos' method looks for a direction of negative curvature, with at most 30
 * evaluations each time. The curvature is measured in the variables x_i/(1 + |x_i|). A direction is found if
 * its negative curvature is more than 1e-4 of the largest curvature, and if 30 steps from a random direction
 * show it; they surely do if it is more than about a hundredth. A saddle that is flatter counts as a minimum.
 */
#ifndef LIEGRAD_MINIMISE_H
#define LIEGRAD_MINIMISE_H

#include "liegrad/core.h"

LG_BEGIN_DECLS

typedef enum lg_minimise_method {
    /* Self-scaled Broyden family (Al-Baali; Urban, Stefanou, Pons, J. Comput. Phys. 523 (2025) 113656). H is
     * a dense matrix: it takes 8 n^2 bytes, and about 3 n^2 multiplications per iteration. It is formed from
     * the first 3 pairs, which work as in L-BFGS until then. */
    LG_MINIMISE_SSBROYDEN,
    /* Limited memory BFGS (Nocedal 1980; Liu & Nocedal 1989): 16 n bytes per stored pair (options.memory
     * pairs). If n is at most options.memory, it begins with a diagonal H that the pairs update (Gilbert &
     * Lemarechal 1989). */
    LG_MINIMISE_LBFGS,
    /* Levenberg-Marquardt for sums of squares (Marquardt 1963; damping after Nielsen 1999): the step d solves
     * (A + mu D) d = -g, where A is the Gauss-Newton matrix, mu the damping and D the largest diagonal that A
     * has had so far. lg_least_squares finds mu from the length of d (trust region, More 1978). lg_minimise
     * does not take this method; use lg_least_squares or lg_minimiser_tell_squares. */
    LG_MINIMISE_LM
} lg_minimise_method;
#define LG_MINIMISE_METHOD_COUNT 3

/* Why a run ended. */
typedef enum lg_minimise_end {
    LG_MINIMISE_RUNNING,     /* it has not ended */
    LG_MINIMISE_EVALUATIONS, /* options.evaluations are used up */
    LG_MINIMISE_SECONDS,     /* options.seconds are used up */
    LG_MINIMISE_GRADIENT,    /* max |g_i| <= options.gradient_tolerance */
    LG_MINIMISE_SLOW,        /* with options.slow: 200 iterations (LM: 20) lowered f by less than 1e-4 f */
    /* No step lowers f any more, because of rounding; g agrees with f, and the Hessian with a minimum. LM: a
     * step would lower f by less than 1e-16 f. */
    LG_MINIMISE_ROUNDING,
    LG_MINIMISE_CANCELLED,      /* the context's cancel flag is set, or the objective returned LG_CANCELLED */
    LG_MINIMISE_UNBOUNDED,      /* f falls without end along a direction */
    LG_MINIMISE_NOT_FINITE,     /* f or g is NaN or infinite at the start */
    LG_MINIMISE_WRONG_GRADIENT, /* g disagrees with differences of f */
    LG_MINIMISE_WRONG_JACOBIAN, /* lg_least_squares: J disagrees with differences of r */
    LG_MINIMISE_BARRIER,        /* no step lowers f, because f is not finite beyond x */
    /* No step lowers f, or each of ten times 50 + 4 n iterations (least squares: 20 + 4 n) lowered it by less
     * than 3e-4 of it; and the Hessian does not show a minimum. */
    LG_MINIMISE_STUCK,
    LG_MINIMISE_LIMIT /* 10000 evaluations did not lead to another end; options.evaluations is 0 */
} lg_minimise_end;
#define LG_MINIMISE_END_COUNT 14
/* Returns a sentence about the end, without a full stop; "" for LG_MINIMISE_RUNNING. */
LG_API const char *lg_minimise_end_sentence(lg_minimise_end end);
/* Returns the status of an end: LG_CANCELLED (cancelled), LG_NO_CONVERGENCE (unbounded, stuck, limit),
 * LG_NOT_FINITE (not finite at the start), LG_CHECK_FAILED (wrong gradient or Jacobian), and LG_OK for all
 * other ends. */
LG_API lg_status lg_minimise_end_status(lg_minimise_end end);

typedef struct lg_minimise_options {
    size_t size;               /* sizeof(lg_minimise_options) */
    lg_minimise_method method; /* default LG_MINIMISE_SSBROYDEN; not read by lg_least_squares */
    uint32_t memory;           /* L-BFGS: number of stored pairs, 1 to 1000; default 50 */
    double gradient_tolerance; /* see LG_MINIMISE_GRADIENT; default 0: only if g is exactly zero */
    /* true (default): compares g with differences of f along a random line, at the start and when no step
     * lowers f. This takes 1 evaluation each time, and up to 16 if f is rough or before g is called wrong.
     * It also verifies minima, as said above. lg_least_squares compares J with differences of r along a
     * random line, when a step is refused for the first time or before the end: 1 evaluation, and 8 before J
     * is called wrong. */
    bool check;
    bool slow; /* true: a slow run ends with LG_MINIMISE_SLOW; default false */
    /* Levenberg-Marquardt: the last `blocks` * `block` variables form blocks of `block` variables each, such
     * that no residual depends on two of these blocks. The method eliminates the blocks, so its cost grows in
     * proportion to their number, not to its third power. Default 0 and 0. */
    size_t blocks, block;
    /* NULL (default): one process. Otherwise ranks that minimise together (liegrad/core.h): the rows of
     * SSBroyden's H are divided over the ranks, and every rank does everything else. All ranks must tell the
     * same f and g. */
    const lg_ranks *ranks;
    /* The next two are read by lg_minimise and lg_least_squares only. */
    uint64_t evaluations; /* limit; 0 (default): 10000, and to reach it is a failure, LG_MINIMISE_LIMIT */
    double seconds;       /* limit on the wall time; 0 (default): no limit */
} lg_minimise_options;
LG_API void lg_minimise_options_init(lg_minimise_options *options);

typedef struct lg_minimise_result {
    lg_minimise_end end;
    uint64_t evaluations, iterations; /* evaluations of f and g; accepted steps */
    double value, gradient;           /* f and max |g_i| at x */
} lg_minimise_result;

/* The objective: computes f and its gradient (n) at x (n). It may return LG_NOT_FINITE, or a value or
 * gradient that is not finite: then the line search shortens its step. Any other failure ends the run;
 * lg_minimise returns this status. `user` is the pointer that lg_minimise got. */
typedef lg_status (*lg_objective)(void *user, const double *x, double *value, double *gradient);

/* Minimises f, starting from x (n). On return x is the best point, also after a failure during the run.
 * `options` NULL means the defaults; `result` may be NULL. Returns lg_minimise_end_status of the end of the
 * run, with its sentence in `error`. Further errors: LG_INVALID_ARGUMENT (options out of range),
 * LG_NOT_FINITE (x), the status of the objective. */
LG_API lg_status lg_minimise(const lg_context *context, size_t n, lg_objective objective, void *user,
                             const lg_minimise_options *options, double *x, lg_minimise_result *result,
                             lg_error *error);

/* ---- least squares ---- */

/* Computes the residuals r (m) and their Jacobian at x (n): jacobian[i n + j] = dr_i/dx_j. Statuses and
 * `user` are as in lg_objective. */
typedef lg_status (*lg_residuals)(void *user, const double *x, double *r, double *jacobian);

/* Minimises f = |r|^2 by Levenberg-Marquardt, starting from x (n); n <= m. On return x is the best point,
 * also after a failure during the run. Each step uses a QR decomposition of J, so its error grows in
 * proportion to the condition number of J, not to its square. An evaluation is one call of `residuals`.
 *
 * `covariance` (n, n) may be NULL. Otherwise it becomes the covariance of x, if the residuals have
 * independent errors of equal, unknown variance: |r|^2/(m - n) (J^T J)^-1. It is NaN if m = n, or if J^T J is
 * singular up to rounding, that is, if the data do not determine some combination of the variables. Errors:
 * as in lg_minimise, and LG_INVALID_ARGUMENT for m < n. */
LG_API lg_status lg_least_squares(const lg_context *context, size_t n, size_t m, lg_residuals residuals,
                                  void *user, const lg_minimise_options *options, double *x,
                                  double *covariance, lg_minimise_result *result, lg_error *error);

/* Linear least squares: minimises |A x - y|^2 for each of `columns` right sides y. It needs only sums over
 * the rows of A: `matrix` = A^T A (n, n), of which the lower triangle is read, and `right` = A^T y (columns,
 * n), one right side per row. `right` becomes x; `matrix` is overwritten. Each diagonal element is first
 * multiplied by 1 + `ridge`. With a ridge of 1e-12 or more, the solution is divided among columns of A that
 * are linearly dependent up to rounding, and a column of zeros gets x_i = 0; with 0 or -1e-12 such columns
 * are an error. Errors: LG_CHECK_FAILED (the matrix is not positive definite or holds NaN; both arrays are
 * overwritten). */
LG_API lg_status lg_normal_equations(size_t n, size_t columns, double ridge, double *matrix, double *right);

/* ---- ask and tell ----
 *
 * With lg_minimiser the caller runs the loop: lg_minimiser_point gives the point, the caller evaluates f and
 * g there and tells them by lg_minimiser_tell, until lg_minimiser_result shows an end. The state can be saved
 * between any two evaluations. x and f are not scaled here. */

typedef struct lg_minimiser lg_minimiser;

/* Makes a minimiser that starts from x (n, copied). `options` NULL means the defaults. The context and the
 * ranks must outlive the minimiser. Errors: LG_INVALID_ARGUMENT (options out of range), LG_NOT_FINITE (x). */
LG_API lg_status lg_minimiser_create(const lg_context *context, size_t n, const lg_minimise_options *options,
                                     const double *x, lg_minimiser **out, lg_error *error);
LG_API void lg_minimiser_destroy(lg_minimiser *minimiser);
/* Returns the point (n) at which f and g are to be evaluated next; after the end, the best point. Borrowed
 * until the next call of lg_minimiser_tell. */
LG_API const double *lg_minimiser_point(const lg_minimiser *minimiser);
/* Tells f and g (n, copied) at the point of lg_minimiser_point. Returns true if this point became the new
 * best point, that is, if a step was accepted. */
LG_API bool lg_minimiser_tell(lg_minimiser *minimiser, double value, const double *gradient);
/* Returns the number of elements of `matrix` in lg_minimiser_tell_squares. */
LG_API size_t lg_minimise_matrix_length(size_t n, const lg_minimise_options *options);
/* The same as lg_minimiser_tell, for LG_MINIMISE_LM and f = |r|^2. `matrix` is the Gauss-Newton matrix 2 J^T
 * J (n, n). With options.blocks it has three parts, one after the other, where p = n - blocks * block: the
 * first p rows and columns of 2 J^T J (p, p); the first p columns of its other rows (blocks * block, p); and
 * its diagonal blocks (blocks, block, block). */
LG_API bool lg_minimiser_tell_squares(lg_minimiser *minimiser, double value, const double *gradient,
                                      const double *matrix);
/* Returns LG_OK, or the status with which an exchange between ranks failed; then the minimiser cannot be used
 * any more. */
LG_API lg_status lg_minimiser_status(const lg_minimiser *minimiser);
/* Returns the best point so far (n), borrowed. */
LG_API const double *lg_minimiser_best(const lg_minimiser *minimiser);
/* Returns g at the best point (n), borrowed. */
LG_API const double *lg_minimiser_gradient(const lg_minimiser *minimiser);
/* Tells that the objective has changed a little: at the best point f and g (n, copied) have these values from
 * now on. H is kept, and a new line search begins. It does nothing before the first accepted step, after the
 * end, and for Levenberg-Marquardt. */
LG_API void lg_minimiser_change(lg_minimiser *minimiser, double value, const double *gradient);
/* Returns the end (or LG_MINIMISE_RUNNING), the counts so far, and f and max |g_i| at the best point. */
LG_API lg_minimise_result lg_minimiser_result(const lg_minimiser *minimiser);

/* For ranks: all ranks must call lg_minimiser_collect before rank 0 calls lg_minimiser_save. Rank 0 then has
 * a copy of H with the rows of all ranks; lg_minimiser_scatter frees this copy after saving. Without ranks
 * both functions do nothing. Errors: the status of the exchange. */
LG_API lg_status lg_minimiser_collect(lg_minimiser *minimiser, lg_error *error);
LG_API void lg_minimiser_scatter(lg_minimiser *minimiser);
/* Saves the whole state as minimise/{x,point,gradient,direction,curvature,counts,numbers}. Errors: the status
 * of the writer, LG_UNSUPPORTED (with ranks: this rank has no copy of the whole H). */
LG_API lg_status lg_minimiser_save(const lg_minimiser *minimiser, const lg_archive_writer *writer,
                                   lg_error *error);
/* Replaces the state by a saved one, of a minimiser with the same n and options. On failure the state is
 * unchanged. Errors: the status of the reader, LG_FORMAT (an impossible state). */
LG_API lg_status lg_minimiser_load(lg_minimiser *minimiser, const lg_archive_reader *reader, lg_error *error);

LG_END_DECLS

#endif
