/* Scalar code as C: straight lines of local variables, in static functions of bounded size; elementwise
 * operations as loops around such lines. */
#include <stdio.h>
#include <string.h>

#include "autodiff/program_c.h"
#include "autodiff/tape_internal.h"

/* Instructions of a function of straight code: compilers stay quick, stacks small. */
#define BLOCK 512

/* Bytes of the frame of a function with these lines, at -O0: a slot for each local variable, twice that to be
 * sure. */
static size_t frame_of(const lg_text *lines) {
    size_t locals = 0;
    for (const char *s = lines->data; s != NULL && (s = strstr(s, "real ")) != NULL; s++) locals++;
    return 512 + 16 * locals;
}

/* ---- fragments ---- */

static const lg_c_fragment c_exp = {.file = {"exp_double", "exp_float"}};
static const lg_c_fragment c_tanh = {.file = {"tanh", "tanh"}, .needs = {&c_exp}};
static const lg_c_fragment c_sigmoid = {.file = {"sigmoid", "sigmoid"}, .needs = {&c_exp}};
static const lg_c_fragment c_larger = {
    .comment = "NaN where one of them is.",
    .text = LG_C(static real larger(real a, real b) { return a != a || a >= b ? a : b; })};

/* a, b and c are operands, p and n the constants. */
static const struct {
    const char *text;
    const lg_c_fragment *needs;
} expressions[LG_SCALAR_OPS] = {
    [LG_S_ADD] = {"a + b", NULL},
    [LG_S_SUB] = {"a - b", NULL},
    [LG_S_MUL] = {"a * b", NULL},
    [LG_S_DIV] = {"a / b", NULL},
    [LG_S_NEG] = {"-a", NULL},
    [LG_S_MAX] = {"larger(a, b)", &c_larger},
    [LG_S_GE] = {"a >= b ? REAL(1.0) : REAL(0.0)", NULL},
    [LG_S_SELECT] = {"a != REAL(0.0) ? b : c", NULL},
    [LG_S_SQRT] = {"SQRT(a)", NULL},
    [LG_S_ABS] = {"FABS(a)", NULL},
    [LG_S_SIGN] = {"a >= REAL(0.0) ? REAL(1.0) : a < REAL(0.0) ? REAL(-1.0) : a", NULL},
    [LG_S_POW] = {"POW(a, p)", NULL},
    [LG_S_EXP] = {"EXP(a)", NULL},
    [LG_S_LOG] = {"LOG(a)", NULL},
    [LG_S_SIN] = {"SIN(a)", NULL},
    [LG_S_COS] = {"COS(a)", NULL},
    [LG_S_TANH] = {"tanh_of(a)", &c_tanh},
    [LG_S_SIGMOID] = {"sigmoid_of(a)", &c_sigmoid},
    [LG_S_ATAN2] = {"ATAN2(a, b)", NULL},
    [LG_S_DEXPINV] = {"dexpinv_coef(a, n)", &lg_c_dexpinv},
};

/* Powers that need no function. */
static const struct {
    double exponent;
    const char *text;
} powers[] = {{-1.0, "REAL(1.0) / a"},
              {-2.0, "REAL(1.0) / (a * a)"},
              {0.5, "SQRT(a)"},
              {3.0, "a * a * a"},
              {4.0, "(a * a) * (a * a)"}};

static const char *expression_of(const lg_scalar_code *code) {
    for (size_t i = 0; code->op == LG_S_POW && i < LG_COUNT(powers); i++)
        if (code->p == powers[i].exponent) return powers[i].text;
    return expressions[code->op].text;
}

/* Operands that are results of instructions. */
static uint8_t operands(lg_scalar_op op) {
    static const uint8_t count[LG_SCALAR_OPS] = {
#define X(name, instructions, all) [LG_S_##name] = instructions,
        LG_SCALAR_LIST(X)
#undef X
    };
    return count[op];
}

/* ---- a directed graph in the order of its results ---- */

/* Where numbers come from and go to. */
typedef struct ends {
    const void *user;
    void (*input)(lg_c *c, lg_text *to, const void *user, uint32_t number);
    void (*output)(lg_c *c, lg_text *to, const void *user, uint32_t number); /* an lvalue */
} ends;

typedef struct graph {
    lg_c *c;
    const lg_scalar_code *code;
    uint32_t count;
    const uint32_t *root;
    uint32_t roots;
    /* by instruction */
    uint32_t *order;   /* in this order they are written: `ordered` of them, neither inputs nor constants */
    uint32_t *place;   /* 1 + where it stands in `order`; 0: not there */
    uint32_t *sibling; /* 1 + the next STUMPFF, SIN or COS of the same operand */
    uint32_t *first;   /* by operand: 1 + the first of these */
    uint32_t *stack;
    uint32_t *shown; /* 1 + the block in which the input's load, or its own line, stands */
    uint32_t *slot;  /* 1 + place among what crosses from block to block */
    uint32_t ordered, slots;
} graph;

static bool is_leaf(const graph *g, uint32_t i) {
    return g->code[i].op == LG_S_INPUT || g->code[i].op == LG_S_CONSTANT;
}

static bool has_siblings(const lg_scalar_code *code) {
    return code->op == LG_S_STUMPFF || code->op == LG_S_SIN || code->op == LG_S_COS;
}

static void put(graph *g, uint32_t i) {
    if (g->place[i] != 0) return;
    g->order[g->ordered++] = i;
    g->place[i] = g->ordered;
}

/* The instruction, and those of the same angle that are of use beside it. */
static void put_family(graph *g, uint32_t i) {
    put(g, i);
    if (!has_siblings(&g->code[i])) return;
    for (uint32_t s = g->first[g->code[i].in[0]]; s != 0; s = g->sibling[s - 1]) {
        const lg_scalar_code *own = &g->code[i], *other = &g->code[s - 1];
        const bool circle = own->op != LG_S_STUMPFF && other->op != LG_S_STUMPFF;
        if (circle || (own->op == other->op && own->n / 16 == other->n / 16)) put(g, s - 1);
    }
}

/* What a result needs comes before it: an operand's whole tree before the next operand's. */
static void sort_from(graph *g, uint32_t root) {
    uint32_t depth = 0;
    g->stack[depth++] = root;
    while (depth > 0) {
        const uint32_t i = g->stack[depth - 1];
        const lg_scalar_code *code = &g->code[i];
        uint32_t missing = UINT32_MAX;
        for (uint8_t k = 0; k < operands(code->op) && missing == UINT32_MAX; k++)
            if (!is_leaf(g, code->in[k]) && g->place[code->in[k]] == 0) missing = code->in[k];
        if (missing != UINT32_MAX) {
            g->stack[depth++] = missing;
        } else {
            if (!is_leaf(g, i)) put_family(g, i);
            depth--;
        }
    }
}

static void mark(uint8_t *used, const graph *g) {
    for (uint32_t r = 0; r < g->roots; r++) used[g->root[r]] = 1;
    for (uint32_t i = g->count; i-- > 0;)
        for (uint8_t k = 0; used[i] && k < operands(g->code[i].op); k++) used[g->code[i].in[k]] = 1;
}

/* What nothing needs is no sibling. Operands stand before what they are of. */
static bool sort(graph *g) {
    uint8_t *used = lg_alloc(g->c->context, g->count, 1);
    if (used == NULL) return lg_c_fail(g->c, LG_OUT_OF_MEMORY, "out of memory");
    mark(used, g);
    for (uint32_t i = g->count; i-- > 0;)
        if (used[i] && has_siblings(&g->code[i])) {
            g->sibling[i] = g->first[g->code[i].in[0]];
            g->first[g->code[i].in[0]] = i + 1;
        }
    for (uint32_t r = 0; r < g->roots; r++) sort_from(g, g->root[r]);
    lg_free(g->c->context, used);
    return true;
}

static uint32_t block_of(const graph *g, uint32_t i) {
    return (g->place[i] - 1) / BLOCK;
}

/* What is read in a later block than it is made gets a slot; roots that are made elsewhere than in the last
 * block are stored where they are made. */
static void find_slots(graph *g) {
    for (uint32_t o = 0; o < g->ordered; o++) {
        const lg_scalar_code *code = &g->code[g->order[o]];
        for (uint8_t k = 0; k < operands(code->op); k++) {
            const uint32_t in = code->in[k];
            if (!is_leaf(g, in) && g->slot[in] == 0 && block_of(g, in) != o / BLOCK) g->slot[in] = ++g->slots;
        }
    }
}

static bool open_graph(graph *g, lg_c *c, const lg_scalar_code *code, uint32_t count, const uint32_t *root,
                       uint32_t roots) {
    *g = (graph){.c = c, .code = code, .count = count, .root = root, .roots = roots};
    uint32_t **const arrays[] = {&g->order, &g->place, &g->sibling, &g->first,
                                 &g->stack, &g->shown, &g->slot};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) {
        *arrays[i] = lg_alloc(c->context, (size_t)count + 1, sizeof **arrays[i]);
        if (*arrays[i] == NULL) return lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
    }
    if (!sort(g)) return false;
    find_slots(g);
    return true;
}

static void close_graph(graph *g) {
    uint32_t *const arrays[] = {g->order, g->place, g->sibling, g->first, g->stack, g->shown, g->slot};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(g->c->context, arrays[i]);
}

/* ---- lines ---- */

static void add_operand(const graph *g, lg_text *to, uint32_t i) {
    const lg_scalar_code *code = &g->code[i];
    if (code->op != LG_S_CONSTANT) {
        lg_text_add(to, "v%u", i);
        return;
    }
    if (code->p < 0) lg_text_add(to, "(");
    lg_text_add_real(to, g->c->dtype, code->p);
    if (code->p < 0) lg_text_add(to, ")");
}

/* A letter that stands alone is an operand or a constant. */
static void add_expression(const graph *g, lg_text *to, const lg_scalar_code *code) {
    const char *text = expression_of(code);
    for (const char *s = text; *s != '\0'; s++) {
        const bool alone = (s == text || strchr(" (-", s[-1]) != NULL) && strchr(" ),", s[1]) != NULL;
        if (alone && *s >= 'a' && *s <= 'c')
            add_operand(g, to, code->in[*s - 'a']);
        else if (alone && *s == 'p')
            lg_text_add_real(to, g->c->dtype, code->p);
        else if (alone && *s == 'n')
            lg_text_add(to, "%u", code->n);
        else
            lg_text_append(to, s, 1);
    }
}

static bool same_row(const lg_scalar_code *a, const lg_scalar_code *b) {
    return a->op == LG_S_STUMPFF && b->op == LG_S_STUMPFF && a->in[0] == b->in[0] && a->n / 16 == b->n / 16;
}

/* Functions of one angle and order are computed as a row, where the first of them stands in a block. */
static void add_stumpff(graph *g, lg_text *to, const char *indent, uint32_t i) {
    const lg_scalar_code *own = &g->code[i];
    uint32_t row = i, most = own->n % 16;
    for (uint32_t o = block_of(g, i) * BLOCK; o + 1 < g->place[i] && row == i; o++)
        if (same_row(own, &g->code[g->order[o]])) row = g->order[o];
    for (uint32_t s = g->first[own->in[0]]; s != 0; s = g->sibling[s - 1])
        if (same_row(own, &g->code[s - 1]) && g->code[s - 1].n % 16 > most) most = g->code[s - 1].n % 16;
    if (row == i) {
        lg_text_add(to, "%sreal s%u[%u];\n%sstumpff_row(", indent, i, most + 1, indent);
        add_operand(g, to, own->in[0]);
        lg_text_add(to, ", %u, %u, s%u);\n", most, own->n / 16, i);
    }
    lg_text_add(to, "%sconst real v%u = s%u[%u];\n", indent, i, row, own->n % 16);
}

/* Operands that are not there yet in this block: inputs, and what was made in an earlier one. */
static void add_loads(graph *g, lg_text *to, const char *indent, const ends *e, uint32_t block, uint32_t i,
                      size_t slots_at) {
    const bool made = !is_leaf(g, i) && block_of(g, i) == block;
    if (made || g->code[i].op == LG_S_CONSTANT || g->shown[i] == block + 1) return;
    g->shown[i] = block + 1;
    lg_text_add(to, "%sconst real v%u = ", indent, i);
    if (is_leaf(g, i))
        e->input(g->c, to, e->user, g->code[i].n);
    else
        lg_text_add(to, "work[%zu]", slots_at + g->slot[i] - 1);
    lg_text_add(to, ";\n");
}

static void add_line(graph *g, lg_text *to, const char *indent, const ends *e, uint32_t block, uint32_t i,
                     size_t slots_at) {
    const lg_scalar_code *code = &g->code[i];
    for (uint8_t k = 0; k < operands(code->op); k++)
        add_loads(g, to, indent, e, block, code->in[k], slots_at);
    if (code->op == LG_S_STUMPFF) {
        lg_c_need(g->c, &lg_c_stumpff);
        add_stumpff(g, to, indent, i);
        return;
    }
    if (expressions[code->op].needs != NULL) lg_c_need(g->c, expressions[code->op].needs);
    lg_text_add(to, "%sconst real v%u = ", indent, i);
    add_expression(g, to, code);
    lg_text_add(to, ";\n");
}

/* Roots of this block; those that are inputs or constants belong to the last one. */
static void add_stores(graph *g, lg_text *to, const char *indent, const ends *e, uint32_t block, bool last,
                       size_t slots_at) {
    for (uint32_t o = block * BLOCK; o < g->ordered && o < (block + 1) * BLOCK; o++)
        if (g->slot[g->order[o]] != 0)
            lg_text_add(to, "%swork[%zu] = v%u;\n", indent, slots_at + g->slot[g->order[o]] - 1, g->order[o]);
    for (uint32_t r = 0; r < g->roots; r++) {
        const uint32_t i = g->root[r];
        if (is_leaf(g, i) ? !last : block_of(g, i) != block) continue;
        add_loads(g, to, indent, e, block, i, slots_at);
        lg_text_add(to, "%s", indent);
        e->output(g->c, to, e->user, r);
        lg_text_add(to, " = ");
        add_operand(g, to, i);
        lg_text_add(to, ";\n");
    }
}

static uint32_t blocks_of(const graph *g) {
    return g->ordered == 0 ? 1 : (g->ordered + BLOCK - 1) / BLOCK;
}

static void add_block(graph *g, lg_text *to, const char *indent, const ends *e, uint32_t block,
                      size_t slots_at) {
    for (uint32_t o = block * BLOCK; o < g->ordered && o < (block + 1) * BLOCK; o++)
        add_line(g, to, indent, e, block, g->order[o], slots_at);
    add_stores(g, to, indent, e, block, block + 1 == blocks_of(g), slots_at);
}

/* ---- elementwise operations ---- */

typedef struct element_ends {
    uint64_t over;   /* bit k: input k is the output's memory */
    const bool *one; /* NULL, or by input: a single number */
    uint32_t levels; /* 0: x[i]; else strides */
    const size_t (*stride)[LG_MAX_RANK];
} element_ends;

static void element_input(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    const element_ends *e = user;
    const char *plus = "";
    (void)c;
    if (e->over >> number & 1u) {
        lg_text_add(to, e->levels == 0 ? "y[i]" : "*y");
        return;
    }
    lg_text_add(to, "x%u[", number);
    if (e->levels == 0) lg_text_add(to, "%s", e->one != NULL && e->one[number] ? "0" : "i");
    for (uint32_t l = 0; l < e->levels; l++) {
        const size_t stride = e->stride[number][l];
        if (stride == 0) continue;
        lg_text_add(to, "%si%u", plus, l);
        if (stride != 1) lg_text_add(to, " * %zu", stride);
        plus = " + ";
    }
    if (e->levels > 0 && plus[0] == '\0') lg_text_add(to, "0");
    lg_text_add(to, "]");
}

static void element_output(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    (void)c, (void)user, (void)number;
    lg_text_add(to, "*y++");
}

static void element_output_i(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    (void)c, (void)user, (void)number;
    lg_text_add(to, "y[i]");
}

/* The operation's line in `g`; false on failure. */
static bool element_graph(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs, lg_scalars *s,
                          uint32_t *root, graph *g) {
    lg_scalar in[LG_MAX_INPUTS];
    lg_scalars_init(s, c->context);
    for (uint32_t k = 0; k < inputs; k++) in[k] = lg_s_input(s, k);
    *root = op->element(s, attr, in, inputs);
    if (s->failed) return lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
    return open_graph(g, c, s->code, s->count, root, 1);
}

/* What stands for the input's memory: an argument, unless it is not read or the output's. */
static bool is_argument(const lg_op *op, const lg_attr *attr, uint32_t inputs, uint64_t over, uint32_t k) {
    const uint32_t unread = op->unread != NULL ? op->unread(attr, inputs) : 0;
    return !(over >> k & 1u) && (k >= 32 || !(unread >> k & 1u));
}

static void add_unused(lg_text *to, const graph *g, const lg_op *op, const lg_attr *attr, uint32_t inputs,
                       uint64_t over) {
    for (uint32_t k = 0; k < inputs; k++)
        if (g->shown[k] == 0 && is_argument(op, attr, inputs, over, k))
            lg_text_add(to, "    (void)x%u;\n", k);
}

static void add_parameters(lg_text *to, const lg_op *op, const lg_attr *attr, uint32_t inputs,
                           uint64_t over) {
    for (uint32_t k = 0; k < inputs; k++)
        if (is_argument(op, attr, inputs, over, k)) lg_text_add(to, "const real *RESTRICT x%u, ", k);
    lg_text_add(to, "real *RESTRICT y) {\n");
}

static void add_loops(lg_text *to, uint32_t levels, const size_t *length) {
    if (levels == 0) lg_text_add(to, "    for (int i = 0; i < n; i++) {\n");
    for (uint32_t l = 0; l < levels; l++)
        lg_text_add(to, "%sfor (int i%u = 0; i%u < %zu; i%u++)%s\n", l == 0 ? "    " : "        ", l, l,
                    length[l], l, l + 1 == levels ? " {" : "");
}

/* A function over all elements: over n of them, or where there are levels, over `length` of each. */
/* Bytes: clang writes loops over short rows out. */
enum { BROADCAST_FRAME = 4096 };

static const char *define_elements(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs,
                                   const element_ends *user, const size_t *length) {
    const ends to = {user, element_input, user->levels == 0 ? element_output_i : element_output};
    lg_text lines = {.context = c->context}, text = {.context = c->context};
    lg_scalars s;
    graph g;
    uint32_t root;
    const char *name = NULL;
    lg_c_need(c, &lg_c_noinline);
    if (element_graph(c, op, attr, inputs, &s, &root, &g)) {
        add_block(&g, &lines, "        ", &to, 0, 0);
        lg_text_add(&text, "static NOINLINE void @(%s", user->levels == 0 ? "int n, " : "");
        add_parameters(&text, op, attr, inputs, user->over);
        add_unused(&text, &g, op, attr, inputs, user->over);
        add_loops(&text, user->levels, length);
        lg_c_largest(c, user->levels > 0 ? BROADCAST_FRAME : frame_of(&lines));
        lg_text_add(&text, "%s    }\n}\n", lines.data);
        if (text.failed || lines.failed)
            (void)lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
        else
            name = lg_c_define(c, op->name, text.data);
    }
    close_graph(&g);
    lg_scalars_destroy(&s);
    lg_text_destroy(&lines);
    lg_text_destroy(&text);
    return name;
}

const char *lg_c_map(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs, uint64_t over) {
    const element_ends user = {.over = over};
    const char *name = lg_c_good(c) ? define_elements(c, op, attr, inputs, &user, NULL) : NULL;
    return name != NULL ? name : "";
}

/* Strides of the inputs along the output's axes, neighbouring axes that go on alike taken together. */
static uint32_t levels_of(const lg_evaluation *e, size_t length[LG_MAX_RANK], size_t (*stride)[LG_MAX_RANK]) {
    uint32_t levels = 0;
    for (uint32_t d = 0; d < e->shape->rank; d++) {
        size_t own[LG_MAX_INPUTS];
        bool same = levels > 0;
        if (e->shape->dims[d] == 1) continue;
        for (uint32_t k = 0; k < e->inputs; k++) {
            const lg_shape *in = e->in[k];
            const uint32_t missing = e->shape->rank - in->rank;
            own[k] = d >= missing && in->dims[d - missing] != 1 ? 1 : 0;
            for (uint32_t a = d + 1; own[k] > 0 && a < e->shape->rank; a++) own[k] *= in->dims[a - missing];
            same = same && stride[k][levels - 1] == own[k] * e->shape->dims[d];
        }
        if (!same) length[levels++] = 1;
        length[levels - 1] *= e->shape->dims[d];
        for (uint32_t k = 0; k < e->inputs; k++) stride[k][levels - 1] = own[k];
    }
    return levels;
}

static void add_call(lg_c *c, const lg_op *op, const char *name, const lg_evaluation *e, uint64_t over,
                     bool counted) {
    lg_text call = {.context = c->context};
    if (name == NULL) return;
    lg_text_add(&call, "%s(", name);
    if (counted) lg_text_add(&call, "%zu, ", e->count);
    for (uint32_t k = 0; k < e->inputs; k++)
        if (is_argument(op, e->attr, e->inputs, over, k)) lg_text_add(&call, "$%u, ", k);
    lg_text_add(&call, "$y)");
    if (call.failed)
        (void)lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
    else
        lg_c_call(c, NULL, "%s", call.data);
    lg_text_destroy(&call);
}

static bool same_place(const lg_place *a, const lg_place *b) {
    return a->area == b->area && a->offset == b->offset &&
           (a->area == LG_AREA_WORK || a->number == b->number);
}

/* Same shapes and single numbers are one loop over all elements. */
void lg_c_elementwise(lg_c *c, const lg_op *op, const lg_evaluation *e) {
    size_t length[LG_MAX_RANK], stride[LG_MAX_INPUTS][LG_MAX_RANK] = {{0}};
    bool one[LG_MAX_INPUTS];
    const uint32_t levels = levels_of(e, length, stride);
    uint64_t over = 0;
    for (uint32_t k = 0; k < e->inputs; k++) {
        /* What is not read is no argument either. */
        if (c->step->x[k].area == LG_AREA_NONE || same_place(&c->step->x[k], &c->step->y))
            over |= (uint64_t)1 << k;
        one[k] = levels == 1 && stride[k][0] == 0;
    }
    const bool single = levels <= 1;
    const element_ends user = {over, one, single ? 0 : levels, (const size_t(*)[LG_MAX_RANK])stride};
    add_call(c, op, define_elements(c, op, e->attr, e->inputs, &user, length), e, over, single);
}

/* ---- a step of scalar code ---- */

/* x[offset + i] */
static void add_element(const lg_c *c, lg_text *to, const lg_scalar_range *range, uint32_t i) {
    const lg_place *at = &range->place;
    if (at->area == LG_AREA_CONSTANTS) {
        lg_text_add(to, "%s_weights[%zu]", c->name, lg_c_constant_at(c, at->offset + i));
        return;
    }
    lg_text_add(to, "%s", at->area == LG_AREA_INPUT ? "x" : at->area == LG_AREA_OUTPUT ? "y" : "work");
    if (at->area != LG_AREA_WORK) lg_text_add(to, "%u", at->number);
    lg_text_add(to, "[%zu]", at->offset + i);
}

/* Ranges are in the order of their numbers. */
static const lg_scalar_range *range_of(const lg_scalar_range *range, uint32_t count, uint32_t number) {
    uint32_t low = 0, high = count;
    while (high - low > 1) {
        const uint32_t middle = (low + high) / 2;
        if (range[middle].first <= number)
            low = middle;
        else
            high = middle;
    }
    return &range[low];
}

static void step_input(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    const lg_scalar_step *step = user;
    const lg_scalar_range *range = range_of(step->in, step->ins, number);
    add_element(c, to, range, number - range->first);
}

static void step_output(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    const lg_scalar_step *step = user;
    const lg_scalar_range *range = range_of(step->out, step->outs, number);
    add_element(c, to, range, number - range->first);
}

static void add_argument(lg_text *parameters, lg_text *arguments, const char *type, const char *name) {
    lg_text_add(parameters, "%s%s%s", parameters->length > 0 ? ", " : "", type, name);
    lg_text_add(arguments, "%s%s", arguments->length > 0 ? ", " : "", name);
}

/* The function of a block, and its call. */
static void define_block(lg_c *c, const lg_text *lines) {
    const lg_plan *plan = c->frame->plan;
    lg_text parameters = {.context = c->context}, arguments = {.context = c->context};
    lg_text text = {.context = c->context};
    char word[32];
    const char *body = lines->data != NULL ? lines->data : "";
    for (size_t i = 0; i < plan->inputs + plan->outputs; i++) {
        const bool in = i < plan->inputs;
        (void)snprintf(word, sizeof word, in ? "x%zu" : "y%zu", in ? i : i - plan->inputs);
        if (lg_c_uses(body, word))
            add_argument(&parameters, &arguments, in ? "const real *" : "real *", word);
    }
    if (lg_c_uses(body, "work")) add_argument(&parameters, &arguments, "real *", "work");
    lg_text_add(&text, "static NOINLINE void @(%s) {\n%s}\n",
                parameters.data != NULL ? parameters.data : "void", body);
    lg_c_need(c, &lg_c_noinline);
    const bool failed = text.failed || parameters.failed || arguments.failed || lines->failed;
    const char *name = failed ? NULL : lg_c_define(c, "scalars", text.data);
    lg_c_largest(c, frame_of(lines));
    if (failed) (void)lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
    if (name != NULL)
        lg_text_add(&c->frame->body, "    %s(%s);\n", name, arguments.data != NULL ? arguments.data : "");
    lg_text_destroy(&parameters);
    lg_text_destroy(&arguments);
    lg_text_destroy(&text);
}

static double constant_at(const lg_plan *plan, const lg_scalar_step *step, uint32_t i) {
    return plan->k->dtype == LG_F64 ? ((const double *)step->constant)[i]
                                    : (double)((const float *)step->constant)[i];
}

static void add_group(const lg_plan *plan, const lg_scalar_step *step, const lg_scalar_group *group,
                      lg_scalar_code *code) {
    const uint32_t *operand = step->operands + group->operands;
    const uint8_t count = operands((lg_scalar_op)group->op);
    for (uint32_t i = 0; i < group->count; i++) {
        lg_scalar_code *made = &code[group->result + i];
        *made = (lg_scalar_code){.op = (lg_scalar_op)group->op};
        for (uint8_t k = 0; k < count; k++) made->in[k] = *operand++;
        if (made->op == LG_S_POW) made->p = constant_at(plan, step, *operand++);
        if (made->op == LG_S_STUMPFF || made->op == LG_S_DEXPINV) made->n = *operand++;
    }
}

/* Registers as instructions: constants, inputs (by the number of their register), results. */
static lg_scalar_code *registers_of(lg_c *c, const lg_scalar_step *step) {
    const uint32_t first = step->constants + step->loads;
    const lg_plan *plan = c->frame->plan;
    lg_scalar_code *code = lg_alloc(c->context, (size_t)first + step->instructions, sizeof *code);
    for (uint32_t i = 0; code != NULL && i < step->constants; i++)
        code[i] = (lg_scalar_code){.op = LG_S_CONSTANT, .p = constant_at(plan, step, i)};
    for (uint32_t i = step->constants; code != NULL && i < first; i++)
        code[i] = (lg_scalar_code){.op = LG_S_INPUT, .n = i};
    for (uint32_t i = 0; code != NULL && i < step->groups; i++) add_group(plan, step, &step->group[i], code);
    return code;
}

static void use_ranges(lg_c *c, const lg_scalar_range *range, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) lg_c_use(c, range[i].place, range[i].count);
}

void lg_c_scalars(lg_c *c, const lg_scalar_step *step) {
    const ends e = {step, step_input, step_output};
    const uint32_t all = step->constants + step->loads + step->instructions;
    const uint32_t roots =
        step->outs == 0 ? 0 : step->out[step->outs - 1].first + step->out[step->outs - 1].count;
    lg_scalar_code *code = registers_of(c, step);
    graph g = {.c = c};
    if (code == NULL) {
        (void)lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
        return;
    }
    use_ranges(c, step->in, step->ins);
    use_ranges(c, step->out, step->outs);
    if (open_graph(&g, c, code, all, step->stored, roots)) {
        for (uint32_t b = 0; b < blocks_of(&g) && lg_c_good(c); b++) {
            lg_text lines = {.context = c->context};
            add_block(&g, &lines, "    ", &e, b, step->registers.offset);
            define_block(c, &lines);
            lg_text_destroy(&lines);
        }
        lg_c_use(c, step->registers, g.slots);
    }
    close_graph(&g);
    lg_free(c->context, code);
}
