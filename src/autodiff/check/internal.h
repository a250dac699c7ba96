/* Gradient check inside: the planted error that a tape carries, and a look at what a function records. */
#ifndef LG_GRADCHECK_INTERNAL_H
#define LG_GRADCHECK_INTERNAL_H

#include "autodiff/tape/tape_internal.h"
#include "liegrad/gradcheck.h"

/* A planted error: a copy of an operation's row whose vjp, jvp or scalar code is wrong. */
typedef struct lg_plant {
    lg_exchange exchange; /* the row for that with the error; none for errors in plans */
    lg_plant_direction direction;
    lg_plant_mutation mutation;
    uint32_t input;
    size_t applied, changed;
    struct lg_planted_row {
        lg_op row; /* first: vjp, jvp and scalar code find the rest by the row in use */
        struct lg_plant *plant;
    } wrong;
} lg_plant;
/* The plant must not move while its exchange is in use. LG_INVALID_ARGUMENT: there is no such operation. */
lg_status lg_plant_open(lg_plant *plant, const lg_gradcheck_plant *chosen);

/* Whether function and options can be checked. */
bool lg_gradcheck_valid(const lg_gradcheck_function *function, const lg_gradcheck_options *options);

/* max |a_i - b_i| (b NULL: of zeros), NaN when one is; 0 for none. */
double lg_largest_difference(const double *a, const double *b, size_t n);
static inline double lg_largest(const double *a, size_t n) {
    return lg_largest_difference(a, NULL, n);
}

struct lg_plan;
/* Changes one step of the plan by plant->mutation; counts in plant->applied the places that fit. False: none
 * does. `constants`: memory for LG_PLANT_CONSTANT is taken from the plan. */
bool lg_plant_plan(lg_plant *plant, struct lg_plan *plan);

/* The largest number of inputs of an `op` on the tape of the function and its derivatives, 0 when there is
 * none. */
lg_status lg_gradcheck_inputs_of(const lg_context *context, const lg_gradcheck_function *function,
                                 const lg_gradcheck_options *options, const lg_op *op, uint32_t *inputs);

#endif
