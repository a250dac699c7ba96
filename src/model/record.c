/* Tape operations that the programs of several learned models use. */
#include "model/record.h"

#include "kernels/kernels.h"

lg_var lg_record_copies(lg_tape *tape, lg_var x, uint32_t copies) {
    const lg_shape shape = lg_var_shape(tape, x);
    if (shape.rank == 0 || copies == 1) return x;
    const uint32_t rows = shape.dims[0], length = (uint32_t)(lg_shape_count(shape) / rows);
    lg_shape all = shape;
    all.dims[0] = rows * copies;
    const lg_var one = lg_reshape(tape, x, lg_shape3(rows, 1, length));
    return lg_reshape(tape, lg_broadcast_to(tape, one, lg_shape3(rows, copies, length)), all);
}

lg_var lg_record_units(lg_tape *tape, uint32_t rows, const uint32_t *at, uint32_t count, uint32_t n) {
    void *values = NULL;
    const lg_kernels *k = lg_kernels_for(lg_tape_dtype(tape));
    const lg_var units = lg_input_buffer(tape, lg_shape3(1, count, n), &values);
    if (lg_is_none(units)) return units;
    k->fill((size_t)count * n, 0.0, values);
    for (uint32_t i = 0; i < count; i++)
        k->fill(1, 1.0, (unsigned char *)values + ((size_t)i * n + (at != NULL ? at[i] : i)) * k->size);
    const lg_var all = lg_broadcast_to(tape, units, lg_shape3(rows, count, n));
    return lg_reshape(tape, all, lg_shape2(rows * count, n));
}
