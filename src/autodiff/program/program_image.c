/* Conversion of a program's functions to plain data (images) and back. */
#include "autodiff/ops/op_table.h"
#include "liegrad/program.h"

#include <string.h>

#include "autodiff/program/program_call.h"

/* Names of leaves in images; leaves always have revision 1. */
static const char *const leaf_names[] = {
    [LG_LEAF_INPUT] = "input", [LG_LEAF_PARAMETER] = "parameter", [LG_LEAF_CONSTANT] = "constant"};

_Static_assert(LG_WHOLE_COUNT == sizeof((lg_program_node *)0)->i / sizeof(lg_affine), "attributes");

/* ---- function to image ---- */

static lg_operation operation_of(const lg_function *f, const lg_program_node *node) {
    const lg_op *op = node->op;
    const bool leaf = node->op == &lg_op_leaf;
    lg_operation o = {.name = leaf ? leaf_names[node->leaf] : op->name,
                      .revision = leaf ? 1 : 1u + op->revision,
                      .inputs = f->edges + node->first,
                      .input_count = node->inputs,
                      .rank = node->rank,
                      .real = node->c,
                      .reciprocal = node->inverse};
    memcpy(o.shape, node->dims, node->rank * sizeof *o.shape);
    memcpy(o.whole, node->i, sizeof o.whole);
    if (leaf && node->leaf != LG_LEAF_CONSTANT) o.whole[0] = (lg_affine){node->number, 0};
    if (node->leaf == LG_LEAF_CONSTANT || op->payload == LG_PAYLOAD_REALS) {
        o.reals = f->reals + node->payload;
        o.real_count = node->payload_count;
    } else if (op->payload == LG_PAYLOAD_INDICES) {
        o.indices = f->indices + node->payload;
        o.index_count = node->payload_count;
    }
    return o;
}

lg_owned_image *lg_owned_image_create(const lg_context *context, size_t most) {
    lg_owned_image *made = lg_alloc(context, 1, sizeof *made);
    if (made != NULL) made->heap = (lg_heap){.context = context, .most = most};
    return made;
}

lg_status lg_function_image_create(const lg_program *p, size_t function, lg_function_image **out) {
    if (p == NULL || out == NULL) return LG_INVALID_ARGUMENT;
    if (function >= p->functions) return LG_NOT_FOUND;
    const lg_function *f = &p->function[function];
    lg_owned_image *made = lg_owned_image_create(p->context, SIZE_MAX);
    lg_operation *operations = made != NULL ? lg_heap_take(&made->heap, f->nodes, sizeof *operations) : NULL;
    if (operations == NULL) {
        lg_free(p->context, made);
        return LG_OUT_OF_MEMORY;
    }
    for (uint32_t i = 0; i < f->nodes; i++) operations[i] = operation_of(f, &f->node[i]);
    made->image = (lg_function_image){.name = f->name,
                                      .inputs = f->input,
                                      .input_count = f->inputs,
                                      .outputs = f->output,
                                      .output_count = f->outputs,
                                      .operations = operations,
                                      .operation_count = f->nodes,
                                      .results = f->result,
                                      .times = f->times,
                                      .callee = f->callee,
                                      .carry = f->carry,
                                      .path = f->path,
                                      .path_count = f->paths};
    *out = &made->image;
    return LG_OK;
}

void lg_function_image_destroy(lg_function_image *image) {
    lg_owned_image *owned = (lg_owned_image *)image;
    if (owned == NULL) return;
    const lg_context *context = owned->heap.context;
    lg_heap_destroy(&owned->heap);
    lg_free(context, owned);
}

/* ---- image to function ---- */

/* The function being made; the counts in `f` say how far its lists are filled. */
typedef struct making {
    const lg_program *program;
    const lg_function_image *from;
    lg_function f;
    lg_error *error;
} making;

static lg_status refuse(const making *m, size_t i, lg_status status, const char *why) {
    char name[LG_SHOWN_NAME], operation[LG_SHOWN_NAME];
    return lg_fail(m->error, status, "function '%s', operation %zu (%s): %s",
                   lg_shown_name(m->from->name, name), i,
                   lg_shown_name(m->from->operations[i].name, operation), why);
}

static lg_status find_operation(const making *m, size_t i, lg_program_node *node) {
    const lg_operation *o = &m->from->operations[i];
    for (uint32_t leaf = LG_LEAF_INPUT; o->name != NULL && leaf < LG_COUNT(leaf_names); leaf++)
        if (strcmp(o->name, leaf_names[leaf]) == 0) {
            node->op = &lg_op_leaf;
            node->leaf = (lg_leaf)leaf;
        }
    if (o->name != NULL && node->leaf == LG_LEAF_NONE)
        node->op = strcmp(o->name, lg_op_call.name) == 0 ? &lg_op_call : lg_op_named(o->name);
    if (node->op == NULL || (node->op == &lg_op_leaf && node->leaf == LG_LEAF_NONE))
        return refuse(m, i, LG_FORMAT, "there is no such operation");
    const uint32_t known = node->op == &lg_op_leaf ? 1u : 1u + node->op->revision;
    if (o->revision > known) return refuse(m, i, LG_VERSION, "its revision is newer than this library knows");
    if (o->revision < known)
        return refuse(m, i, LG_FORMAT, "its revision is too old: this library does not read it any more");
    return LG_OK;
}

/* Copies the numbers and indices of an operation to the lists of the function. */
static lg_status take_payload(making *m, size_t i, lg_program_node *node) {
    const lg_operation *o = &m->from->operations[i];
    lg_function *f = &m->f;
    const lg_payload payload = node->op->payload;
    const bool reals = node->leaf == LG_LEAF_CONSTANT || payload == LG_PAYLOAD_REALS;
    const bool indices = payload == LG_PAYLOAD_INDICES;
    if ((o->real_count > 0 && !reals) || (o->index_count > 0 && !indices))
        return refuse(m, i, LG_FORMAT, "it has numbers or indices, but this operation takes none");
    node->payload = (uint32_t)(reals ? f->real_count : f->index_count);
    node->payload_count = reals ? o->real_count : o->index_count;
    if (o->real_count > 0) memcpy(f->reals + f->real_count, o->reals, o->real_count * sizeof *o->reals);
    if (o->index_count > 0)
        memcpy(f->indices + f->index_count, o->indices, o->index_count * sizeof *o->indices);
    f->real_count += o->real_count;
    f->index_count += o->index_count;
    return LG_OK;
}

static lg_status take_operation(making *m, size_t i) {
    const lg_operation *o = &m->from->operations[i];
    lg_function *f = &m->f;
    lg_program_node *node = &f->node[i];
    *node = (lg_program_node){
        .first = (uint32_t)f->edge_count, .inputs = o->input_count, .c = o->real, .inverse = o->reciprocal};
    LG_TRY(find_operation(m, i, node));
    if (o->rank > LG_MAX_RANK) return refuse(m, i, LG_FORMAT, "its rank is too high");
    node->rank = o->rank;
    memcpy(node->dims, o->shape, o->rank * sizeof *o->shape);
    if (node->leaf == LG_LEAF_INPUT || node->leaf == LG_LEAF_PARAMETER) {
        if (o->whole[0].rows != 0 || o->whole[0].base < 0 || o->whole[0].base > UINT32_MAX)
            return refuse(m, i, LG_FORMAT, "there is no such input or parameter");
        node->number = (uint32_t)o->whole[0].base;
    } else {
        memcpy(node->i, o->whole, sizeof node->i);
    }
    if (o->input_count > 0) memcpy(f->edges + f->edge_count, o->inputs, o->input_count * sizeof *o->inputs);
    f->edge_count += o->input_count;
    return take_payload(m, i, node);
}

/* Allocates the lists, with the sizes that the operations state. */
static lg_status make_lists(making *m) {
    const lg_context *context = m->program->context;
    const lg_function_image *from = m->from;
    lg_function *f = &m->f;
    uint64_t edges = 0, reals = 0, indices = 0;
    char shown[LG_SHOWN_NAME];
    if (from->operation_count > LG_PROGRAM_MAX_NODES)
        return lg_fail(m->error, LG_FORMAT, "function '%s' has too many operations",
                       lg_shown_name(from->name, shown));
    for (size_t i = 0; i < from->operation_count; i++) {
        const lg_operation *o = &from->operations[i];
        if (o->input_count > LG_MAX_INPUTS) return refuse(m, i, LG_FORMAT, "it has too many inputs");
        edges += o->input_count;
        reals += o->real_count;
        indices += o->index_count;
    }
    if (reals > UINT32_MAX || indices > UINT32_MAX)
        return lg_fail(m->error, LG_FORMAT, "function '%s' has too many numbers",
                       lg_shown_name(from->name, shown));
    f->nodes = (uint32_t)from->operation_count;
    return LG_ALLOC_ALL(context, LG_ARRAY(f->node, f->nodes), LG_ARRAY(f->edges, edges),
                        LG_ARRAY(f->reals, reals), LG_ARRAY(f->indices, indices));
}

static uint32_t *copy_numbers(const lg_context *context, const uint32_t *from, size_t count) {
    uint32_t *made = lg_alloc(context, count, sizeof *made);
    if (made != NULL && count > 0) memcpy(made, from, count * sizeof *made);
    return made;
}

/* Sets unused dimensions to 0. */
static void tidy_ports(lg_port *ports, size_t count) {
    for (size_t i = 0; i < count; i++)
        for (uint32_t d = ports[i].shape.rank; d < LG_MAX_RANK; d++) ports[i].shape.dims[d] = 0;
}

static lg_status make_ports(making *m) {
    const lg_context *context = m->program->context;
    const lg_function_image *from = m->from;
    lg_function *f = &m->f;
    char shown[LG_SHOWN_NAME];
    if (from->input_count < 1 || from->input_count > LG_PROGRAM_MAX_PORTS || from->output_count < 1 ||
        from->output_count > LG_PROGRAM_MAX_PORTS)
        return lg_fail(m->error, LG_INVALID_ARGUMENT,
                       "function '%s' has the wrong number of inputs or outputs: expected 1 to 64 of each",
                       lg_shown_name(from->name, shown));
    f->inputs = from->input_count;
    LG_TRY(lg_ports_copy(context, from->inputs, from->input_count, &f->input));
    f->outputs = from->output_count;
    LG_TRY(lg_ports_copy(context, from->outputs, from->output_count, &f->output));
    tidy_ports(f->input, f->inputs);
    tidy_ports(f->output, f->outputs);
    return LG_OK;
}

static lg_status make_function(making *m) {
    const lg_context *context = m->program->context;
    const lg_function_image *from = m->from;
    lg_function *f = &m->f;
    f->name = lg_strdup(context, from->name != NULL ? from->name : "");
    if (f->name == NULL) return LG_OUT_OF_MEMORY;
    LG_TRY(make_ports(m));
    if (from->times > 0) {
        f->times = from->times;
        f->callee = from->callee;
        f->nodes = (uint32_t)(from->operation_count > 0);
        f->carry = copy_numbers(context, from->carry, from->input_count);
        f->paths = from->path_count;
        if (f->paths > 0) f->path = copy_numbers(context, from->path, f->paths);
        return f->carry != NULL && (f->path != NULL || f->paths == 0) ? LG_OK : LG_OUT_OF_MEMORY;
    }
    LG_TRY(make_lists(m));
    f->result = copy_numbers(context, from->results, from->output_count);
    if (f->result == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < from->operation_count; i++) LG_TRY(take_operation(m, i));
    return LG_OK;
}

lg_status lg_program_add_image(lg_program *program, const lg_function_image *image, lg_error *error) {
    LG_NEEDS(error, program, image);
    making m = {.program = program, .from = image, .error = error};
    lg_error ignored;
    if (error == NULL) m.error = &ignored;
    m.error->message[0] = '\0';
    lg_status status = make_function(&m);
    if (status == LG_OK) status = lg_program_take_function(program, &m.f, m.error);
    if (status == LG_OUT_OF_MEMORY && m.error->message[0] == '\0')
        (void)lg_fail(m.error, status, "no memory for a function");
    lg_function_destroy(program->context, &m.f);
    return status;
}
