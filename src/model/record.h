/* Tape operations that the programs of several learned models use. */
#ifndef LG_MODELS_RECORD_H
#define LG_MODELS_RECORD_H

#include "integrators/taped_internal.h"

/* Columns first .. first + count - 1 of x (B, n). */
static inline lg_var lg_columns(lg_tape *tape, lg_var x, uint32_t first, uint32_t count) {
    return lg_slice(tape, x, 1, first, count);
}

/* Repeats each row of x `copies` times in succession: (B, ...) -> (B copies, ...). */
lg_var lg_record_copies(lg_tape *tape, lg_var x, uint32_t copies);
/* Unit vectors e_at[0], e_at[1], ... with n numbers (`at` NULL: e_0, e_1, ...), repeated for each of `rows`
 * rows: (rows count, n). */
lg_var lg_record_units(lg_tape *tape, uint32_t rows, const uint32_t *at, uint32_t count, uint32_t n);
/* The rows `samples` (shape.dims[0]) of `values`, numbers of the type `from`, as a variable of this shape and
 * of the tape's type. */
lg_var lg_record_rows(lg_tape *tape, lg_dtype from, const void *values, lg_shape shape,
                      const uint32_t *samples);
/* The labels of the rows `samples` (count) as targets (count, outputs): one output is the label, several are
 * 1 for the label's class and 0 for others, also for a label that is no class. */
lg_var lg_record_labels(lg_tape *tape, const uint32_t *label, uint32_t outputs, const uint32_t *samples,
                        uint32_t count);

#endif
