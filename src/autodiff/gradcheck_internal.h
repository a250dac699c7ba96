/* Gradient check inside: the planted error that a tape carries, and a look at what a function records. */
#ifndef LG_GRADCHECK_INTERNAL_H
#define LG_GRADCHECK_INTERNAL_H

#include "autodiff/tape_internal.h"
#include "liegrad/gradcheck.h"

struct lg_plant {
    lg_op_code op;
    lg_plant_direction direction;
    lg_plant_mutation mutation;
    uint32_t input;
    size_t applied, changed;
};
typedef struct lg_plant lg_plant;

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

/* The code of a name, -1 for none. */
int lg_op_by_name(const char *name);

/* Bit `op` of used[op / 32] is set for each operation on the tape after y and its recorded vjp; `inputs` is
 * the largest number of inputs of a node with code `op`, 0 when there is none. */
lg_status lg_gradcheck_inputs_of(const lg_context *context, const lg_gradcheck_function *function,
                                 const lg_gradcheck_options *options, lg_op_code op, uint32_t *inputs);

#endif
