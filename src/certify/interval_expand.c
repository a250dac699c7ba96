/* Writes functions of a program as scalar code of one row. Only exact operations fold constants. */
#include <fenv.h>
#include <math.h>
#include <string.h>

#include "autodiff/program/plan_graph.h"
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

lg_status lg_interval_nearest(lg_error *error) {
    if (fegetround() == FE_TONEAREST) return LG_OK;
    return lg_fail(error, LG_UNSUPPORTED, "bounds need the rounding mode FE_TONEAREST of this thread");
}

static lg_scalar *elements(lg_expansion *to, size_t count) {
    return lg_heap_take(&to->heap, count + 1, sizeof(lg_scalar));
}

/* Why scalar code failed: no memory, or too many instructions. */
static lg_status out_of_room(const lg_scalars *s, const char *name, lg_error *error) {
    if (s->count < LG_SCALARS_MOST) return LG_OUT_OF_MEMORY;
    return lg_fail(error, LG_UNSUPPORTED, "function '%s' has more than %u operations on numbers", name,
                   LG_SCALARS_MOST);
}

/* of: for each node of g, the graph of the function `name`, its elements */
static lg_status node(lg_expansion *to, const char *name, const lg_graph *g, uint32_t i,
                      const lg_scalar *const *input, lg_scalar **of, lg_error *error) {
    const lg_graph_node *n = &g->node[i];
    const lg_scalar *in[LG_MAX_INPUTS] = {NULL};
    const lg_shape *shapes[LG_MAX_INPUTS];
    if ((of[i] = elements(to, n->count)) == NULL) return LG_OUT_OF_MEMORY;
    for (size_t k = 0; k < n->count && n->sort == LG_GRAPH_CONSTANT; k++)
        of[i][k] = lg_s_constant(&to->s, n->value[k]);
    if (n->sort == LG_GRAPH_INPUT) memcpy(of[i], input[n->number], n->count * sizeof(lg_scalar));
    if (n->sort != LG_GRAPH_OPERATION) return LG_OK;
    for (uint32_t k = 0; k < n->inputs; k++)
        if (n->in[k] != LG_GRAPH_NONE) in[k] = of[n->in[k]];
    lg_graph_shapes(g, n, shapes);
    const lg_evaluation e = {
        .attr = &n->attr, .inputs = n->inputs, .in = shapes, .shape = &n->shape, .count = n->count};
    if (lg_scalars_expand(&to->s, n->op, &e, in, of[i])) return LG_OK;
    if (to->s.failed) return out_of_room(&to->s, name, error);
    return lg_fail(error, LG_UNSUPPORTED, "function '%s': the operation '%s' has no interval form", name,
                   n->op->name);
}

/* Appends the elements of the outputs, from `at` on; returns where they end in *at. */
static lg_status expand(lg_expansion *to, const lg_program *program, size_t number,
                        const lg_scalar *const *input, size_t *at, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *flat = NULL;
    LG_CLEAN(lg_heap_destroy) lg_heap own = {.context = program->context};
    lg_plan_options options;
    lg_graph g;
    lg_plan_options_init(&options);
    LG_TRY(lg_program_flat(program, number, &flat, error));
    LG_TRY(lg_graph_make(&own, flat, flat->function, &options, true, &g, error));
    lg_scalar **of = lg_heap_take(&own, g.count + 1, sizeof *of);
    if (of == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < g.count; i++) LG_TRY(node(to, flat->function->name, &g, i, input, of, error));
    for (size_t j = 0; j < flat->function->outputs; j++) {
        const size_t n = g.node[g.result[j]].count;
        memcpy(to->result + *at, of[g.result[j]], n * sizeof *to->result);
        *at += n;
    }
    return LG_OK;
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

lg_status lg_expand(const lg_program *program, const size_t *functions, size_t count, lg_expansion *out,
                    lg_error *error) {
    *out = (lg_expansion){.heap = {.context = program->context}};
    lg_scalars_init(&out->s, program->context);
    out->s.level_of = lg_interval_level;
    LG_TRY(lg_interval_nearest(error));
    LG_TRY(check(program, functions, count, error));
    const lg_function *first = &program->function[functions[0]];
    const lg_scalar *input[LG_PROGRAM_MAX_PORTS];
    for (size_t k = 0; k < first->inputs; k++) {
        const size_t n = lg_shape_count(first->input[k].shape);
        lg_scalar *own = elements(out, n);
        if (own == NULL) return LG_OUT_OF_MEMORY;
        for (size_t i = 0; i < n; i++) own[i] = lg_s_input(&out->s, (uint32_t)out->inputs++);
        input[k] = own;
    }
    for (size_t i = 0; i < count; i++) {
        const lg_function *f = &program->function[functions[i]];
        for (size_t j = 0; j < f->outputs; j++) out->results += lg_shape_count(f->output[j].shape);
    }
    out->result = elements(out, out->results);
    if (out->result == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0, at = 0; i < count; i++) LG_TRY(expand(out, program, functions[i], input, &at, error));
    return out->s.failed ? out_of_room(&out->s, first->name, error) : LG_OK;
}

void lg_expansion_destroy(lg_expansion *x) {
    lg_scalars_destroy(&x->s);
    lg_heap_destroy(&x->heap);
}
