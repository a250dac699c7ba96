/* Declarations that the files of src/table share. */
#ifndef LG_MODELS_TABLE_INTERNAL_H
#define LG_MODELS_TABLE_INTERNAL_H

#include "liegrad/table.h"
#include "nn/net.h"

/* f (B, outputs) of scaled inputs z (B, inputs). taps: NULL, or gets the inputs and outputs of the dense
 * layers. */
lg_var lg_table_record(lg_tape *tape, const lg_table *model, lg_var theta, lg_var z, lg_net_tap *taps);

/* Residuals r (count, outputs) = factor (f - t) of the samples at theta, and their Jacobian (count outputs,
 * parameters) in reverse mode: a dense layer y = x W + b gives dr/dW = x (outer) dr/dy. */
lg_status lg_table_linearise(const lg_table_problem *problem, lg_tape *tape, const double *theta,
                             const uint32_t *samples, size_t count, double factor, double *r,
                             double *jacobian);

/* Far cells dominate the mean and deviation of a column (table/far.c). The rule takes a column values[i
 * stride], which must not have NaN; a cell x is far if |x - median|/2 > limit. */
typedef struct lg_table_far {
    double median, limit;   /* INFINITY: no cell is far */
    size_t count, farthest; /* number of far cells; row of the cell that is farthest from the median */
    bool single;            /* the far cells are errors, probably: no others lie beyond 30 D, and no code */
} lg_table_far;
lg_status lg_table_find_far(const lg_context *context, const double *values, size_t stride, size_t rows,
                            lg_table_far *out);
bool lg_table_is_far(const lg_table_far *far, double x);

#endif
