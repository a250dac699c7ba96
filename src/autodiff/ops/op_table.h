/* The table of all operations that can be on a tape. lg-gradcheck checks each row, and files identify
 * operations by their names. */
#ifndef LG_OP_TABLE_H
#define LG_OP_TABLE_H

#include "autodiff/ops/op.h"

enum { LG_OPS_MOST = 128 }; /* capacity of the table, and of arrays that have one entry per operation */

/* A NULL ends the table. */
extern const lg_op *const lg_ops[LG_OPS_MOST];

/* NULL when no operation has this name. */
const lg_op *lg_op_named(const char *name);
/* Index of the operation in the table; LG_OPS_MOST when it is not there. */
uint32_t lg_op_place(const lg_op *op);

#endif
