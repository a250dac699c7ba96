#include "autodiff/ops/op_table.h"

#include <string.h>

/* X(NAME) for every row lg_op_NAME of the table. */
#define LG_OP_LIST(X)                                                                                        \
    X(leaf)                                                                                                  \
    X(add)                                                                                                   \
    X(sub)                                                                                                   \
    X(mul)                                                                                                   \
    X(div)                                                                                                   \
    X(max)                                                                                                   \
    X(atan2)                                                                                                 \
    X(select)                                                                                                \
    X(ge)                                                                                                    \
    X(mix)                                                                                                   \
    X(combine)                                                                                               \
    X(scale)                                                                                                 \
    X(shift)                                                                                                 \
    X(pow)                                                                                                   \
    X(sqrt)                                                                                                  \
    X(exp)                                                                                                   \
    X(log)                                                                                                   \
    X(sin)                                                                                                   \
    X(cos)                                                                                                   \
    X(abs)                                                                                                   \
    X(sign)                                                                                                  \
    X(stop_gradient)                                                                                         \
    X(act)                                                                                                   \
    X(act_derivative)                                                                                        \
    X(matmul)                                                                                                \
    X(reduce)                                                                                                \
    X(repeat)                                                                                                \
    X(reduce_max)                                                                                            \
    X(argmax_mask)                                                                                           \
    X(reshape)                                                                                               \
    X(slice)                                                                                                 \
    X(pad)                                                                                                   \
    X(concat)                                                                                                \
    X(permute)                                                                                               \
    X(conv1d)                                                                                                \
    X(conv1d_block)                                                                                          \
    X(conv1d_input)                                                                                          \
    X(conv1d_weight)                                                                                         \
    X(avg_pool1d)                                                                                            \
    X(avg_pool1d_adjoint)                                                                                    \
    X(pool_pick)                                                                                             \
    X(pool_place)                                                                                            \
    X(gather)                                                                                                \
    X(scatter)                                                                                               \
    X(rowdot)                                                                                                \
    X(cross)                                                                                                 \
    X(spd_factor)                                                                                            \
    X(spd_solve)                                                                                             \
    X(covariance)                                                                                            \
    X(centre)                                                                                                \
    X(covariance_root)                                                                                       \
    X(lyapunov)                                                                                              \
    X(rocket)                                                                                                \
    X(stumpff)                                                                                               \
    X(dexpinv_coef)                                                                                          \
    X(lie)                                                                                                   \
    X(custom)                                                                                                \
    X(custom_derivative)

#define X(name) extern const lg_op lg_op_##name;
LG_OP_LIST(X)
#undef X

const lg_op *const lg_ops[LG_OPS_MOST] = {
#define X(name) &lg_op_##name,
    LG_OP_LIST(X)
#undef X
};

#define X(name) +1
_Static_assert(LG_OP_LIST(X) < LG_OPS_MOST, "the table ends with NULL");
#undef X

const lg_op *lg_op_named(const char *name) {
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (strcmp(lg_ops[i]->name, name) == 0) return lg_ops[i];
    return NULL;
}

uint32_t lg_op_place(const lg_op *op) {
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (lg_ops[i] == op) return i;
    return LG_OPS_MOST;
}
