/* Plans of recordings. The operations on a dry tape become a function with two inputs, theta and the data.
 * The data are the values of all other leaves, one after the other. */
#include <string.h>

#include "autodiff/ops/op_table.h"
#include "autodiff/program/program.h"
#include "autodiff/program/program_tape.h"

enum { THETA, DATA, INPUTS }; /* the first nodes of the function, and its inputs */

typedef struct taking {
    lg_tape *tape;
    lg_function made;
    uint32_t *place; /* for each node of the tape: 1 + its node in the function; 0: not needed */
    uint32_t theta;
    size_t data; /* elements of the data so far */
} taking;

/* Leaves begin at multiples of a cache line. */
static size_t room_of(const lg_tape *tape, const lg_node *node) {
    const size_t unit = LG_ALIGNMENT / tape->k->size;
    return (node->count + unit - 1) / unit * unit;
}

static bool is_data(const taking *t, uint32_t i) {
    const lg_node *node = &t->tape->nodes[i];
    return node->inputs == 0 && i != t->theta && !(node->flags & LG_NODE_FULL);
}

static const uint32_t *parents_of(const taking *t, uint32_t i) {
    return t->tape->parents + t->tape->nodes[i].parents;
}

static lg_affine fixed(size_t x) {
    return (lg_affine){.base = (int64_t)x};
}

static lg_program_node *append(taking *t, const lg_op *op, const lg_shape *shape) {
    lg_function *f = &t->made;
    lg_program_node *node = &f->node[f->nodes++];
    *node = (lg_program_node){.op = op, .rank = shape->rank, .first = (uint32_t)f->edge_count};
    for (uint32_t d = 0; d < shape->rank; d++) node->dims[d] = fixed(shape->dims[d]);
    return node;
}

static void put_edge(taking *t, lg_program_node *node, uint32_t from) {
    t->made.edges[t->made.edge_count++] = from;
    node->inputs++;
}

/* Replaces a leaf of the tape by a slice of the data, in the leaf's shape. */
static void put_data(taking *t, const lg_node *leaf) {
    const lg_shape flat = lg_shape1((uint32_t)leaf->count);
    lg_program_node *part = append(t, lg_op_named("slice"), &flat);
    part->i[1] = fixed(t->data);
    part->i[2] = fixed(leaf->count);
    put_edge(t, part, DATA);
    t->data += room_of(t->tape, leaf);
    if (leaf->shape.rank == 1) return;
    const uint32_t from = t->made.nodes - 1;
    put_edge(t, append(t, lg_op_named("reshape"), &leaf->shape), from);
}

static void put_full(taking *t, const lg_node *leaf) {
    lg_function *f = &t->made;
    lg_program_node *node = append(t, &lg_op_leaf, &leaf->shape);
    node->leaf = LG_LEAF_CONSTANT;
    node->payload = (uint32_t)f->real_count;
    node->payload_count = 1;
    f->reals[f->real_count] = 0.0;
    if (leaf->count > 0) t->tape->k->convert_out(1, leaf->value, &f->reals[f->real_count]);
    f->real_count++;
}

static void put_operation(taking *t, uint32_t i) {
    const lg_node *from = &t->tape->nodes[i];
    lg_function *f = &t->made;
    lg_program_node *node = append(t, from->op, &from->shape);
    node->c = from->attr.c;
    for (uint32_t a = 0; a < 4; a++)
        if (!(from->op->follows >> a & 1u)) node->i[a] = fixed(from->attr.i[a]);
    for (uint32_t k = 0; k < from->inputs; k++) put_edge(t, node, t->place[parents_of(t, i)[k]] - 1);
    if (from->op->payload == LG_PAYLOAD_REALS) {
        node->payload = (uint32_t)f->real_count;
        node->payload_count = from->inputs;
        memcpy(f->reals + f->real_count, from->attr.pointer, from->inputs * sizeof *f->reals);
        f->real_count += from->inputs;
    } else if (from->op->payload == LG_PAYLOAD_INDICES) {
        node->payload = (uint32_t)f->index_count;
        node->payload_count = from->attr.i[0];
        memcpy(f->indices + f->index_count, from->attr.pointer, from->attr.i[0] * sizeof *f->indices);
        f->index_count += from->attr.i[0];
    }
}

/* Allocates the function's arrays for the nodes that the outputs need. Returns false if memory is short. */
static bool take_memory(taking *t) {
    const lg_context *context = t->tape->context;
    size_t nodes = INPUTS, edges = 0, reals = 0, indices = 0;
    for (uint32_t i = 0; i < t->tape->count; i++) {
        const lg_node *node = &t->tape->nodes[i];
        if (t->place[i] == 0) continue;
        nodes += is_data(t, i) ? 2 : 1;
        edges += is_data(t, i) ? 2 : node->inputs;
        reals += node->op->payload == LG_PAYLOAD_REALS ? node->inputs : node->inputs == 0;
        indices += node->op->payload == LG_PAYLOAD_INDICES ? node->attr.i[0] : 0;
    }
    lg_function *f = &t->made;
    f->name = lg_strdup(context, "recording");
    return f->name != NULL && LG_ALLOC_ALL(context, LG_ARRAY(f->node, nodes), LG_ARRAY(f->edges, edges + 1),
                                           LG_ARRAY(f->reals, reals + 1), LG_ARRAY(f->indices, indices + 1),
                                           LG_ARRAY(f->result, f->outputs)) == LG_OK;
}

static void mark_needed(taking *t, const lg_var *outputs) {
    for (size_t j = 0; j < t->made.outputs; j++) t->place[outputs[j].index] = 1;
    for (uint32_t i = t->tape->count; i-- > 0;)
        for (uint32_t k = 0; t->place[i] != 0 && k < t->tape->nodes[i].inputs; k++)
            t->place[parents_of(t, i)[k]] = 1;
}

static void put_nodes(taking *t, const lg_var *outputs) {
    const lg_shape none = lg_shape1(0);
    for (uint32_t n = 0; n < INPUTS; n++) {
        lg_program_node *leaf = append(t, &lg_op_leaf, &none);
        leaf->leaf = LG_LEAF_INPUT;
        leaf->number = n;
    }
    for (uint32_t i = 0; i < t->tape->count; i++) {
        if (t->place[i] == 0) continue;
        if (is_data(t, i))
            put_data(t, &t->tape->nodes[i]);
        else if (i != t->theta && t->tape->nodes[i].inputs == 0)
            put_full(t, &t->tape->nodes[i]);
        else if (i != t->theta)
            put_operation(t, i);
        t->place[i] = i == t->theta ? 1 + THETA : t->made.nodes;
    }
    t->made.node[THETA].dims[0] = fixed(t->tape->nodes[t->theta].count);
    if (t->data == 0) t->data = 1;
    t->made.node[DATA].dims[0] = fixed(t->data);
    for (size_t j = 0; j < t->made.outputs; j++) t->made.result[j] = t->place[outputs[j].index] - 1;
}

static lg_status put_ports(taking *t, const lg_var *outputs) {
    static const char *const name[] = {"y0", "y1", "y2", "y3"};
    lg_function *f = &t->made;
    const lg_port in[INPUTS] = {{.name = "theta", .shape = t->tape->nodes[t->theta].shape, .shared = true},
                                {.name = "data", .shape = lg_shape1((uint32_t)t->data), .shared = true}};
    lg_port out[LG_COUNT(name)];
    for (size_t j = 0; j < f->outputs; j++)
        out[j] = (lg_port){.name = name[j], .shape = t->tape->nodes[outputs[j].index].shape, .shared = true};
    LG_TRY(lg_ports_copy(t->tape->context, in, INPUTS, &f->input));
    f->inputs = INPUTS;
    return lg_ports_copy(t->tape->context, out, f->outputs, &f->output);
}

/* Allocates the data and moves the leaves' values there. */
static void *move_data(taking *t) {
    const size_t size = t->tape->k->size;
    unsigned char *data = lg_payload_allocate(t->tape, (t->data + 1) * size);
    size_t at = 0;
    for (uint32_t i = 0; data != NULL && i < t->tape->count; i++) {
        lg_node *node = &t->tape->nodes[i];
        if (t->place[i] == 0 || !is_data(t, i)) continue;
        memcpy(data + at * size, node->value, node->count * size);
        node->value = data + at * size;
        node->flags &= (uint8_t)~LG_NODE_GIVEN;
        at += room_of(t->tape, node);
    }
    return data;
}

static lg_status make_plan(taking *t, size_t rows, lg_plan **plan, lg_error *error) {
    lg_program *program = NULL;
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = t->tape->options.dtype;
    if (t->tape->options.max_size > 0) options.max_size = t->tape->options.max_size;
    LG_TRY(lg_program_create(t->tape->context, &program));
    lg_status status = lg_program_take_function(program, &t->made, error);
    if (status == LG_OK) status = lg_plan_create(program, 0, &options, plan, error);
    lg_program_destroy(program);
    return status;
}

static lg_status take(taking *t, const lg_var *outputs, size_t rows, lg_plan **plan, void **data,
                      lg_error *error) {
    t->place = lg_alloc(t->tape->context, t->tape->count, sizeof *t->place);
    if (t->place == NULL) return LG_OUT_OF_MEMORY;
    mark_needed(t, outputs);
    if (!take_memory(t)) return LG_OUT_OF_MEMORY;
    put_nodes(t, outputs);
    LG_TRY(put_ports(t, outputs));
    LG_TRY(make_plan(t, rows, plan, error));
    *data = move_data(t);
    if (*data != NULL) return LG_OK;
    lg_plan_destroy(*plan);
    return LG_OUT_OF_MEMORY;
}

lg_status lg_plan_of_tape(lg_tape *tape, lg_var theta, const lg_var *outputs, size_t count, size_t rows,
                          lg_plan **plan, void **data, lg_error *error) {
    LG_TRY(lg_tape_status(tape));
    taking t = {.tape = tape, .theta = theta.index, .made.outputs = count};
    const lg_status status = take(&t, outputs, rows, plan, data, error);
    lg_function_destroy(tape->context, &t.made);
    lg_free(tape->context, t.place);
    return status;
}
