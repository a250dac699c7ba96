/* Tape operations that the programs of several learned models use. */
#include "model/record.h"

#include <string.h>

#include "kernels/kernels.h"

lg_status lg_record_gradient(lg_recording *value, void *user, lg_tape *tape, const lg_var *theta,
                             const lg_var *x, bool forward, lg_var *y) {
    LG_TRY(value(user, tape, theta, x, y));
    const lg_shape shape = lg_var_shape(tape, *x);
    const uint32_t rows = shape.dims[0], out = lg_var_shape(tape, *y).dims[1],
                   in = (uint32_t)(lg_shape_count(shape) / rows), count = forward ? in : out;
    const lg_var copies = lg_record_copies(tape, *x, count);
    lg_var all = LG_NONE, by = LG_NONE;
    LG_TRY(value(user, tape, theta, &copies, &all));
    const lg_var units = lg_record_units(tape, rows, count, 0, count);
    LG_TRY(forward ? lg_jvp(tape, &all, 1, &copies, &units, 1, &by)
                   : lg_vjp(tape, &all, &units, 1, &copies, 1, &by));
    by = lg_reshape(tape, by, lg_shape3(rows, count, forward ? out : in));
    y[1] = forward ? lg_transpose(tape, by) : by;
    return lg_tape_status(tape);
}

lg_var lg_record_softmax(lg_tape *tape, lg_var y) {
    const lg_var part = lg_exp(tape, lg_sub(tape, y, lg_max_axis(tape, y, 1, true)));
    return lg_div(tape, part, lg_sum_axis(tape, part, 1, true));
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
