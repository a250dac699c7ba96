/* Losses, composed of other operations. */
#include "autodiff/tape/tape_internal.h"

/* log softmax over the last axis. The maximum is subtracted first, as a constant for differentiation. */
lg_var lg_log_softmax(lg_tape *tape, lg_var x) {
    lg_var top = lg_stop_gradient(tape, lg_max_axis(tape, x, -1, true));
    lg_var shifted = lg_sub(tape, x, top);
    lg_var total = lg_sum_axis(tape, lg_exp(tape, shifted), -1, true);
    return lg_sub(tape, shifted, lg_log(tape, total));
}

/* The Huber loss: r^2/2 for |r| <= 1, |r| - 1/2 otherwise. With c = min(|r|, 1) both cases are c (|r| -
 * c/2). */
static lg_var huber(lg_tape *tape, lg_var residual) {
    lg_var size = lg_abs(tape, residual);
    lg_var minus_one = lg_full(tape, lg_shape0(), -1.0);
    lg_var c = lg_neg(tape, lg_max(tape, lg_neg(tape, size), minus_one));
    return lg_mul(tape, c, lg_sub(tape, size, lg_scale(tape, c, 0.5)));
}

/* x, but 0 where x is infinite and its factor is 0, because 0 times infinity is NaN. An infinite x is found
 * by |x| >= 2 |x| + 1, without an infinite constant, which exported code cannot have. */
static lg_var bounded(lg_tape *tape, lg_var x, lg_var factor) {
    if (tape->status != LG_OK) return LG_NONE;
    const lg_shape shape = lg_node_at(tape, x)->shape;
    const lg_var size = lg_abs(tape, x), more = lg_add_scalar(tape, lg_scale(tape, size, 2.0), 1.0);
    const lg_var counts = lg_select(tape, lg_ge(tape, size, more), lg_broadcast_to(tape, factor, shape),
                                    lg_full(tape, shape, 1.0));
    return lg_select(tape, counts, x, lg_full(tape, shape, 0.0));
}

/* Binary cross entropy of logits y and targets t: log(1 + exp(y)) - y t. It is (1 - t) y + log(1 + exp(-y))
 * for y >= 0 and -t y + log(1 + exp(y)) for y < 0. Each of these equals the loss for every y, so the
 * derivatives of the chosen one are right at 0, too. */
static lg_var bce_with_logits(lg_tape *tape, lg_var y, lg_var t) {
    const lg_var above = lg_ge(tape, y, lg_full(tape, lg_shape0(), 0.0)), slope = lg_sub(tape, above, t);
    const lg_var down = lg_select(tape, above, lg_neg(tape, y), y);
    const lg_var tail = lg_log(tape, lg_add_scalar(tape, lg_exp(tape, down), 1.0));
    return lg_add(tape, lg_mul(tape, slope, bounded(tape, y, slope)), tail);
}

/* -sum_c t_c log softmax(y)_c, shape (n, 1). */
static lg_var cross_entropy(lg_tape *tape, lg_var y, lg_var t) {
    return lg_neg(tape, lg_rowdot(tape, bounded(tape, lg_log_softmax(tape, y), t), t));
}

static lg_var elementwise_loss(lg_tape *tape, lg_loss kind, lg_var y, lg_var t) {
    switch (kind) {
    case LG_LOSS_MSE:
        return lg_square(tape, lg_sub(tape, y, t));
    case LG_LOSS_MAE:
        return lg_abs(tape, lg_sub(tape, y, t));
    case LG_LOSS_HUBER:
        return huber(tape, lg_sub(tape, y, t));
    case LG_LOSS_BCE_LOGITS:
        return bce_with_logits(tape, y, t);
    case LG_LOSS_CROSS_ENTROPY:
        return cross_entropy(tape, y, t);
    }
    return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "loss", "unknown loss");
}

lg_var lg_loss_record(lg_tape *tape, lg_loss kind, lg_var prediction, lg_var target, lg_var weights) {
    const lg_node *in[2] = {lg_node_of(tape, prediction, "loss"), lg_node_of(tape, target, "loss")};
    if (in[0] == NULL || in[1] == NULL) return LG_NONE;
    if (!lg_same_shape(&in[0]->shape, &in[1]->shape) || in[0]->shape.rank == 0)
        return lg_fail_shapes(tape, "loss", in, 2);
    lg_var each = elementwise_loss(tape, kind, prediction, target);
    if (!lg_is_none(weights) && tape->status == LG_OK) {
        const lg_node *both[2] = {lg_node_at(tape, each), lg_node_of(tape, weights, "loss")};
        if (both[1] == NULL) return LG_NONE;
        if (both[1]->shape.rank != 1 || both[1]->shape.dims[0] != both[0]->shape.dims[0])
            return lg_fail_shapes(tape, "loss weights", both, 2);
        lg_shape column = {both[0]->shape.rank, {both[1]->shape.dims[0], 1, 1, 1}};
        for (uint32_t i = column.rank; i < LG_MAX_RANK; i++) column.dims[i] = 0;
        weights = lg_reshape(tape, weights, column);
        each = lg_mul(tape, bounded(tape, each, weights), weights);
    }
    return lg_mean(tape, each);
}

lg_var lg_mse(lg_tape *tape, lg_var prediction, lg_var target) {
    const lg_node *in[2] = {lg_node_of(tape, prediction, "mse"), lg_node_of(tape, target, "mse")};
    if (in[0] == NULL || in[1] == NULL) return LG_NONE;
    if (!lg_same_shape(&in[0]->shape, &in[1]->shape)) return lg_fail_shapes(tape, "mse", in, 2);
    return lg_mean(tape, lg_square(tape, lg_sub(tape, prediction, target)));
}
