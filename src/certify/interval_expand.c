/* Writes functions of a program as scalar code of one row, without rounding: calls and loops are written out,
 * constants stay as they are. */
#include <math.h>
#include <string.h>

#include "autodiff/ops/op_rows.h"
#include "certify/interval.h"

_Static_assert((int)LG_INTERVAL_DEFINED == LG_S_DEFINED && (int)LG_INTERVAL_LIPSCHITZ == LG_S_LIPSCHITZ,
               "levels of scalar code");

/* Returns the level of an instruction (lg_interval_flag) that holds for all numbers: the interval form is
 * evaluated over unbounded operands. */
uint8_t lg_interval_level(const lg_scalars *s, const lg_scalar_code *c) {
    lg_interval_value in[3];
    if (c->op == LG_S_INPUT) return LG_INTERVAL_DIFFERENTIABLE;
    if (c->op == LG_S_CONSTANT) return isfinite(c->p) ? LG_INTERVAL_DIFFERENTIABLE : LG_INTERVAL_UNDEFINED;
    for (uint32_t k = 0; k < lg_scalar_instructions(c->op); k++) {
        const lg_scalar_code *from = &s->code[c->in[k]];
        const bool known = from->op == LG_S_CONSTANT && isfinite(from->p);
        in[k] = (lg_interval_value){known ? from->p : -(double)INFINITY, known ? from->p : (double)INFINITY,
                                    from->level};
    }
    return lg_interval_one(c, false, in).level;
}

typedef struct expanding {
    lg_expansion *to;
    const lg_program *program;
    const lg_function *f;
    const lg_scalar *const *input; /* elements of each input of f */
    lg_scalar **parameter;         /* for each parameter of the program: its elements, once they are used */
    lg_scalar **of;                /* for each node of f: its elements */
    uint8_t *needed;
    lg_error *error;
} expanding;

static lg_scalar *elements(expanding *x, size_t count) {
    return lg_heap_take(&x->to->heap, count + 1, sizeof(lg_scalar));
}

static lg_status constants(expanding *x, const double *values, size_t count, size_t period, lg_scalar **out) {
    if ((*out = elements(x, count)) == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < count; i++) (*out)[i] = lg_s_constant(&x->to->s, values[i % period]);
    return LG_OK;
}

static lg_status leaf(expanding *x, uint32_t i, size_t count) {
    const lg_program_node *n = &x->f->node[i];
    if (n->leaf == LG_LEAF_CONSTANT)
        return constants(x, x->f->reals + n->payload, count, n->payload_count, &x->of[i]);
    if (n->leaf == LG_LEAF_PARAMETER) {
        lg_scalar **own = &x->parameter[n->number];
        if (*own == NULL) LG_TRY(constants(x, x->program->parameter[n->number].values, count, count, own));
        x->of[i] = *own;
        return LG_OK;
    }
    if ((x->of[i] = elements(x, count)) == NULL) return LG_OUT_OF_MEMORY;
    memcpy(x->of[i], x->input[n->number], count * sizeof(lg_scalar));
    return LG_OK;
}

static lg_status function(expanding *x, size_t number, const lg_scalar *const *input, lg_scalar **output);

static lg_status call(expanding *x, const lg_program_node *n, const lg_scalar *const *in, lg_scalar **out) {
    lg_scalar *output[LG_PROGRAM_MAX_PORTS];
    LG_TRY(function(x, lg_called(n), in, output));
    *out = output[lg_called_output(n)];
    return LG_OK;
}

/* Why scalar code failed: no memory, or too many instructions. */
static lg_status out_of_room(const lg_scalars *s, const char *name, lg_error *error) {
    if (s->count < LG_SCALARS_MOST) return LG_OUT_OF_MEMORY;
    return lg_fail(error, LG_UNSUPPORTED, "function '%s' has more than %u operations on numbers", name,
                   LG_SCALARS_MOST);
}

static lg_status operation(expanding *x, uint32_t i, const lg_shape *shape, size_t count) {
    const lg_function *f = x->f;
    const lg_program_node *n = &f->node[i];
    const lg_scalar *in[LG_MAX_INPUTS];
    lg_shape shapes[LG_MAX_INPUTS];
    const lg_shape *pointers[LG_MAX_INPUTS];
    lg_attr attr;
    for (uint32_t k = 0; k < n->inputs; k++) {
        const uint32_t edge = f->edges[n->first + k];
        in[k] = x->of[edge];
        pointers[k] = &shapes[k];
        if (!lg_node_shape_at(&f->node[edge], 1, &shapes[k])) return LG_SHAPE;
    }
    if (lg_is_call(n->op)) return call(x, n, in, &x->of[i]);
    if (!lg_node_attr_at(f, n, 1, &attr))
        return lg_fail(x->error, LG_SHAPE, "function '%s': an attribute of '%s' is out of range", f->name,
                       n->op->name);
    const lg_evaluation e = {
        .attr = &attr, .inputs = n->inputs, .in = pointers, .shape = shape, .count = count};
    if ((x->of[i] = elements(x, count)) == NULL) return LG_OUT_OF_MEMORY;
    if (lg_scalars_expand(&x->to->s, n->op, &e, in, x->of[i])) return LG_OK;
    if (x->to->s.failed) return out_of_room(&x->to->s, f->name, x->error);
    return lg_fail(x->error, LG_UNSUPPORTED, "function '%s': the operation '%s' has no interval form",
                   f->name, n->op->name);
}

static uint32_t unread(const lg_function *f, const lg_program_node *n) {
    lg_attr attr;
    return n->op->unread == NULL || !lg_node_attr_at(f, n, 1, &attr) ? 0 : n->op->unread(&attr, n->inputs);
}

/* Needed nodes only: what no result needs may have no interval form. */
static lg_status nodes(expanding *x) {
    const lg_function *f = x->f;
    for (size_t j = 0; j < f->outputs; j++) x->needed[f->result[j]] = 1;
    for (uint32_t i = f->nodes; i-- > 0;) {
        if (!x->needed[i]) continue;
        const uint32_t not = unread(f, &f->node[i]);
        for (uint32_t k = 0; k < f->node[i].inputs; k++)
            if (k >= 32 || !(not >> k & 1u)) x->needed[f->edges[f->node[i].first + k]] = 1;
    }
    for (uint32_t i = 0; i < f->nodes; i++) {
        lg_shape shape;
        if (!x->needed[i]) continue;
        if (!lg_node_shape_at(&f->node[i], 1, &shape)) return LG_SHAPE;
        const size_t count = lg_shape_count(shape);
        LG_TRY(f->node[i].op == &lg_op_leaf ? leaf(x, i, count) : operation(x, i, &shape, count));
    }
    return LG_OK;
}

/* A loop: the called function again and again. A path is what the calls gave, one after the other. */
static lg_status loop(expanding *x, const lg_function *f, const lg_scalar *const *input, lg_scalar **output) {
    const lg_scalar *now[LG_PROGRAM_MAX_PORTS];
    const size_t called = f->outputs - f->paths;
    memcpy(now, input, f->inputs * sizeof *now);
    for (size_t k = 0; k < f->paths; k++) {
        output[called + k] = elements(x, lg_shape_count(lg_port_shape(&f->output[called + k], 1)));
        if (output[called + k] == NULL) return LG_OUT_OF_MEMORY;
    }
    for (uint32_t n = 0; n < f->times; n++) {
        LG_TRY(function(x, f->callee, now, output));
        for (size_t k = 0; k < f->paths; k++) {
            const size_t one = lg_shape_count(lg_port_shape(&f->output[f->path[k]], 1));
            memcpy(output[called + k] + n * one, output[f->path[k]], one * sizeof(lg_scalar));
        }
        for (size_t i = 0; i < f->inputs; i++)
            if (f->carry[i] != UINT32_MAX) now[i] = output[f->carry[i]];
    }
    return LG_OK;
}

static lg_status function(expanding *x, size_t number, const lg_scalar *const *input, lg_scalar **output) {
    const lg_function *f = &x->program->function[number];
    expanding inner = *x;
    if (x->to->s.failed) return out_of_room(&x->to->s, f->name, x->error);
    if (f->times > 0) return loop(x, f, input, output);
    inner.f = f;
    inner.input = input;
    inner.of = lg_heap_take(&x->to->heap, f->nodes + 1, sizeof *inner.of);
    inner.needed = lg_heap_take(&x->to->heap, f->nodes + 1, 1);
    if (inner.of == NULL || inner.needed == NULL) return LG_OUT_OF_MEMORY;
    const lg_status status = nodes(&inner);
    for (size_t j = 0; j < f->outputs; j++) output[j] = inner.of[f->result[j]];
    return status;
}

static lg_status check(const lg_program *p, const size_t *functions, size_t count, lg_error *error) {
    for (size_t i = 0; i < count; i++) {
        if (functions[i] >= p->functions)
            return lg_fail(error, LG_NOT_FOUND, "the program has no function number %zu", functions[i]);
        const lg_function *f = &p->function[functions[i]], *first = &p->function[functions[0]];
        bool same = f->inputs == first->inputs;
        for (size_t k = 0; same && k < f->inputs; k++)
            same = lg_same_shape(&f->input[k].shape, &first->input[k].shape);
        if (!same)
            return lg_fail(error, LG_INVALID_ARGUMENT, "the functions '%s' and '%s' differ in their inputs",
                           first->name, f->name);
    }
    return LG_OK;
}

static lg_status collect(expanding *x, size_t number, lg_scalar *const *output, lg_scalar *to, size_t *at) {
    const lg_function *f = &x->program->function[number];
    for (size_t j = 0; j < f->outputs; j++) {
        const size_t n = lg_shape_count(f->output[j].shape);
        memcpy(to + *at, output[j], n * sizeof *to);
        *at += n;
    }
    return LG_OK;
}

lg_status lg_expand(const lg_program *program, const size_t *functions, size_t count, lg_expansion *out,
                    lg_error *error) {
    *out = (lg_expansion){.heap = {.context = program->context}};
    lg_scalars_init(&out->s, program->context);
    out->s.level_of = lg_interval_level;
    LG_TRY(check(program, functions, count, error));
    expanding x = {.to = out, .program = program, .error = error};
    const lg_function *first = &program->function[functions[0]];
    const lg_scalar *input[LG_PROGRAM_MAX_PORTS];
    for (size_t k = 0; k < first->inputs; k++) {
        const size_t n = lg_shape_count(first->input[k].shape);
        lg_scalar *own = elements(&x, n);
        if (own == NULL) return LG_OUT_OF_MEMORY;
        for (size_t i = 0; i < n; i++) own[i] = lg_s_input(&out->s, (uint32_t)out->inputs++);
        input[k] = own;
    }
    for (size_t i = 0; i < count; i++) {
        const lg_function *f = &program->function[functions[i]];
        for (size_t j = 0; j < f->outputs; j++) out->results += lg_shape_count(f->output[j].shape);
    }
    out->result = elements(&x, out->results);
    x.parameter = lg_heap_take(&out->heap, program->parameters + 1, sizeof *x.parameter);
    if (out->result == NULL || x.parameter == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0, at = 0; i < count; i++) {
        lg_scalar *output[LG_PROGRAM_MAX_PORTS];
        LG_TRY(function(&x, functions[i], input, output));
        LG_TRY(collect(&x, functions[i], output, out->result, &at));
    }
    return out->s.failed ? out_of_room(&out->s, first->name, error) : LG_OK;
}

void lg_expansion_destroy(lg_expansion *x) {
    lg_scalars_destroy(&x->s);
    lg_heap_destroy(&x->heap);
}
