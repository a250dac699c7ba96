/* Gradient check: tests whether the derivatives of a function that is recorded on a tape are right. Library
 * liegrad; the executable lg-gradcheck runs it on all operations.
 *
 * The function f and its argument x are in double precision. J is the Jacobian of f at x. The check draws a
 * few random directions d and cotangents c. For each of them it tests:
 *   - Taylor remainder: R(h) = <c, f(x(h)) - f(x)> - <J^T c, x(h) - x> with x(h) = x + h d falls like h^2. h
 *     is halved again and again. The slope of log max(|R(h)|, |R(-h)|) over log h, by regression over the
 *     smallest h at which R is above rounding errors, must be at least 1.9. The test is passed too if R is at
 *     the level of rounding errors for all h, as it is for a linear function.
 *   - Forward mode: each element of J d equals the difference quotient of f (extrapolated, with an error of
 *     order h^4).
 *   - Both modes agree: <c, J d> = <J^T c, d> up to rounding.
 *   - lg_backward equals lg_vjp up to rounding.
 * For the second order the same tests are made for the function G(x, c) = J(x)^T c. A further test is that
 * <c, D^2 f[d, e]> = <d, H e> = <e, H d> for another direction e, where H is the Hessian of <c, f>; the left
 * side is computed as the jvp of a jvp and as the vjp of a jvp.
 *
 * If an argument lies on a manifold, a direction d is an element of the Lie algebra, and x(h) = exp(h d) . x
 * is computed by the callback `perturb`.
 */
#ifndef LIEGRAD_GRADCHECK_H
#define LIEGRAD_GRADCHECK_H

#include "liegrad/tape.h"

LG_BEGIN_DECLS

#define LG_GRADCHECK_MAX_INPUTS 12
#define LG_GRADCHECK_ORDERS     2

typedef struct lg_gradcheck_argument {
    lg_shape shape;
    /* The point x, lg_shape_count(shape) numbers. NULL: drawn uniformly from [low, high); low = high = 0
     * means [-1, 1). Must be given if algebra > 0. */
    const double *values;
    double low, high;
    double scale;     /* directions are multiplied by it, so that steps are at most scale/16; 0 means 1 */
    uint32_t algebra; /* dimension of the Lie algebra, if x lies on a manifold; 0: x lies in R^n */
} lg_gradcheck_argument;

typedef struct lg_gradcheck_function {
    const char *name;
    uint32_t inputs; /* 1..LG_GRADCHECK_MAX_INPUTS */
    const lg_gradcheck_argument *arguments;
    /* Records the function: returns y, computed from the variables x[0..inputs-1]. Errors are kept by the
     * tape; report an error of your own by lg_tape_fail. */
    lg_var (*build)(const void *user, lg_tape *tape, const lg_var *x);
    /* The next two are only needed if an argument has algebra > 0; `argument` is its number, and d has
     * `algebra` numbers. perturb: moved = exp(h d) . x. tangent: dx is the derivative of exp(h d) . x by h at
     * h = 0. `moved` and `dx` have as many numbers as x. */
    lg_status (*perturb)(const void *user, uint32_t argument, const double *x, const double *d, double h,
                         double *moved);
    lg_status (*tangent)(const void *user, uint32_t argument, const double *x, const double *d, double *dx);
    const void *user;
    /* true: the function contains an lg_custom operation with numeric derivatives only. Then the check
     * demands that the second order fails with LG_NOT_DIFFERENTIABLE. */
    bool first_order_only;
    /* true: the function is lg_stop_gradient of its arguments. Then the check demands that the derivative is
     * exactly zero, although the value changes. */
    bool stops;
} lg_gradcheck_function;

typedef struct lg_gradcheck_options {
    size_t size;    /* sizeof(lg_gradcheck_options) */
    uint64_t seed;  /* of the random numbers; default 1 */
    int order;      /* highest order that is checked, 1 or 2; default 2 */
    int directions; /* number of random directions per order; default 2 */
    double slope;   /* smallest slope of the Taylor remainder that passes; default 1.9 */
    /* Largest difference between J d and the difference quotient, relative to the largest element; default
     * 1e-6. */
    double difference_tolerance;
    /* Largest difference of values that must be equal up to rounding; default 1e-10. Scalar products are
     * compared relative to the sum of the magnitudes of their terms, arrays relative to their largest
     * element. */
    double rounding_tolerance;
} lg_gradcheck_options;
LG_API void lg_gradcheck_options_init(lg_gradcheck_options *options);

/* The result of one order. */
typedef struct lg_gradcheck_order {
    bool checked, passed;
    double slope;      /* smallest slope of all directions; NaN if all remainders were rounding errors */
    double error;      /* largest relative error of all comparisons */
    double derivative; /* largest magnitude of an element of J d and J^T c */
} lg_gradcheck_order;

typedef struct lg_gradcheck_result {
    bool passed;
    lg_gradcheck_order order[LG_GRADCHECK_ORDERS]; /* of order 1 and order 2 */
    char message[320];                             /* what failed; "" if passed */
} lg_gradcheck_result;

/* Checks a function. `options` NULL means the defaults. `result` is always filled. Returns LG_OK if the check
 * passed. Errors: LG_CHECK_FAILED (a derivative is wrong, or a value is not finite), LG_INVALID_ARGUMENT
 * (options out of range; a function without name, build or arguments; an argument on a manifold without
 * `values`, perturb or tangent), LG_UNSUPPORTED (an operation is not in the library's table of operations),
 * the status of the tape or of a callback. */
LG_API lg_status lg_gradcheck(const lg_context *context, const lg_gradcheck_function *function,
                              const lg_gradcheck_options *options, lg_gradcheck_result *result);

LG_END_DECLS

#endif
