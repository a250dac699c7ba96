/* Cases of the gradient check, planted faults, and checks of programs. They are part of no library;
 * lg-gradcheck and the tests link them. */
#ifndef LG_GRADCHECK_CASES_H
#define LG_GRADCHECK_CASES_H

#include "liegrad/gradcheck.h"

#include "autodiff/tape/tape_internal.h"

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
    /* NULL: the function can become a program. Otherwise lg_program_build must reject it, with a message that
     * contains this text. */
    const char *no_program;
    /* true: a program takes a fixed number of Newton steps where the function iterates, so values agree to
     * rounding, not to the last bit. */
    bool rounded;
} lg_gradcheck_case;

/* Case `index` = 0, 1, ... of a table with every operation, in every variant of shapes that matters. NULL
 * beyond the last case. The cases are static. */
const lg_gradcheck_case *lg_gradcheck_operation(size_t index);
/* The same for a longer table, in which the cases of the rooms follow: layers, integrators, systems, learned
 * models. */
const lg_gradcheck_case *lg_gradcheck_case_at(size_t index);

/* ---- planted faults ---- */

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

/* An opened fault: a copy of an operation's row with a wrong vjp, jvp or scalar code. */
typedef struct lg_plant {
    /* Replaces the right row by the wrong one; empty for faults in plans. */
    lg_exchange exchange;
    const char *operation;
    lg_plant_direction direction;
    lg_plant_mutation mutation;
    uint32_t input;
    /* How often the fault was applied (in programs: to operations or steps of plans), and how often it
     * changed a number. */
    size_t applied, changed;
    struct lg_planted_row {
        /* Must be the first member: the wrong functions get a pointer to this row and find the plant from
         * it. */
        lg_op row;
        struct lg_plant *plant;
    } wrong;
} lg_plant;
/* Prepares a fault. The plant must not move in memory while it is in use. LG_INVALID_ARGUMENT: there is no
 * such operation. */
lg_status lg_plant_open(lg_plant *plant, const lg_gradcheck_plant *chosen);
struct lg_plan;
/* Changes one step of the plan as plant->mutation says, sets plant->input to the step and adds 1 to
 * plant->applied. False: no step fits. Memory that LG_PLANT_CONSTANT needs is taken from the plan's heap. */
bool lg_plant_plan(lg_plant *plant, struct lg_plan *plan);
/* Sets *inputs to the largest number of inputs of any node with operation `op`, among the nodes of the
 * function and of its derivatives; 0 if there is no such node. */
lg_status lg_gradcheck_inputs_of(const lg_context *context, const lg_gradcheck_function *function,
                                 const lg_gradcheck_options *options, const lg_op *op, uint32_t *inputs);

/* ---- checks ---- */

/* Runs lg_gradcheck on the function of a case, with this fault (NULL: none). If `zero` is true, it also
 * checks that the first derivative is exactly zero. Other arguments, result and errors as in lg_gradcheck. */
lg_status lg_gradcheck_run(const lg_context *context, const lg_gradcheck_case *test,
                           const lg_gradcheck_options *options, lg_plant *plant, lg_gradcheck_result *result);

typedef struct lg_gradcheck_program_result {
    bool passed, refused; /* refused: lg_program_build did not accept the function */
    /* Largest relative errors of the plans of value, forward mode and adjoint; NaN if rejected. */
    double value, forward, adjoint;
    char message[320]; /* what failed, or why the function was rejected; "" if passed */
} lg_gradcheck_program_result;

/* Checks that the function of a case computes the same as a program (liegrad/program.h). The arguments become
 * shared inputs; where the case gives values, points are drawn at a distance of up to scale/100 from them.
 * The program is differentiated by lg_program_derive. At new random points it is tested that
 *   - lg_program_record gives value, J d and J^T c that equal those of the recorded function to the last
 *     bit
 *   - plans of the function, of its forward mode and of its adjoint agree with the tape to
 *     rounding_tolerance/100, relative to the largest element of the result (for a derivative: to 1/1000 of
 *     the largest element of the value, if that is larger)
 * If `no_program` is not NULL, it is only tested that the function is rejected. The fault (NULL: none) must
 * be one in scalar code or in plans. Arguments and errors as in lg_gradcheck. */
lg_status lg_gradcheck_program(const lg_context *context, const lg_gradcheck_case *test,
                               const lg_gradcheck_options *options, lg_plant *plant,
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
lg_status lg_gradcheck_plant_all(const lg_context *context, const lg_gradcheck_case *test,
                                 const lg_gradcheck_options *options, lg_plant_report_fn report, void *user);
/* Returns "vjp", "jvp", "scalars" or "plan". */
const char *lg_plant_direction_name(lg_plant_direction direction);
/* Returns "sign", "drop", "factor", "transpose", "missing", ... */
const char *lg_plant_mutation_name(lg_plant_mutation mutation);

#endif
