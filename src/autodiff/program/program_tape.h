/* Plans of recordings. */
#ifndef LG_PROGRAM_TAPE_H
#define LG_PROGRAM_TAPE_H

#include "liegrad/program.h"

/* Makes a plan of what stands on a dry tape (lg_tape_set_dry). Its inputs are theta, which must be a leaf of
 * rank 1, and *data: the values of all other leaves, which from now on lie there, so that repeating the
 * recording (lg_tape_repeat) renews them. Constants of lg_full are part of the plan. Its outputs are the
 * `count` <= 4 variables `outputs`. Tensors with `rows` elements along the first axis are computed row by row
 * where that is possible, which only matters for speed. *data belongs to the tape, *plan to the caller.
 * Errors: LG_FORMAT (an operation of the caller), LG_NOT_FINITE (a constant), LG_OUT_OF_MEMORY, the tape's
 * status. */
lg_status lg_plan_of_tape(lg_tape *tape, lg_var theta, const lg_var *outputs, size_t count, size_t rows,
                          lg_plan **plan, void **data, lg_error *error);

#endif
