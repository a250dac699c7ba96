/* Gradients of each row of a batch (rows.c), as a part of the unrecorded sweep (backward.c). */
#ifndef LG_ROWS_H
#define LG_ROWS_H

#include "autodiff/tape/sweep.h"

typedef struct lg_rows lg_rows;

/* Takes what is shared out of `reach`. `gradient` (count, elements of theta) is set to 0. NULL: error set. */
lg_rows *lg_rows_open(lg_tape *tape, lg_range range, lg_var theta, size_t count, double *gradient,
                      uint8_t *reach);
/* Node i with cotangent g: adds the parts of its shared inputs. */
void lg_rows_add(lg_tape *tape, lg_rows *rows, uint32_t i, lg_var g);
/* After the sweep. Recorded mode. */
void lg_rows_close(lg_tape *tape, lg_rows *rows);

#endif
