/* Leaves: inputs, parameters and constants. */
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/tape_internal.h"

#include <string.h>

void lg_no_vjp(lg_reverse *r) {
}

lg_var lg_with_tangent(const lg_forward *f, uint32_t k) {
    lg_var in[LG_MAX_INPUTS];
    const lg_node *y = lg_node_at(f->tape, f->y);
    memcpy(in, f->in, f->inputs * sizeof *in);
    in[k] = f->tangents[k];
    if (y->op->record != NULL) return y->op->record(f->tape, in[0], f->attr, y->shape);
    return lg_record_shaped(f->tape, y->op, in, f->inputs, f->attr, y->shape);
}

lg_var lg_linear_jvp(const lg_forward *f) {
    return lg_with_tangent(f, 0);
}

lg_var lg_zero_jvp(const lg_forward *f) {
    return lg_zeros_like(f->tape, f->y);
}

static lg_status leaf_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    return LG_INVALID_ARGUMENT;
}

const lg_op lg_op_leaf = {LG_OP("leaf", 0, 0, 0, leaf_shape, NULL, lg_no_vjp, lg_zero_jvp)};

static lg_var record_leaf(lg_tape *tape, lg_shape shape, void *value, uint32_t flags) {
    return lg_record_value(tape, &lg_op_leaf, NULL, 0, NULL, shape, value, flags);
}

static void *leaf_memory(lg_tape *tape, const char *name, lg_shape *shape, bool valid) {
    if (tape->status != LG_OK) return NULL;
    if (shape->rank > LG_MAX_RANK || !valid) {
        lg_tape_fail(tape, LG_INVALID_ARGUMENT, name, "the rank is above 4, or the data is NULL");
        return NULL;
    }
    for (uint32_t i = shape->rank; i < LG_MAX_RANK; i++) shape->dims[i] = 0;
    return tape->repeated > 0 ? lg_repeated_leaf(tape, shape)
                              : lg_value_allocate(tape, lg_shape_count(*shape));
}

static uint32_t fresh_flags(const lg_tape *tape) {
    return tape->unrecorded ? LG_NODE_POOLED : 0;
}

lg_var lg_input(lg_tape *tape, lg_shape shape, const void *data) {
    void *value = leaf_memory(tape, "input", &shape, data != NULL);
    if (value == NULL) return LG_NONE;
    memcpy(value, data, lg_shape_count(shape) * tape->k->size);
    return record_leaf(tape, shape, value, fresh_flags(tape));
}

lg_var lg_input_f64(lg_tape *tape, lg_shape shape, const double *data) {
    void *value = leaf_memory(tape, "input", &shape, data != NULL);
    if (value == NULL) return LG_NONE;
    tape->k->convert_in(lg_shape_count(shape), data, value);
    return record_leaf(tape, shape, value, fresh_flags(tape));
}

lg_var lg_input_buffer(lg_tape *tape, lg_shape shape, void **values) {
    void *value = leaf_memory(tape, "input", &shape, values != NULL);
    if (value == NULL) return LG_NONE;
    *values = value;
    return record_leaf(tape, shape, value, fresh_flags(tape));
}

lg_var lg_parameter(lg_tape *tape, lg_shape shape, const void *data) {
    if (tape->status != LG_OK) return LG_NONE;
    if (shape.rank > LG_MAX_RANK || data == NULL || lg_shape_count(shape) > SIZE_MAX / 16)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "parameter",
                            "the rank is above 4, the shape is too large, or the data is NULL");
    for (uint32_t i = shape.rank; i < LG_MAX_RANK; i++) shape.dims[i] = 0;
    if (tape->count < tape->repeated && !(tape->nodes[tape->count].flags & LG_NODE_GIVEN))
        return lg_input(tape, shape, data);
    /* the tape never writes to this value */
    return record_leaf(tape, shape, (void *)(uintptr_t)data, LG_NODE_GIVEN);
}

lg_var lg_full(lg_tape *tape, lg_shape shape, double c) {
    void *value = leaf_memory(tape, "full", &shape, true);
    if (value == NULL) return LG_NONE;
    const size_t count = lg_shape_count(shape);
    if (tape->repeated > 0 && count > 0) {
        double one; /* of the table's type */
        tape->k->convert_in(1, &c, &one);
        if (!(tape->nodes[tape->count].flags & LG_NODE_FULL) || memcmp(value, &one, tape->k->size) != 0)
            return lg_tape_fail(tape, LG_UNSUPPORTED, "full", "the repeated recording has another constant");
    } else {
        tape->k->fill(count, c, value);
    }
    return record_leaf(tape, shape, value, fresh_flags(tape) | LG_NODE_FULL);
}

lg_var lg_zeros_like(lg_tape *tape, lg_var v) {
    if (tape->status != LG_OK) return LG_NONE;
    return lg_full(tape, lg_node_at(tape, v)->shape, 0.0);
}
