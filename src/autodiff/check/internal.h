/* Internals of the gradient check: planted errors, and a search for operations that a function records. */
#ifndef LG_GRADCHECK_INTERNAL_H
#define LG_GRADCHECK_INTERNAL_H

#include "autodiff/tape/tape_internal.h"
#include "liegrad/gradcheck.h"

/* A planted error: a copy of an operation's row with a wrong vjp, jvp or scalar code. */
typedef struct lg_plant {
    /* Replaces the right row by the wrong one; empty for errors planted in plans. */
    lg_exchange exchange;
    lg_plant_direction direction;
    lg_plant_mutation mutation;
    uint32_t input;
    size_t applied, changed;
    struct lg_planted_row {
        /* Must be the first member: the wrong functions get a pointer to this row and find the plant from
         * it. */
        lg_op row;
        struct lg_plant *plant;
    } wrong;
} lg_plant;
/* Prepares a planted error. The plant must not move in memory while its exchange is in use.
 * LG_INVALID_ARGUMENT: there is no such operation. */
lg_status lg_plant_open(lg_plant *plant, const lg_gradcheck_plant *chosen);

/* Whether the function and the options are valid for the gradient check. */
bool lg_gradcheck_valid(const lg_gradcheck_function *function, const lg_gradcheck_options *options);

/* max |a_i - b_i|, where b = NULL stands for zeros. NaN if one of the numbers is NaN; 0 if n = 0. */
double lg_largest_difference(const double *a, const double *b, size_t n);
static inline double lg_largest(const double *a, size_t n) {
    return lg_largest_difference(a, NULL, n);
}

struct lg_plan;
/* Changes one step of the plan as plant->mutation says, sets plant->input to the step and adds 1 to
 * plant->applied. False: no step fits. Memory that LG_PLANT_CONSTANT needs is taken from the plan's heap. */
bool lg_plant_plan(lg_plant *plant, struct lg_plan *plan);

/* Sets *inputs to the largest number of inputs of any node with operation `op`, among the nodes of the
 * function and of its derivatives; 0 if there is no such node. */
lg_status lg_gradcheck_inputs_of(const lg_context *context, const lg_gradcheck_function *function,
                                 const lg_gradcheck_options *options, const lg_op *op, uint32_t *inputs);

#endif
