/* Gradient check: are the derivatives of a function built on a tape right?
 *
 * In double precision only. For each of a few random directions d and cotangents c, at each order:
 *   - slope: the Taylor remainder R(h) = <c, f(x(h)) - f(x)> - <J^T c, x(h) - x>, x(h) = x + h d, falls like
 * h^2: the slope of max(|R(h)|, |R(-h)|) over halvings of h, by regression over the smallest h above
 * rounding, is at least 1.9; or the remainder is at rounding level for all h, as of a linear function;
 *   - the forward mode J d equals the difference quotient of f (extrapolated, order h^4) in each element;
 *   - <c, J d> = <J^T c, d> to rounding;
 *   - lg_backward equals lg_vjp to rounding.
 * Second order is the same for G(x, c) = J(x)^T c, and
 *   <c, D^2 f[d, e]> = <d, H e> = <e, H d>, the first once as jvp of jvp, once as vjp of jvp.
 *
 * An argument on a manifold is moved along its algebra: x(h) = exp(h d).x by the callback `perturb`.
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
    double scale;         /* length of a unit of d; 0: 1. Steps are scale/16 and less. */
    uint32_t algebra;     /* numbers of a direction along the manifold; 0: a flat argument */
} lg_gradcheck_argument;

typedef struct lg_gradcheck_function {
    const char *name;
    uint32_t inputs; /* 1..LG_GRADCHECK_MAX_INPUTS */
    const lg_gradcheck_argument *arguments;
    /* Records y from the arguments' variables x[0..inputs-1]. Errors stick to the tape; lg_tape_fail reports
     * your own. */
    lg_var (*build)(const void *user, lg_tape *tape, const lg_var *x);
    /* Only for arguments with algebra > 0. perturb: moved = exp(h d).x; tangent: its derivative with respect
     * to h at h = 0, of x's shape. */
    lg_status (*perturb)(const void *user, uint32_t argument, const double *x, const double *d, double h,
                         double *moved);
    lg_status (*tangent)(const void *user, uint32_t argument, const double *x, const double *d, double *dx);
    const void *user;
    /* A numeric lg_custom operation inside: there is no second order, and asking for it must be
     * LG_NOT_DIFFERENTIABLE. */
    bool first_order_only;
    /* lg_stop_gradient inside, and nothing else: the derivative must be exactly zero although the value
     * moves. */
    bool stops;
} lg_gradcheck_function;

/* A deliberate fault, to see that a check catches it. VJP, JVP: what one operation's vjp or jvp returns is
 * changed wherever it is called. SCALARS: what one operation's scalar code (of plans, liegrad/program.h)
 * gives is changed. PLAN: a step of a plan that is made is changed. */
typedef enum lg_plant_direction {
    LG_PLANT_VJP,
    LG_PLANT_JVP,
    LG_PLANT_SCALARS,
    LG_PLANT_PLAN
} lg_plant_direction;
#define LG_PLANT_DIRECTIONS 4
typedef enum lg_plant_mutation {
    LG_PLANT_SIGN,      /* negated */
    LG_PLANT_DROP,      /* one input's contribution is left out; scalar code: the last element is 0 */
    LG_PLANT_FACTOR,    /* times 1 + 1/1024 */
    LG_PLANT_TRANSPOSE, /* numbers in the order of the transposed tensor (last two axes); scalar code: each in
                         * the place of the one before */
    /* Of plans: */
    LG_PLANT_MISSING,   /* a step is left out */
    LG_PLANT_OPERAND,   /* a step reads another place */
    LG_PLANT_OPERATION, /* a step computes something else */
    LG_PLANT_CONSTANT,  /* constants times 1 + 1/1024, and 1/1024 more */
    LG_PLANT_CLOBBER    /* a step writes over numbers that are still needed */
} lg_plant_mutation;
#define LG_PLANT_MUTATIONS      4 /* of derivatives and scalar code */
#define LG_PLANT_PLAN_MUTATIONS 5

typedef struct lg_gradcheck_plant {
    const char
        *operation; /* name as in messages: "mul", "matmul", ...; PLAN: "value", "forward", "adjoint" */
    lg_plant_direction direction;
    lg_plant_mutation mutation;
    uint32_t input; /* whose cotangent (vjp), which input's tangent is dropped (jvp), which step (plan) */
} lg_gradcheck_plant;

typedef struct lg_gradcheck_options {
    size_t size;    /* sizeof(lg_gradcheck_options) */
    uint64_t seed;  /* 1 */
    int order;      /* 2; the highest order that is checked, 1 or 2 */
    int directions; /* 2 */
    double slope;   /* 1.9 */
    double
        difference_tolerance; /* 1e-6: J d against the difference quotient, relative to the largest element */
    double rounding_tolerance; /* 1e-10: what must hold to rounding, relative to the sum of magnitudes */
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
    size_t plant_applied, plant_changed; /* calls that the plant met; those whose numbers it changed */
    char message[320];                   /* what failed; "" when passed */
} lg_gradcheck_result;

/* `options` NULL: defaults. `result` is always filled. LG_OK: passed; LG_CHECK_FAILED: a derivative is wrong,
 * or a value is not finite; LG_INVALID_ARGUMENT: options, or a function without name, build, arguments or
 * (where a manifold asks for them) perturb and tangent, or an unknown operation to plant in; else what
 * building or a callback reported, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_gradcheck(const lg_context *context, const lg_gradcheck_function *function,
                              const lg_gradcheck_options *options, lg_gradcheck_result *result);

/* ---- tables of checks: what lg-gradcheck runs ---- */

#define LG_GRADCHECK_CASE_OPERATIONS 3
typedef struct lg_gradcheck_case {
    lg_gradcheck_function function;
    /* The operations for which this row stands: their derivatives are mutated by --plant. NULL ends the list;
     * a composed function stands for none. */
    const char *operations[LG_GRADCHECK_CASE_OPERATIONS];
    /* The derivative is identically zero (a sign, the second derivative of a kink): nothing can be planted;
     * that it is zero is checked. */
    bool zero;
    /* A word of the sentence by which lg_program_build refuses the function; NULL: it can be a program. */
    const char *no_program;
} lg_gradcheck_case;

/* Checks a row: lg_gradcheck, and that the derivative is exactly zero where the row says so. */
LG_API lg_status lg_gradcheck_run(const lg_context *context, const lg_gradcheck_case *row,
                                  const lg_gradcheck_options *options, lg_gradcheck_result *result);

/* Is the row's function as a program (liegrad/program.h) the same function? It is recorded with the row's
 * arguments as shared inputs (where values are given: moved by 1/100 of the scale), and derived. At fresh
 * points:
 *   - lg_program_record has the bits of the function recorded on the tape: value, J d and J^T c,
 *   - plans of the function, of its forward and of its adjoint equal the tape to rounding_tolerance/100,
 *     relative to the largest element (of a derivative: at least 1/1000 of the value's).
 * A row that says so must be refused instead. */
typedef struct lg_gradcheck_program_result {
    bool passed, refused;
    double value, forward, adjoint;      /* largest relative errors of plans; NaN when refused */
    size_t plant_applied, plant_changed; /* operations (steps) that the plant met; those that it changed */
    char message[320];                   /* what failed, or why it is refused; "" when passed */
} lg_gradcheck_program_result;

/* As lg_gradcheck_run; of the plants those of scalar code and of plans strike. */
LG_API lg_status lg_gradcheck_program(const lg_context *context, const lg_gradcheck_case *row,
                                      const lg_gradcheck_options *options,
                                      lg_gradcheck_program_result *result);

/* Row number `index` = 0, 1, ... of all operations in every variant of shapes that matters; NULL beyond the
 * last. Static. */
LG_API const lg_gradcheck_case *lg_gradcheck_operation(size_t index);

typedef enum lg_plant_outcome { LG_PLANT_CAUGHT, LG_PLANT_MISSED, LG_PLANT_EXCLUDED } lg_plant_outcome;
/* `reason` says why a mutation is excluded, or what caught it. */
typedef void (*lg_plant_report_fn)(void *user, const lg_gradcheck_case *row, const lg_gradcheck_plant *plant,
                                   lg_plant_outcome outcome, const char *reason);

/* Plants every mutation in the vjp and jvp of every operation for which the row stands, in each of its
 * inputs, in its scalar code, and in the plans of the row's value, forward and adjoint (one step for each
 * mutation), and checks. Excluded, and reported as such, are mutations that cannot be seen:
 *   - of an operation or input that is constant to differentiation, or a leaf: its derivative is never asked
 * for;
 *   - of a numeric derivative's derivative: asking for it is an error;
 *   - in a row whose derivative is identically zero;
 *   - transpositions that change no number: fewer than two axes longer than one, all equal, or symmetric;
 *   - of scalar code of an operation that the row's plans do not have: too large, or folded away;
 *   - of plans that have no such step, or where the fault changes rounding alone.
 * Returns LG_OK whether caught or missed, else as lg_gradcheck. */
LG_API lg_status lg_gradcheck_plant_all(const lg_context *context, const lg_gradcheck_case *row,
                                        const lg_gradcheck_options *options, lg_plant_report_fn report,
                                        void *user);
LG_API const char *
lg_plant_direction_name(lg_plant_direction direction); /* "vjp", "jvp", "scalars", "plan" */
LG_API const char *lg_plant_mutation_name(
    lg_plant_mutation mutation); /* "sign", "drop", "factor", "transpose", "missing", ... */

LG_END_DECLS

#endif
