/* Tape operations that the programs of several learned models use. */
#ifndef LG_MODELS_RECORD_H
#define LG_MODELS_RECORD_H

#include "autodiff/tape/sweep.h"
#include "integrators/taped_internal.h"

/* Columns first .. first + count - 1 of x (B, n). */
static inline lg_var lg_columns(lg_tape *tape, lg_var x, uint32_t first, uint32_t count) {
    return lg_slice(tape, x, 1, first, count);
}

/* As lg_function_spec.record. */
typedef lg_status lg_recording(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out);
/* Records y[0] = value(x) (B, outputs) and y[1], its Jacobian (B, outputs, numbers of a row of x), of which a
 * batch computes all rows at once: `value` at a copy of x for each output, and one sweep in reverse; with
 * `forward` at a copy for each number of x. */
LG_API lg_status lg_record_gradient(lg_recording *value, void *user, lg_tape *tape, const lg_var *theta,
                                    const lg_var *x, bool forward, lg_var *y);
LG_API lg_var lg_record_softmax(lg_tape *tape, lg_var y); /* of each row */
/* The rows `samples` (shape.dims[0]) of `values`, numbers of the type `from`, as a variable of this shape and
 * of the tape's type. */
lg_var lg_record_rows(lg_tape *tape, lg_dtype from, const void *values, lg_shape shape,
                      const uint32_t *samples);
/* The labels of the rows `samples` (count) as targets (count, outputs): one output is the label, several are
 * 1 for the label's class and 0 for others, also for a label that is no class. */
lg_var lg_record_labels(lg_tape *tape, const uint32_t *label, uint32_t outputs, const uint32_t *samples,
                        uint32_t count);

#endif
