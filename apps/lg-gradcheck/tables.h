/* Cases of the gradient check for what is made of operations. */
#ifndef LG_GRADCHECK_TABLES_H
#define LG_GRADCHECK_TABLES_H

#include "autodiff/cases/shapes.h"

const lg_gradcheck_case *layer_rows(size_t *count);
const lg_gradcheck_case *integrator_rows(size_t *count);
const lg_gradcheck_case *system_rows(size_t *count);
const lg_gradcheck_case *hamiltonian_rows(size_t *count);
const lg_gradcheck_case *surrogate_rows(size_t *count);
const lg_gradcheck_case *machine_rows(size_t *count);

#endif
