/* Cases of the gradient check. They are part of no library; lg-gradcheck and the tests link them. */
#ifndef LG_GRADCHECK_CASES_H
#define LG_GRADCHECK_CASES_H

#include "liegrad/gradcheck.h"

/* Case `index` = 0, 1, ... of a table with every operation, in every variant of shapes that matters. NULL
 * beyond the last case. The cases are static. */
const lg_gradcheck_case *lg_gradcheck_operation(size_t index);
/* The same for a longer table, in which the cases of the rooms follow: layers, integrators, systems, learned
 * models. */
const lg_gradcheck_case *lg_gradcheck_case_at(size_t index);

#endif
