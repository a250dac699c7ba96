/* Finds out which elements of an output depend on which elements of an input, by propagating sets of input
 * elements through the simplified graph of one row. For an operation with scalar code that is short enough,
 * the code tells the dependencies; otherwise every element is assumed to depend on all elements of all
 * inputs. */
#include <math.h>
#include <string.h>

#include "autodiff/program/plan_graph.h"
#include "autodiff/program/scalars.h"

enum { MOST_ELEMENTS = 1 << 15 }; /* limit on the elements of an operation whose scalar code is examined */

typedef struct spreading {
    lg_heap heap;
    lg_graph g;
    size_t words;   /* 64-bit words per set */
    uint64_t **set; /* for each node: one set per element; NULL: all sets are empty */
} spreading;

static void join(const spreading *s, uint64_t *to, const uint64_t *from) {
    for (size_t w = 0; w < s->words; w++) to[w] |= from[w];
}

static uint64_t *sets_of(spreading *s, uint32_t node) {
    return s->set[node] = lg_heap_take(&s->heap, s->g.node[node].count * s->words, sizeof(uint64_t));
}

static lg_status spread_input(spreading *s, uint32_t node) {
    uint64_t *set = sets_of(s, node);
    if (set == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < s->g.node[node].count; i++) set[i * s->words + i / 64] |= (uint64_t)1 << (i % 64);
    return LG_OK;
}

static lg_status spread_all(spreading *s, uint32_t node) {
    const lg_graph_node *n = &s->g.node[node];
    uint64_t *set = sets_of(s, node);
    if (set == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t k = 0; k < n->inputs && n->count > 0; k++)
        if (n->in[k] != LG_GRAPH_NONE && s->set[n->in[k]] != NULL)
            for (size_t i = 0; i < s->g.node[n->in[k]].count; i++)
                join(s, set, s->set[n->in[k]] + i * s->words);
    for (size_t i = 1; i < n->count; i++) memcpy(set + i * s->words, set, s->words * sizeof *set);
    return LG_OK;
}

/* Makes the operation's scalar code, with its inputs' elements numbered consecutively, and propagates the
 * sets from instruction to instruction. *known: whether the operation has scalar code. */
static lg_status spread_code(spreading *s, uint32_t node, lg_scalars *code, bool *known) {
    const lg_graph_node *n = &s->g.node[node];
    const lg_scalar *x[LG_MAX_INPUTS];
    const lg_shape *shapes[LG_MAX_INPUTS];
    uint32_t number = 0;
    lg_scalar *y = lg_heap_take(&s->heap, n->count, sizeof *y);
    for (uint32_t k = 0; k < n->inputs; k++) {
        const size_t count = n->in[k] == LG_GRAPH_NONE ? 0 : s->g.node[n->in[k]].count;
        lg_scalar *in = lg_heap_take(&s->heap, count, sizeof *in);
        if (in == NULL) return LG_OUT_OF_MEMORY;
        for (size_t i = 0; i < count; i++) in[i] = lg_s_input(code, number++);
        x[k] = in;
    }
    lg_graph_shapes(&s->g, n, shapes);
    const lg_evaluation e = {
        .attr = &n->attr, .inputs = n->inputs, .in = shapes, .shape = &n->shape, .count = n->count};
    if (y == NULL) return LG_OUT_OF_MEMORY;
    *known = lg_scalars_expand(code, n->op, &e, x, y);
    if (!*known) return code->failed && code->count < LG_SCALARS_MOST ? LG_OUT_OF_MEMORY : LG_OK;
    uint64_t *of = lg_heap_take(&s->heap, (size_t)code->count * s->words, sizeof *of),
             *set = sets_of(s, node);
    if (of == NULL || set == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t k = 0; k < n->inputs; k++)
        for (size_t i = 0;
             n->in[k] != LG_GRAPH_NONE && s->set[n->in[k]] != NULL && i < s->g.node[n->in[k]].count; i++)
            join(s, of + x[k][i] * s->words, s->set[n->in[k]] + i * s->words);
    for (uint32_t c = 0; c < code->count; c++)
        for (uint32_t k = 0; k < lg_scalar_instructions(code->code[c].op); k++)
            join(s, of + c * s->words, of + code->code[c].in[k] * s->words);
    for (size_t i = 0; i < n->count; i++)
        memcpy(set + i * s->words, of + y[i] * s->words, s->words * sizeof *set);
    return LG_OK;
}

static lg_status spread(spreading *s, uint32_t node) {
    const lg_graph_node *n = &s->g.node[node];
    const lg_op *op = n->op;
    size_t elements = n->count;
    bool any = false, known = false;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        elements += s->g.node[n->in[k]].count;
        any = any || s->set[n->in[k]] != NULL;
    }
    if (!any) return LG_OK;
    lg_status status = LG_OK;
    if ((op->element != NULL || op->expand != NULL) && elements <= MOST_ELEMENTS) {
        lg_scalars code;
        lg_scalars_init(&code, s->heap.context);
        status = spread_code(s, node, &code, &known);
        lg_scalars_destroy(&code);
    }
    return known || status != LG_OK ? status : spread_all(s, node);
}

static lg_status find(spreading *s, const lg_program *program, const lg_function *f, size_t output,
                      size_t input, unsigned char *pattern, lg_error *error) {
    const lg_plan_options options = {.rows = 1, .dtype = LG_F64, .most_work = INFINITY};
    LG_TRY(lg_graph_make(&s->heap, program, f, &options, false, &s->g, error));
    const size_t elements = lg_shape_count(f->input[input].shape);
    s->words = (elements + 63) / 64;
    s->set = lg_heap_take(&s->heap, s->g.count, sizeof *s->set);
    if (s->set == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < s->g.count; i++) {
        const lg_graph_node *n = &s->g.node[i];
        if (n->sort == LG_GRAPH_INPUT && n->number == input) LG_TRY(spread_input(s, i));
        if (n->sort == LG_GRAPH_OPERATION) LG_TRY(spread(s, i));
    }
    const uint32_t result = s->g.result[output];
    for (size_t a = 0; a < s->g.node[result].count; a++)
        for (size_t b = 0; b < elements; b++)
            pattern[a * elements + b] =
                s->set[result] != NULL && (s->set[result][a * s->words + b / 64] >> (b % 64) & 1u);
    return LG_OK;
}

lg_status lg_program_sparsity(const lg_program *program, size_t function, size_t output, size_t input,
                              unsigned char *pattern, lg_error *error) {
    LG_NEEDS(error, program, pattern);
    if (function >= program->functions || output >= program->function[function].outputs ||
        input >= program->function[function].inputs)
        return lg_fail(error, LG_NOT_FOUND, "the program has no such function, output or input");
    const lg_function *f = &program->function[function];
    /* For a loop, every element of the output is assumed to depend on every element of the input. */
    if (f->times > 0) {
        memset(pattern, 1, lg_shape_count(f->output[output].shape) * lg_shape_count(f->input[input].shape));
        return LG_OK;
    }
    spreading s = {.heap = {.context = program->context}};
    const lg_status status = find(&s, program, f, output, input, pattern, error);
    lg_heap_destroy(&s.heap);
    return status == LG_OUT_OF_MEMORY ? lg_fail(error, status, "function '%s': no memory", f->name) : status;
}
