/* Gradient check: are the derivatives of a function built on a tape right?
 *
 * In double precision only. For each of a few random directions d and cotangents c, at each order:
 *   - The Taylor remainder R(h) = <c, f(x(h)) - f(x)> - <J^T c, x(h) - x>, x(h) = x + h d, falls like h^2.
 *     The slope of max(|R(h)|, |R(-h)|) over halvings of h, by regression over the smallest h above rounding,
 *     is at least 1.9. Or the remainder is at rounding level for all h, as for a linear function.
 *   - The forward mode J d equals the difference quotient of f (extrapolated, order h^4) in each element.
 *   - <c, J d> = <J^T c, d> to rounding.
 *   - lg_backward equals lg_vjp to rounding.
 * Second order checks the same for G(x, c) = J(x)^T c. In addition <c, D^2 f[d, e]> = <d, H e> = <e, H d>;
 * the left side is computed as jvp of jvp and as vjp of jvp.
 *
 * An argument on a manifold moves along its algebra: the callback `perturb` gives x(h) = exp(h d).x.
 */
#ifndef LIEGRAD_GRADCHECK_H
#define LIEGRAD_GRADCHECK_H

#include "liegrad/tape.h"

LG_BEGIN_DECLS

#define LG_GRADCHECK_MAX_INPUTS 12
#define LG_GRADCHECK_ORDERS     2

typedef struct lg_gradcheck_argument {
    lg_shape shape;
    const double *values; /* the point, count(shape) numbers; NULL: drawn uniformly from [low, high) */
    double low, high;     /* both 0: [-1, 1) */
    double scale;         /* length of a unit of d; 0 means 1. Steps are at most scale/16 */
    uint32_t algebra;     /* numbers of a direction along the manifold; 0: a flat argument */
} lg_gradcheck_argument;

typedef struct lg_gradcheck_function {
    const char *name;
    uint32_t inputs; /* 1..LG_GRADCHECK_MAX_INPUTS */
    const lg_gradcheck_argument *arguments;
    /* Records y from the arguments' variables x[0..inputs-1]. Errors stick to the tape; report your own with
     * lg_tape_fail. */
    lg_var (*build)(const void *user, lg_tape *tape, const lg_var *x);
    /* Only for arguments with algebra > 0. perturb: moved = exp(h d).x; tangent: its derivative with respect
     * to h at h = 0, of x's shape. */
    lg_status (*perturb)(const void *user, uint32_t argument, const double *x, const double *d, double h,
                         double *moved);
    lg_status (*tangent)(const void *user, uint32_t argument, const double *x, const double *d, double *dx);
    const void *user;
    /* The function contains a numeric lg_custom operation: the second order must be refused with
     * LG_NOT_DIFFERENTIABLE. */
    bool first_order_only;
    /* The function is lg_stop_gradient of its arguments: the derivative must be exactly zero although the
     * value changes. */
    bool stops;
} lg_gradcheck_function;

/* A planted fault shows that a check catches it. The direction says what is changed. */
typedef enum lg_plant_direction {
    LG_PLANT_VJP,     /* the result of one operation's vjp, wherever it is called */
    LG_PLANT_JVP,     /* the result of one operation's jvp */
    LG_PLANT_SCALARS, /* the result of one operation's scalar code in plans (liegrad/program.h) */
    LG_PLANT_PLAN     /* one step of a plan */
} lg_plant_direction;
#define LG_PLANT_DIRECTIONS 4
typedef enum lg_plant_mutation {
    LG_PLANT_SIGN,      /* negated */
    LG_PLANT_DROP,      /* one input's contribution is left out; scalar code: the last element is 0 */
    LG_PLANT_FACTOR,    /* multiplied by 1 + 1/1024 */
    LG_PLANT_TRANSPOSE, /* the last two axes are swapped in memory; scalar code: each number takes the place
                         * of the one before */
    /* Of plans: */
    LG_PLANT_MISSING,   /* a step is left out */
    LG_PLANT_OPERAND,   /* a step reads another place */
    LG_PLANT_OPERATION, /* a step computes something else */
    LG_PLANT_CONSTANT,  /* constants c become c (1 + 1/1024) + 1/1024 */
    LG_PLANT_CLOBBER    /* a step writes over numbers that are still needed */
} lg_plant_mutation;
#define LG_PLANT_MUTATIONS      4 /* of derivatives and scalar code */
#define LG_PLANT_PLAN_MUTATIONS 5

typedef struct lg_gradcheck_plant {
    /* Name as in messages: "mul", "matmul", ...; of plans "value", "forward", "adjoint". */
    const char *operation;
    lg_plant_direction direction;
    lg_plant_mutation mutation;
    uint32_t input; /* the input whose cotangent (vjp) or tangent (jvp) it is; the step of a plan */
} lg_gradcheck_plant;

typedef struct lg_gradcheck_options {
    size_t size;    /* sizeof(lg_gradcheck_options) */
    uint64_t seed;  /* 1 */
    int order;      /* 2; the highest order that is checked, 1 or 2 */
    int directions; /* 2 */
    double slope;   /* 1.9 */
    /* 1e-6: J d against the difference quotient, relative to the largest element. */
    double difference_tolerance;
    double rounding_tolerance; /* 1e-10: for equalities up to rounding, relative to the sum of magnitudes */
    const lg_gradcheck_plant *plant; /* NULL */
} lg_gradcheck_options;
LG_API void lg_gradcheck_options_init(lg_gradcheck_options *options);

typedef struct lg_gradcheck_order {
    bool checked, passed;
    double slope;      /* the smallest over the directions; NaN when all remainders were at rounding level */
    double error;      /* largest relative error of all comparisons */
    double derivative; /* largest magnitude in J d and J^T c */
} lg_gradcheck_order;

typedef struct lg_gradcheck_result {
    bool passed;
    lg_gradcheck_order order[LG_GRADCHECK_ORDERS];
    size_t plant_applied, plant_changed; /* calls that met the plant; those whose result it changed */
    char message[320];                   /* what failed; "" when passed */
} lg_gradcheck_result;

/* `options` NULL: defaults. `result` is always filled. Returns:
 * - LG_OK: passed
 * - LG_CHECK_FAILED: a derivative is wrong, or a value is not finite
 * - LG_INVALID_ARGUMENT: wrong options; a function without name, build or arguments, or without perturb and
 *   tangent although an argument lies on a manifold; an unknown operation to plant in
 * - LG_OUT_OF_MEMORY, and what building or a callback reported */
LG_API lg_status lg_gradcheck(const lg_context *context, const lg_gradcheck_function *function,
                              const lg_gradcheck_options *options, lg_gradcheck_result *result);

/* ---- tables of checks: what lg-gradcheck runs ---- */

#define LG_GRADCHECK_CASE_OPERATIONS 3
typedef struct lg_gradcheck_case {
    lg_gradcheck_function function;
    /* The operations that this case tests: --plant changes their derivatives. NULL ends the list; a composed
     * function tests none. */
    const char *operations[LG_GRADCHECK_CASE_OPERATIONS];
    /* The derivative is identically zero (a sign, the second derivative of a kink). The check is that it is
     * zero; nothing can be planted. */
    bool zero;
    /* NULL: the function can be a program. Else a word of the sentence with which lg_program_build refuses
     * it. */
    const char *no_program;
} lg_gradcheck_case;

/* Runs lg_gradcheck on the function of a case. Checks that a derivative is exactly zero if `zero` says so. */
LG_API lg_status lg_gradcheck_run(const lg_context *context, const lg_gradcheck_case *test,
                                  const lg_gradcheck_options *options, lg_gradcheck_result *result);

/* Checks that the function of a case stays the same function as a program (liegrad/program.h). The arguments
 * become shared inputs; given values are moved by 1/100 of the scale. The program is derived. At fresh
 * points:
 *   - lg_program_record gives value, J d and J^T c with the bits of the function recorded on the tape
 *   - plans of the function, its forward and its adjoint equal the tape to rounding_tolerance/100, relative
 *     to the largest element (for a derivative at least 1/1000 of the largest element of the value)
 * A case with `no_program` must be refused instead. */
typedef struct lg_gradcheck_program_result {
    bool passed, refused;
    double value, forward, adjoint;      /* largest relative errors of plans; NaN when refused */
    size_t plant_applied, plant_changed; /* operations (steps) that met the plant; those that it changed */
    char message[320];                   /* what failed, or why it is refused; "" when passed */
} lg_gradcheck_program_result;

/* Returns what lg_gradcheck_run does. Plants in scalar code and in plans have an effect, others none. */
LG_API lg_status lg_gradcheck_program(const lg_context *context, const lg_gradcheck_case *test,
                                      const lg_gradcheck_options *options,
                                      lg_gradcheck_program_result *result);

typedef enum lg_plant_outcome { LG_PLANT_CAUGHT, LG_PLANT_MISSED, LG_PLANT_EXCLUDED } lg_plant_outcome;
/* `reason` says why a mutation is excluded, or what caught it. */
typedef void (*lg_plant_report_fn)(void *user, const lg_gradcheck_case *test, const lg_gradcheck_plant *plant,
                                   lg_plant_outcome outcome, const char *reason);

/* Plants every mutation and runs the check each time: in the vjp and jvp of every operation of the case, for
 * each of its inputs; in its scalar code; and in one step of the plans of value, forward and adjoint.
 * Mutations that cannot be seen are excluded, and reported as excluded:
 *   - of an operation or input that is constant to differentiation, or of a leaf: its derivative is not used
 *   - of the derivative of a numeric derivative, which is an error
 *   - in a case whose derivative is identically zero
 *   - transpositions that change no number: fewer than two axes longer than one, equal numbers, symmetry
 *   - in scalar code of an operation that is not in the plans, because it is too large or folded away
 *   - in plans that have no such step, or where the fault changes rounding only
 * Returns LG_OK whether faults are caught or missed, else what lg_gradcheck returns. */
LG_API lg_status lg_gradcheck_plant_all(const lg_context *context, const lg_gradcheck_case *test,
                                        const lg_gradcheck_options *options, lg_plant_report_fn report,
                                        void *user);
/* "vjp", "jvp", "scalars", "plan" */
LG_API const char *lg_plant_direction_name(lg_plant_direction direction);
/* "sign", "drop", "factor", "transpose", "missing", ... */
LG_API const char *lg_plant_mutation_name(lg_plant_mutation mutation);

LG_END_DECLS

#endif
