/* Programs: what they own, what is checked when a part is added, looking at them. */
#include "autodiff/op_rows.h"
#include "autodiff/op_table.h"
#include "autodiff/program_call.h"

#include <math.h>
#include <string.h>

/* ---- names ---- */

static const char *const reserved[] = {
    "alignas",
    "alignof",
    "and",
    "and_eq",
    "asm",
    "auto",
    "bitand",
    "bitor",
    "bool",
    "break",
    "case",
    "catch",
    "char",
    "char16_t",
    "char32_t",
    "char8_t",
    "class",
    "co_await",
    "co_return",
    "co_yield",
    "compl",
    "concept",
    "const",
    "const_cast",
    "consteval",
    "constexpr",
    "constinit",
    "continue",
    "decltype",
    "default",
    "delete",
    "do",
    "double",
    "dynamic_cast",
    "else",
    "enum",
    "explicit",
    "export",
    "extern",
    "false",
    "float",
    "for",
    "friend",
    "goto",
    "if",
    "inline",
    "int",
    "long",
    "mutable",
    "namespace",
    "new",
    "noexcept",
    "not",
    "not_eq",
    "nullptr",
    "operator",
    "or",
    "or_eq",
    "private",
    "protected",
    "public",
    "register",
    "reinterpret_cast",
    "requires",
    "restrict",
    "return",
    "short",
    "signed",
    "sizeof",
    "static",
    "static_assert",
    "static_cast",
    "struct",
    "switch",
    "template",
    "this",
    "thread_local",
    "throw",
    "true",
    "try",
    "typedef",
    "typeid",
    "typename",
    "typeof",
    "union",
    "unsigned",
    "using",
    "virtual",
    "void",
    "volatile",
    "wchar_t",
    "while",
    "xor",
    "xor_eq",
};

static bool is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
}

const char *lg_program_name_problem(const char *name) {
    if (name == NULL || name[0] == '\0') return "it is empty";
    if (!is_letter(name[0]) || name[0] == '_') return "it does not begin with a letter";
    size_t length = 0;
    for (; name[length] != '\0'; length++) {
        const char c = name[length];
        if (!is_letter(c) && !(c >= '0' && c <= '9')) return "it is not a C identifier";
        if (c == '_' && name[length + 1] == '_')
            return "it has two underscores together, as C++ reserves them";
        if (length >= LG_PROGRAM_MAX_NAME) return "it is too long";
    }
    for (size_t i = 0; i < LG_COUNT(reserved); i++)
        if (strcmp(name, reserved[i]) == 0) return "it is a word of C or C++";
    return NULL;
}

const char *lg_shown_name(const char *name, char shown[LG_SHOWN_NAME]) {
    size_t n = 0;
    for (; name != NULL && name[n] != '\0' && n + 1 < LG_SHOWN_NAME; n++)
        shown[n] = name[n] >= ' ' && name[n] <= '~' ? name[n] : '?';
    shown[n] = '\0';
    return shown;
}

/* ---- life ---- */

void lg_program_spec_init(lg_program_spec *spec) {
    *spec = (lg_program_spec){.size = sizeof *spec};
}

lg_status lg_program_create(const lg_context *context, lg_program **out) {
    lg_program *made = lg_alloc(context, 1, sizeof *made);
    if (made == NULL) return LG_OUT_OF_MEMORY;
    made->context = context;
    *out = made;
    return LG_OK;
}

static void free_ports(const lg_context *context, lg_port *ports, size_t count) {
    union {
        const char *kept;
        void *memory;
    } text;
    for (size_t i = 0; ports != NULL && i < count; i++) {
        text.kept = ports[i].name;
        lg_free(context, text.memory);
        text.kept = ports[i].unit;
        lg_free(context, text.memory);
    }
    lg_free(context, ports);
}

lg_status lg_ports_copy(const lg_context *context, const lg_port *ports, size_t count, lg_port **out) {
    lg_port *made = lg_alloc(context, count, sizeof *made);
    if (made == NULL) return LG_OUT_OF_MEMORY;
    bool whole = true;
    for (size_t i = 0; i < count; i++) {
        made[i] = ports[i];
        made[i].name = ports[i].name == NULL ? NULL : lg_strdup(context, ports[i].name);
        made[i].unit = ports[i].unit == NULL ? NULL : lg_strdup(context, ports[i].unit);
        whole = whole && (ports[i].name == NULL || made[i].name != NULL) &&
                (ports[i].unit == NULL || made[i].unit != NULL);
    }
    if (!whole) {
        free_ports(context, made, count);
        return LG_OUT_OF_MEMORY;
    }
    *out = made;
    return LG_OK;
}

void lg_function_destroy(const lg_context *context, lg_function *f) {
    free_ports(context, f->input, f->inputs);
    free_ports(context, f->output, f->outputs);
    lg_free(context, f->name);
    lg_free(context, f->node);
    lg_free(context, f->edges);
    lg_free(context, f->reals);
    lg_free(context, f->indices);
    lg_free(context, f->result);
    lg_free(context, f->carry);
    *f = (lg_function){.name = NULL};
}

void lg_program_destroy(lg_program *p) {
    if (p == NULL) return;
    const lg_context *context = p->context;
    for (size_t i = 0; i < p->functions; i++) lg_function_destroy(context, &p->function[i]);
    for (size_t i = 0; i < p->parameters; i++) {
        lg_free(context, p->parameter[i].name);
        lg_free(context, p->parameter[i].values);
    }
    lg_free(context, p->function);
    lg_free(context, p->parameter);
    lg_free(context, p->description);
    lg_free(context, p);
}

/* ---- shapes ---- */

/* Product of dimensions, 1 for 0; false: too large. */
static bool grow_count(size_t *count, size_t length) {
    if (length >= (size_t)LG_PROGRAM_MAX_DIM) return false;
    *count *= length > 0 ? length : 1;
    return *count < (size_t)LG_PROGRAM_MAX_DIM;
}

bool lg_node_shape_at(const lg_program_node *node, size_t rows, lg_shape *shape) {
    *shape = (lg_shape){.rank = node->rank};
    size_t count = 1;
    bool empty = false;
    for (uint32_t d = 0; d < node->rank; d++) {
        const int64_t length = lg_affine_at(node->dims[d], rows);
        if (length < 0 || !grow_count(&count, (size_t)length)) return false;
        shape->dims[d] = (uint32_t)length;
        empty = empty || length == 0;
    }
    return !empty || count <= LG_PROGRAM_MAX_EMPTY;
}

bool lg_node_attr_at(const lg_function *f, const lg_program_node *node, size_t rows, lg_attr *attr) {
    *attr = (lg_attr){.c = node->c};
    if (node->inverse.base != 0 || node->inverse.rows != 0) {
        const int64_t count = lg_affine_at(node->inverse, rows);
        if (count <= 0) return false;
        attr->c = 1.0 / (double)count;
    }
    for (int k = 0; k < 4; k++) {
        const int64_t value = lg_affine_at(node->i[k], rows);
        if (value < 0 || value > (int64_t)UINT32_MAX) return false;
        attr->i[k] = (uint32_t)value;
    }
    const lg_payload payload = node->op->payload;
    if (payload == LG_PAYLOAD_REALS) attr->pointer = f->reals + node->payload;
    if (payload == LG_PAYLOAD_INDICES) attr->pointer = f->indices + node->payload;
    return true;
}

lg_shape lg_port_shape(const lg_port *port, size_t rows) {
    if (port->shared) return port->shape;
    lg_shape shape = {port->shape.rank + 1, {(uint32_t)rows, 0, 0, 0}};
    for (uint32_t d = 0; d < port->shape.rank && d + 1 < LG_MAX_RANK; d++)
        shape.dims[d + 1] = port->shape.dims[d];
    return shape;
}

/* ---- adding parts ---- */

static lg_status check_name(const char *what, const char *name, lg_error *error) {
    const char *problem = lg_program_name_problem(name);
    char shown[LG_SHOWN_NAME];
    return problem == NULL ? LG_OK
                           : lg_fail(error, LG_INVALID_ARGUMENT, "'%s' cannot be the name of %s: %s",
                                     lg_shown_name(name, shown), what, problem);
}

static bool shape_is_sound(const lg_shape *shape, uint32_t most) {
    size_t count = 1;
    for (uint32_t d = 0; shape->rank <= most && d < shape->rank; d++)
        if (!grow_count(&count, shape->dims[d])) return false;
    return shape->rank <= most && (lg_shape_count(*shape) > 0 || count <= LG_PROGRAM_MAX_EMPTY);
}

/* Units stand in comments of C. */
static bool unit_is_sound(const char *unit) {
    if (unit == NULL) return true;
    for (const char *c = unit; *c != '\0'; c++)
        if ((unsigned char)*c < ' ' || *c == '\x7f' || *c == '\\' || *c == '"' || *c == '?' ||
            (*c == '*' && c[1] == '/') || (*c == '/' && (c[1] == '*' || c[1] == '/')))
            return false;
    return strlen(unit) <= LG_PROGRAM_MAX_NAME;
}

lg_status lg_program_add_parameter(lg_program *p, const lg_parameter_spec *spec, lg_error *error) {
    LG_TRY(check_name("a parameter", spec->name, error));
    if (p->parameters == LG_PROGRAM_MAX_PARAMETERS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "more than %d parameters", LG_PROGRAM_MAX_PARAMETERS);
    for (size_t i = 0; i < p->parameters; i++)
        if (strcmp(p->parameter[i].name, spec->name) == 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "two parameters are called '%s'", spec->name);
    if (!shape_is_sound(&spec->shape, LG_MAX_RANK) || spec->values == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "parameter '%s' has no values or is too large",
                       spec->name);
    const size_t count = lg_shape_count(spec->shape);
    for (size_t i = 0; i < count; i++)
        if (!isfinite(spec->values[i]))
            return lg_fail(error, LG_NOT_FINITE, "parameter '%s' has a number that is not finite",
                           spec->name);
    lg_program_parameter_own *grown = lg_alloc(p->context, p->parameters + 1, sizeof *grown);
    lg_program_parameter_own made = {.name = lg_strdup(p->context, spec->name),
                                     .shape = spec->shape,
                                     .count = count,
                                     .values = lg_alloc(p->context, count, sizeof(double))};
    if (grown == NULL || made.name == NULL || made.values == NULL) {
        lg_free(p->context, grown);
        lg_free(p->context, made.name);
        lg_free(p->context, made.values);
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for parameter '%s'", spec->name);
    }
    memcpy(made.values, spec->values, count * sizeof(double));
    if (p->parameters > 0) memcpy(grown, p->parameter, p->parameters * sizeof *grown);
    grown[p->parameters++] = made;
    lg_free(p->context, p->parameter);
    p->parameter = grown;
    return LG_OK;
}

static lg_status check_ports(const lg_function *f, lg_error *error) {
    if (f->inputs < 1 || f->inputs > LG_PROGRAM_MAX_PORTS || f->outputs < 1 ||
        f->outputs > LG_PROGRAM_MAX_PORTS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "function '%s' has no or too many inputs or outputs",
                       f->name);
    for (size_t i = 0; i < f->inputs + f->outputs; i++) {
        const lg_port *port = i < f->inputs ? &f->input[i] : &f->output[i - f->inputs];
        LG_TRY(check_name(i < f->inputs ? "an input" : "an output", port->name, error));
        for (size_t j = 0; j < i; j++) {
            const lg_port *other = j < f->inputs ? &f->input[j] : &f->output[j - f->inputs];
            if (strcmp(port->name, other->name) == 0)
                return lg_fail(error, LG_INVALID_ARGUMENT, "function '%s' has two ports called '%s'", f->name,
                               port->name);
        }
        if (!shape_is_sound(&port->shape, port->shared ? LG_MAX_RANK : LG_MAX_RANK - 1))
            return lg_fail(error, LG_SHAPE,
                           "'%s' of function '%s' has a rank that is too high, or is too large", port->name,
                           f->name);
        if (!unit_is_sound(port->unit))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "the unit of '%s' of function '%s' is too long or cannot stand in a comment of C",
                           port->name, f->name);
        if (!isfinite(port->low) || !isfinite(port->high) || port->low > port->high)
            return lg_fail(error, LG_INVALID_ARGUMENT, "'%s' of function '%s' has a range that is none",
                           port->name, f->name);
    }
    return LG_OK;
}

static lg_status bad_node(const lg_function *f, uint32_t i, const char *why, lg_error *error) {
    const char *name = f->node[i].op != NULL ? f->node[i].op->name : "?";
    return lg_fail(error, LG_FORMAT, "function '%s', operation %u (%s): %s", f->name, i, name, why);
}

static lg_status check_leaf(const lg_program *p, const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    if (node->inputs != 0) return bad_node(f, i, "a leaf has inputs", error);
    if (node->leaf == LG_LEAF_CONSTANT) {
        if (node->payload_count == 0 || node->payload > f->real_count ||
            node->payload_count > f->real_count - node->payload)
            return bad_node(f, i, "its numbers are not there", error);
        return LG_OK;
    }
    const size_t most = node->leaf == LG_LEAF_INPUT ? f->inputs : p->parameters;
    if ((node->leaf != LG_LEAF_INPUT && node->leaf != LG_LEAF_PARAMETER) || node->number >= most)
        return bad_node(f, i, "there is no such input or parameter", error);
    for (size_t rows = 1; rows <= 3; rows++) {
        lg_shape shape, wanted = node->leaf == LG_LEAF_INPUT ? lg_port_shape(&f->input[node->number], rows)
                                                             : p->parameter[node->number].shape;
        if (!lg_node_shape_at(node, rows, &shape) || !lg_same_shape(&shape, &wanted))
            return bad_node(f, i, "its shape is not that of the input or parameter", error);
    }
    return LG_OK;
}

/* Calls go to functions that were there before, so they end. */
static lg_status check_call(const lg_program *p, const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    const lg_affine to = node->i[0], output = node->i[1];
    if (to.rows != 0 || to.base < 0 || (uint64_t)to.base >= p->functions)
        return bad_node(f, i, "it calls no function that was there before", error);
    const lg_function *callee = &p->function[to.base];
    if (output.rows != 0 || output.base < 0 || (uint64_t)output.base >= callee->outputs ||
        callee->inputs != node->inputs)
        return bad_node(f, i, "the function that it calls has other inputs or outputs", error);
    for (size_t rows = 1; rows <= 3; rows++)
        for (uint32_t k = 0; k <= node->inputs; k++) {
            const lg_program_node *at = k < node->inputs ? &f->node[f->edges[node->first + k]] : node;
            const lg_shape wanted =
                lg_port_shape(k < node->inputs ? &callee->input[k] : &callee->output[output.base], rows);
            lg_shape there;
            if (!lg_node_shape_at(at, rows, &there) || !lg_same_shape(&there, &wanted))
                return bad_node(f, i, "shapes are not those of the function that it calls", error);
        }
    return LG_OK;
}

static lg_status check_payload(const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    const lg_payload payload = node->op->payload;
    if (payload == LG_PAYLOAD_IN_PROCESS)
        return bad_node(f, i, "an operation of the caller's own lives in the process only", error);
    if (payload != LG_PAYLOAD_REALS && payload != LG_PAYLOAD_INDICES) return LG_OK;
    const size_t there = payload == LG_PAYLOAD_REALS ? f->real_count : f->index_count;
    if (node->payload > there || node->payload_count > there - node->payload)
        return bad_node(f, i, "its payload is not there", error);
    if (payload == LG_PAYLOAD_REALS && node->payload_count != node->inputs)
        return bad_node(f, i, "it has not one coefficient for each input", error);
    if (payload != LG_PAYLOAD_INDICES) return LG_OK;
    if (node->i[0].rows != 0 || node->i[1].rows != 0 || node->i[0].base != node->payload_count)
        return bad_node(f, i, "the number of its indices is wrong", error);
    for (uint32_t k = 0; k < node->payload_count; k++)
        if ((int64_t)f->indices[node->payload + k] >= node->i[1].base)
            return bad_node(f, i, "an index is out of range", error);
    return LG_OK;
}

/* Affine shapes and attributes satisfy the shape rule at these numbers of rows; lg_plan_create and
 * lg_program_record ask it again at theirs. */
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

/* No overflow for any number of rows that fits into 32 bits. */
static bool affine_within(lg_affine a) {
    const int64_t most = 2 * LG_PROGRAM_MAX_DIM, slope = LG_PROGRAM_MAX_DIM / 2;
    return a.base <= most && a.base >= -most && a.rows <= slope && a.rows >= -slope;
}

static lg_status check_node(const lg_program *p, const lg_function *f, uint32_t i, lg_error *error) {
    const lg_program_node *node = &f->node[i];
    if (node->op == NULL || (node->op != &lg_op_call && lg_op_place(node->op) == LG_OPS_MOST))
        return bad_node(f, i, "there is no such operation", error);
    const lg_op *op = node->op;
    if (node->rank > LG_MAX_RANK) return bad_node(f, i, "its rank is too high", error);
    if (!isfinite(node->c)) return bad_node(f, i, "an attribute is not finite", error);
    if (node->inputs < op->least || node->inputs > op->most || node->first > f->edge_count ||
        node->inputs > f->edge_count - node->first)
        return bad_node(f, i, "it has not the right number of inputs", error);
    for (uint32_t k = 0; k < node->inputs; k++)
        if (f->edges[node->first + k] >= i) return bad_node(f, i, "an input comes after it", error);
    bool within = affine_within(node->inverse);
    for (int k = 0; k < 4; k++) within = within && affine_within(node->dims[k]) && affine_within(node->i[k]);
    if (!within) return bad_node(f, i, "a dimension or attribute is too large", error);
    if (node->op == &lg_op_leaf) LG_TRY(check_leaf(p, f, i, error));
    if (node->op == &lg_op_call) LG_TRY(check_call(p, f, i, error));
    LG_TRY(check_payload(f, i, error));
    return check_shapes(f, i, error);
}

static lg_status check_nodes(const lg_program *p, const lg_function *f, lg_error *error) {
    if (f->nodes == 0 || f->nodes > LG_PROGRAM_MAX_NODES)
        return lg_fail(error, LG_FORMAT, "function '%s' has no or too many operations", f->name);
    for (size_t i = 0; i < f->real_count; i++)
        if (!isfinite(f->reals[i]))
            return lg_fail(error, LG_NOT_FINITE, "function '%s' has a constant that is not finite", f->name);
    for (uint32_t i = 0; i < f->nodes; i++) LG_TRY(check_node(p, f, i, error));
    for (size_t j = 0; j < f->outputs; j++) {
        if (f->result[j] >= f->nodes)
            return lg_fail(error, LG_FORMAT, "output '%s' of function '%s' is no operation of it",
                           f->output[j].name, f->name);
        for (size_t rows = 1; rows <= 3; rows++) {
            lg_shape shape;
            const lg_shape wanted = lg_port_shape(&f->output[j], rows);
            if (!lg_node_shape_at(&f->node[f->result[j]], rows, &shape) || !lg_same_shape(&shape, &wanted))
                return lg_fail(error, LG_FORMAT, "output '%s' of function '%s' has another shape than stated",
                               f->output[j].name, f->name);
        }
    }
    return LG_OK;
}

static bool same_port(const lg_port *a, const lg_port *b) {
    return a->shared == b->shared && lg_same_shape(&a->shape, &b->shape);
}

static lg_status check_loop(const lg_program *p, const lg_function *f, lg_error *error) {
    if (f->times > LG_PROGRAM_MAX_TIMES)
        return lg_fail(error, LG_FORMAT, "loop '%s' is run more than %u times", f->name,
                       LG_PROGRAM_MAX_TIMES);
    if (f->nodes != 0 || f->callee >= p->functions || p->function[f->callee].times != 0)
        return lg_fail(error, LG_FORMAT,
                       "loop '%s' calls no function that was there before it, or another loop", f->name);
    const lg_function *callee = &p->function[f->callee];
    bool fits = f->inputs == callee->inputs && f->outputs == callee->outputs && f->carry != NULL;
    for (size_t i = 0; fits && i < f->inputs; i++) {
        fits = same_port(&f->input[i], &callee->input[i]);
        if (f->carry[i] != UINT32_MAX)
            fits = fits && f->carry[i] < f->outputs && same_port(&f->input[i], &callee->output[f->carry[i]]);
    }
    for (size_t j = 0; fits && j < f->outputs; j++) fits = same_port(&f->output[j], &callee->output[j]);
    return fits ? LG_OK
                : lg_fail(error, LG_FORMAT, "loop '%s' has other ports than the function that it calls",
                          f->name);
}

lg_status lg_program_add_function(lg_program *p, lg_function *f, lg_error *error) {
    size_t there;
    LG_TRY(check_name("a function", f->name, error));
    if (lg_program_find(p, f->name, &there) == LG_OK)
        return lg_fail(error, LG_INVALID_ARGUMENT, "two functions are called '%s'", f->name);
    if (p->functions == LG_PROGRAM_MAX_FUNCTIONS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "more than %d functions", LG_PROGRAM_MAX_FUNCTIONS);
    LG_TRY(check_ports(f, error));
    size_t nodes = f->nodes;
    for (size_t i = 0; i < p->functions; i++) nodes += p->function[i].nodes;
    if (nodes > LG_PROGRAM_MAX_ALL_NODES)
        return lg_fail(error, LG_FORMAT, "function '%s': the program has more than %u operations", f->name,
                       LG_PROGRAM_MAX_ALL_NODES);
    LG_TRY(f->times > 0 ? check_loop(p, f, error) : check_nodes(p, f, error));
    if (p->functions == p->capacity) {
        const size_t capacity = p->capacity == 0 ? 8 : 2 * p->capacity;
        lg_function *grown = lg_alloc(p->context, capacity, sizeof *grown);
        if (grown == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for function '%s'", f->name);
        if (p->functions > 0) memcpy(grown, p->function, p->functions * sizeof *grown);
        lg_free(p->context, p->function);
        p->function = grown;
        p->capacity = capacity;
    }
    p->function[p->functions++] = *f;
    *f = (lg_function){.name = NULL};
    return LG_OK;
}

lg_status lg_program_add_loop(lg_program *p, const char *name, const char *function, size_t times,
                              const lg_carry *carry, size_t carry_count, lg_error *error) {
    size_t callee;
    LG_TRY(check_name("a function", name, error));
    if (function == NULL || lg_program_find(p, function, &callee) != LG_OK)
        return lg_fail(error, LG_NOT_FOUND, "there is no function '%s'", function != NULL ? function : "");
    if (times < 1 || times > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "loop '%s' is run %zu times", name, times);
    const lg_function *of = &p->function[callee];
    lg_function f = {
        .inputs = of->inputs, .outputs = of->outputs, .times = (uint32_t)times, .callee = (uint32_t)callee};
    f.name = lg_strdup(p->context, name);
    f.carry = lg_alloc(p->context, of->inputs, sizeof *f.carry);
    lg_status status = f.name == NULL || f.carry == NULL ? LG_OUT_OF_MEMORY : LG_OK;
    if (status == LG_OK) status = lg_ports_copy(p->context, of->input, of->inputs, &f.input);
    if (status == LG_OK) status = lg_ports_copy(p->context, of->output, of->outputs, &f.output);
    for (size_t i = 0; status == LG_OK && i < of->inputs; i++) f.carry[i] = UINT32_MAX;
    for (size_t c = 0; status == LG_OK && c < carry_count; c++) {
        size_t i = 0, j = 0;
        while (i < of->inputs && strcmp(of->input[i].name, carry[c].input) != 0) i++;
        while (j < of->outputs && strcmp(of->output[j].name, carry[c].output) != 0) j++;
        if (i == of->inputs || j == of->outputs)
            status = lg_fail(error, LG_NOT_FOUND, "function '%s' has no input '%s' or no output '%s'",
                             function, carry[c].input, carry[c].output);
        else if (f.carry[i] != UINT32_MAX)
            status = lg_fail(error, LG_INVALID_ARGUMENT, "loop '%s': input '%s' is carried twice", name,
                             carry[c].input);
        else
            f.carry[i] = (uint32_t)j;
    }
    if (status == LG_OK) status = lg_program_add_function(p, &f, error);
    if (status == LG_OUT_OF_MEMORY) (void)lg_fail(error, status, "no memory for loop '%s'", name);
    if (status == LG_FORMAT) {
        status = LG_INVALID_ARGUMENT;
        if (error != NULL) error->status = status;
    }
    lg_function_destroy(p->context, &f);
    return status;
}

/* ---- looking ---- */

size_t lg_program_functions(const lg_program *p) {
    return p->functions;
}

const char *lg_program_function_name(const lg_program *p, size_t function) {
    return function < p->functions ? p->function[function].name : NULL;
}

lg_status lg_program_find(const lg_program *p, const char *name, size_t *function) {
    for (size_t i = 0; name != NULL && i < p->functions; i++)
        if (strcmp(p->function[i].name, name) == 0) {
            *function = i;
            return LG_OK;
        }
    return LG_NOT_FOUND;
}

const lg_port *lg_program_inputs(const lg_program *p, size_t function, size_t *count) {
    *count = function < p->functions ? p->function[function].inputs : 0;
    return function < p->functions ? p->function[function].input : NULL;
}

const lg_port *lg_program_outputs(const lg_program *p, size_t function, size_t *count) {
    *count = function < p->functions ? p->function[function].outputs : 0;
    return function < p->functions ? p->function[function].output : NULL;
}

size_t lg_program_parameters(const lg_program *p) {
    return p->parameters;
}

lg_parameter_spec lg_program_parameter(const lg_program *p, size_t index) {
    if (index >= p->parameters) return (lg_parameter_spec){.name = NULL};
    const lg_program_parameter_own *own = &p->parameter[index];
    return (lg_parameter_spec){own->name, own->shape, own->values};
}

lg_status lg_program_set_parameter(lg_program *p, size_t index, const double *values) {
    if (index >= p->parameters) return LG_NOT_FOUND;
    const lg_program_parameter_own *own = &p->parameter[index];
    for (size_t i = 0; i < own->count; i++)
        if (!isfinite(values[i])) return LG_NOT_FINITE;
    memcpy(own->values, values, own->count * sizeof *values);
    return LG_OK;
}

const char *lg_program_description(const lg_program *p) {
    return p->description != NULL ? p->description : "";
}

size_t lg_program_operations(const lg_program *p, size_t function) {
    size_t count = 0;
    if (function >= p->functions) return 0;
    const lg_function *f = &p->function[function];
    for (uint32_t i = 0; i < f->nodes; i++) count += f->node[i].op != &lg_op_leaf;
    return count;
}
