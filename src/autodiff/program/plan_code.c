#include "autodiff/program/plan_code.h"

#include <string.h>

/* Limits for scalar code: elements of the output, elements of all inputs, terms of a sum. Beyond them,
 * kernels are faster, and shorter as C. */
enum { MOST_OUT = 12, MOST_IN = 64, MOST_TERMS = 16 };

bool lg_code_fits(const lg_graph *g, const lg_graph_node *n) {
    const lg_op *op = n->op;
    size_t in = 0;
    if (n->sort != LG_GRAPH_OPERATION || (op->element == NULL && op->expand == NULL)) return false;
    const double work = lg_graph_work(g, n);
    if (n->count > MOST_OUT || work > MOST_TERMS * (double)n->count) return false;
    if (op->most_code > 0 && work > op->most_code) return false;
    for (uint32_t k = 0; k < n->inputs; k++)
        if (n->in[k] != LG_GRAPH_NONE) in += g->node[n->in[k]].count;
    return in <= MOST_IN;
}

void lg_code_begin(lg_code *code, lg_heap *temporary, const lg_graph *graph, lg_scalar **value) {
    *code = (lg_code){.temporary = temporary, .graph = graph, .value = value};
    lg_scalars_init(&code->s, temporary->context);
}

void lg_code_end(lg_code *code, const uint32_t *nodes, uint32_t count) {
    for (uint32_t j = 0; j < count; j++) {
        const lg_graph_node *n = &code->graph->node[nodes[j]];
        code->value[nodes[j]] = NULL;
        for (uint32_t k = 0; k < n->inputs; k++)
            if (n->in[k] != LG_GRAPH_NONE) code->value[n->in[k]] = NULL;
    }
    lg_scalars_destroy(&code->s);
}

static lg_status new_load(lg_code *code, uint32_t node, uint32_t element, lg_scalar *out) {
    if (code->loads == code->capacity) {
        const uint32_t capacity = code->capacity == 0 ? 64 : 2 * code->capacity;
        uint32_t *grown = lg_heap_take(code->temporary, 2 * (size_t)capacity, sizeof *grown);
        if (grown == NULL) return LG_OUT_OF_MEMORY;
        if (code->loads > 0) memcpy(grown, code->load, 2 * code->loads * sizeof *grown);
        code->load = grown;
        code->capacity = capacity;
    }
    code->load[2 * code->loads] = node;
    code->load[2 * code->loads + 1] = element;
    *out = lg_s_input(&code->s, code->loads++);
    return LG_OK;
}

/* Provides the instructions of a node that is not computed in this run: constants or loads. */
static lg_status bring(lg_code *code, uint32_t node) {
    const lg_graph_node *n = &code->graph->node[node];
    lg_scalar *value = lg_heap_take(code->temporary, n->count, sizeof *value);
    if (value == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < n->count; i++) {
        /* Parameters are loaded, so that the weights stay in one array. */
        if (n->sort == LG_GRAPH_CONSTANT && !n->weights)
            value[i] = lg_s_constant(&code->s, n->value[i]);
        else
            LG_TRY(new_load(code, node, (uint32_t)i, &value[i]));
    }
    code->value[node] = value;
    return LG_OK;
}

lg_status lg_code_add(lg_code *code, uint32_t node) {
    const lg_graph_node *n = &code->graph->node[node];
    const lg_scalar *x[LG_MAX_INPUTS];
    const lg_shape *shapes[LG_MAX_INPUTS];
    for (uint32_t k = 0; k < n->inputs; k++) {
        x[k] = NULL;
        if (n->in[k] == LG_GRAPH_NONE) continue;
        if (code->value[n->in[k]] == NULL) LG_TRY(bring(code, n->in[k]));
        x[k] = code->value[n->in[k]];
    }
    lg_graph_shapes(code->graph, n, shapes);
    lg_scalar *y = lg_heap_take(code->temporary, n->count, sizeof *y);
    if (y == NULL) return LG_OUT_OF_MEMORY;
    const lg_evaluation e = {
        .attr = &n->attr, .inputs = n->inputs, .in = shapes, .shape = &n->shape, .count = n->count};
    const lg_op *op = lg_row_in_use(&code->exchange, n->op);
    if (!lg_scalars_expand(&code->s, op, &e, x, y)) return LG_OUT_OF_MEMORY;
    code->value[node] = y;
    return LG_OK;
}

/* ---- registers ---- */

typedef struct finishing {
    lg_code *code;
    lg_heap *memory;
    const lg_kernels *k;
    uint32_t *level; /* for each instruction: 1 + the highest level of its operands; 0: not needed */
    uint32_t *reg;   /* for each instruction: its register */
    uint32_t *order; /* the needed instructions, in the order of their registers */
    uint32_t count;  /* number of entries of `order`, which holds no constants and loads */
    lg_scalar_step made;
} finishing;

enum { NEEDED = 1 };

static void mark(finishing *f, const uint32_t *stored, size_t count) {
    const lg_scalars *s = &f->code->s;
    for (size_t j = 0; j < count; j++)
        for (size_t i = 0; i < f->code->graph->node[stored[j]].count; i++)
            f->level[f->code->value[stored[j]][i]] = NEEDED;
    for (uint32_t i = s->count; i-- > 0;)
        for (uint32_t k = 0; f->level[i] != 0 && k < lg_scalar_instructions(s->code[i].op); k++)
            f->level[s->code[i].in[k]] = NEEDED;
    for (uint32_t i = 0; i < s->count; i++) {
        uint32_t highest = 0;
        if (f->level[i] == 0) continue;
        for (uint32_t k = 0; k < lg_scalar_instructions(s->code[i].op); k++)
            if (f->level[s->code[i].in[k]] > highest) highest = f->level[s->code[i].in[k]];
        f->level[i] = highest + 1;
    }
}

/* Stable counting sort by a key of at most `most`. */
static void sort_by(uint32_t *items, uint32_t *spare, uint32_t count, const uint32_t *key, uint32_t *buckets,
                    uint32_t most) {
    memset(buckets, 0, ((size_t)most + 2) * sizeof *buckets);
    for (uint32_t i = 0; i < count; i++) buckets[key[items[i]] + 1]++;
    for (uint32_t b = 1; b <= most + 1; b++) buckets[b] += buckets[b - 1];
    for (uint32_t i = 0; i < count; i++) spare[buckets[key[items[i]]]++] = items[i];
    memcpy(items, spare, count * sizeof *items);
}

/* Numbers the registers: constants, loads, then all other instructions, sorted by level, then by operation,
 * then by their first operand, which puts functions of the same rotation angle together. */
static lg_status number_registers(finishing *f) {
    lg_code *code = f->code;
    const lg_scalars *s = &code->s;
    lg_heap *t = code->temporary;
    uint32_t *key = lg_heap_take(t, s->count, sizeof *key), *spare = lg_heap_take(t, s->count, sizeof *spare);
    uint32_t *buckets = lg_heap_take(t, (size_t)s->count + LG_SCALAR_OPS + 3, sizeof *buckets);
    if (key == NULL || spare == NULL || buckets == NULL) return LG_OUT_OF_MEMORY;
    uint32_t constants = 0, loads = 0, top = 0;
    for (uint32_t i = 0; i < s->count; i++) constants += f->level[i] != 0 && s->code[i].op == LG_S_CONSTANT;
    /* The exponents of POW need registers of constants, too. */
    for (uint32_t i = 0; i < s->count; i++) constants += f->level[i] != 0 && s->code[i].op == LG_S_POW;
    for (uint32_t i = 0, c = 0; i < s->count; i++) {
        if (f->level[i] == 0) continue;
        if (f->level[i] > top) top = f->level[i];
        if (s->code[i].op == LG_S_CONSTANT)
            f->reg[i] = c++;
        else if (s->code[i].op == LG_S_INPUT)
            f->reg[i] = constants + loads++;
        else
            f->order[f->count++] = i;
    }
    for (uint32_t i = 0; i < s->count; i++) key[i] = s->code[i].in[0];
    sort_by(f->order, spare, f->count, key, buckets, s->count);
    for (uint32_t i = 0; i < s->count; i++) key[i] = s->code[i].op;
    sort_by(f->order, spare, f->count, key, buckets, LG_SCALAR_OPS);
    sort_by(f->order, spare, f->count, f->level, buckets, top);
    for (uint32_t j = 0; j < f->count; j++) f->reg[f->order[j]] = constants + loads + j;
    f->made.constants = constants;
    f->made.loads = loads;
    f->made.instructions = f->count;
    return LG_OK;
}

static lg_status make_constants(finishing *f) {
    const lg_scalars *s = &f->code->s;
    double *values = lg_heap_take(f->code->temporary, f->made.constants + 1, sizeof *values);
    void *kept = lg_heap_take(f->memory, f->made.constants + 1, f->k->size);
    uint32_t c = 0;
    if (values == NULL || kept == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < s->count; i++)
        if (f->level[i] != 0 && s->code[i].op == LG_S_CONSTANT) values[c++] = s->code[i].p;
    for (uint32_t j = 0; j < f->count; j++)
        if (s->code[f->order[j]].op == LG_S_POW) values[c++] = s->code[f->order[j]].p;
    f->k->convert_in(f->made.constants, values, kept);
    f->made.constant = kept;
    return LG_OK;
}

static lg_status make_groups(finishing *f) {
    const lg_scalars *s = &f->code->s;
    const uint32_t first = f->made.constants + f->made.loads;
    lg_scalar_group *group = lg_heap_take(f->memory, f->count + 1, sizeof *group);
    uint32_t *operands = lg_heap_take(f->memory, 3 * (size_t)f->count + 1, sizeof *operands);
    uint32_t used = 0, exponent = f->made.constants, groups = 0;
    if (group == NULL || operands == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t j = 0; j < f->count; j++) exponent -= s->code[f->order[j]].op == LG_S_POW;
    for (uint32_t j = 0; j < f->count; j++) {
        const uint32_t i = f->order[j];
        const lg_scalar_code *c = &s->code[i];
        const bool joins =
            groups > 0 && group[groups - 1].op == (uint32_t)c->op && f->level[i] == f->level[f->order[j - 1]];
        if (!joins)
            group[groups++] = (lg_scalar_group){.op = (uint32_t)c->op, .result = first + j, .operands = used};
        group[groups - 1].count++;
        for (uint32_t k = 0; k < lg_scalar_instructions(c->op); k++) operands[used++] = f->reg[c->in[k]];
        if (lg_scalar_operands(c->op) > lg_scalar_instructions(c->op))
            operands[used++] = c->op == LG_S_POW ? exponent++ : c->n;
    }
    f->made.group = group;
    f->made.groups = groups;
    f->made.operands = operands;
    return LG_OK;
}

/* Makes ranges of loads: adjacent elements of a node form one range. */
static lg_status make_loads(finishing *f, lg_code_place place_of, void *user) {
    const lg_code *code = f->code;
    const lg_scalars *s = &code->s;
    lg_scalar_range *in = lg_heap_take(f->memory, f->made.loads + 1, sizeof *in);
    uint32_t ranges = 0, node = LG_GRAPH_NONE, next = 0;
    if (in == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < s->count; i++) {
        if (f->level[i] == 0 || s->code[i].op != LG_S_INPUT) continue;
        const uint32_t from = code->load[2 * s->code[i].n], element = code->load[2 * s->code[i].n + 1];
        if (from != node || element != next) {
            in[ranges] = (lg_scalar_range){.place = place_of(user, from), .first = f->reg[i]};
            in[ranges++].place.offset += element;
            node = from;
        }
        in[ranges - 1].count++;
        next = element + 1;
    }
    f->made.in = in;
    f->made.ins = ranges;
    return LG_OK;
}

static lg_status make_stores(finishing *f, const uint32_t *stored, size_t count, lg_code_place place_of,
                             void *user) {
    const lg_code *code = f->code;
    lg_scalar_range *out = lg_heap_take(f->memory, count + 1, sizeof *out);
    size_t total = 0;
    for (size_t j = 0; j < count; j++) total += code->graph->node[stored[j]].count;
    uint32_t *registers = lg_heap_take(f->memory, total + 1, sizeof *registers), at = 0;
    if (out == NULL || registers == NULL) return LG_OUT_OF_MEMORY;
    for (size_t j = 0; j < count; j++) {
        const uint32_t elements = (uint32_t)code->graph->node[stored[j]].count;
        out[j] = (lg_scalar_range){.place = place_of(user, stored[j]), .count = elements, .first = at};
        for (uint32_t i = 0; i < elements; i++) registers[at++] = f->reg[code->value[stored[j]][i]];
    }
    f->made.out = out;
    f->made.outs = (uint32_t)count;
    f->made.stored = registers;
    return LG_OK;
}

lg_status lg_code_finish(lg_code *code, lg_heap *memory, const lg_kernels *k, const uint32_t *stored,
                         size_t count, lg_code_place place_of, void *user, lg_scalar_step *out) {
    finishing f = {.code = code, .memory = memory, .k = k};
    if (code->s.failed) return LG_OUT_OF_MEMORY;
    f.level = lg_heap_take(code->temporary, code->s.count + 1, sizeof *f.level);
    f.reg = lg_heap_take(code->temporary, code->s.count + 1, sizeof *f.reg);
    f.order = lg_heap_take(code->temporary, code->s.count + 1, sizeof *f.order);
    if (f.level == NULL || f.reg == NULL || f.order == NULL) return LG_OUT_OF_MEMORY;
    mark(&f, stored, count);
    LG_TRY(number_registers(&f));
    LG_TRY(make_constants(&f));
    LG_TRY(make_groups(&f));
    LG_TRY(make_loads(&f, place_of, user));
    LG_TRY(make_stores(&f, stored, count, place_of, user));
    *out = f.made;
    return LG_OK;
}
