/* Taylor coefficients in time of motions x' = f(x, u) with a constant u, and their Jacobians, as scalar code.
 *
 * Every instruction is a function of time along a motion. With x(t) = sum_k x_k t^k, the coefficients of f
 * give x_{k+1} = f_k/(k + 1). For y = g(a, b) the rule y' = g_a a' + g_b b' gives
 *     y_k = sum_operands sum_{i=1..k} (i/k) a_i (g_a)_{k-i},
 * where g_a is scalar code, whose coefficients follow in the same way. So a row of the table is the slope of
 * its operation; products, quotients and roots have shorter formulas. The Jacobians are the forward mode of
 * the code that results. */
#include "certify/interval.h"
#include "kernels/stumpff.h"

typedef struct taylor {
    lg_expansion *x;
    lg_scalars *s;
    size_t states, columns;
    uint32_t orders;
    lg_scalar *coefficient; /* (capacity, orders): 1 + the instruction; 0: not computed */
    size_t capacity;
    lg_scalar *state; /* (orders, states): x_k for k >= 1 */
    lg_scalar *point; /* for each instruction: the same at a point; NULL: Jacobians instead of chords */
    const char *unsupported;
} taylor;

static bool is_zero(const taylor *t, lg_scalar a) {
    double value;
    return lg_s_is_constant(t->s, a, &value) && value == 0.0;
}

static lg_scalar number(taylor *t, double value) {
    return lg_s_constant(t->s, value);
}

/* a i/k; a quotient that is not exact is kept as a division of constants. */
static lg_scalar part(taylor *t, uint32_t i, uint32_t k, lg_scalar a) {
    const bool exact = (k & (k - 1)) == 0;
    if (i == k) return a;
    return lg_s_mul(t->s, exact ? number(t, (double)i / k) : lg_s_div(t->s, number(t, i), number(t, k)), a);
}

/* ---- slopes by operand k of y = op(a, b) ---- */

typedef lg_scalar slope_of(taylor *t, const lg_scalar_code *c, lg_scalar y, uint32_t k);
#define SLOPE(name) static lg_scalar name(taylor *t, const lg_scalar_code *c, lg_scalar y, uint32_t k)

SLOPE(by_one) {
    return number(t, 1);
}
SLOPE(by_sign) {
    return number(t, k == 1 || c->op == LG_S_NEG ? -1 : 1);
}
SLOPE(by_other) {
    return c->in[0] == c->in[1] && k == 0 ? lg_s_scale(t->s, 2, c->in[0]) : c->in[1 - k];
}
SLOPE(of_quotient) {
    if (k == 0) return lg_s_div(t->s, number(t, 1), c->in[1]);
    return lg_s_neg(t->s, lg_s_div(t->s, y, c->in[1]));
}
SLOPE(of_root) {
    return lg_s_div(t->s, number(t, 0.5), y);
}
/* p a^(p-1), if p - 1 is exact */
SLOPE(of_power) {
    const bool exact = 2 * c->p == (double)(int)(2 * c->p);
    return lg_s_scale(t->s, c->p, exact ? lg_s_pow(t->s, c->in[0], c->p - 1) : lg_s_div(t->s, y, c->in[0]));
}
SLOPE(of_exp) {
    return y;
}
SLOPE(of_log) {
    return lg_s_div(t->s, number(t, 1), c->in[0]);
}
SLOPE(of_sin) {
    return lg_s(t->s, LG_S_COS, c->in[0], 0);
}
SLOPE(of_cos) {
    return lg_s_neg(t->s, lg_s(t->s, LG_S_SIN, c->in[0], 0));
}
SLOPE(of_tanh) {
    return lg_s_sub(t->s, number(t, 1), lg_s_mul(t->s, y, y));
}
SLOPE(of_sigmoid) {
    return lg_s_mul(t->s, y, lg_s_sub(t->s, number(t, 1), y));
}
SLOPE(of_angle) {
    const lg_scalar a = c->in[0], b = c->in[1],
                    square = lg_s_add(t->s, lg_s_mul(t->s, a, a), lg_s_mul(t->s, b, b));
    return lg_s_div(t->s, k == 0 ? b : lg_s_neg(t->s, a), square);
}
/* The next derivative of a numbered function */
SLOPE(of_numbered) {
    const bool stumpff = c->op == LG_S_STUMPFF;
    if ((stumpff ? c->n / 16 : c->n) + 1 > LG_STUMPFF_MAX_ORDER) t->unsupported = "a Stumpff function";
    return lg_s_numbered(t->s, c->op, c->in[0], c->n + (stumpff ? 16 : 1));
}

/* ---- slopes of chords from a point: y - y_0 = sum_k slope_k (in_k - in_k0) ----
 *
 * The slope of a smooth operation over the box is a slope of its chords, too. These are narrower, mostly by
 * half. */

SLOPE(chord_of_product) {
    const lg_scalar a = c->in[0], first = t->point[a];
    if (a == c->in[1]) return lg_s_add(t->s, a, first);
    return k == 0 ? c->in[1] : first;
}
SLOPE(chord_of_quotient) {
    if (k == 0) return lg_s_div(t->s, number(t, 1), c->in[1]);
    return lg_s_neg(t->s, lg_s_div(t->s, t->point[y], c->in[1]));
}
SLOPE(chord_of_root) {
    return lg_s_div(t->s, number(t, 1), lg_s_add(t->s, y, t->point[y]));
}
/* sin a - sin b = cos((a + b)/2) (a - b) sin(w)/w with w = (a - b)/2, and 1 - w^2/6 <= sin(w)/w <= 1. The
 * bounds of w^2 begin with 0. */
SLOPE(chord_of_wave) {
    const lg_scalar a = c->in[0], b = t->point[a], half = lg_s_scale(t->s, 0.5, lg_s_add(t->s, a, b)),
                    apart = lg_s_sub(t->s, a, b), square = lg_s_mul(t->s, apart, apart),
                    least = lg_s_sub(t->s, number(t, 1), lg_s_scale(t->s, 0x1.5555555555556p-5, square)),
                    slope = lg_s(t->s, c->op == LG_S_SIN ? LG_S_COS : LG_S_SIN, half, 0),
                    out = lg_s_mul(t->s, slope, least);
    return c->op == LG_S_SIN ? out : lg_s_neg(t->s, out);
}

/* ---- kinks and jumps ---- */

/* 0 where a condition is decided over the box; else without bounds, because the root of a number below 0 is.
 * Conditions are comparisons and products of them. */
static lg_scalar jump(taylor *t, lg_scalar condition) {
    const lg_scalar_code c = t->s->code[condition];
    if (c.op == LG_S_MUL) return lg_s_add(t->s, jump(t, c.in[0]), jump(t, c.in[1]));
    if (c.op != LG_S_GE) t->unsupported = "a choice (lg_select) by a value that is no comparison";
    const lg_scalar both = lg_s_mul(t->s, condition, lg_s_sub(t->s, number(t, 1), condition));
    return lg_s(t->s, LG_S_SQRT, lg_s_neg(t->s, both), 0);
}

/* Whether the instruction is such a root. Its derivatives are itself: 0, or without bounds. */
static bool is_jump(const taylor *t, const lg_scalar_code *c) {
    const lg_scalar_code *code = t->s->code, *inner = &code[c->in[0]];
    if (c->op != LG_S_SQRT || inner->op != LG_S_NEG || code[inner->in[0]].op != LG_S_MUL) return false;
    inner = &code[inner->in[0]];
    return code[inner->in[0]].op == LG_S_GE || code[inner->in[1]].op == LG_S_GE;
}

/* What a comparison, a sign, a choice or a maximum gives for derivatives d of its operands. `smooth`: the
 * derivative is of second or higher order, so it is unknown where a kink is not decided. */
typedef lg_scalar choice_of(taylor *t, const lg_scalar_code *c, const lg_scalar *d, bool smooth);
#define CHOICE(name)                                                                                         \
    static lg_scalar name(taylor *t, const lg_scalar_code *c, const lg_scalar *d, bool smooth)

static lg_scalar chosen(taylor *t, lg_scalar condition, lg_scalar yes, lg_scalar no, bool jumps) {
    const lg_scalar value = lg_s_select(t->s, condition, yes, no);
    return jumps ? lg_s_add(t->s, value, jump(t, condition)) : value;
}
CHOICE(of_jump) {
    const bool sign = c->op == LG_S_SIGN;
    if (is_zero(t, d[0]) && (sign || is_zero(t, d[1]))) return number(t, 0);
    return jump(t, lg_s(t->s, LG_S_GE, c->in[0], sign ? number(t, 0) : c->in[1]));
}
CHOICE(of_select) {
    return chosen(t, c->in[0], d[1], d[2], !is_zero(t, d[0]));
}
CHOICE(of_maximum) {
    const bool moves = !is_zero(t, d[0]) || !is_zero(t, d[1]);
    return chosen(t, lg_s(t->s, LG_S_GE, c->in[0], c->in[1]), d[0], d[1], smooth && moves);
}
CHOICE(of_size) {
    return chosen(t, lg_s(t->s, LG_S_GE, c->in[0], number(t, 0)), d[0], lg_s_neg(t->s, d[0]),
                  smooth && !is_zero(t, d[0]));
}

/* ---- coefficients ---- */

static lg_scalar at(taylor *t, lg_scalar i, uint32_t k);
typedef lg_scalar series_of(taylor *t, const lg_scalar_code *c, lg_scalar y, uint32_t k);
#define SERIES(name) static lg_scalar name(taylor *t, const lg_scalar_code *c, lg_scalar y, uint32_t k)

/* sum_{i=from..to} a_i b_{k-i}; squares are computed as such. */
static lg_scalar convolved(taylor *t, lg_scalar a, lg_scalar b, uint32_t k, uint32_t from, uint32_t to) {
    lg_scalar sum = number(t, 0);
    for (uint32_t i = from; i <= to; i++) {
        const bool twice = a == b && from == k - to && 2 * i < k;
        if (a == b && from == k - to && 2 * i > k) break;
        const lg_scalar product = lg_s_mul(t->s, at(t, a, i), at(t, b, k - i));
        sum = lg_s_add(t->s, sum, twice ? lg_s_scale(t->s, 2, product) : product);
    }
    return sum;
}
SERIES(sum_series) {
    const lg_scalar a = at(t, c->in[0], k);
    if (c->op == LG_S_NEG) return lg_s_neg(t->s, a);
    return lg_s(t->s, c->op, a, at(t, c->in[1], k));
}
SERIES(product_series) {
    return convolved(t, c->in[0], c->in[1], k, 0, k);
}
SERIES(quotient_series) {
    const lg_scalar rest = convolved(t, c->in[1], y, k, 1, k);
    return lg_s_div(t->s, lg_s_sub(t->s, at(t, c->in[0], k), rest), c->in[1]);
}
SERIES(root_series) {
    const lg_scalar rest = convolved(t, y, y, k, 1, k - 1);
    return lg_s_div(t->s, lg_s_sub(t->s, at(t, c->in[0], k), rest), lg_s_scale(t->s, 2, y));
}

static const struct {
    slope_of *slope;
    series_of *series; /* NULL: from the slope */
    choice_of *choice; /* instead of a slope */
    slope_of *chord;   /* NULL: the slope over the box */
} rows[LG_SCALAR_OPS] = {[LG_S_ADD] = {by_one, sum_series, NULL, NULL},
                         [LG_S_SUB] = {by_sign, sum_series, NULL, NULL},
                         [LG_S_NEG] = {by_sign, sum_series, NULL, NULL},
                         [LG_S_MUL] = {by_other, product_series, NULL, chord_of_product},
                         [LG_S_DIV] = {of_quotient, quotient_series, NULL, chord_of_quotient},
                         [LG_S_SQRT] = {of_root, root_series, NULL, chord_of_root},
                         [LG_S_POW] = {of_power, NULL, NULL, NULL},
                         [LG_S_EXP] = {of_exp, NULL, NULL, NULL},
                         [LG_S_LOG] = {of_log, NULL, NULL, NULL},
                         [LG_S_SIN] = {of_sin, NULL, NULL, chord_of_wave},
                         [LG_S_COS] = {of_cos, NULL, NULL, chord_of_wave},
                         [LG_S_TANH] = {of_tanh, NULL, NULL, NULL},
                         [LG_S_SIGMOID] = {of_sigmoid, NULL, NULL, NULL},
                         [LG_S_ATAN2] = {of_angle, NULL, NULL, NULL},
                         [LG_S_STUMPFF] = {of_numbered, NULL, NULL, NULL},
                         [LG_S_DEXPINV] = {of_numbered, NULL, NULL, NULL},
                         [LG_S_GE] = {NULL, NULL, of_jump, NULL},
                         [LG_S_SIGN] = {NULL, NULL, of_jump, NULL},
                         [LG_S_SELECT] = {NULL, NULL, of_select, NULL},
                         [LG_S_MAX] = {NULL, NULL, of_maximum, NULL},
                         [LG_S_ABS] = {NULL, NULL, of_size, NULL}};

static uint32_t operands(const lg_scalar_code *c) {
    const bool square = c->op == LG_S_MUL && c->in[0] == c->in[1];
    return square ? 1 : lg_scalar_instructions(c->op);
}

/* Whether the table knows the operation; an operation without operands is constant. A power of 1 marks what
 * lg_stop_gradient hides. */
static bool known(taylor *t, const lg_scalar_code *c) {
    const bool stopped = c->op == LG_S_POW && c->p == 1.0;
    if (lg_scalar_instructions(c->op) == 0) return true;
    if (!stopped && (rows[c->op].slope != NULL || rows[c->op].choice != NULL)) return true;
    t->unsupported = stopped ? "lg_stop_gradient" : "an operation without a row";
    return false;
}

static lg_scalar computed(taylor *t, lg_scalar i, uint32_t k) {
    const lg_scalar_code c = t->s->code[i];
    lg_scalar d[3] = {0}, sum = number(t, 0);
    bool moves = false;
    if (c.op == LG_S_INPUT) return c.n < t->states ? t->state[(k - 1) * t->states + c.n] : sum;
    if (!known(t, &c)) return sum;
    for (uint32_t o = 0; o < operands(&c); o++) moves = !is_zero(t, at(t, c.in[o], 1)) || moves;
    if (!moves) return sum; /* constant in time */
    if (is_jump(t, &c)) return i;
    if (rows[c.op].choice != NULL) {
        for (uint32_t o = 0; o < operands(&c); o++) d[o] = at(t, c.in[o], k);
        return rows[c.op].choice(t, &c, d, k > 1);
    }
    if (rows[c.op].series != NULL) return rows[c.op].series(t, &c, i, k);
    for (uint32_t o = 0; o < operands(&c); o++) {
        const lg_scalar slope = rows[c.op].slope(t, &c, i, o);
        for (uint32_t j = 1; j <= k && !t->s->failed; j++)
            sum = lg_s_add(t->s, sum, part(t, j, k, lg_s_mul(t->s, at(t, c.in[o], j), at(t, slope, k - j))));
    }
    return sum;
}

/* Coefficient k of instruction i */
static lg_scalar at(taylor *t, lg_scalar i, uint32_t k) {
    if (k == 0 || t->s->failed) return i;
    if (i >= t->capacity) {
        const size_t capacity = 2 * (size_t)i + 256;
        lg_scalar *grown = lg_heap_take(&t->x->heap, capacity * t->orders, sizeof *grown);
        if (grown == NULL) {
            t->s->failed = true;
            return 0;
        }
        for (size_t j = 0; j < t->capacity * t->orders; j++) grown[j] = t->coefficient[j];
        t->coefficient = grown;
        t->capacity = capacity;
    }
    const size_t place = (size_t)i * t->orders + k - 1;
    if (t->coefficient[place] == 0) {
        const lg_scalar made = computed(t, i, k);
        t->coefficient[(size_t)i * t->orders + k - 1] = made + 1;
    }
    return t->coefficient[(size_t)i * t->orders + k - 1] - 1;
}

/* ---- Jacobians ---- */

static lg_scalar derivative(taylor *t, lg_scalar i, const lg_scalar *of, size_t column) {
    const lg_scalar_code c = t->s->code[i];
    lg_scalar d[3] = {0}, sum = number(t, 0);
    bool moves = false;
    if (c.op == LG_S_INPUT) return number(t, c.n == column);
    if (!known(t, &c)) return sum;
    for (uint32_t o = 0; o < operands(&c); o++) {
        d[o] = of[c.in[o] * t->columns + column];
        moves = moves || !is_zero(t, d[o]);
    }
    if (!moves) return sum;
    if (is_jump(t, &c)) return i;
    if (rows[c.op].choice != NULL) return rows[c.op].choice(t, &c, d, false);
    slope_of *const slope =
        t->point != NULL && rows[c.op].chord != NULL ? rows[c.op].chord : rows[c.op].slope;
    for (uint32_t o = 0; o < operands(&c); o++)
        if (!is_zero(t, d[o])) sum = lg_s_add(t->s, sum, lg_s_mul(t->s, slope(t, &c, i, o), d[o]));
    return sum;
}

/* The instruction with other operands; inputs follow those of the code. */
static lg_scalar copied(taylor *t, lg_scalar i) {
    const lg_scalar_code c = t->s->code[i];
    const lg_scalar *in = c.in, *to = t->point;
    if (c.op == LG_S_CONSTANT) return i;
    if (c.op == LG_S_INPUT) return lg_s_input(t->s, c.n + (uint32_t)t->columns);
    if (c.op == LG_S_SELECT) return lg_s_select(t->s, to[in[0]], to[in[1]], to[in[2]]);
    if (c.op == LG_S_POW) return lg_s_pow(t->s, to[in[0]], c.p);
    if (c.op == LG_S_STUMPFF || c.op == LG_S_DEXPINV) return lg_s_numbered(t->s, c.op, to[in[0]], c.n);
    return lg_s(t->s, c.op, to[in[0]], to[in[1]]);
}

/* The Jacobians of `count` results, (count, columns). `chords`: the results at a point, then slopes of
 * chords */
static lg_scalar *jacobians(taylor *t, const lg_scalar *result, size_t count, bool chords) {
    const uint32_t end = t->s->count;
    lg_scalar *of = lg_heap_take(&t->x->heap, (size_t)end * t->columns + 1, sizeof *of),
              *all = lg_heap_take(&t->x->heap, count * (t->columns + 1) + 1, sizeof *all),
              *point = lg_heap_take(&t->x->heap, end, sizeof *point), *out = all;
    uint8_t *live = lg_heap_take(&t->x->heap, end, 1);
    if (of == NULL || all == NULL || live == NULL || point == NULL) return NULL;
    lg_scalars_mark(t->s, result, count, live);
    if (chords) t->point = point;
    for (uint32_t i = 0; i < end && chords && !t->s->failed; i++)
        if (live[i]) point[i] = copied(t, i);
    for (size_t j = 0; j < count && chords; j++) *out++ = point[result[j]];
    for (uint32_t i = 0; i < end && !t->s->failed; i++)
        for (size_t j = 0; live[i] && j < t->columns; j++) of[i * t->columns + j] = derivative(t, i, of, j);
    for (size_t j = 0; j < count * t->columns; j++)
        out[j] = of[result[j / t->columns] * t->columns + j % t->columns];
    return all;
}

/* ---- the evaluator ---- */

lg_status lg_expansion_taylor(lg_expansion *x, size_t states, const lg_interval_taylor_spec *what,
                              lg_error *error) {
    taylor t = {.x = x, .s = &x->s, .states = states, .columns = x->inputs, .orders = what->last};
    const uint32_t code = t.s->count;
    const size_t count = what->last == 0 ? x->results : (what->last - what->first + 1) * states;
    t.state = lg_heap_take(&x->heap, what->last * states + 1, sizeof *t.state);
    if (t.state == NULL) return LG_OUT_OF_MEMORY;
    x->s.drops = true;
    for (uint32_t k = 0; k < what->last; k++) {
        for (uint32_t i = 0; k > 0 && i < code; i++) (void)at(&t, i, k); /* in order: no deep recursion */
        for (size_t j = 0; j < states; j++)
            t.state[k * states + j] = part(&t, 1, k + 1, at(&t, x->result[j], k));
    }
    if (what->last > 0) x->result = t.state + (what->first - 1) * states;
    x->results = count;
    if (what->slopes && !t.s->failed) {
        x->results = count * (t.columns + what->chords);
        x->result = jacobians(&t, x->result, count, what->chords);
        if (what->chords) x->inputs = 2 * t.columns;
    }
    if (t.unsupported != NULL)
        return lg_fail(error, LG_UNSUPPORTED, "the rate has no Taylor coefficients of order %u: %s",
                       what->last, t.unsupported);
    if (t.s->failed && t.s->count >= LG_SCALARS_MOST)
        return lg_fail(error, LG_UNSUPPORTED,
                       "the Taylor coefficients have more than %u operations on numbers", LG_SCALARS_MOST);
    return t.s->failed || x->result == NULL ? LG_OUT_OF_MEMORY : LG_OK;
}
