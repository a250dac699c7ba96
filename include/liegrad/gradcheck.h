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

/* A planted fault: a deliberate error in a derivative or in a plan, which shows that the check catches such
 * errors. The direction says where the fault is. */
typedef enum lg_plant_direction {
    LG_PLANT_VJP,     /* in the result of the vjp of one operation, at each of its calls */
    LG_PLANT_JVP,     /* in the result of the jvp of one operation, at each of its calls */
    LG_PLANT_SCALARS, /* in the result of the scalar code of one operation in plans (liegrad/program.h) */
    LG_PLANT_PLAN     /* in one step of a plan */
} lg_plant_direction;
#define LG_PLANT_DIRECTIONS 4
/* What the fault does. */
typedef enum lg_plant_mutation {
    /* Faults in a vjp, a jvp or scalar code: */
    LG_PLANT_SIGN,   /* the result is negated */
    LG_PLANT_DROP,   /* the contribution of one input is left out; scalar code: the last element becomes 0 */
    LG_PLANT_FACTOR, /* the result is multiplied by 1 + 1/1024 */
    /* The last two axes of the result are swapped in memory, while its shape stays. Scalar code: each number
     * moves to the place of the number before it. */
    LG_PLANT_TRANSPOSE,
    /* Faults in a step of a plan: */
    LG_PLANT_MISSING,   /* the step is left out */
    LG_PLANT_OPERAND,   /* the step reads an operand from a wrong place */
    LG_PLANT_OPERATION, /* the step computes another operation */
    LG_PLANT_CONSTANT,  /* each constant c becomes c (1 + 1/1024) + 1/1024 */
    LG_PLANT_CLOBBER    /* the step overwrites numbers that later steps still need */
} lg_plant_mutation;
#define LG_PLANT_MUTATIONS      4 /* number of faults in derivatives and scalar code */
#define LG_PLANT_PLAN_MUTATIONS 5 /* number of faults in plans */

typedef struct lg_gradcheck_plant {
    /* Name of the operation as in messages: "mul", "matmul", ... For LG_PLANT_PLAN: "value", "forward" or
     * "adjoint", the plan that gets the fault. */
    const char *operation;
    lg_plant_direction direction;
    lg_plant_mutation mutation;
    /* LG_PLANT_VJP: number of the input whose cotangent is changed. LG_PLANT_JVP with LG_PLANT_DROP: number
     * of the input whose tangent is left out. LG_PLANT_PLAN: number of the step. */
    uint32_t input;
} lg_gradcheck_plant;

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
    const lg_gradcheck_plant *plant; /* a fault to plant; default NULL: none */
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
    /* How often the fault was applied, and how often it changed a number. */
    size_t plant_applied, plant_changed;
    char message[320]; /* what failed; "" if passed */
} lg_gradcheck_result;

/* Checks a function. `options` NULL means the defaults. `result` is always filled. Returns LG_OK if the check
 * passed. Errors: LG_CHECK_FAILED (a derivative is wrong, or a value is not finite), LG_INVALID_ARGUMENT
 * (NULL; options out of range; a function without name, build or arguments; an argument on a manifold without
 * `values`, perturb or tangent; the plant names an unknown operation), LG_UNSUPPORTED (an operation is not in
 * the library's table of operations), LG_OUT_OF_MEMORY, the status of the tape or of a callback. */
LG_API lg_status lg_gradcheck(const lg_context *context, const lg_gradcheck_function *function,
                              const lg_gradcheck_options *options, lg_gradcheck_result *result);

/* ---- cases: what lg-gradcheck runs ---- */

#define LG_GRADCHECK_CASE_OPERATIONS 3
/* A function to check, with what is known about it. */
typedef struct lg_gradcheck_case {
    lg_gradcheck_function function;
    /* Names of the operations that this case tests; lg-gradcheck --plant plants faults in them. A list with
     * fewer names ends with NULL; it is empty for a function that is composed of several operations. */
    const char *operations[LG_GRADCHECK_CASE_OPERATIONS];
    /* true: the derivative is identically zero (a sign, or the derivative of a piecewise linear function).
     * Then the check demands that it is exactly zero; no fault can be planted. */
    bool zero;
    /* NULL: the function can become a program. Otherwise lg_program_build must refuse it, with a message that
     * contains this text. */
    const char *no_program;
} lg_gradcheck_case;

/* Runs lg_gradcheck on the function of a case. If `zero` is true, it also checks that the first derivative is
 * exactly zero. Arguments, result and errors as in lg_gradcheck. */
LG_API lg_status lg_gradcheck_run(const lg_context *context, const lg_gradcheck_case *test,
                                  const lg_gradcheck_options *options, lg_gradcheck_result *result);

typedef struct lg_gradcheck_program_result {
    bool passed, refused; /* refused: lg_program_build refused the function */
    /* Largest relative errors of the plans of value, forward mode and adjoint; NaN if refused. */
    double value, forward, adjoint;
    /* How many operations or steps of plans got the fault, and in how many it changed a number. */
    size_t plant_applied, plant_changed;
    char message[320]; /* what failed, or why the function was refused; "" if passed */
} lg_gradcheck_program_result;

/* Checks that the function of a case computes the same as a program (liegrad/program.h). The arguments become
 * shared inputs; where the case gives values, points are drawn at a distance of up to scale/100 from them.
 * The program is differentiated by lg_program_derive. At new random points it is tested that
 *   - lg_program_record gives value, J d and J^T c that equal those of the recorded function to the last bit
 *   - plans of the function, of its forward mode and of its adjoint agree with the tape to
 *     rounding_tolerance/100, relative to the largest element of the result (for a derivative: to 1/1000 of
 *     the largest element of the value, if that is larger)
 * If `no_program` is not NULL, it is only tested that the function is refused. Of the planted faults only
 * those in scalar code and in plans have an effect. Arguments and errors as in lg_gradcheck. */
LG_API lg_status lg_gradcheck_program(const lg_context *context, const lg_gradcheck_case *test,
                                      const lg_gradcheck_options *options,
                                      lg_gradcheck_program_result *result);

/* A fault was caught by the check, was missed by it, or was excluded because it cannot change a result. */
typedef enum lg_plant_outcome { LG_PLANT_CAUGHT, LG_PLANT_MISSED, LG_PLANT_EXCLUDED } lg_plant_outcome;
/* Receives the outcome of one planted fault. `reason` says why it was excluded, or which test caught it. */
typedef void (*lg_plant_report_fn)(void *user, const lg_gradcheck_case *test, const lg_gradcheck_plant *plant,
                                   lg_plant_outcome outcome, const char *reason);

/* Plants one fault after the other, runs the check each time, and reports each outcome. Faults are planted in
 * the vjp and the jvp of every operation of the case, for each of its inputs; in its scalar code; and in one
 * step of the plans of value, forward mode and adjoint. These faults are excluded:
 *   - in an operation, or for an input, that differentiation treats as constant, and in a leaf: its
 *     derivative is never used
 *   - in the derivative of a numeric derivative, which is an error anyway
 *   - in a case whose derivative is identically zero
 *   - a transposition that changes no number: fewer than two axes longer than 1, equal numbers, a symmetric
 *     matrix
 *   - in scalar code of an operation that does not occur in the plans, because it is too large or was
 *     computed in advance
 *   - in plans that have no step for this fault, or where it would only change rounding errors
 * Returns LG_OK whether faults are caught or missed. Errors: as in lg_gradcheck. */
LG_API lg_status lg_gradcheck_plant_all(const lg_context *context, const lg_gradcheck_case *test,
                                        const lg_gradcheck_options *options, lg_plant_report_fn report,
                                        void *user);
/* Returns "vjp", "jvp", "scalars" or "plan". */
LG_API const char *lg_plant_direction_name(lg_plant_direction direction);
/* Returns "sign", "drop", "factor", "transpose", "missing", ... */
LG_API const char *lg_plant_mutation_name(lg_plant_mutation mutation);

LG_END_DECLS

#endif
