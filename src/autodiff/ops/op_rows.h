/* Rows of the operation table (op_table.h) that are used outside the file that defines them. */
#ifndef LG_OP_ROWS_H
#define LG_OP_ROWS_H

#include "autodiff/ops/op.h"

extern const lg_op lg_op_leaf, lg_op_add, lg_op_sub, lg_op_mul, lg_op_div, lg_op_max, lg_op_atan2,
    lg_op_select, lg_op_ge, lg_op_combine, lg_op_scale, lg_op_shift, lg_op_sqrt, lg_op_exp, lg_op_log,
    lg_op_sin, lg_op_cos, lg_op_abs, lg_op_sign, lg_op_stop_gradient, lg_op_act, lg_op_act_derivative,
    lg_op_matmul, lg_op_concat, lg_op_pad, lg_op_repeat, lg_op_reshape, lg_op_permute, lg_op_conv1d_input,
    lg_op_conv1d_weight, lg_op_avg_pool1d, lg_op_avg_pool1d_adjoint, lg_op_pool_place, lg_op_cross,
    lg_op_spd_factor, lg_op_spd_solve, lg_op_covariance, lg_op_centre, lg_op_covariance_root, lg_op_lyapunov,
    lg_op_stumpff, lg_op_dexpinv_coef, lg_op_custom_derivative;

/* The operation with input k replaced by its tangent. lg_linear_jvp is the jvp of an operation that is linear
 * in input 0 and whose other inputs are constants. */
lg_var lg_with_tangent(const struct lg_forward *f, uint32_t k);
lg_var lg_linear_jvp(const struct lg_forward *f);

/* Operations on each row of a batch, at most four inputs of rank 3 or one for all rows, in double precision.
 * lg_batch_forward calls `row` with the addresses of the inputs, of the output and of memory behind the
 * converted numbers in e->scratch, lg_batch_doubles of them. lg_batch_c writes a loop of calls, `call` being
 * the function and its sizes, "name(1, 2". */
typedef void lg_batch_row(const lg_evaluation *e, const double *const *x, double *y, double *memory);
size_t lg_batch_doubles(const lg_evaluation *e);
lg_status lg_batch_forward(lg_evaluation *e, lg_batch_row *row);
void lg_batch_c(struct lg_c *c, const lg_evaluation *e, size_t work, const char *call, ...)
    __attribute__((format(printf, 4, 5)));
/* The forward function of an operation with the function NAME_row. */
#define LG_BATCH_FORWARD(name)                                                                               \
    static lg_status name##_forward(lg_evaluation *e) {                                                      \
        return lg_batch_forward(e, name##_row);                                                              \
    }

#endif
