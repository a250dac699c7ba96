/* The table of operations: every operation that can be on a tape. lg-gradcheck has a row for each, files know
 * them by their names. */
#ifndef LG_OP_TABLE_H
#define LG_OP_TABLE_H

#include "autodiff/ops/op.h"

enum { LG_OPS_MOST = 128 }; /* room for them, and for an array beside the table */

/* NULL ends it. */
extern const lg_op *const lg_ops[LG_OPS_MOST];

/* NULL: there is none. */
const lg_op *lg_op_named(const char *name);
/* Its place in the table, LG_OPS_MOST for an operation that is not there. */
uint32_t lg_op_place(const lg_op *op);

#endif
