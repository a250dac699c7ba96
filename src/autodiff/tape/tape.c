/* The tape: creation, handles, marks, recording and readers. */
#include "autodiff/tape/tape_internal.h"

#include <string.h>

/* ---- creation and destruction ---- */

void lg_tape_options_init(lg_tape_options *options) {
    *options = (lg_tape_options){.size = sizeof *options, .dtype = LG_F64, .threads = 1};
}

lg_status lg_tape_create(const lg_context *context, const lg_tape_options *options, lg_tape **out) {
    LG_NEEDS(NULL, out);
    lg_tape_options chosen;
    lg_tape_options_init(&chosen);
    if (options != NULL) {
        if (options->size != sizeof *options) return LG_INVALID_ARGUMENT;
        chosen = *options;
    }
    if (chosen.dtype != LG_F64 && chosen.dtype != LG_F32) return LG_INVALID_ARGUMENT;
    if (chosen.threads < 1 || chosen.threads > 1024) return LG_INVALID_ARGUMENT;
    lg_tape *tape = lg_alloc(context, 1, sizeof *tape);
    if (tape == NULL) return LG_OUT_OF_MEMORY;
    tape->context = context;
    tape->options = chosen;
    tape->k = lg_kernels_for(chosen.dtype);
    /* The first generation depends on the tape's address, so that a handle of another tape is unlikely to
     * look valid. */
    tape->generation = (uint32_t)((uintptr_t)tape >> 6) * 2654435761u | 1u;
    if (chosen.threads > 1) {
        const lg_status status = lg_thread_pool_create(context, chosen.threads, &tape->workers);
        if (status != LG_OK) {
            lg_tape_destroy(tape);
            return status;
        }
    }
    *out = tape;
    return LG_OK;
}

void lg_tape_destroy(lg_tape *tape) {
    if (tape == NULL) return;
    if (tape->kept != NULL) tape->release(tape->kept);
    lg_thread_pool_destroy(tape->workers);
    lg_arena_destroy(tape, &tape->arena);
    lg_arena_destroy(tape, &tape->pool.arena);
    LG_FREE_ALL(tape->context, tape->nodes, tape->parents, tape->transposed, tape->lasting, tape);
}

lg_dtype lg_tape_dtype(const lg_tape *tape) {
    return tape->options.dtype;
}

size_t lg_tape_size(const lg_tape *tape) {
    return tape->bytes;
}

/* ---- shapes ---- */

lg_shape lg_shape_of(uint32_t rank, const uint32_t *dims) {
    lg_shape shape = {rank, {0, 0, 0, 0}};
    for (uint32_t i = 0; i < rank && i < LG_MAX_RANK; i++) shape.dims[i] = dims[i];
    return shape;
}

size_t lg_shape_count(lg_shape shape) {
    size_t count = 1;
    for (uint32_t i = 0; i < shape.rank && i < LG_MAX_RANK; i++) {
        if (shape.dims[i] != 0 && count > SIZE_MAX / shape.dims[i]) return SIZE_MAX;
        count *= shape.dims[i];
    }
    return count;
}

/* ---- marks ---- */

/* A mark stores the generation of the last node before it. If this node was rewound since, the node now in
 * its place has another generation, and the mark is rejected. */
lg_mark lg_tape_mark(const lg_tape *tape) {
    lg_mark mark = {tape->count, tape->parents_count,
                    tape->count == 0 ? 0 : tape->nodes[tape->count - 1].generation, tape->arena.current,
                    tape->arena.used};
    return mark;
}

void lg_forget_nodes(lg_tape *tape, uint32_t node) {
    lg_forget_transposes(tape, node);
    tape->count = node;
}

lg_status lg_tape_rewind(lg_tape *tape, lg_mark mark) {
    LG_NEEDS(NULL, tape);
    if (tape->repeated > 0) return LG_UNSUPPORTED;
    if (mark.nodes > tape->count) return LG_INVALID_ARGUMENT;
    if (mark.nodes > 0 && tape->nodes[mark.nodes - 1].generation != mark.generation)
        return LG_INVALID_ARGUMENT;
    lg_forget_nodes(tape, mark.nodes);
    tape->parents_count = mark.nodes == 0 ? 0 : mark.parents;
    /* A mark taken on an empty tape is valid for any tape, so its other members are not used. */
    tape->arena.current = mark.nodes == 0 ? 0 : mark.chunk;
    tape->arena.used = mark.nodes == 0 ? 0 : mark.used;
    if (++tape->generation == 0) tape->generation = 1;
    if (tape->status != LG_OK && tape->failed_at >= mark.nodes) {
        tape->status = LG_OK;
        tape->message[0] = '\0';
    }
    return LG_OK;
}

void lg_tape_reset(lg_tape *tape) {
    tape->repeated = 0;
    (void)lg_tape_rewind(tape, (lg_mark){0, 0, 0, 0, 0});
    tape->status = LG_OK;
    tape->message[0] = '\0';
    tape->scope_depth = 0;
}

/* ---- handles ---- */

lg_node *lg_node_of(lg_tape *tape, lg_var v, const char *operation) {
    if (tape->status == LG_OK && v.index < tape->count && v.generation != 0 &&
        v.generation == tape->nodes[v.index].generation)
        return &tape->nodes[v.index];
    lg_tape_fail(tape, LG_STALE_HANDLE, operation,
                 lg_is_none(v) ? "an input is LG_NONE" : "an input was rewound or belongs to another tape");
    return NULL;
}

/* ---- recording ---- */

void *lg_value_allocate(lg_tape *tape, size_t count) {
    if (count > (SIZE_MAX / 16)) {
        lg_tape_fail(tape, LG_OUT_OF_MEMORY, "tape", "a tensor is too large");
        return NULL;
    }
    size_t bytes = count * tape->k->size;
    return tape->unrecorded ? lg_pool_take(tape, bytes) : lg_arena_allocate(tape, &tape->arena, bytes);
}

void *lg_payload_allocate(lg_tape *tape, size_t bytes) {
    return lg_arena_allocate(tape, &tape->arena, bytes);
}

/* Reserves memory for one more node and its parents, so that pointers to nodes stay valid while the node is
 * made. The array of parents exists from the first leaf on, because &parents[offset] of a NULL array is
 * undefined. */
static bool reserve(lg_tape *tape, uint32_t inputs) {
    return lg_grow(tape, (void **)&tape->nodes, &tape->capacity, tape->count + 1, sizeof *tape->nodes) &&
           lg_grow(tape, (void **)&tape->parents, &tape->parents_capacity,
                   tape->parents_count + inputs + (tape->parents == NULL), sizeof *tape->parents);
}

static lg_node *append_node(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs,
                            const lg_attr *attr, const lg_shape *shape, size_t count, void *value,
                            uint32_t flags) {
    lg_node *node = &tape->nodes[tape->count];
    node->value = value;
    node->transposed = NULL;
    node->count = count;
    if (attr != NULL)
        node->attr = *attr;
    else
        node->attr = (lg_attr){0};
    node->shape = *shape;
    node->generation = tape->generation;
    node->parents = tape->parents_count;
    node->op = op;
    node->inputs = (uint8_t)inputs;
    node->flags = (uint8_t)flags;
    for (uint32_t i = 0; i < inputs; i++) tape->parents[tape->parents_count + i] = in[i].index;
    return node;
}

static void note_scope(lg_tape *tape) {
    tape->watched[0] = '\0';
    for (int i = 0; i < tape->scope_depth && i < LG_SCOPE_DEPTH; i++) {
        lg_tape_append(tape->watched, sizeof tape->watched, i == 0 ? "" : "/");
        lg_tape_append(tape->watched, sizeof tape->watched, tape->scopes[i]);
    }
}

static lg_var commit(lg_tape *tape, uint32_t inputs) {
    if (tape->count + 1 == tape->watch) note_scope(tape);
    tape->parents_count += inputs;
    return lg_var_at(tape, tape->count++);
}

/* ---- recording the same again ---- */

void lg_tape_set_dry(lg_tape *tape) {
    tape->dry = true;
}

void lg_tape_repeat(lg_tape *tape) {
    if (tape->repeated == 0) {
        tape->repeated = tape->count;
        tape->end_chunk = tape->arena.current;
        tape->end_used = tape->arena.used;
    }
    tape->count = tape->parents_count = 0;
    tape->arena.current = tape->end_chunk;
    tape->arena.used = tape->end_used;
    if (++tape->generation == 0) tape->generation = 1;
    tape->status = LG_OK;
    tape->message[0] = '\0';
    tape->scope_depth = 0;
}

static lg_var other_recording(lg_tape *tape, const lg_op *op) {
    return lg_tape_fail(tape, LG_UNSUPPORTED, op->name,
                        "it is not what the recording that is being repeated has here");
}

static bool same_attributes(const lg_node *node, const lg_attr *attr) {
    size_t bytes = 0;
    if (memcmp(&node->attr.c, &attr->c, sizeof attr->c) != 0 ||
        memcmp(node->attr.i, attr->i, sizeof attr->i) != 0 || node->op->payload == LG_PAYLOAD_IN_PROCESS)
        return false;
    if (node->op->payload == LG_PAYLOAD_REALS) bytes = node->inputs * sizeof(double);
    if (node->op->payload == LG_PAYLOAD_INDICES) bytes = attr->i[0] * sizeof(uint32_t);
    return bytes == 0 || memcmp(node->attr.pointer, attr->pointer, bytes) == 0;
}

/* Checks that the caller records the next node of the repeated recording. `shape` is NULL if inputs and
 * attributes determine the shape. */
static lg_var repeat(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr,
                     const lg_shape *shape) {
    static const lg_attr none;
    lg_node *node = &tape->nodes[tape->count];
    if (tape->count == tape->repeated || node->op != op || node->inputs != inputs ||
        !same_attributes(node, attr != NULL ? attr : &none) ||
        (shape != NULL && !lg_same_shape(&node->shape, shape)))
        return other_recording(tape, op);
    for (uint32_t k = 0; k < inputs; k++) {
        if (lg_node_of(tape, in[k], op->name) == NULL) return LG_NONE;
        if (tape->parents[node->parents + k] != in[k].index) return other_recording(tape, op);
    }
    node->generation = tape->generation;
    tape->parents_count += inputs;
    return lg_var_at(tape, tape->count++);
}

void *lg_repeated_leaf(lg_tape *tape, const lg_shape *shape) {
    const lg_node *node = &tape->nodes[tape->count];
    if (tape->count < tape->repeated && node->inputs == 0 && !(node->flags & LG_NODE_GIVEN) &&
        lg_same_shape(&node->shape, shape))
        return node->value;
    lg_tape_fail(tape, LG_UNSUPPORTED, "input",
                 "it is not what the recording that is being repeated has here");
    return NULL;
}

lg_var lg_record_value(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr,
                       lg_shape shape, void *value, uint32_t flags) {
    if (tape->status != LG_OK) return LG_NONE;
    if (tape->repeated > 0) {
        const lg_var again = repeat(tape, op, in, inputs, attr, &shape);
        if (lg_is_none(again) || inputs > 0) return again;
        if ((tape->nodes[again.index].flags ^ flags) & LG_NODE_FULL) return other_recording(tape, op);
        tape->nodes[again.index].value = value;
        return again;
    }
    if (!reserve(tape, inputs)) return LG_NONE;
    append_node(tape, op, in, inputs, attr, &shape, lg_shape_count(shape), value, flags);
    return commit(tape, inputs);
}

/* Provides what the operation needs besides its inputs and its output: a transpose, kept memory and scratch.
 * False: error set. */
static bool take_extras(lg_tape *tape, const lg_op *op, const lg_var *in, lg_evaluation *e, size_t *scratch) {
    if (op->transpose != NULL) {
        e->transposed = lg_kept_transpose(tape, op->transpose(e), in[1].index);
        if (tape->status != LG_OK) return false;
    }
    if (op->kept != NULL && !tape->unrecorded) {
        const size_t bytes = op->kept(e);
        if (bytes > 0 && (e->kept = lg_payload_allocate(tape, bytes)) == NULL) return false;
    }
    *scratch = op->scratch != NULL ? op->scratch(e) : 0;
    return *scratch == 0 || (e->scratch = lg_pool_take(tape, *scratch)) != NULL;
}

static lg_status evaluate(lg_tape *tape, const lg_op *op, const lg_var *in, lg_evaluation *e) {
    size_t scratch = 0;
    if (!take_extras(tape, op, in, e, &scratch)) return tape->status;
    const lg_status status = op->forward(e);
    if (scratch > 0) lg_pool_give(tape, e->scratch, scratch);
    return status;
}

lg_var lg_record_shaped(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs,
                        const lg_attr *attr, lg_shape shape) {
    static const lg_attr none;
    const lg_node *nodes[LG_MAX_INPUTS];
    const lg_shape *shapes[LG_MAX_INPUTS];
    const void *values[LG_MAX_INPUTS];
    if (tape->status != LG_OK) return LG_NONE;
    if (inputs > LG_MAX_INPUTS) return lg_tape_fail(tape, LG_INVALID_ARGUMENT, op->name, "too many inputs");
    if (tape->repeated > 0) return repeat(tape, op, in, inputs, attr, op->given ? &shape : NULL);
    if (!reserve(tape, inputs)) return LG_NONE;
    for (uint32_t i = 0; i < inputs; i++) {
        nodes[i] = lg_node_of(tape, in[i], op->name);
        if (nodes[i] == NULL) return LG_NONE;
        shapes[i] = &nodes[i]->shape;
        values[i] = nodes[i]->flags & LG_NODE_NO_VALUE ? NULL : nodes[i]->value;
    }
    if (attr == NULL) attr = &none;
    lg_status status = op->shape(shapes, inputs, attr, &shape);
    if (status == LG_SHAPE) return lg_fail_shapes(tape, op->name, nodes, inputs);
    if (status != LG_OK) return lg_tape_fail(tape, status, op->name, lg_status_sentence(status));
    const size_t count = lg_shape_count(shape);
    if (tape->dry) {
        append_node(tape, op, in, inputs, attr, &shape, count, tape, LG_NODE_NO_VALUE);
        return commit(tape, inputs);
    }
    void *value = lg_value_allocate(tape, count);
    if (value == NULL) return LG_NONE;
    const lg_crew crew = lg_tape_crew(tape);
    lg_evaluation e = {.k = tape->k,
                       .crew = &crew,
                       .attr = attr,
                       .inputs = inputs,
                       .in = shapes,
                       .x = values,
                       .shape = &shape,
                       .count = count,
                       .y = value};
    status = evaluate(tape, op, in, &e);
    if (status != LG_OK) {
        if (tape->unrecorded) lg_pool_give(tape, value, count * tape->k->size);
        return lg_tape_fail(tape, status, op->name, lg_status_sentence(status));
    }
    lg_node *node = append_node(tape, op, in, inputs, attr, &shape, count, value,
                                tape->unrecorded ? (uint32_t)LG_NODE_POOLED : 0u);
    if (op->payload == LG_PAYLOAD_KEPT) node->attr.pointer = e.kept;
    return commit(tape, inputs);
}

lg_var lg_record(lg_tape *tape, const lg_op *op, const lg_var *in, uint32_t inputs, const lg_attr *attr) {
    return lg_record_shaped(tape, op, in, inputs, attr, lg_shape0());
}

/* ---- readers ---- */

static const lg_node *readable(const lg_tape *tape, lg_var v) {
    if (tape->status != LG_OK || v.index >= tape->count) return NULL;
    const lg_node *node = &tape->nodes[v.index];
    return node->generation == v.generation ? node : NULL;
}

lg_shape lg_var_shape(const lg_tape *tape, lg_var v) {
    const lg_node *node = readable(tape, v);
    return node != NULL ? node->shape : lg_shape0();
}

const void *lg_value(const lg_tape *tape, lg_var v) {
    const lg_node *node = readable(tape, v);
    return node != NULL && !tape->dry ? node->value : NULL;
}

lg_status lg_read(const lg_tape *tape, lg_var v, size_t count, double *out) {
    LG_NEEDS(NULL, tape, out);
    if (tape->status != LG_OK) return tape->status;
    const lg_node *node = readable(tape, v);
    if (node == NULL) return LG_STALE_HANDLE;
    if (tape->dry) return LG_UNSUPPORTED;
    if (node->count != count || node->value == NULL) return LG_SHAPE;
    tape->k->convert_out(count, node->value, out);
    return LG_OK;
}
