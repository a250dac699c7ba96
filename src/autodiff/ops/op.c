#include "autodiff/ops/op.h"

lg_row_use lg_rows_each(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                        lg_attr *attr) {
    return shape->rank > 1 ? LG_ROWS_EACH : LG_ROWS_MEET;
}

lg_row_use lg_rows_first(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape, uint32_t copies,
                         lg_attr *attr) {
    return LG_ROWS_FIRST;
}

lg_row_use lg_rows_but_axis(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape,
                            uint32_t copies, lg_attr *attr) {
    return attr->i[0] != 0 ? LG_ROWS_EACH : LG_ROWS_MEET;
}

size_t lg_no_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return 0;
}
