#include "autodiff/program/program_c_lines.h"
#include "core/clean.h"

#include <string.h>

/* Maximum number of instructions in one function of straight-line code; this keeps compile times short and
 * stack frames small. */
#define BLOCK 512

/* At -O0 each local variable takes a stack slot of 8 bytes; twice that is a safe bound. */
size_t lg_c_frame_of(const lg_text *lines) {
    size_t locals = 0;
    for (const char *s = lines->data; s != NULL && (s = strstr(s, "real ")) != NULL; s++) locals++;
    return 512 + 16 * locals;
}

/* ---- expressions ---- */

/* a, b and c stand for operands, p and n for the instruction's constants. */
static const char *const expressions[LG_SCALAR_OPS] = {
    [LG_S_ADD] = "a + b",
    [LG_S_SUB] = "a - b",
    [LG_S_MUL] = "a * b",
    [LG_S_DIV] = "a / b",
    [LG_S_NEG] = "-a",
    [LG_S_MAX] = "larger(a, b)",
    [LG_S_GE] = "a >= b ? REAL(1.0) : REAL(0.0)",
    [LG_S_SELECT] = "a != REAL(0.0) ? b : c",
    [LG_S_SQRT] = "SQRT(a)",
    [LG_S_ABS] = "FABS(a)",
    [LG_S_SIGN] = "a >= REAL(0.0) ? REAL(1.0) : a < REAL(0.0) ? REAL(-1.0) : a",
    [LG_S_POW] = "POW(a, p)",
    [LG_S_EXP] = "EXP(a)",
    [LG_S_LOG] = "LOG(a)",
    [LG_S_SIN] = "SIN(a)",
    [LG_S_COS] = "COS(a)",
    [LG_S_TANH] = "tanh_of(a)",
    [LG_S_SIGMOID] = "sigmoid_of(a)",
    [LG_S_ATAN2] = "ATAN2(a, b)",
    [LG_S_DEXPINV] = "dexpinv_coef(a, n)",
};

/* Powers that are written without a call of POW. */
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
    return expressions[code->op];
}

/* ---- sorting the instructions by the results that need them ---- */

static bool is_leaf(const lg_c_graph *g, uint32_t i) {
    return g->code[i].op == LG_S_INPUT || g->code[i].op == LG_S_CONSTANT;
}

static bool has_siblings(const lg_scalar_code *code) {
    return code->op == LG_S_STUMPFF || code->op == LG_S_SIN || code->op == LG_S_COS;
}

static void put(lg_c_graph *g, uint32_t i) {
    if (g->place[i] != 0) return;
    g->order[g->ordered++] = i;
    g->place[i] = g->ordered;
}

/* Appends the instruction to the sequence g->order, together with needed instructions that are cheap to
 * compute at the same time: SIN and COS of the same angle, or Stumpff functions of the same argument and
 * derivative. */
static void put_family(lg_c_graph *g, uint32_t i) {
    put(g, i);
    if (!has_siblings(&g->code[i])) return;
    for (uint32_t s = g->first[g->code[i].in[0]]; s != 0; s = g->sibling[s - 1]) {
        const lg_scalar_code *own = &g->code[i], *other = &g->code[s - 1];
        const bool circle = own->op != LG_S_STUMPFF && other->op != LG_S_STUMPFF;
        if (circle || (own->op == other->op && own->n / 16 == other->n / 16)) put(g, s - 1);
    }
}

/* Adds everything that a result needs to the order, operands first: all instructions for one operand, then
 * all for the next. */
static void sort_from(lg_c_graph *g, uint32_t root) {
    uint32_t depth = 0;
    g->stack[depth++] = root;
    while (depth > 0) {
        const uint32_t i = g->stack[depth - 1];
        const lg_scalar_code *code = &g->code[i];
        uint32_t missing = UINT32_MAX;
        for (uint8_t k = 0; k < lg_scalar_instructions(code->op) && missing == UINT32_MAX; k++)
            if (!is_leaf(g, code->in[k]) && g->place[code->in[k]] == 0) missing = code->in[k];
        if (missing != UINT32_MAX) {
            g->stack[depth++] = missing;
        } else {
            if (!is_leaf(g, i)) put_family(g, i);
            depth--;
        }
    }
}

static void mark(uint8_t *used, const lg_c_graph *g) {
    for (uint32_t r = 0; r < g->roots; r++) used[g->root[r]] = 1;
    for (uint32_t i = g->count; i-- > 0;)
        for (uint8_t k = 0; used[i] && k < lg_scalar_instructions(g->code[i].op); k++)
            used[g->code[i].in[k]] = 1;
}

/* Sorts the instructions. Only needed instructions become siblings. Operands always have smaller numbers than
 * the instructions that use them. */
static bool sort(lg_c_graph *g) {
    LG_TRY_SCRATCH(uint8_t, used, g->c->context, g->count,
                   lg_c_fail(g->c, LG_OUT_OF_MEMORY, "out of memory"));
    mark(used, g);
    for (uint32_t i = g->count; i-- > 0;)
        if (used[i] && has_siblings(&g->code[i])) {
            g->sibling[i] = g->first[g->code[i].in[0]];
            g->first[g->code[i].in[0]] = i + 1;
        }
    for (uint32_t r = 0; r < g->roots; r++) sort_from(g, g->root[r]);
    return true;
}

static uint32_t block_of(const lg_c_graph *g, uint32_t i) {
    return (g->place[i] - 1) / BLOCK;
}

/* Gives a slot to each value that a later block than its own reads. A root is stored by the block that
 * computes it, so it needs no slot for that. */
static void find_slots(lg_c_graph *g) {
    for (uint32_t o = 0; o < g->ordered; o++) {
        const lg_scalar_code *code = &g->code[g->order[o]];
        for (uint8_t k = 0; k < lg_scalar_instructions(code->op); k++) {
            const uint32_t in = code->in[k];
            if (!is_leaf(g, in) && g->slot[in] == 0 && block_of(g, in) != o / BLOCK) g->slot[in] = ++g->slots;
        }
    }
}

bool lg_c_graph_open(lg_c_graph *g, lg_c *c, const lg_scalar_code *code, uint32_t count, const uint32_t *root,
                     uint32_t roots) {
    *g = (lg_c_graph){.c = c, .code = code, .count = count, .root = root, .roots = roots};
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

void lg_c_graph_close(lg_c_graph *g) {
    uint32_t *const arrays[] = {g->order, g->place, g->sibling, g->first, g->stack, g->shown, g->slot};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(g->c->context, arrays[i]);
}

/* ---- lines ---- */

static void add_operand(const lg_c_graph *g, lg_text *to, uint32_t i) {
    const lg_scalar_code *code = &g->code[i];
    if (code->op != LG_S_CONSTANT) {
        lg_text_add(to, "v%u", i);
        return;
    }
    if (code->p < 0) lg_text_add(to, "(");
    lg_text_add_real(to, g->c->dtype, code->p);
    if (code->p < 0) lg_text_add(to, ")");
}

/* Writes an expression; in its text, a single letter that stands alone is an operand or a constant. */
static void add_expression(const lg_c_graph *g, lg_text *to, const lg_scalar_code *code) {
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

/* Stumpff functions of the same argument and order are computed as one row by the first of them in a block;
 * the others read elements of this row. */
static void add_stumpff(lg_c_graph *g, lg_text *to, const char *indent, uint32_t i) {
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

/* Loads an operand that this block does not have yet: an input, or a value computed in an earlier block. */
static void add_loads(lg_c_graph *g, lg_text *to, const char *indent, const lg_c_ends *e, uint32_t block,
                      uint32_t i, size_t slots_at) {
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

static void add_line(lg_c_graph *g, lg_text *to, const char *indent, const lg_c_ends *e, uint32_t block,
                     uint32_t i, size_t slots_at) {
    const lg_scalar_code *code = &g->code[i];
    for (uint8_t k = 0; k < lg_scalar_instructions(code->op); k++)
        add_loads(g, to, indent, e, block, code->in[k], slots_at);
    if (code->op == LG_S_STUMPFF) {
        lg_c_need(g->c, "stumpff_row");
        add_stumpff(g, to, indent, i);
        return;
    }
    lg_c_need_called(g->c, expressions[code->op]);
    lg_text_add(to, "%sconst real v%u = ", indent, i);
    add_expression(g, to, code);
    lg_text_add(to, ";\n");
}

/* Stores the slots and roots that this block computes. The last block also stores roots that are inputs or
 * constants. */
static void add_stores(lg_c_graph *g, lg_text *to, const char *indent, const lg_c_ends *e, uint32_t block,
                       bool last, size_t slots_at) {
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

uint32_t lg_c_graph_blocks(const lg_c_graph *g) {
    return g->ordered == 0 ? 1 : (g->ordered + BLOCK - 1) / BLOCK;
}

void lg_c_graph_lines(lg_c_graph *g, lg_text *to, const char *indent, const lg_c_ends *e, uint32_t block,
                      size_t slots_at) {
    for (uint32_t o = block * BLOCK; o < g->ordered && o < (block + 1) * BLOCK; o++)
        add_line(g, to, indent, e, block, g->order[o], slots_at);
    add_stores(g, to, indent, e, block, block + 1 == lg_c_graph_blocks(g), slots_at);
}
