/* The registry: every operation of the table in the variants of shapes and attributes that matter, a family
 * after the other. */
#include "autodiff/cases/rows.h"

typedef const lg_gradcheck_case *(*family_fn)(size_t *count);
static const family_fn families[] = {
    lg_gradcheck_elementwise, lg_gradcheck_products, lg_gradcheck_convolutions, lg_gradcheck_arrays,
    lg_gradcheck_geometry,    lg_gradcheck_losses,   lg_gradcheck_custom};

const lg_gradcheck_case *lg_gradcheck_operation(size_t index) {
    for (size_t f = 0; f < LG_COUNT(families); f++) {
        size_t count;
        const lg_gradcheck_case *rows = families[f](&count);
        if (index < count) return &rows[index];
        index -= count;
    }
    return NULL;
}
