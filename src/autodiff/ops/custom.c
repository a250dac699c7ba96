/* Operations defined by the user. A derivative that the user builds with tape operations can be
 * differentiated again. A numeric derivative is recorded as CUSTOM_DERIVATIVE; differentiating that is an
 * error that names the operation. If the user gives both kinds of vjp, the numeric one is used in unrecorded
 * mode. */
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/tape_internal.h"

#include <string.h>

extern const lg_op lg_op_custom;

static lg_status custom_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    *out = lg_shape_of(LG_MAX_RANK, attr->i);
    out->rank = 0;
    while (out->rank < LG_MAX_RANK && attr->i[out->rank] != UINT32_MAX) out->rank++;
    for (uint32_t k = out->rank; k < LG_MAX_RANK; k++) out->dims[k] = 0;
    return LG_OK;
}

static lg_status custom_forward(lg_evaluation *e) {
    const lg_custom_op *op = e->attr->pointer;
    const void *values[LG_CUSTOM_MAX_INPUTS];
    for (uint32_t k = 0; k < e->inputs; k++) values[k] = e->x[k];
    return op->forward(op->user, e->k->dtype, values, e->y);
}

static lg_var fail_custom(lg_tape *tape, const lg_custom_op *op, lg_status status, const char *reason) {
    return lg_tape_fail(tape, status, op->name, reason);
}

/* A new node for a numeric derivative. Its inputs are all variables that the derivative depends on, so
 * differentiating with respect to any of them reaches the error. */
static lg_var derivative_node(lg_tape *tape, const lg_custom_op *op, const lg_var *in, uint32_t inputs,
                              lg_shape shape) {
    void *value = lg_value_allocate(tape, lg_shape_count(shape));
    if (value == NULL) return LG_NONE;
    lg_attr attr = {.pointer = op};
    return lg_record_value(tape, &lg_op_custom_derivative, in, inputs, &attr, shape, value,
                           tape->unrecorded ? (uint32_t)LG_NODE_POOLED : 0u);
}

static void numeric_vjp(lg_reverse *r, const lg_custom_op *op) {
    lg_tape *tape = r->tape;
    lg_var inputs[LG_CUSTOM_MAX_INPUTS + 1];
    const void *values[LG_CUSTOM_MAX_INPUTS];
    void *results[LG_CUSTOM_MAX_INPUTS];
    memcpy(inputs, r->in, r->inputs * sizeof *inputs);
    inputs[r->inputs] = r->g;
    for (uint32_t k = 0; k < r->inputs; k++) {
        results[k] = NULL;
        values[k] = lg_node_at(tape, r->in[k])->value;
        if (!r->need[k]) continue;
        r->out[k] = derivative_node(tape, op, inputs, r->inputs + 1, lg_node_at(tape, r->in[k])->shape);
        if (tape->status != LG_OK) return;
        results[k] = lg_node_at(tape, r->out[k])->value;
    }
    lg_status status = op->numeric_vjp(op->user, tape->k->dtype, values, lg_node_at(tape, r->y)->value,
                                       lg_node_at(tape, r->g)->value, results);
    if (status != LG_OK) fail_custom(tape, op, status, "the vjp failed");
}

/* Checks that a derivative returned by a callback is LG_NONE or has the required shape. */
static bool fits(lg_tape *tape, const lg_custom_op *op, lg_var got, lg_var like) {
    if (lg_is_none(got)) return true;
    if (lg_node_of(tape, got, op->name) == NULL) return false;
    if (lg_same_shape(&lg_node_at(tape, got)->shape, &lg_node_at(tape, like)->shape)) return true;
    fail_custom(tape, op, LG_SHAPE, "a derivative has the wrong shape");
    return false;
}

static void custom_vjp(lg_reverse *r) {
    const lg_custom_op *op = r->attr->pointer;
    if (op->vjp != NULL && !(op->numeric_vjp != NULL && r->sweep != NULL)) {
        lg_status status = op->vjp(op->user, r->tape, r->in, r->inputs, r->y, r->g, r->need, r->out);
        if (status != LG_OK) fail_custom(r->tape, op, status, "the vjp failed");
        for (uint32_t k = 0; k < r->inputs; k++)
            if (!r->need[k]) r->out[k] = LG_NONE;
        for (uint32_t k = 0; k < r->inputs && r->tape->status == LG_OK; k++)
            (void)fits(r->tape, op, r->out[k], r->in[k]);
    } else if (op->numeric_vjp != NULL) {
        numeric_vjp(r, op);
    } else {
        fail_custom(r->tape, op, LG_NOT_DIFFERENTIABLE, "the operation has no vjp");
    }
}

static lg_var numeric_jvp(const lg_forward *f, const lg_custom_op *op) {
    lg_tape *tape = f->tape;
    lg_var inputs[2 * LG_CUSTOM_MAX_INPUTS];
    uint32_t n = f->inputs;
    const void *values[LG_CUSTOM_MAX_INPUTS], *tangents[LG_CUSTOM_MAX_INPUTS];
    memcpy(inputs, f->in, f->inputs * sizeof *inputs);
    for (uint32_t k = 0; k < f->inputs; k++)
        if (!lg_is_none(f->tangents[k])) inputs[n++] = f->tangents[k];
    lg_var out = derivative_node(tape, op, inputs, n, lg_node_at(tape, f->y)->shape);
    if (tape->status != LG_OK) return LG_NONE;
    for (uint32_t k = 0; k < f->inputs; k++) {
        values[k] = lg_node_at(tape, f->in[k])->value;
        tangents[k] = lg_is_none(f->tangents[k]) ? NULL : lg_node_at(tape, f->tangents[k])->value;
    }
    lg_status status = op->numeric_jvp(op->user, tape->k->dtype, values, lg_node_at(tape, f->y)->value,
                                       tangents, lg_node_at(tape, out)->value);
    return status == LG_OK ? out : fail_custom(tape, op, status, "the jvp failed");
}

static lg_var custom_jvp(const lg_forward *f) {
    const lg_custom_op *op = f->attr->pointer;
    if (op->jvp == NULL && op->numeric_jvp == NULL)
        return fail_custom(f->tape, op, LG_NOT_DIFFERENTIABLE, "the operation has no jvp");
    if (op->jvp == NULL) return numeric_jvp(f, op);
    lg_var out = LG_NONE;
    lg_status status = op->jvp(op->user, f->tape, f->in, f->inputs, f->y, f->tangents, &out);
    if (status != LG_OK) return fail_custom(f->tape, op, status, "the jvp failed");
    if (!fits(f->tape, op, out, f->y)) return LG_NONE;
    return lg_is_none(out) ? lg_zeros_like(f->tape, f->y) : out;
}

const lg_op lg_op_custom = {
    LG_OP("custom", 0, 0, LG_CUSTOM_MAX_INPUTS, custom_shape, custom_forward, custom_vjp, custom_jvp),
    .payload = LG_PAYLOAD_IN_PROCESS};

static lg_status no_forward(lg_evaluation *e) {
    return LG_INVALID_ARGUMENT;
}

static void derivative_vjp(lg_reverse *r) {
    fail_custom(r->tape, r->attr->pointer, LG_NOT_DIFFERENTIABLE,
                "a numeric vjp or jvp cannot be differentiated again");
}

static lg_var derivative_jvp(const lg_forward *f) {
    return fail_custom(f->tape, f->attr->pointer, LG_NOT_DIFFERENTIABLE,
                       "a numeric vjp or jvp cannot be differentiated again");
}

const lg_op lg_op_custom_derivative = {
    LG_OP("custom_derivative", 0, 0, LG_MAX_INPUTS, custom_shape, no_forward, derivative_vjp, derivative_jvp),
    .payload = LG_PAYLOAD_IN_PROCESS};

lg_var lg_custom(lg_tape *tape, const lg_custom_op *op, const lg_var *inputs, size_t n, lg_shape shape) {
    if (op == NULL || op->name == NULL || op->forward == NULL || n > LG_CUSTOM_MAX_INPUTS ||
        (inputs == NULL && n > 0) || shape.rank > LG_MAX_RANK || (op->jvp != NULL && op->numeric_jvp != NULL))
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "custom",
                            "expected a name, forward, at most one of jvp and numeric_jvp, at most 8 inputs, "
                            "and rank 4 or less");
    lg_attr attr = {.pointer = op};
    for (uint32_t i = 0; i < LG_MAX_RANK; i++) attr.i[i] = i < shape.rank ? shape.dims[i] : UINT32_MAX;
    lg_scope_push(tape, op->name);
    lg_var y = lg_record(tape, &lg_op_custom, inputs, (uint32_t)n, &attr);
    lg_scope_pop(tape);
    return y;
}
