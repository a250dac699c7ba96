/* Checks that are made when a function is added to a program. */
#include "autodiff/program/program_check.h"

#include <math.h>
#include <string.h>

#include "autodiff/ops/op_table.h"
#include "autodiff/program/program_call.h"

/* Units are printed in comments of C, so they must not end a comment or contain escapes. */
static bool unit_is_sound(const char *unit) {
    if (unit == NULL) return true;
    for (const char *c = unit; *c != '\0'; c++)
        if ((unsigned char)*c < ' ' || *c == '\x7f' || *c == '\\' || *c == '"' || *c == '?' ||
            (*c == '*' && c[1] == '/') || (*c == '/' && (c[1] == '*' || c[1] == '/')))
            return false;
    return strlen(unit) <= LG_PROGRAM_MAX_NAME;
}

static lg_status check_ports(const lg_function *f, lg_error *error) {
    for (size_t i = 0; i < f->inputs + f->outputs; i++) {
        const lg_port *port = i < f->inputs ? &f->input[i] : &f->output[i - f->inputs];
        LG_TRY(lg_program_check_name(i < f->inputs ? "an input" : "an output", port->name, error));
        for (size_t j = 0; j < i; j++) {
            const lg_port *other = j < f->inputs ? &f->input[j] : &f->output[j - f->inputs];
            if (strcmp(port->name, other->name) == 0)
                return lg_fail(error, LG_INVALID_ARGUMENT,
                               "function '%s' has two inputs or outputs called '%s'", f->name, port->name);
        }
        if (!lg_program_shape_is_sound(&port->shape, port->shared ? LG_MAX_RANK : LG_MAX_RANK - 1))
            return lg_fail(
                error, LG_SHAPE,
                "'%s' of function '%s' is too large, or its rank (with the axis of rows) is above 4",
                port->name, f->name);
        if (!unit_is_sound(port->unit))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "the unit of '%s' of function '%s' is too long, or has characters that a comment "
                           "in C cannot have",
                           port->name, f->name);
        if (!isfinite(port->low) || !isfinite(port->high) || port->low > port->high)
            return lg_fail(
                error, LG_INVALID_ARGUMENT,
                "'%s' of function '%s': low and high must be finite, and low must not be above high",
                port->name, f->name);
    }
    return LG_OK;
}

static lg_status bad_node(const lg_function *f, uint32_t i, const char *why, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "function '%s', operation %u (%s): %s", f->name, i, f->node[i].op->name,
                   why);
}

static lg_status check_leaf(const lg_program *p, const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    if (node->leaf == LG_LEAF_CONSTANT) {
        if (node->payload_count == 0) return bad_node(f, i, "it has no numbers", error);
        return LG_OK;
    }
    const size_t most = node->leaf == LG_LEAF_INPUT ? f->inputs : p->parameters;
    if ((node->leaf != LG_LEAF_INPUT && node->leaf != LG_LEAF_PARAMETER) || node->number >= most)
        return bad_node(f, i, "there is no such input or parameter", error);
    for (size_t rows = 1; rows <= 3; rows++) {
        lg_shape shape, wanted = node->leaf == LG_LEAF_INPUT ? lg_port_shape(&f->input[node->number], rows)
                                                             : p->parameter[node->number].shape;
        if (!lg_node_shape_at(node, rows, &shape) || !lg_same_shape(&shape, &wanted))
            return bad_node(f, i, "its shape differs from the shape of the input or parameter", error);
    }
    return LG_OK;
}

/* A call must go to a function that was added before; so calls cannot recurse. */
static lg_status check_call(const lg_program *p, const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    const lg_affine to = node->i[0], output = node->i[1];
    if (to.rows != 0 || to.base < 0 || (uint64_t)to.base >= p->functions)
        return bad_node(f, i, "it must call a function that comes before this one", error);
    const lg_function *callee = &p->function[to.base];
    if (output.rows != 0 || output.base < 0 || (uint64_t)output.base >= callee->outputs ||
        callee->inputs != node->inputs)
        return bad_node(f, i, "the function that it calls has another number of inputs, or no such output",
                        error);
    for (size_t rows = 1; rows <= 3; rows++)
        for (uint32_t k = 0; k <= node->inputs; k++) {
            const lg_program_node *at = k < node->inputs ? &f->node[f->edges[node->first + k]] : node;
            const lg_shape wanted =
                lg_port_shape(k < node->inputs ? &callee->input[k] : &callee->output[output.base], rows);
            lg_shape there;
            if (!lg_node_shape_at(at, rows, &there) || !lg_same_shape(&there, &wanted))
                return bad_node(f, i, "a shape differs from the one in the function that it calls", error);
        }
    return LG_OK;
}

static lg_status check_payload(const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    const lg_payload payload = node->op->payload;
    if (payload == LG_PAYLOAD_IN_PROCESS)
        return bad_node(f, i, "a custom operation cannot be part of a program", error);
    if (payload != LG_PAYLOAD_REALS && payload != LG_PAYLOAD_INDICES) return LG_OK;
    if (payload == LG_PAYLOAD_REALS && node->payload_count != node->inputs)
        return bad_node(f, i, "the number of its coefficients is not the number of its inputs", error);
    if (payload != LG_PAYLOAD_INDICES) return LG_OK;
    if (node->i[0].rows != 0 || node->i[1].rows != 0 || node->i[0].base != node->payload_count)
        return bad_node(f, i, "the number of its indices is wrong", error);
    for (uint32_t k = 0; k < node->payload_count; k++)
        if ((int64_t)f->indices[node->payload + k] >= node->i[1].base)
            return bad_node(f, i, "an index is out of range", error);
    return LG_OK;
}

/* Checks that shapes and attributes, which are affine in the rows, satisfy the shape rule for 1, 2 and 3
 * rows. lg_plan_create and lg_program_record check them again for their numbers of rows. */
static lg_status check_shapes(const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    lg_shape shapes[LG_MAX_INPUTS], stated, found;
    const lg_shape *in[LG_MAX_INPUTS];
    lg_attr attr;
    for (size_t rows = 1; rows <= 3; rows++) {
        for (uint32_t k = 0; k < node->inputs; k++) {
            (void)lg_node_shape_at(&f->node[f->edges[node->first + k]], rows, &shapes[k]);
            in[k] = &shapes[k];
        }
        if (!lg_node_shape_at(node, rows, &stated) || !lg_node_attr_at(f, node, rows, &attr))
            return bad_node(f, i, "a dimension or attribute is negative or too large", error);
        found = stated;
        if (node->op == &lg_op_leaf) continue;
        const lg_status status = node->op->shape(in, node->inputs, &attr, &found);
        if (status != LG_OK || !lg_same_shape(&found, &stated))
            return bad_node(f, i, "its shape or attributes do not fit its inputs", error);
    }
    return LG_OK;
}

/* Whether the affine number cannot overflow for any number of rows below 2^32. */
static bool affine_within(lg_affine a) {
    const int64_t most = 2 * LG_PROGRAM_MAX_DIM, slope = LG_PROGRAM_MAX_DIM / 2;
    return a.base <= most && a.base >= -most && a.rows <= slope && a.rows >= -slope;
}

static lg_status check_node(const lg_program *p, const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    if (!lg_is_call(node->op) && lg_op_place(node->op) == LG_OPS_MOST)
        return bad_node(f, i, "there is no such operation", error);
    const lg_op *op = node->op;
    if (!isfinite(node->c)) return bad_node(f, i, "an attribute is not finite", error);
    if (node->inputs < op->least || node->inputs > op->most)
        return bad_node(f, i, "it has the wrong number of inputs", error);
    for (uint32_t k = 0; k < node->inputs; k++)
        if (f->edges[node->first + k] >= i)
            return bad_node(f, i, "an input is an operation that comes after it", error);
    bool within = affine_within(node->inverse);
    for (int k = 0; k < 4; k++) within = within && affine_within(node->dims[k]) && affine_within(node->i[k]);
    if (!within) return bad_node(f, i, "a dimension or attribute is too large", error);
    if (node->op == &lg_op_leaf) LG_TRY(check_leaf(p, f, i, error));
    if (lg_is_call(node->op)) LG_TRY(check_call(p, f, i, error));
    LG_TRY(check_payload(f, i, error));
    return check_shapes(f, i, error);
}

static lg_status check_nodes(const lg_program *p, const lg_function *f, lg_error *error) {
    if (f->nodes == 0 || f->nodes > LG_PROGRAM_MAX_NODES)
        return lg_fail(error, LG_FORMAT, "function '%s' has %u operations, expected 1 to %u", f->name,
                       f->nodes, LG_PROGRAM_MAX_NODES);
    for (size_t i = 0; i < f->real_count; i++)
        if (!isfinite(f->reals[i]))
            return lg_fail(error, LG_NOT_FINITE, "function '%s' has a constant that is not finite", f->name);
    for (uint32_t i = 0; i < f->nodes; i++) LG_TRY(check_node(p, f, i, error));
    for (size_t j = 0; j < f->outputs; j++) {
        if (f->result[j] >= f->nodes)
            return lg_fail(
                error, LG_FORMAT,
                "output '%s' of function '%s' refers to an operation that the function does not have",
                f->output[j].name, f->name);
        for (size_t rows = 1; rows <= 3; rows++) {
            lg_shape shape;
            const lg_shape wanted = lg_port_shape(&f->output[j], rows);
            if (!lg_node_shape_at(&f->node[f->result[j]], rows, &shape) || !lg_same_shape(&shape, &wanted))
                return lg_fail(error, LG_FORMAT,
                               "output '%s' of function '%s' has another shape than the function states",
                               f->output[j].name, f->name);
        }
    }
    return LG_OK;
}

static bool same_port(const lg_port *a, const lg_port *b) {
    return a->shared == b->shared && lg_same_shape(&a->shape, &b->shape);
}

/* `from` is the output that becomes this input, or UINT32_MAX. */
static lg_status check_carry(const lg_function *f, const lg_port *input, uint32_t from, lg_error *error) {
    if (from == UINT32_MAX) return LG_OK;
    if (from >= f->outputs)
        return lg_fail(error, LG_FORMAT,
                       "loop '%s': input '%s' is carried from an output that does not exist", f->name,
                       input->name);
    const lg_port *output = &f->output[from];
    if (output->shared != input->shared)
        return lg_fail(error, LG_FORMAT,
                       "loop '%s': output '%s' cannot become input '%s': one of them is shared by all rows, "
                       "the other has a value per row",
                       f->name, output->name, input->name);
    if (!lg_same_shape(&output->shape, &input->shape))
        return lg_fail(error, LG_FORMAT,
                       "loop '%s': output '%s' cannot become input '%s': their shapes differ", f->name,
                       output->name, input->name);
    return LG_OK;
}

static bool is_path(const lg_function *loop, const lg_function *callee, size_t k) {
    const uint32_t of = loop->path[k];
    if (of >= callee->outputs || callee->output[of].shape.rank == LG_MAX_RANK) return false;
    const lg_port wanted = lg_path_port(&callee->output[of], loop->times, NULL);
    return same_port(&wanted, &loop->output[callee->outputs + k]);
}

static lg_status check_loop(const lg_program *p, const lg_function *f, lg_error *error) {
    if (f->times > LG_PROGRAM_MAX_TIMES)
        return lg_fail(error, LG_FORMAT, "loop '%s': times must be at most %u", f->name,
                       LG_PROGRAM_MAX_TIMES);
    if (f->nodes != 0)
        return lg_fail(error, LG_FORMAT, "loop '%s' has operations, but a loop can only repeat a function",
                       f->name);
    if (f->callee >= p->functions)
        return lg_fail(error, LG_FORMAT, "loop '%s' must call a function that comes before it", f->name);
    const lg_function *callee = &p->function[f->callee];
    if (callee->times != 0)
        return lg_fail(error, LG_FORMAT,
                       "loop '%s' calls '%s', which is a loop too: a loop cannot call a loop", f->name,
                       callee->name);
    bool fits = f->inputs == callee->inputs && f->outputs == callee->outputs + f->paths && f->carry != NULL;
    for (size_t i = 0; fits && i < f->inputs; i++) fits = same_port(&f->input[i], &callee->input[i]);
    for (size_t j = 0; fits && j < callee->outputs; j++) fits = same_port(&f->output[j], &callee->output[j]);
    for (size_t k = 0; fits && k < f->paths; k++) fits = is_path(f, callee, k);
    if (!fits)
        return lg_fail(error, LG_FORMAT,
                       "loop '%s' and function '%s', which it calls, have different inputs or outputs",
                       f->name, callee->name);
    for (size_t i = 0; i < f->inputs; i++) LG_TRY(check_carry(f, &f->input[i], f->carry[i], error));
    return LG_OK;
}

lg_status lg_program_check_function(const lg_program *p, const lg_function *f, lg_error *error) {
    LG_TRY(check_ports(f, error));
    size_t nodes = f->nodes;
    for (size_t i = 0; i < p->functions; i++) nodes += p->function[i].nodes;
    if (nodes > LG_PROGRAM_MAX_ALL_NODES)
        return lg_fail(error, LG_FORMAT, "function '%s': the program has more than %u operations", f->name,
                       LG_PROGRAM_MAX_ALL_NODES);
    return f->times > 0 ? check_loop(p, f, error) : check_nodes(p, f, error);
}
