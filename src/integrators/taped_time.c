/* Times and step sizes on a tape: plain numbers, or variables with one number per row of the batch. */
#include "integrators/taped_internal.h"
#include "liegrad/ops.h"

lg_var lg_taped_time_rows(lg_tape *tape, lg_taped_time t, uint32_t batch) {
    lg_var terms[2];
    double c[2];
    size_t n = 0;
    if (!lg_taped_time_varies(t)) return lg_full(tape, lg_shape2(batch, 1), t.value);
    if (!lg_is_none(t.rows)) terms[n] = t.rows, c[n++] = 1.0;
    if (!lg_is_none(t.step)) terms[n] = t.step, c[n++] = t.weight;
    lg_var sum = n == 1 && c[0] == 1.0 ? terms[0] : lg_linear_combination(tape, terms, c, n);
    const lg_shape shape = lg_var_shape(tape, sum);
    if (!lg_is_none(sum) && (shape.rank != 2 || shape.dims[0] != batch || shape.dims[1] != 1))
        return lg_tape_fail(tape, LG_SHAPE, "time",
                            "the time must have shape (B, 1), where B is the wanted number of rows");
    return t.value != 0.0 ? lg_add_scalar(tape, sum, t.value) : sum;
}

lg_taped_time lg_taped_stage_time(const lg_taped_span *over, double c) {
    lg_taped_time t = over->t;
    if (lg_is_none(over->rows)) {
        t.value += c * over->h;
    } else if (c != 0.0) {
        t.weight += c * over->h;
        t.step = over->rows;
    }
    return t;
}

lg_var lg_taped_by_rows(lg_tape *tape, const lg_taped_span *over, lg_var x) {
    if (lg_is_none(over->rows)) return x;
    return lg_mul(tape, x, lg_var_shape(tape, x).rank == 3 ? over->tall : over->rows);
}
