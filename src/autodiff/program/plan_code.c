#include "autodiff/program/plan_code.h"

#include <string.h>

/* Limits for scalar code: elements of the output, elements of all inputs, terms of a sum. Beyond them,
 * kernels are faster, and shorter as C. */
enum { MOST_OUT = 12, MOST_IN = 64, MOST_TERMS = 16, MOST_TERMS_OF_ROWS = 6 };

/* Returns true if the node's first axis has as many elements as the batch has rows. Scalar code computes such
 * a node one row at a time. It computes every other node as a whole. */
static bool by_rows(const lg_graph *g, uint32_t node) {
    const lg_shape *shape = &g->node[node].shape;
    return g->rows > 1 && shape->rank > 0 && shape->dims[0] == g->rows;
}

size_t lg_code_count(const lg_graph *g, uint32_t node) {
    const size_t count = g->node[node].count;
    return by_rows(g, node) ? count / g->rows : count;
}

/* Attributes and shapes of the operation that computes one row of a node, or a node without rows. */
typedef struct one_row {
    lg_attr attr;
    lg_shape shape, own[LG_MAX_INPUTS];
    const lg_shape *in[LG_MAX_INPUTS];
} one_row;

/* Returns true if row r of the node uses only row r of input k. */
static bool row_of_input(const lg_graph_node *n, uint32_t k, const lg_shape *in, lg_row_use use) {
    if (use == LG_ROWS_BROADCAST) return in->rank == n->shape.rank && in->dims[0] != 1;
    return use == LG_ROWS_EACH || k == 0;
}

/* Returns false if a row of the node needs other rows of an input. Scalar code cannot compute such a node. */
static bool find_one_row(const lg_graph *g, uint32_t node, one_row *out) {
    const lg_graph_node *n = &g->node[node];
    const bool rows = by_rows(g, node);
    out->attr = n->attr;
    out->shape = n->shape;
    lg_graph_shapes(g, n, out->in);
    const lg_row_use use = n->op->rows == NULL ? n->op->element != NULL ? LG_ROWS_BROADCAST : LG_ROWS_MEET
                           : rows ? n->op->rows(out->in, n->inputs, &n->shape, g->rows, &out->attr)
                                  : LG_ROWS_EACH;
    if (rows && use == LG_ROWS_MEET) return false;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        const bool own = by_rows(g, n->in[k]);
        if (own != (rows && row_of_input(n, k, out->in[k], use))) return false;
        if (!own) continue;
        out->own[k] = *out->in[k];
        out->own[k].dims[0] = 1;
        out->in[k] = &out->own[k];
    }
    if (rows) out->shape.dims[0] = 1;
    return true;
}

bool lg_code_fits(const lg_graph *g, uint32_t node) {
    const lg_graph_node *n = &g->node[node];
    const lg_op *op = n->op;
    size_t in = 0;
    one_row row;
    if (n->sort != LG_GRAPH_OPERATION || (op->element == NULL && op->expand == NULL)) return false;
    const size_t count = lg_code_count(g, node);
    const double work = n->count == 0 ? 0.0 : lg_graph_work(g, n) * (double)count / (double)n->count;
    const double terms = by_rows(g, node) ? MOST_TERMS_OF_ROWS : MOST_TERMS;
    if (count > MOST_OUT || work > terms * (double)count) return false;
    if (op->most_code > 0 && work > op->most_code) return false;
    for (uint32_t k = 0; k < n->inputs; k++)
        if (n->in[k] != LG_GRAPH_NONE) in += lg_code_count(g, n->in[k]);
    return in <= MOST_IN && find_one_row(g, node, &row);
}

void lg_code_begin(lg_code *code, lg_heap *temporary, const lg_graph *graph, lg_scalar **value) {
    *code = (lg_code){.temporary = temporary, .graph = graph, .rows = 1, .value = value};
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

/* Returns true if all rows of the constant are equal, or if it has no rows. */
static bool same_rows(const lg_graph_node *n, size_t count) {
    for (size_t i = count; i < n->count; i++)
        if (memcmp(&n->value[i], &n->value[i - count], sizeof *n->value) != 0) return false;
    return true;
}

/* Provides the instructions of a node that is not computed in this run: constants or loads. */
static lg_status bring(lg_code *code, uint32_t node) {
    const lg_graph_node *n = &code->graph->node[node];
    const size_t count = lg_code_count(code->graph, node);
    lg_scalar *value = lg_heap_take(code->temporary, count, sizeof *value);
    if (value == NULL) return LG_OUT_OF_MEMORY;
    /* Parameters are loaded, so that the weights stay in one array. */
    const bool constant = n->sort == LG_GRAPH_CONSTANT && !n->weights && same_rows(n, count);
    for (size_t i = 0; i < count; i++) {
        if (constant)
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
    one_row row;
    for (uint32_t k = 0; k < n->inputs; k++) {
        x[k] = NULL;
        if (n->in[k] == LG_GRAPH_NONE) continue;
        if (code->value[n->in[k]] == NULL) LG_TRY(bring(code, n->in[k]));
        x[k] = code->value[n->in[k]];
    }
    const size_t count = lg_code_count(code->graph, node);
    lg_scalar *y = lg_heap_take(code->temporary, count, sizeof *y);
    if (y == NULL) return LG_OUT_OF_MEMORY;
    (void)find_one_row(code->graph, node, &row);
    const lg_evaluation e = {
        .attr = &row.attr, .inputs = n->inputs, .in = row.in, .shape = &row.shape, .count = count};
    if (by_rows(code->graph, node)) code->rows = code->graph->rows;
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
        for (size_t i = 0; i < lg_code_count(f->code->graph, stored[j]); i++)
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

static uint32_t apart_of(const lg_graph *g, uint32_t node) {
    return by_rows(g, node) ? (uint32_t)lg_code_count(g, node) : 0;
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
            in[ranges] = (lg_scalar_range){
                .place = place_of(user, from), .apart = apart_of(code->graph, from), .first = f->reg[i]};
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
    for (size_t j = 0; j < count; j++) total += lg_code_count(code->graph, stored[j]);
    uint32_t *registers = lg_heap_take(f->memory, total + 1, sizeof *registers), at = 0;
    if (out == NULL || registers == NULL) return LG_OUT_OF_MEMORY;
    for (size_t j = 0; j < count; j++) {
        const uint32_t elements = (uint32_t)lg_code_count(code->graph, stored[j]);
        out[j] = (lg_scalar_range){.place = place_of(user, stored[j]),
                                   .count = elements,
                                   .apart = apart_of(code->graph, stored[j]),
                                   .first = at};
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
    f.made.rows = code->rows;
    *out = f.made;
    return LG_OK;
}
