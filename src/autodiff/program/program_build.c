/* Makes functions from recordings.
 *
 * A function is recorded at three numbers of rows and several points. All recordings must have the same
 * structure. Every dimension and whole-number attribute must be affine in the rows; a real attribute must be
 * constant or the reciprocal of an affine number (a mean); a constant must be the same everywhere, or consist
 * of equal rows. Only nodes that the outputs need are compared and kept. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program_call.h"

/* What consists of known operations, such as a derivative, is the same at all values: three numbers of rows
 * suffice, and nothing is computed. A caller's own code may branch on values, which recordings at more points
 * reveal. */
enum { RECORDINGS = 8, OF_KNOWN = 3 };
static const size_t rows_of[RECORDINGS] = {2, 3, 5, 2, 3, 2, 3, 2};

typedef struct recording {
    lg_tape *tape;
    lg_var *output;
    lg_calls calls;
} recording;

typedef struct building {
    lg_program *program;
    const lg_function_spec *spec;
    recording r[RECORDINGS];
    size_t recordings;
    uint32_t *place; /* for each node of the tapes: 1 + its index in the function; 0: not needed */
    uint32_t count;  /* number of nodes on each tape */
    lg_function made;
    lg_error *error;
} building;

static void *memory(const building *b, size_t count, size_t size) {
    return lg_alloc(b->program->context, count, size);
}

/* ---- recording ---- */

/* A dry tape does not read values, so its leaves need no memory: any address stands for them. */
static lg_var parameter_leaf(lg_tape *tape, const lg_program_parameter_own *p, lg_rng *rng, bool moved) {
    void *values = NULL;
    if (tape->dry) return lg_parameter(tape, p->shape, tape);
    const lg_var leaf = lg_input_buffer(tape, p->shape, &values);
    double *to = values;
    for (size_t i = 0; to != NULL && i < p->count; i++) {
        const double shift =
            moved ? 0.05 * lg_rng_uniform_in(rng, -1.0, 1.0) * (fabs(p->values[i]) + 0.1) : 0.0;
        to[i] = p->values[i] + shift;
    }
    return leaf;
}

static lg_var input_leaf(lg_tape *tape, const lg_port *port, size_t rows, lg_rng *rng) {
    const bool ranged = port->low != 0.0 || port->high != 0.0;
    const lg_shape shape = lg_port_shape(port, rows);
    void *values = NULL;
    if (tape->dry) return lg_parameter(tape, shape, tape);
    const lg_var leaf = lg_input_buffer(tape, shape, &values);
    double *to = values;
    for (size_t i = 0; to != NULL && i < lg_shape_count(shape); i++)
        to[i] = lg_rng_uniform_in(rng, ranged ? port->low : -1.0, ranged ? port->high : 1.0);
    return leaf;
}

/* Records the function once. The first leaves on the tape are the parameters, followed by the inputs. */
static lg_status record(building *b, size_t which, lg_var *leaves) {
    const lg_program *p = b->program;
    const lg_function_spec *spec = b->spec;
    lg_tape *tape = b->r[which].tape;
    lg_rng rng;
    lg_rng_seed(&rng, 20, which);
    lg_tape_reset(tape);
    for (size_t i = 0; i < p->parameters; i++)
        leaves[i] = parameter_leaf(tape, &p->parameter[i], &rng, which > 0);
    for (size_t i = 0; i < spec->input_count; i++)
        leaves[p->parameters + i] = input_leaf(tape, &spec->inputs[i], rows_of[which], &rng);
    for (size_t j = 0; j < spec->output_count; j++) b->r[which].output[j] = LG_NONE;
    b->r[which].calls.program = p;
    b->r[which].calls.parameters = leaves;
    b->r[which].calls.count = 0;
    tape->calls = &b->r[which].calls;
    const lg_status status =
        spec->record(spec->user, tape, leaves, leaves + p->parameters, b->r[which].output);
    tape->calls = NULL;
    if (lg_tape_status(tape) != LG_OK)
        return lg_fail(b->error, lg_tape_status(tape), "function '%s': %s", spec->name,
                       lg_tape_message(tape));
    if (status != LG_OK)
        return lg_fail(b->error, status, "function '%s': the callback `record` failed: %s", spec->name,
                       lg_status_sentence(status));
    if (lg_node_of(tape, leaves[p->parameters + spec->input_count - 1], "input") == NULL)
        return lg_fail(b->error, LG_INVALID_ARGUMENT,
                       "function '%s': the callback `record` has reset the tape, which it must not do",
                       spec->name);
    for (size_t j = 0; j < spec->output_count; j++)
        if (lg_node_of(tape, b->r[which].output[j], "output") == NULL)
            return lg_fail(
                b->error, LG_INVALID_ARGUMENT,
                "function '%s': the callback `record` has not set output '%s' to a variable of the tape",
                spec->name, spec->outputs[j].name);
    return LG_OK;
}

static lg_status record_all(building *b) {
    const lg_context *context = b->program->context;
    const size_t leaves = b->program->parameters + b->spec->input_count;
    LG_TRY_SCRATCH(lg_var, leaf, context, leaves, LG_OUT_OF_MEMORY);
    for (size_t k = 0; k < b->recordings; k++) {
        b->r[k].output = memory(b, b->spec->output_count, sizeof *b->r[k].output);
        if (b->r[k].output == NULL) return LG_OUT_OF_MEMORY;
        LG_TRY(lg_tape_create(context, NULL, &b->r[k].tape));
        if (b->recordings == OF_KNOWN) lg_tape_set_dry(b->r[k].tape);
        LG_TRY(record(b, k, leaf));
    }
    return LG_OK;
}

/* ---- refusal of a function ---- */

static const lg_node *node_in(const building *b, size_t which, uint32_t i) {
    return &b->r[which].tape->nodes[i];
}

/* Finds the scope in which node `i` is recorded, by repeating the first recording with a watch on the
 * node. */
static void look_at(building *b, uint32_t i) {
    lg_var leaves[LG_PROGRAM_MAX_PARAMETERS + LG_PROGRAM_MAX_PORTS];
    lg_tape *tape = b->r[0].tape;
    lg_error *error = b->error;
    tape->watch = i + 1;
    b->error = NULL;
    (void)record(b, 0, leaves);
    b->error = error;
}

/* Name of the first operation that uses node i. */
static const char *taken_by(const building *b, uint32_t i) {
    const lg_tape *tape = b->r[0].tape;
    for (uint32_t j = i + 1; j < b->count; j++)
        for (uint32_t k = 0; k < tape->nodes[j].inputs; k++)
            if (tape->parents[tape->nodes[j].parents + k] == i) return tape->nodes[j].op->name;
    return "an output";
}

static lg_status refuse(building *b, uint32_t i, const char *why) {
    const lg_node *node = node_in(b, 0, i);
    const char *name = node->op->name, *by = taken_by(b, i);
    const bool leaf = node->op == &lg_op_leaf;
    look_at(b, i);
    const char *where = b->r[0].tape->watched;
    return lg_fail(b->error, LG_UNSUPPORTED, "function '%s': %s%s%s%s%s: %s", b->spec->name,
                   leaf ? "a constant used by " : "operation ", leaf ? by : name,
                   where[0] != '\0' ? " (in " : "", where, where[0] != '\0' ? ")" : "", why);
}

/* ---- comparison of the structures ---- */

static lg_status refuse_structure(const building *b, uint32_t i) {
    const uint32_t last = i < b->count ? i : b->count - 1;
    return lg_fail(
        b->error, LG_UNSUPPORTED,
        "function '%s': recordings with different numbers of rows or different values have different "
        "operations, from number %u (%s) on: a program cannot branch on values or loop over rows",
        b->spec->name, i, node_in(b, 0, last)->op->name);
}

static lg_status compare_structure(const building *b) {
    const lg_tape *first = b->r[0].tape;
    for (size_t k = 1; k < b->recordings; k++) {
        const lg_tape *other = b->r[k].tape;
        for (uint32_t i = 0; i < b->count; i++) {
            if (i >= other->count) return refuse_structure(b, i);
            const lg_node *x = &first->nodes[i], *y = &other->nodes[i];
            if (x->op != y->op || x->inputs != y->inputs || x->shape.rank != y->shape.rank)
                return refuse_structure(b, i);
            for (uint32_t j = 0; j < x->inputs; j++)
                if (first->parents[x->parents + j] != other->parents[y->parents + j])
                    return refuse_structure(b, i);
        }
        if (other->count != b->count) return refuse_structure(b, b->count);
        for (size_t j = 0; j < b->spec->output_count; j++)
            if (b->r[0].output[j].index != b->r[k].output[j].index)
                return refuse_structure(b, b->r[0].output[j].index);
        for (size_t c = 0; c < b->r[0].calls.count; c++)
            if (b->r[k].calls.count != b->r[0].calls.count ||
                memcmp(&b->r[k].calls.mark[c], &b->r[0].calls.mark[c], sizeof(lg_call_mark)) != 0)
                return refuse_structure(b, b->r[0].calls.mark[c].result);
    }
    return LG_OK;
}

/* The nodes that node i of the first tape depends on in the function. For the result of a call, these are the
 * inputs of the call. */
typedef struct taking {
    const lg_call_mark *call; /* NULL: the node is an ordinary operation */
    const uint32_t *nodes;
    uint32_t count;
} taking;

static taking taken_from(const building *b, uint32_t i) {
    const lg_tape *tape = b->r[0].tape;
    const lg_call_mark *call = lg_calls_find(&b->r[0].calls, i);
    if (call != NULL)
        return (taking){call, call->input, (uint32_t)b->program->function[call->function].inputs};
    return (taking){NULL, tape->parents + tape->nodes[i].parents, tape->nodes[i].inputs};
}

/* Marks the nodes that the outputs need, and numbers them. Needed parameters and inputs stay leaves. Returns
 * the number of marked nodes. */
static uint32_t number_nodes(building *b) {
    uint32_t nodes = 0;
    for (size_t j = 0; j < b->spec->output_count; j++) b->place[b->r[0].output[j].index] = 1;
    for (uint32_t i = b->count; i-- > 0;) {
        if (b->place[i] == 0) continue;
        const taking from = taken_from(b, i);
        for (uint32_t k = 0; k < from.count; k++) b->place[from.nodes[k]] = 1;
    }
    for (uint32_t i = 0; i < b->count; i++)
        if (b->place[i] != 0) b->place[i] = ++nodes;
    return nodes;
}

/* ---- attributes and payload ---- */

static bool affine_of(const building *b, const int64_t *value, lg_affine *out) {
    out->rows = (value[1] - value[0]) / (int64_t)(rows_of[1] - rows_of[0]);
    out->base = value[0] - out->rows * (int64_t)rows_of[0];
    for (size_t k = 0; k < b->recordings; k++)
        if (lg_affine_at(*out, rows_of[k]) != value[k]) return false;
    return true;
}

static bool affine_shape(const building *b, uint32_t i, lg_program_node *node) {
    node->rank = node_in(b, 0, i)->shape.rank;
    for (uint32_t d = 0; d < node->rank; d++) {
        int64_t value[RECORDINGS] = {0};
        for (size_t k = 0; k < b->recordings; k++) value[k] = node_in(b, k, i)->shape.dims[d];
        if (!affine_of(b, value, &node->dims[d])) return false;
    }
    return true;
}

static bool affine_attributes(const building *b, uint32_t i, lg_program_node *node) {
    for (int a = 0; a < 4; a++) {
        int64_t value[RECORDINGS] = {0};
        for (size_t k = 0; k < b->recordings; k++) value[k] = node_in(b, k, i)->attr.i[a];
        if (!affine_of(b, value, &node->i[a])) return false;
    }
    return true;
}

/* attr.c must be the same in all recordings, or the reciprocal of an affine number. */
static bool real_attribute(const building *b, uint32_t i, lg_program_node *node) {
    int64_t count[RECORDINGS] = {0};
    bool same = true, reciprocal = true;
    node->c = node_in(b, 0, i)->attr.c;
    for (size_t k = 0; k < b->recordings; k++) {
        const double c = node_in(b, k, i)->attr.c, inverse = 1.0 / c;
        same = same && memcmp(&c, &node->c, sizeof c) == 0;
        reciprocal = reciprocal && inverse >= 1.0 && inverse < 0x1p31;
        count[k] = reciprocal ? (int64_t)(inverse + 0.5) : 0;
        reciprocal = reciprocal && 1.0 / (double)count[k] == c;
    }
    if (same) return true;
    node->c = 0.0;
    return reciprocal && affine_of(b, count, &node->inverse);
}

static bool same_payload(const building *b, uint32_t i, size_t bytes) {
    for (size_t k = 1; k < b->recordings; k++)
        if (memcmp(node_in(b, 0, i)->attr.pointer, node_in(b, k, i)->attr.pointer, bytes) != 0) return false;
    return true;
}

/* Appends a payload to one of the function's lists. */
static lg_status append(building *b, lg_program_node *node, void **list, size_t *length, const void *values,
                        size_t count, size_t size) {
    unsigned char *grown = *length + count <= UINT32_MAX ? memory(b, *length + count + 1, size) : NULL;
    if (grown == NULL) return LG_OUT_OF_MEMORY;
    if (*length > 0) memcpy(grown, *list, *length * size);
    memcpy(grown + *length * size, values, count * size);
    lg_free(b->program->context, *list);
    *list = grown;
    node->payload = (uint32_t)*length;
    node->payload_count = (uint32_t)count;
    *length += count;
    return LG_OK;
}

static lg_status add_reals(building *b, lg_program_node *node, const double *values, size_t count) {
    lg_function *f = &b->made;
    return append(b, node, (void **)&f->reals, &f->real_count, values, count, sizeof *values);
}

static lg_status add_indices(building *b, lg_program_node *node, const uint32_t *values, size_t count) {
    lg_function *f = &b->made;
    return append(b, node, (void **)&f->indices, &f->index_count, values, count, sizeof *values);
}

static lg_status payload(building *b, uint32_t i, lg_program_node *node) {
    const lg_node *from = node_in(b, 0, i);
    switch (from->op->payload) {
    case LG_PAYLOAD_REALS:
        if (!same_payload(b, i, from->inputs * sizeof(double)))
            return refuse(b, i, "its coefficients depend on values or on the number of rows");
        return add_reals(b, node, from->attr.pointer, from->inputs);
    case LG_PAYLOAD_INDICES:
        if (node->i[0].rows != 0 || node->i[1].rows != 0 ||
            !same_payload(b, i, from->attr.i[0] * sizeof(uint32_t)))
            return refuse(b, i, "its indices depend on values or on the number of rows");
        return add_indices(b, node, from->attr.pointer, from->attr.i[0]);
    default: /* LG_PAYLOAD_IN_PROCESS is refused before this */
        return LG_OK;
    }
}

/* ---- leaves ---- */

static bool repeats(const double *values, size_t count, const double *row, size_t period) {
    for (size_t j = 0; j < count; j++)
        if (memcmp(&values[j], &row[j % period], sizeof *row) != 0) return false;
    return true;
}

/* Tries three forms, in this order: one number repeated; one row repeated, if the first axis is the batch;
 * all numbers. */
static lg_status constant(building *b, uint32_t i, lg_program_node *node) {
    const lg_node *first = node_in(b, 0, i);
    const double *values = first->value;
    const size_t along =
        first->shape.rank > 0 && first->shape.dims[0] > 0 ? first->count / first->shape.dims[0] : 0;
    const size_t periods[3] = {1, along, first->count};
    static const double nothing;
    if (first->count == 0) values = &nothing;
    for (size_t c = 0; c < LG_COUNT(periods); c++) {
        bool fits = periods[c] > 0;
        for (size_t k = 0; fits && k < b->recordings; k++) {
            const lg_node *other = node_in(b, k, i);
            fits = (c < 2 || other->count == first->count) &&
                   repeats(other->value, other->count, values, periods[c]);
        }
        if (fits) return add_reals(b, node, values, periods[c]);
    }
    return refuse(b, i,
                  "its values differ from one recording to another: declare it as an input or a parameter, "
                  "or compute it with operations");
}

static lg_status leaf(building *b, uint32_t i, lg_program_node *node) {
    const size_t parameters = b->program->parameters;
    if (i < parameters) {
        node->leaf = LG_LEAF_PARAMETER;
        node->number = i;
    } else if (i < parameters + b->spec->input_count) {
        node->leaf = LG_LEAF_INPUT;
        node->number = i - (uint32_t)parameters;
    } else {
        node->leaf = LG_LEAF_CONSTANT;
        return constant(b, i, node);
    }
    return LG_OK;
}

/* ---- nodes and outputs ---- */

static lg_status node(building *b, uint32_t i, lg_program_node *out) {
    const lg_node *from = &b->r[0].tape->nodes[i];
    const taking takes = taken_from(b, i);
    lg_function *f = &b->made;
    *out = (lg_program_node){.op = from->op, .inputs = takes.count, .first = (uint32_t)f->edge_count};
    for (uint32_t k = 0; k < takes.count; k++) f->edges[f->edge_count++] = b->place[takes.nodes[k]] - 1;
    if (!affine_shape(b, i, out)) return refuse(b, i, "its shape is not affine in the number of rows");
    if (takes.call != NULL) {
        out->op = &lg_op_call;
        out->i[0].base = takes.call->function;
        out->i[1].base = takes.call->output;
        return LG_OK;
    }
    if (!affine_attributes(b, i, out))
        return refuse(b, i, "an attribute is not affine in the number of rows");
    for (uint32_t k = 0; k < LG_WHOLE_COUNT; k++)
        if (from->op->follows >> k & 1) out->i[k] = (lg_affine){0, 0};
    if (!real_attribute(b, i, out)) return refuse(b, i, "an attribute depends on values");
    return from->op == &lg_op_leaf ? leaf(b, i, out) : payload(b, i, out);
}

/* Sets whether the output is shared by all rows, and its shape (of one row, or of the whole if shared). */
static lg_status output_port(building *b, size_t j, lg_port *port) {
    const lg_program_node *from = &b->made.node[b->made.result[j]];
    bool batched = from->rank > 0 && from->dims[0].base == 0 && from->dims[0].rows == 1, fixed = true;
    for (uint32_t d = 0; d < from->rank; d++) {
        fixed = fixed && from->dims[d].rows == 0;
        batched = batched && (d == 0 || from->dims[d].rows == 0);
    }
    if (!batched && !fixed)
        return lg_fail(b->error, LG_UNSUPPORTED,
                       "function '%s': output '%s' has neither one value per row, shape (B, ...), nor one "
                       "value for all rows",
                       b->spec->name, port->name);
    port->shared = fixed;
    port->shape = (lg_shape){.rank = fixed ? from->rank : from->rank - 1};
    for (uint32_t d = 0; d < port->shape.rank; d++)
        port->shape.dims[d] = (uint32_t)from->dims[fixed ? d : d + 1].base;
    return LG_OK;
}

/* This is checked first, because the inputs of such an operation may be constants that differ between
 * recordings; otherwise the error message would name these constants. */
static lg_status refuse_custom(building *b) {
    for (uint32_t i = 0; i < b->count; i++)
        if (b->place[i] != 0 && node_in(b, 0, i)->op->payload == LG_PAYLOAD_IN_PROCESS)
            return refuse(
                b, i, "a custom operation exists in this process only, so it cannot be part of a program");
    return LG_OK;
}

static lg_status make_nodes(building *b) {
    lg_function *f = &b->made;
    size_t edges = 0;
    f->nodes = number_nodes(b);
    for (uint32_t i = 0; i < b->count; i++) edges += b->place[i] != 0 ? taken_from(b, i).count : 0;
    f->node = memory(b, f->nodes, sizeof *f->node);
    f->edges = memory(b, edges + 1, sizeof *f->edges);
    f->result = memory(b, f->outputs, sizeof *f->result);
    if (f->node == NULL || f->edges == NULL || f->result == NULL) return LG_OUT_OF_MEMORY;
    LG_TRY(refuse_custom(b));
    for (uint32_t i = 0; i < b->count; i++)
        if (b->place[i] != 0) LG_TRY(node(b, i, &f->node[b->place[i] - 1]));
    for (size_t j = 0; j < f->outputs; j++) {
        f->result[j] = b->place[b->r[0].output[j].index] - 1;
        LG_TRY(output_port(b, j, &f->output[j]));
    }
    return LG_OK;
}

static lg_status make(building *b) {
    const lg_context *context = b->program->context;
    const lg_function_spec *spec = b->spec;
    lg_function *f = &b->made;
    LG_TRY(record_all(b));
    b->count = b->r[0].tape->count;
    LG_TRY(compare_structure(b));
    b->place = memory(b, b->count, sizeof *b->place);
    f->name = lg_strdup(context, spec->name);
    f->inputs = spec->input_count;
    f->outputs = spec->output_count;
    if (b->place == NULL || f->name == NULL) return LG_OUT_OF_MEMORY;
    LG_TRY(lg_ports_copy(context, spec->inputs, spec->input_count, &f->input));
    LG_TRY(lg_ports_copy(context, spec->outputs, spec->output_count, &f->output));
    LG_TRY(make_nodes(b));
    return lg_program_take_function(b->program, f, b->error);
}

static lg_status check_spec(const lg_function_spec *spec, lg_error *error) {
    if (spec->record == NULL || spec->inputs == NULL || spec->outputs == NULL || spec->input_count < 1 ||
        spec->output_count < 1 || spec->input_count > LG_PROGRAM_MAX_PORTS ||
        spec->output_count > LG_PROGRAM_MAX_PORTS)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a function needs the callback `record`, 1 to %d inputs and 1 to %d outputs",
                       LG_PROGRAM_MAX_PORTS, LG_PROGRAM_MAX_PORTS);
    const char *problem = lg_program_name_problem(spec->name);
    if (problem != NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a function's name cannot be its name: %s", problem);
    for (size_t i = 0; i < spec->input_count; i++) {
        const lg_port *port = &spec->inputs[i];
        if (port->shape.rank > (port->shared ? LG_MAX_RANK : LG_MAX_RANK - 1) ||
            lg_shape_count(port->shape) >= (size_t)LG_PROGRAM_MAX_DIM / 8)
            return lg_fail(
                error, LG_SHAPE,
                "function '%s': input %zu is too large, or its rank (with the axis of rows) is above 4",
                spec->name, i);
    }
    return LG_OK;
}

lg_status lg_program_record_function(lg_program *program, const lg_function_spec *spec, bool known,
                                     lg_error *error) {
    LG_TRY(check_spec(spec, error));
    building b = {
        .program = program, .spec = spec, .error = error, .recordings = known ? OF_KNOWN : RECORDINGS};
    lg_error ignored;
    if (error == NULL) b.error = &ignored;
    b.error->message[0] = '\0';
    const lg_status status = make(&b);
    if (status != LG_OK && b.error->message[0] == '\0')
        (void)lg_fail(b.error, status, "function '%s': %s", spec->name, lg_status_sentence(status));
    for (size_t k = 0; k < b.recordings; k++) {
        lg_tape_destroy(b.r[k].tape);
        lg_free(program->context, b.r[k].output);
        lg_calls_destroy(&b.r[k].calls);
    }
    lg_free(program->context, b.place);
    lg_function_destroy(program->context, &b.made);
    return status;
}

lg_status lg_program_add_function(lg_program *program, const lg_function_spec *function, lg_error *error) {
    LG_NEEDS(error, program, function);
    return lg_program_record_function(program, function, false, error);
}

/* begin: functions are added later. */
static lg_status build(const lg_context *context, const lg_program_spec *spec, bool begin, lg_program **out,
                       lg_error *error) {
    lg_error ignored;
    if (error == NULL) error = &ignored;
    error->message[0] = '\0';
    if (spec == NULL || spec->size != sizeof *spec || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the specification or `out` is NULL, or the specification's size is wrong");
    if (begin && spec->function_count > 0)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "function_count must be 0 here: add functions later, or build the program with lg_program_build");
    if (!begin && (spec->functions == NULL || spec->function_count == 0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "a program needs at least one function");
    if (spec->parameters == NULL && spec->parameter_count > 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "parameter_count is %zu, but `parameters` is NULL",
                       spec->parameter_count);
    if (spec->description != NULL && strlen(spec->description) > LG_PROGRAM_MAX_TEXT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the description has more than %d bytes",
                       LG_PROGRAM_MAX_TEXT);
    LG_CLEAN(lg_program_destroy_at) lg_program *made = NULL;
    if (lg_program_create(context, &made) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a program");
    lg_status status = LG_OK;
    if (spec->description != NULL && (made->description = lg_strdup(context, spec->description)) == NULL)
        status = LG_OUT_OF_MEMORY;
    for (size_t i = 0; status == LG_OK && i < spec->parameter_count; i++)
        status = lg_program_add_parameter(made, &spec->parameters[i], error);
    for (size_t i = 0; status == LG_OK && i < spec->function_count; i++)
        status = lg_program_record_function(made, &spec->functions[i], false, error);
    if (status == LG_OK) return LG_MOVE(out, made);
    if (error->message[0] == '\0') (void)lg_fail(error, status, "%s", lg_status_sentence(status));
    return status;
}

lg_status lg_program_build(const lg_context *context, const lg_program_spec *spec, lg_program **out,
                           lg_error *error) {
    return build(context, spec, false, out, error);
}

lg_status lg_program_begin(const lg_context *context, const lg_program_spec *spec, lg_program **out,
                           lg_error *error) {
    return build(context, spec, true, out, error);
}

lg_status lg_program_of(const lg_context *context, const lg_function_spec *functions, size_t count,
                        lg_program **out, lg_error *error) {
    const lg_program_spec spec = {.size = sizeof spec, .functions = functions, .function_count = count};
    return lg_program_build(context, &spec, out, error);
}

lg_status lg_program_record_part(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                 lg_var *out) {
    const lg_program_part *part = user;
    return lg_program_record(tape, part->program, part->function, NULL, in, out);
}

lg_status lg_program_bare(const lg_program *from, lg_program **out, lg_error *error) {
    lg_parameter_spec parameters[LG_PROGRAM_MAX_PARAMETERS];
    const lg_program_spec spec = {.size = sizeof spec,
                                  .parameters = parameters,
                                  .parameter_count = from->parameters,
                                  .description = from->description};
    for (size_t i = 0; i < from->parameters; i++) parameters[i] = lg_program_parameter(from, i);
    return lg_program_begin(from->context, &spec, out, error);
}

static lg_status record_flat(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_program_part *part = user;
    return lg_program_record(tape, part->program, part->function, theta, in, out);
}

lg_status lg_program_flat(const lg_program *program, size_t function, lg_program **out, lg_error *error) {
    const lg_function *f = &program->function[function];
    lg_program_part part = {program, function};
    const lg_function_spec flat = {f->name, f->input, f->inputs, f->output, f->outputs, record_flat, &part};
    LG_CLEAN(lg_program_destroy_at) lg_program *made = NULL;
    LG_TRY(lg_program_bare(program, &made, error));
    LG_TRY(lg_program_record_function(made, &flat, true, error));
    return LG_MOVE(out, made);
}
