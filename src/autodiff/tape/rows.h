/* The gradient of each row of a batch (rows.c), as part of the unrecorded sweep (backward.c). */
#ifndef LG_ROWS_H
#define LG_ROWS_H

#include "autodiff/tape/sweep.h"

typedef struct lg_rows lg_rows;

/* Finds the nodes that are shared by all rows and clears `reach` for them, so the ordinary sweep skips them.
 * Sets `gradient` (count, elements of theta) to 0. NULL: error set. */
lg_rows *lg_rows_open(lg_tape *tape, lg_node_range range, lg_var theta, size_t count, double *gradient,
                      uint8_t *reach);
/* Given node i and its cotangent g, adds the part of each row to the gradients of the node's shared
 * inputs. */
void lg_rows_add(lg_tape *tape, lg_rows *rows, uint32_t i, lg_var g);
/* Completes the gradients after the sweep and frees `rows`. The tape must be back in recorded mode. */
void lg_rows_close(lg_tape *tape, lg_rows *rows);

#endif
