#include "autodiff/program/scalars.h"

#include "core/widen.h"

#include <math.h>
#include <string.h>

uint32_t lg_scalar_instructions(lg_scalar_op op) {
    static const uint8_t count[LG_SCALAR_OPS] = {
#define X(name, instructions, all) [LG_S_##name] = instructions,
        LG_SCALAR_LIST(X)
#undef X
    };
    return count[op];
}

uint32_t lg_scalar_operands(lg_scalar_op op) {
    static const uint8_t count[LG_SCALAR_OPS] = {
#define X(name, instructions, all) [LG_S_##name] = all,
        LG_SCALAR_LIST(X)
#undef X
    };
    return count[op];
}

/* ---- memory ---- */

void lg_scalars_init(lg_scalars *s, const lg_context *context) {
    *s = (lg_scalars){.context = context};
}

void lg_scalars_destroy(lg_scalars *s) {
    LG_FREE_ALL(s->context, s->code, s->table);
    *s = (lg_scalars){.context = s->context};
}

static uint64_t hash(const lg_scalar_code *c) {
    uint64_t bits, h = (uint64_t)c->op * 0x9e3779b97f4a7c15u;
    memcpy(&bits, &c->p, sizeof bits);
    const uint64_t parts[5] = {c->in[0], c->in[1], c->in[2], c->n, bits};
    for (size_t i = 0; i < LG_COUNT(parts); i++) h = (h ^ parts[i]) * 0xff51afd7ed558ccdu, h ^= h >> 32;
    return h;
}

static bool same(const lg_scalar_code *a, const lg_scalar_code *b) {
    return a->op == b->op && a->n == b->n && memcmp(&a->p, &b->p, sizeof a->p) == 0 &&
           memcmp(a->in, b->in, sizeof a->in) == 0;
}

/* The table's slot of this instruction, or the free slot where it belongs. */
static uint32_t *slot_of(const lg_scalars *s, const lg_scalar_code *c) {
    uint32_t at = (uint32_t)hash(c) & (s->slots - 1);
    while (s->table[at] != 0 && !same(&s->code[s->table[at] - 1], c)) at = (at + 1) & (s->slots - 1);
    return &s->table[at];
}

static bool grow(lg_scalars *s) {
    const uint32_t capacity = s->capacity == 0 ? 256 : 2 * s->capacity;
    if (s->failed || s->count >= LG_SCALARS_MOST) return false;
    uint32_t *table = lg_alloc(s->context, 2 * (size_t)capacity, sizeof *table);
    lg_scalar_code *code =
        table == NULL ? NULL : lg_widen(s->context, s->code, s->count, capacity, sizeof *code);
    lg_free(s->context, code == NULL ? table : s->table);
    if (code == NULL) return false;
    s->code = code;
    s->table = table;
    s->capacity = capacity;
    s->slots = 2 * capacity;
    for (uint32_t i = 0; i < s->count; i++) *slot_of(s, &s->code[i]) = i + 1;
    return true;
}

static lg_scalar look_up(lg_scalars *s, const lg_scalar_code *c) {
    if (s->count == s->capacity && !grow(s)) s->failed = true;
    if (s->failed) return 0;
    uint32_t *slot = slot_of(s, c);
    if (*slot == 0) {
        s->code[s->count] = *c;
        if (s->level_of != NULL) s->code[s->count].level = s->level_of(s, c);
        *slot = ++s->count;
    }
    return *slot - 1;
}

/* ---- instructions ---- */

lg_scalar lg_s_input(lg_scalars *s, uint32_t number) {
    return look_up(s, &(lg_scalar_code){.op = LG_S_INPUT, .n = number});
}

lg_scalar lg_s_constant(lg_scalars *s, double value) {
    return look_up(s, &(lg_scalar_code){.op = LG_S_CONSTANT, .p = value == 0.0 ? 0.0 : value});
}

void lg_scalars_mark(const lg_scalars *s, const lg_scalar *result, size_t count, uint8_t *live) {
    for (size_t j = 0; j < count; j++) live[result[j]] = 1;
    for (uint32_t i = s->count; i-- > 0;)
        for (uint32_t k = 0; live[i] && k < lg_scalar_instructions(s->code[i].op); k++)
            live[s->code[i].in[k]] = 1;
}

bool lg_s_is_constant(const lg_scalars *s, lg_scalar a, double *value) {
    if (s->failed || s->code[a].op != LG_S_CONSTANT) return false;
    *value = s->code[a].p;
    return true;
}

/* Evaluates an operation on constants by the kernel that runs it, which rounds as a plan does. */
static double carry_out(const lg_scalar_code *c, const double *x) {
    enum { A, B, EXPONENT, RESULT, REGISTERS };
    double r[REGISTERS] = {[A] = x[0], [B] = x[1], [EXPONENT] = c->p};
    const bool numbered = c->op == LG_S_STUMPFF || c->op == LG_S_DEXPINV;
    const uint32_t operands[] = {A, numbered ? c->n : c->op == LG_S_POW ? EXPONENT : B};
    const lg_scalar_group group = {.op = c->op, .count = 1, .result = RESULT};
    lg_kernels_for(LG_F64)->scalars(1, &group, operands, r);
    return r[RESULT];
}

/* Operations that round nothing: exact code evaluates them on constants. */
static bool is_exact(lg_scalar_op op) {
    return op == LG_S_NEG || op == LG_S_MAX || op == LG_S_GE || op == LG_S_ABS || op == LG_S_SIGN;
}

/* If all operands are constants and the result is finite, sets *out to a constant and returns true. */
static bool folded(lg_scalars *s, const lg_scalar_code *c, lg_scalar *out) {
    double x[2] = {0, 0};
    if (s->level_of != NULL && !is_exact(c->op)) return false;
    for (uint8_t k = 0; k < lg_scalar_instructions(c->op); k++)
        if (!lg_s_is_constant(s, c->in[k], &x[k])) return false;
    const double value = carry_out(c, x);
    if (!isfinite(value)) return false;
    *out = lg_s_constant(s, value);
    return true;
}

static bool is_value(const lg_scalars *s, lg_scalar a, double value) {
    double is;
    return lg_s_is_constant(s, a, &is) && is == value;
}

/* Whether a value may be dropped whose product with 0 is needed. */
static bool droppable(const lg_scalars *s, lg_scalar a) {
    return s->level_of == NULL || s->drops || s->code[a].level >= LG_S_LIPSCHITZ;
}

/* 0 a */
static lg_scalar nothing(lg_scalars *s, lg_scalar a) {
    const lg_scalar zero = lg_s_constant(s, 0.0);
    return droppable(s, a) ? zero : look_up(s, &(lg_scalar_code){.op = LG_S_MUL, .in = {zero, a, 0}});
}

/* Simplifies x + 0, x - 0, 0 - x, 1 x, -1 x, 0 x, x/1, 0/x, x - x, a - (-b), a + (-b), (-a) (-b), -(-x). */
static bool simpler(lg_scalars *s, lg_scalar_op op, lg_scalar a, lg_scalar b, lg_scalar *out) {
    const bool negative_a = s->code[a].op == LG_S_NEG, negative_b = s->code[b].op == LG_S_NEG;
    *out = a;
    switch (op) {
    case LG_S_ADD:
        if (is_value(s, b, 0.0)) return true;
        if (is_value(s, a, 0.0)) return *out = b, true;
        if (negative_b) return *out = lg_s_sub(s, a, s->code[b].in[0]), true;
        if (negative_a) return *out = lg_s_sub(s, b, s->code[a].in[0]), true;
        return false;
    case LG_S_SUB:
        if (is_value(s, b, 0.0)) return true;
        if (is_value(s, a, 0.0)) return *out = lg_s_neg(s, b), true;
        if (a == b) return *out = nothing(s, a), true;
        if (negative_b) return *out = lg_s_add(s, a, s->code[b].in[0]), true;
        return false;
    case LG_S_MUL:
        if (is_value(s, b, 1.0)) return true;
        if (is_value(s, a, 1.0)) return *out = b, true;
        if (is_value(s, b, -1.0)) return *out = lg_s_neg(s, a), true;
        if (is_value(s, a, -1.0)) return *out = lg_s_neg(s, b), true;
        if (is_value(s, b, 0.0) || is_value(s, a, 0.0))
            return *out = nothing(s, is_value(s, b, 0.0) ? a : b), true;
        if (negative_a && negative_b) return *out = lg_s_mul(s, s->code[a].in[0], s->code[b].in[0]), true;
        return false;
    case LG_S_DIV:
        if (is_value(s, b, 1.0)) return true;
        if (is_value(s, a, 0.0) && (s->level_of == NULL || s->drops)) return *out = a, true;
        return false;
    case LG_S_NEG:
        return negative_a ? (*out = s->code[a].in[0], true) : false;
    default:
        return false;
    }
}

static bool commutes(lg_scalar_op op) {
    return op == LG_S_ADD || op == LG_S_MUL;
}

lg_scalar lg_s(lg_scalars *s, lg_scalar_op op, lg_scalar a, lg_scalar b) {
    lg_scalar out;
    lg_scalar_code c = {.op = op, .in = {a, lg_scalar_instructions(op) > 1 ? b : 0, 0}};
    if (s->failed) return 0;
    if (folded(s, &c, &out) || simpler(s, op, a, b, &out)) return out;
    if (commutes(op) && c.in[0] > c.in[1]) {
        c.in[0] = b;
        c.in[1] = a;
    }
    return look_up(s, &c);
}

lg_scalar lg_s_select(lg_scalars *s, lg_scalar condition, lg_scalar yes, lg_scalar no) {
    double value;
    if (s->failed) return 0;
    if (yes == no && (s->level_of == NULL || s->code[condition].level >= LG_S_DEFINED)) return yes;
    if (lg_s_is_constant(s, condition, &value)) return value != 0.0 ? yes : no;
    return look_up(s, &(lg_scalar_code){.op = LG_S_SELECT, .in = {condition, yes, no}});
}

lg_scalar lg_s_pow(lg_scalars *s, lg_scalar a, double exponent) {
    lg_scalar out;
    if (exponent == 1.0) return a;
    if (exponent == 2.0) return lg_s_mul(s, a, a);
    const lg_scalar_code c = {.op = LG_S_POW, .p = exponent, .in = {a, 0, 0}};
    if (s->failed) return 0;
    return folded(s, &c, &out) ? out : look_up(s, &c);
}

lg_scalar lg_s_stopped(lg_scalars *s, lg_scalar a) {
    return s->level_of != NULL ? look_up(s, &(lg_scalar_code){.op = LG_S_POW, .p = 1.0, .in = {a, 0, 0}}) : a;
}

lg_scalar lg_s_numbered(lg_scalars *s, lg_scalar_op op, lg_scalar a, uint32_t n) {
    lg_scalar out;
    const lg_scalar_code c = {.op = op, .n = n, .in = {a, 0, 0}};
    if (s->failed) return 0;
    return folded(s, &c, &out) ? out : look_up(s, &c);
}

lg_scalar lg_s_sum(lg_scalars *s, const lg_scalar *terms, size_t n, size_t step) {
    if (n == 0) return lg_s_constant(s, 0.0);
    if (n == 1) return terms[0];
    const size_t half = (n + 1) / 2;
    const lg_scalar left = lg_s_sum(s, terms, half, step);
    return lg_s_add(s, left, lg_s_sum(s, terms + half * step, n - half, step));
}

lg_scalar lg_s_dot(lg_scalars *s, const lg_scalar *a, size_t sa, const lg_scalar *b, size_t sb, size_t n) {
    if (n == 0) return lg_s_constant(s, 0.0);
    if (n == 1) return lg_s_mul(s, a[0], b[0]);
    const size_t half = (n + 1) / 2;
    const lg_scalar left = lg_s_dot(s, a, sa, b, sb, half);
    return lg_s_add(s, left, lg_s_dot(s, a + half * sa, sa, b + half * sb, sb, n - half));
}

/* ---- expansion of operations ---- */

/* Index of the element of an input that element `at` of the output uses. */
static size_t broadcast_index(const lg_shape *in, const lg_shape *out, size_t at) {
    size_t index = 0, stride = 1;
    for (uint32_t d = 0; d < in->rank; d++) {
        const uint32_t length = out->dims[out->rank - 1 - d], own = in->dims[in->rank - 1 - d];
        index += own == 1 ? 0 : at % length * stride;
        stride *= own;
        at /= length;
    }
    return index;
}

static void expand_elementwise(lg_scalars *s, const lg_op *op, const lg_evaluation *e,
                               const lg_scalar *const *x, lg_scalar *y) {
    const uint32_t unread = op->unread != NULL ? op->unread(e->attr, e->inputs) : 0;
    for (size_t i = 0; i < e->count; i++) {
        lg_scalar in[LG_MAX_INPUTS];
        for (uint32_t k = 0; k < e->inputs; k++)
            in[k] = k < 32 && (unread >> k & 1u) ? 0 : x[k][broadcast_index(e->in[k], e->shape, i)];
        y[i] = op->element(s, e->attr, in, e->inputs);
    }
}

_Static_assert(sizeof(lg_scalar) == sizeof(float), "instructions are moved as single numbers are");
void lg_moved_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    lg_evaluation moving = *e;
    moving.k = lg_kernels_for(LG_F32);
    moving.x = (const void *const *)x;
    moving.y = y;
    (void)s->row->forward(&moving);
}

bool lg_scalars_expand(lg_scalars *s, const lg_op *op, const lg_evaluation *e, const lg_scalar *const *x,
                       lg_scalar *y) {
    s->row = op;
    if (op->element != NULL)
        expand_elementwise(s, op, e, x, y);
    else if (op->expand != NULL)
        op->expand(s, e, x, y);
    else
        return false;
    return !s->failed;
}
