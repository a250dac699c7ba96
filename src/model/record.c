/* Tape operations that the programs of several learned models use. */
#include "model/record.h"

#include <string.h>

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

lg_var lg_record_rows(lg_tape *tape, lg_dtype from, const void *values, lg_shape shape,
                      const uint32_t *samples) {
    const lg_kernels *k = lg_kernels_for(lg_tape_dtype(tape)), *own = lg_kernels_for(from);
    void *to;
    const lg_var x = lg_input_buffer(tape, shape, &to);
    if (lg_is_none(x)) return x;
    const size_t count = shape.dims[0], width = lg_shape_count(shape) / count;
    for (size_t i = 0; i < count; i++) {
        const void *row = (const char *)values + samples[i] * width * own->size;
        void *at = (char *)to + i * width * k->size;
        if (k == own)
            memcpy(at, row, width * k->size);
        else if (from == LG_F64)
            k->convert_in(width, row, at);
        else
            own->convert_out(width, row, at);
    }
    return x;
}

lg_var lg_record_labels(lg_tape *tape, const uint32_t *label, uint32_t outputs, const uint32_t *samples,
                        uint32_t count) {
    const lg_kernels *k = lg_kernels_for(lg_tape_dtype(tape));
    void *to;
    const lg_var target = lg_input_buffer(tape, lg_shape2(count, outputs), &to);
    if (lg_is_none(target)) return target;
    k->fill((size_t)count * outputs, 0.0, to);
    for (size_t i = 0; i < count; i++) {
        const size_t class = label[samples[i]], at = outputs == 1 ? i : i * outputs + class;
        if (outputs == 1 || class < outputs)
            k->fill(1, outputs == 1 ? (double)class : 1.0, (char *)to + at * k->size);
    }
    return target;
}
