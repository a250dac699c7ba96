/* Cases of the gradient check. They are in no library: lg-gradcheck and the tests link them. */
#ifndef LG_GRADCHECK_CASES_H
#define LG_GRADCHECK_CASES_H

#include "liegrad/gradcheck.h"

/* Case `index` = 0, 1, ... of a table that has every operation with every variant of shapes that matters;
 * NULL beyond the last. Static. */
const lg_gradcheck_case *lg_gradcheck_operation(size_t index);
/* The same, and then the cases of the rooms: layers, integrators, systems, learned models. */
const lg_gradcheck_case *lg_gradcheck_case_at(size_t index);

#endif
