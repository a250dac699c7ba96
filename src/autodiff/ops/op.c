#include "autodiff/ops/op.h"

#include <stdarg.h>
#include <stdio.h>

#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"

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

/* ---- batches: values in double precision, and C ---- */

size_t lg_batch_doubles(const lg_evaluation *e) {
    size_t count = e->k->dtype == LG_F64 ? 0 : e->count;
    for (uint32_t k = 0; k < e->inputs && count > 0; k++) count += lg_shape_count(*e->in[k]);
    return count;
}

/* Numbers of an input from a row of the batch to the next one; 0 if one serves all. */
static size_t step_of(const lg_shape *in) {
    return in->rank < 3 || in->dims[0] == 1 ? 0 : lg_shape_count(*in) / in->dims[0];
}

lg_status lg_batch_forward(lg_evaluation *e, lg_batch_row *row) {
    const bool same = e->k->dtype == LG_F64;
    double *memory = e->scratch, *y = same ? e->y : memory;
    const double *x[4];
    if (!same) memory += e->count;
    for (uint32_t k = 0; k < e->inputs; k++) {
        const size_t count = lg_shape_count(*e->in[k]);
        x[k] = same ? e->x[k] : memory;
        if (same) continue;
        e->k->convert_out(count, e->x[k], memory);
        memory += count;
    }
    for (size_t b = 0, rows = e->shape->dims[0]; b < rows; b++) {
        row(e, x, y + b * (e->count / rows), memory);
        for (uint32_t k = 0; k < e->inputs; k++) x[k] += step_of(e->in[k]);
    }
    if (!same) e->k->convert_in(e->count, e->scratch, e->y);
    return LG_OK;
}

void lg_batch_c(lg_c *c, const lg_evaluation *e, size_t work, const char *call, ...) {
    char begin[96] = "", inputs[96] = "";
    const uint32_t rows = e->shape->dims[0];
    va_list sizes;
    va_start(sizes, call);
    (void)lg_format_list(begin, sizeof begin, call, sizes);
    va_end(sizes);
    for (uint32_t k = 0, used = 0; k < e->inputs; k++)
        used +=
            (uint32_t)snprintf(inputs + used, sizeof inputs - used, ", $%u + i * %zu", k, step_of(e->in[k]));
    lg_c_scratch(c, work);
    lg_c_call(c, "for (int i = 0; i < %u; i++) %s%s, $y + i * %zu, $s)", rows, begin, inputs,
              e->count / rows);
}
