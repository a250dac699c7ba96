/* Bounds and flags of every operation, compared with MPFR; the counts are arguments. */
#ifndef LG_EXACT_CHECKS_H
#define LG_EXACT_CHECKS_H

#include "exact_support.h"

enum { IB = LG_INTERVAL_BLOCK, OPS = LG_INTERVAL_SHIFT + 2, SQUARE = OPS - 1, PLACES = 6 };

/* Every operation of the table, and x x of one register. `units`: by how many units of 2^-52 |y| + 2^-1074 a
 * bound may be outside of the true range, as liegrad/interval.h says. */
static const struct {
    const char *name;
    double units;
} exact_rows[OPS] = {[LG_S_ADD] = {"add", 1},
                     [LG_S_SUB] = {"sub", 1},
                     [LG_S_MUL] = {"mul", 1},
                     [LG_S_DIV] = {"div", 1},
                     [LG_S_NEG] = {"neg", 0},
                     [LG_S_MAX] = {"max", 0},
                     [LG_S_GE] = {"ge", 0},
                     [LG_S_SELECT] = {"select", 0},
                     [LG_S_SQRT] = {"sqrt", 1},
                     [LG_S_ABS] = {"abs", 0},
                     [LG_S_SIGN] = {"sign", 0},
                     [LG_S_POW] = {"pow", 12},
                     [LG_S_EXP] = {"exp", 14},
                     [LG_S_LOG] = {"log", 12},
                     [LG_S_SIN] = {"sin", 12},
                     [LG_S_COS] = {"cos", 12},
                     [LG_S_TANH] = {"tanh", 12},
                     [LG_S_SIGMOID] = {"sigmoid", 14},
                     [LG_S_ATAN2] = {"atan2", 12},
                     [LG_S_STUMPFF] = {"stumpff", 132},
                     [LG_S_DEXPINV] = {"dexpinv", 180},
                     [LG_INTERVAL_SCALE] = {"scale", 1},
                     [LG_INTERVAL_SHIFT] = {"shift", 1},
                     [SQUARE] = {"square", 1}};

typedef struct instruction {
    lg_interval_code code;
    lg_scalar_code exact;
    uint32_t operands; /* that are read */
} instruction;

static inline instruction exact_instruction(lg_rng *r, uint32_t op) {
    static const double powers[] = {-40, -33, -32, -7,  -3, -2, -1.5, -1, -0.5, 0,   0.25,
                                    0.5, 1.5, 2,   2.5, 3,  4,  7,    32, 33,   40.5};
    static const double factors[] = {-2, 0, 1, -1e-300, 0.1, 1e300, 3, 0x1p-1074, -0x1p-1021};
    instruction f = {.code = {.op = op == SQUARE ? LG_S_MUL : op, .x = {0, op == SQUARE ? 0 : 1, 2}, .y = 3},
                     .operands = 1};
    const uint32_t numbers = op == LG_S_STUMPFF || op == LG_S_DEXPINV;
    f.code.p = op == LG_S_POW ? powers[lg_rng_below(r, LG_COUNT(powers))]
                              : factors[lg_rng_below(r, LG_COUNT(factors))];
    if (numbers) f.code.n = (uint32_t)lg_rng_below(r, 9);
    if (op == LG_S_STUMPFF) f.code.n += 16 * (uint32_t)lg_rng_below(r, lg_rng_below(r, 2) ? 2 : 9);
    f.exact = (lg_scalar_code){.op = op == LG_INTERVAL_SCALE   ? LG_S_MUL
                                     : op == LG_INTERVAL_SHIFT ? LG_S_ADD
                                     : op == SQUARE            ? LG_S_MUL
                                                               : (lg_scalar_op)op,
                               .n = f.code.n,
                               .p = f.code.p};
    if (op < LG_SCALAR_OPS) f.operands = lg_scalar_instructions((lg_scalar_op)op);
    return f;
}

typedef struct box {
    double low[OPERANDS], high[OPERANDS];
} box;

static inline void exact_draw(lg_rng *r, const instruction *f, box *b) {
    for (size_t k = 0; k < OPERANDS; k++) {
        exact_box(r, &b->low[k], &b->high[k]);
        if (lg_rng_below(r, 8) > 0) continue;
        *(b->low[k] > 0 ? &b->low[k] : &b->high[k]) = 0; /* a box that begins or ends at 0 */
        b->low[k] = fmin(b->low[k], b->high[k]);
    }
    if (f->operands > 1 && lg_rng_below(r, 4) == 0) { /* operands that overlap or meet */
        const size_t k = lg_rng_below(r, 2);
        const double meet = lg_rng_below(r, 2) ? b->low[k] : b->high[k];
        *(lg_rng_below(r, 2) ? &b->low[1 - k] : &b->high[1 - k]) = meet;
        if (b->low[1 - k] > b->high[1 - k]) b->low[1 - k] = b->high[1 - k] = meet;
    }
    if (f->code.op == LG_S_SELECT && lg_rng_below(r, 3) == 0) b->low[0] = b->high[0] = 0;
    if (f->code.op == LG_S_STUMPFF && f->code.n == 0 && lg_rng_below(r, 4) == 0) { /* cos of a huge number */
        b->low[0] = b->high[0] = ldexp(1 + lg_rng_uniform(r), 60 + (int)lg_rng_below(r, 900));
        return;
    }
    if (f->code.op == LG_S_STUMPFF && lg_rng_below(r, 2)) {
        const double scale = ldexp(1, -(int)lg_rng_below(r, 12)),
                     a = lg_rng_uniform_in(r, -2000, 1000) * scale;
        b->low[0] = a;
        b->high[0] = lg_rng_below(r, 2) ? a : a + ldexp(lg_rng_uniform(r), 3 - (int)lg_rng_below(r, 50));
    }
}

#ifdef LG_MPFR

/* Evaluates 32 boxes with every instruction set: out[isa][0 or IB + lane], NaN where there is no such set.
 * Operands have all levels. */
typedef struct lanes {
    double registers[8 * IB];
    uint8_t flags[4 * IB];
    bool here;
} lanes;

static inline void exact_run(const instruction *f, const box *boxes, lanes *out) {
    for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
        lg_interval_run *run = lg_interval_kernel((lg_isa)isa);
        lanes *o = &out[isa];
        o->here = run != NULL;
        if (!o->here) continue;
        memset(o->flags, LG_INTERVAL_DIFFERENTIABLE, sizeof o->flags);
        for (size_t i = 0; i < IB; i++)
            for (size_t k = 0; k < OPERANDS; k++) {
                o->registers[k * 2 * IB + i] = boxes[i].low[k];
                o->registers[k * 2 * IB + IB + i] = boxes[i].high[k];
            }
        run(1, &f->code, o->registers, o->flags);
    }
}

typedef struct exact_state {
    mpfr_t x[OPERANDS], y, to[OPERANDS], fy;
} exact_state;

static inline exact_state *exact_begin(void) {
    static exact_state s;
    static bool begun;
    if (begun) return &s;
    mpfr_set_emin(mpfr_get_emin_min());
    mpfr_set_emax(mpfr_get_emax_max());
    for (size_t k = 0; k < OPERANDS; k++) mpfr_inits2(BITS, s.x[k], s.to[k], NULL);
    mpfr_inits2(BITS, s.y, s.fy, NULL);
    begun = true;
    return &s;
}

/* The operand that stands in the code. */
static inline int exact_of(const instruction *f, mpfr_t y, mpfr_t *x) {
    if (f->code.op >= LG_SCALAR_OPS) mpfr_set_d(x[1], f->code.p, MPFR_RNDN);
    if (f->code.op == LG_S_MUL && f->code.x[1] == 0) mpfr_set(x[1], x[0], MPFR_RNDN);
    return exact_operation(y, &f->exact, x);
}

/* Counts a fault, and prints the first ones of each operation. */
static inline void exact_fault(size_t *faults, const instruction *f, const box *b, int isa, const double *x,
                               const char *what, double low, double high, mpfr_srcptr y) {
    char value[64];
    if ((*faults)++ >= 3) return;
    mpfr_snprintf(value, sizeof value, "%.25RNg", y);
    print_message(
        "%s (n %u, p %g, isa %d) on [%a, %a] x [%a, %a]: %s at (%.17g, %.17g, %.17g): %s and [%.17g, "
        "%.17g]\n",
        exact_rows[f->code.op].name, f->code.n, f->code.p, isa, b->low[0], b->high[0], b->low[1], b->high[1],
        what, x[0], x[1], x[2], value, low, high);
}

/* Places of an operand where a bound may be attained: its ends, 0, an extreme of a sine. Returns how many. */
static inline size_t exact_places(const instruction *f, const box *b, size_t k, double *at) {
    size_t n = 0;
    const uint32_t op = f->code.op;
    at[n++] = b->low[k];
    if (b->high[k] == b->low[k]) return n;
    at[n++] = b->high[k];
    if (b->low[k] < 0 && b->high[k] > 0) at[n++] = 0;
    for (int i = 0; (op == LG_S_MAX || op == LG_S_GE) && k < 2 && i < 2; i++) { /* ties */
        const double x = i == 0 ? b->low[1 - k] : b->high[1 - k];
        if (x > b->low[k] && x < b->high[k]) at[n++] = x;
    }
    if ((op == LG_S_SIN || op == LG_S_COS) && fabs(b->low[k]) < 2e6 && n < PLACES) {
        const double shift = op == LG_S_SIN ? 1 : 0, half = 1.5707963267948966;
        for (int i = 0; i < 2; i++) { /* the first maximum or minimum above the lower end */
            const double turn = ceil((b->low[k] / half - shift) / 2) * 2 + shift + 2 * i, x = turn * half;
            if (x >= b->low[k] && x <= b->high[k] && n < PLACES) at[n++] = x;
        }
    }
    return n;
}

typedef struct exact_sum {
    size_t points, undefined, boxes, wide, faults;
    double worst, worst_low, worst_high;
} exact_sum;

/* By how many units a bound is outside of the true one */
static inline double exact_excess(double outside, double bound, double size) {
    const double unit = 0x1p-52 * fmax(fabs(bound), size) + 0x1p-1074;
    return outside == bound ? 0 : fabs(outside - bound) / unit;
}

/* A size that errors are relative to where the value is smaller: Stumpff functions at w >= 0 are computed to
 * units of their values at 0, and for huge w to the error of sqrt(w); the reduction of a sine's argument x
 * has an error below 2^-100 |x|. */
static inline double exact_size(const instruction *f, const box *b) {
    const uint32_t k = f->code.n % 16, d = f->code.n / 16;
    const double x = fmax(fabs(b->low[0]), fabs(b->high[0]));
    if (f->code.op == LG_S_STUMPFF && b->high[0] >= 0)
        return exp(lgamma(d + 1.0) - lgamma(k + 2.0 * d + 1)) * (1 + 0x1p-56 * sqrt(x));
    return (f->code.op == LG_S_SIN || f->code.op == LG_S_COS) && x > 0.75 ? 0x1p-48 * x : 0;
}

static inline void exact_check_box(lg_rng *r, exact_state *s, const instruction *f, const box *b, size_t lane,
                                   const lanes *out, exact_sum *sum) {
    double at[OPERANDS][PLACES], x[OPERANDS] = {0}, low = (double)INFINITY, high = -(double)INFINITY;
    size_t n[OPERANDS] = {1, 1, 1}, defined = 0;
    for (size_t k = 0; k < f->operands; k++) n[k] = exact_places(f, b, k, at[k]);
    const size_t corners = n[0] * n[1] * n[2], all = corners + 4;
    for (size_t p = 0; p < all; p++) {
        const size_t number[OPERANDS] = {p % n[0], p / n[0] % n[1], p / n[0] / n[1] % n[2]};
        for (size_t k = 0; k < f->operands; k++) {
            x[k] = p < corners ? at[k][number[k]] : exact_point(r, b->low[k], b->high[k]);
            mpfr_set_d(s->x[k], x[k], MPFR_RNDN);
        }
        const int above = exact_of(f, s->y, s->x);
        sum->points++;
        if (mpfr_nan_p(s->y)) {
            sum->undefined++;
            for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
                const double l = out[isa].registers[6 * IB + lane], h = out[isa].registers[7 * IB + lane];
                const bool bounded = f->code.op != LG_S_ATAN2 && !(isinf(l) && isinf(h));
                if (out[isa].here && (bounded || out[isa].flags[3 * IB + lane] != LG_INTERVAL_UNDEFINED))
                    exact_fault(&sum->faults, f, b, isa, x, "it is not defined", l, h, s->y);
            }
            continue;
        }
        defined++;
        low = fmin(low, mpfr_get_d(s->y, MPFR_RNDD));
        high = fmax(high, mpfr_get_d(s->y, MPFR_RNDU));
        for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
            const double l = out[isa].registers[6 * IB + lane], h = out[isa].registers[7 * IB + lane];
            if (out[isa].here && !exact_is_within(l, h, s->y, above))
                exact_fault(&sum->faults, f, b, isa, x, "the value is outside", l, h, s->y);
        }
    }
    sum->boxes++;
    for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
        const double l = out[isa].registers[6 * IB + lane], h = out[isa].registers[7 * IB + lane];
        const bool wave = f->code.op == LG_S_SIN || f->code.op == LG_S_COS;
        if (!out[isa].here || defined < all || out[isa].flags[3 * IB + lane] < LG_INTERVAL_CONTINUOUS)
            continue;
        if (wave && fmax(-b->low[0], b->high[0]) > 1e6) continue; /* the bounds are -1 and 1 there */
        if (!(low > -DBL_MAX / 2 && high < DBL_MAX / 2)) continue;
        if (f->code.op == LG_S_STUMPFF && b->high[0] >= 0 && b->low[0] < b->high[0]) continue;
        const double size = exact_size(f, b),
                     excess = fmax(exact_excess(l, low, size), exact_excess(h, high, size));
        const double p = f->code.op == LG_S_POW ? f->code.p : 0.5, far = fmax(-b->low[0], b->high[0]);
        const bool whole = floor(p) == p;
        /* |x|^|p| is too large for a double, or a power by logarithms of a negative number */
        if (whole && (p < 0 || p > 32) &&
            (pow(far, fabs(p)) > DBL_MAX / 4 || (fabs(p) > 32 && b->low[0] < 0)))
            continue;
        sum->wide += excess > exact_rows[f->code.op].units + (whole ? 1.2 * fabs(f->code.p) : 0);
        if (excess > sum->worst) {
            sum->worst = excess;
            sum->worst_low = b->low[0];
            sum->worst_high = b->high[0];
        }
    }
}

/* Random boxes until there are so many points for each operation. */
static inline void check_exact_bounds(size_t points, uint64_t seed) {
    exact_state *s = exact_begin();
    static lanes out[LG_ISA_COUNT];
    size_t faults = 0;
    for (uint32_t op = LG_S_ADD; op < OPS; op++) {
        lg_rng r = test_rng(seed, op);
        exact_sum sum = {0};
        while (sum.points < points) {
            const instruction f = exact_instruction(&r, op);
            box boxes[IB];
            for (size_t i = 0; i < IB; i++) exact_draw(&r, &f, &boxes[i]);
            exact_run(&f, boxes, out);
            for (size_t i = 0; i < IB; i++) exact_check_box(&r, s, &f, &boxes[i], i, out, &sum);
        }
        print_message("%-8s %zu boxes, %zu points, %zu not defined, %zu faults; at most %.3g units wide (at "
                      "[%.17g, %.17g]), %zu wider\n",
                      exact_rows[op].name, sum.boxes, sum.points, sum.undefined, sum.faults, sum.worst,
                      sum.worst_low, sum.worst_high, sum.wide);
        faults += sum.faults + sum.wide;
    }
    assert_int_equal(faults, 0);
}

/* ---- flags ---- */

/* The value at x + step e_k minus the one at x; false: one of them is not known. */
static inline bool exact_step(const instruction *f, exact_state *s, uint32_t k, mpfr_srcptr step, mpfr_t d) {
    for (uint32_t j = 0; j < OPERANDS; j++) mpfr_set(s->to[j], s->x[j], MPFR_RNDN);
    mpfr_add(s->to[k], s->x[k], step, MPFR_RNDN);
    if (f->code.op == LG_S_MUL && f->code.x[1] == 0) mpfr_set(s->to[1], s->to[0], MPFR_RNDN);
    exact_operation(d, &f->exact, s->to);
    if (!mpfr_number_p(d)) return false;
    mpfr_sub(d, d, s->y, MPFR_RNDN);
    return true;
}

/* The highest level that the operation can have on a box with the point s->x, by what is seen there: it is
 * not defined; a step of 2^-70 and one of 2^-140 change it as much: a jump; its slope grows by more than
 * 2^10: no Lipschitz constant; slopes to both sides stay different: a kink. Steps may leave the box, because
 * a box that touches a jump counts; the condition of a choice must not. */
static inline uint8_t exact_level(const instruction *f, exact_state *s, const box *b) {
    static mpfr_t d[2][2], step[2], slope[2][2], t;
    static bool begun;
    uint8_t level = LG_INTERVAL_DIFFERENTIABLE;
    const uint32_t op = f->code.op;
    if (!begun)
        mpfr_inits2(BITS, d[0][0], d[0][1], d[1][0], d[1][1], step[0], step[1], t, slope[0][0], slope[0][1],
                    slope[1][0], slope[1][1], NULL);
    begun = true;
    exact_of(f, s->y, s->x);
    if (mpfr_nan_p(s->y)) return LG_INTERVAL_UNDEFINED;
    if (!mpfr_number_p(s->y)) return level;
    for (uint32_t k = 0; k < f->operands; k++) {
        bool both = true;
        const bool wave =
            op == LG_S_SIN || op == LG_S_COS || op == LG_S_STUMPFF; /* faster than steps, far away */
        if (wave && mpfr_cmpabs_ui(s->x[k], 1000000000000000u) > 0) continue;
        for (int side = 0; side < 2; side++) {
            bool known = true;
            for (int i = 0; i < 2 && known; i++) {
                mpfr_set_si_2exp(
                    step[i], 1, mpfr_zero_p(s->x[k]) ? -1200 * (i + 1) : mpfr_get_exp(s->x[k]) - 70 * (i + 1),
                    MPFR_RNDN);
                if (side == 1) mpfr_neg(step[i], step[i], MPFR_RNDN);
                mpfr_add(t, s->x[k], step[i], MPFR_RNDN);
                const bool leaves = mpfr_cmp_d(t, b->low[k]) < 0 || mpfr_cmp_d(t, b->high[k]) > 0;
                known = !(op == LG_S_SELECT && k == 0 && leaves) && exact_step(f, s, k, step[i], d[side][i]);
                mpfr_div(slope[side][i], d[side][i], step[i], MPFR_RNDN);
            }
            both = both && known;
            if (!known || mpfr_zero_p(d[side][1])) continue;
            const mpfr_exp_t first = mpfr_zero_p(d[side][0]) ? mpfr_get_emin_min() : mpfr_get_exp(d[side][0]);
            const mpfr_exp_t last = mpfr_get_exp(d[side][1]),
                             size = mpfr_zero_p(s->y) ? last : mpfr_get_exp(s->y);
            const mpfr_exp_t shrink = mpfr_zero_p(s->x[k]) ? 1200 : 70;
            uint8_t seen = LG_INTERVAL_DIFFERENTIABLE;
            if (last > size - 200 && last + shrink > first + 10) seen = LG_INTERVAL_CONTINUOUS;
            if (last > size - 100 && last + 1 > first) seen = LG_INTERVAL_DEFINED;
            level = seen < level ? seen : level;
        }
        if (!both || level < LG_INTERVAL_DIFFERENTIABLE) continue;
        mpfr_exp_t apart[2];
        for (int i = 0; i < 2; i++) {
            mpfr_sub(t, slope[0][i], slope[1][i], MPFR_RNDN);
            apart[i] = mpfr_zero_p(t) ? mpfr_get_emin_min() : mpfr_get_exp(t);
        }
        mpfr_abs(slope[0][1], slope[0][1], MPFR_RNDN);
        mpfr_abs(slope[1][1], slope[1][1], MPFR_RNDN);
        mpfr_add(t, slope[0][1], slope[1][1], MPFR_RNDN);
        if (mpfr_zero_p(t)) continue;
        const mpfr_exp_t size = mpfr_get_exp(t),
                         noise = mpfr_zero_p(s->y) ? size - 200
                                                   : mpfr_get_exp(s->y) - 240 - mpfr_get_exp(step[1]);
        if (apart[1] + 1 > apart[0] && apart[1] > size - 60 && apart[1] > noise)
            level = LG_INTERVAL_LIPSCHITZ;
    }
    return level;
}

typedef struct exact_flags {
    size_t boxes, faults, lower, seen[LG_INTERVAL_DIFFERENTIABLE + 1];
} exact_flags;

static inline void exact_check_flag(lg_rng *r, exact_state *s, const instruction *f, const box *b,
                                    size_t lane, const lanes *out, exact_flags *sum) {
    double at[OPERANDS][PLACES], x[OPERANDS] = {0};
    size_t n[OPERANDS] = {1, 1, 1};
    uint8_t level = LG_INTERVAL_DIFFERENTIABLE;
    for (size_t k = 0; k < f->operands; k++) n[k] = exact_places(f, b, k, at[k]);
    const size_t corners = n[0] * n[1] * n[2];
    for (size_t p = 0; p < corners + 2 && level > LG_INTERVAL_UNDEFINED; p++) {
        const size_t number[OPERANDS] = {p % n[0], p / n[0] % n[1], p / n[0] / n[1] % n[2]};
        for (size_t k = 0; k < f->operands; k++) {
            x[k] = p < corners ? at[k][number[k]] : exact_point(r, b->low[k], b->high[k]);
            mpfr_set_d(s->x[k], x[k], MPFR_RNDN);
        }
        const uint8_t here = exact_level(f, s, b);
        level = here < level ? here : level;
        for (int isa = 0; isa < LG_ISA_COUNT; isa++)
            if (out[isa].here && out[isa].flags[3 * IB + lane] > here)
                exact_fault(&sum->faults, f, b, isa, x, "the flag is too high", out[isa].flags[3 * IB + lane],
                            here, s->y);
    }
    sum->boxes++;
    sum->seen[level]++;
    for (int isa = 0; isa < LG_ISA_COUNT; isa++)
        if (out[isa].here && out[isa].flags[3 * IB + lane] < level) {
            sum->lower++;
            break;
        }
}

static inline void check_exact_flags(size_t count, uint64_t seed) {
    exact_state *s = exact_begin();
    static lanes out[LG_ISA_COUNT];
    size_t faults = 0;
    for (uint32_t op = LG_S_ADD; op < OPS; op++) {
        lg_rng r = test_rng(seed, op);
        exact_flags sum = {0};
        while (sum.boxes < count) {
            const instruction f = exact_instruction(&r, op);
            box boxes[IB];
            for (size_t i = 0; i < IB; i++) exact_draw(&r, &f, &boxes[i]);
            exact_run(&f, boxes, out);
            for (size_t i = 0; i < IB; i++) exact_check_flag(&r, s, &f, &boxes[i], i, out, &sum);
        }
        print_message("%-8s %zu boxes of true levels %zu %zu %zu %zu %zu, %zu flags too high, %zu too low\n",
                      exact_rows[op].name, sum.boxes, sum.seen[0], sum.seen[1], sum.seen[2], sum.seen[3],
                      sum.seen[4], sum.faults, sum.lower);
        faults += sum.faults + sum.lower;
    }
    assert_int_equal(faults, 0);
}

/* ---- compositions ---- */

enum { INPUTS = 3, BOXES = 2 };

typedef struct tree {
    lg_expansion expansion;
    lg_interval f;
    bool coarse; /* has a dexpinv coefficient, which is known to SERIES_BITS only */
} tree;

static inline void tree_end(tree *t) {
    lg_expansion_destroy(&t->expansion);
    lg_free(NULL, t->f.constant);
    lg_free(NULL, t->f.constant_flag);
    lg_free(NULL, t->f.code);
    lg_free(NULL, t->f.stored);
    lg_free(NULL, t->f.parity);
}

/* 3 to 8 operations on inputs, constants and earlier results. */
static inline void tree_begin(lg_rng *r, tree *t) {
    static const double constants[] = {0, 1, -1, 0.5, 2, -3, 10, 1e-3, 1e6, 1e-300, 1e300};
    const size_t count = 3 + lg_rng_below(r, 6);
    *t = (tree){.expansion = {.inputs = INPUTS, .results = 1}};
    lg_scalars *s = &t->expansion.s;
    lg_scalar made[INPUTS + 2 + 8];
    lg_scalars_init(s, NULL);
    s->level_of = lg_interval_level;
    size_t n = 0;
    while (n < INPUTS) made[n] = lg_s_input(s, (uint32_t)n), n++;
    for (int i = 0; i < 2; i++) made[n++] = lg_s_constant(s, constants[lg_rng_below(r, LG_COUNT(constants))]);
    for (size_t i = 0; i < count; i++, n++) {
        const uint32_t op = LG_S_ADD + (uint32_t)lg_rng_below(r, LG_SCALAR_OPS - LG_S_ADD);
        const instruction f = exact_instruction(r, op);
        lg_scalar a[OPERANDS];
        t->coarse = t->coarse || op == LG_S_DEXPINV;
        for (int k = 0; k < OPERANDS; k++)
            a[k] = made[lg_rng_below(r, 2) && i > 0 ? n - 1 - lg_rng_below(r, i < 2 ? i : 2)
                                                    : lg_rng_below(r, n)];
        made[n] = op == LG_S_SELECT ? lg_s_select(s, a[0], a[1], a[2])
                  : op == LG_S_POW  ? lg_s_pow(s, a[0], f.code.p)
                  : op == LG_S_STUMPFF || op == LG_S_DEXPINV
                      ? lg_s_numbered(s, (lg_scalar_op)op, a[0], f.code.n)
                      : lg_s(s, (lg_scalar_op)op, a[0], f.operands > 1 ? a[1] : a[0]);
    }
    assert_false(s->failed);
    t->expansion.result = lg_heap_take(&t->expansion.heap, 1, sizeof(lg_scalar));
    t->expansion.result[0] = made[n - 1];
    t->f = (lg_interval){.inputs = INPUTS, .outputs = 1, .functions = 1};
    do t->f.run = lg_interval_kernel((lg_isa)lg_rng_below(r, LG_ISA_COUNT));
    while (t->f.run == NULL);
    assert_ok(lg_interval_choose(&t->expansion, false, &t->f));
}

/* Numbers of instructions, of some precision */
typedef struct walk {
    mpfr_t value[128];
    mpfr_prec_t bits;
} walk;

static inline void walk_init(walk *w, mpfr_prec_t bits) {
    if (w->bits == 0)
        for (size_t i = 0; i < 128; i++) mpfr_init2(w->value[i], bits);
    w->bits = bits;
}

/* NULL: something is larger or smaller than all numbers of MPFR. NaN: not defined. */
static inline mpfr_ptr tree_value(const tree *t, walk *w, mpfr_t *x) {
    const lg_scalars *s = &t->expansion.s;
    assert_true(s->count <= 128);
    for (uint32_t i = 0; i < s->count; i++) {
        const lg_scalar_code *c = &s->code[i];
        mpfr_t in[OPERANDS];
        for (int k = 0; k < OPERANDS; k++) *in[k] = *w->value[c->in[k]];
        int above = 0;
        if (c->op == LG_S_INPUT)
            mpfr_set(w->value[i], x[c->n], MPFR_RNDN);
        else if (c->op == LG_S_CONSTANT)
            mpfr_set_d(w->value[i], c->p, MPFR_RNDN);
        else
            above = exact_operation(w->value[i], c, in);
        if (mpfr_inf_p(w->value[i]) || (mpfr_zero_p(w->value[i]) && above != 0)) return NULL;
    }
    return w->value[t->expansion.result[0]];
}

/* Whether the value jumps between two points: the difference stays when the segment is halved again and
 * again. *size: the exponent of the first difference. Where everything cancels, as in v - a/(a/v), it is
 * rounding, which is of another size at another precision. The first difference may be far below the others,
 * as for 2 x e^(-2 x) at 0 and 1e16: in the second half of the halvings the difference stays too. */
static inline bool tree_jumps(const tree *t, walk *w, const double *from, const double *to, int times,
                              mpfr_exp_t *size) {
    mpfr_t end[2][INPUTS], middle[INPUTS], y[2], apart[2];
    bool jumps = true;
    mpfr_inits2(w->bits, y[0], y[1], apart[0], apart[1], NULL);
    for (int k = 0; k < INPUTS; k++) {
        mpfr_inits2(w->bits, end[0][k], end[1][k], middle[k], NULL);
        mpfr_set_d(end[0][k], from[k], MPFR_RNDN);
        mpfr_set_d(end[1][k], to[k], MPFR_RNDN);
    }
    for (int e = 0; e < 2; e++) {
        mpfr_ptr value = tree_value(t, w, end[e]);
        if (value == NULL || mpfr_nan_p(value)) jumps = false;
        if (value != NULL) mpfr_set(y[e], value, MPFR_RNDN);
    }
    if (jumps) mpfr_sub(apart[0], y[0], y[1], MPFR_RNDN);
    jumps = jumps && !mpfr_zero_p(apart[0]);
    const mpfr_exp_t first = *size = jumps ? mpfr_get_exp(apart[0]) : 0;
    mpfr_exp_t half = 0;
    for (int i = 0; jumps && i < times; i++) {
        for (int k = 0; k < INPUTS; k++) {
            mpfr_add(middle[k], end[0][k], end[1][k], MPFR_RNDN);
            mpfr_div_2ui(middle[k], middle[k], 1, MPFR_RNDN);
        }
        mpfr_ptr value = tree_value(t, w, middle);
        jumps = value != NULL && !mpfr_nan_p(value);
        if (!jumps) break;
        mpfr_sub(apart[1], y[0], value, MPFR_RNDN);
        mpfr_sub(apart[0], value, y[1], MPFR_RNDN);
        const int e = mpfr_cmpabs(apart[1], apart[0]) > 0;
        mpfr_set(y[e], value, MPFR_RNDN);
        for (int k = 0; k < INPUTS; k++) mpfr_set(end[e][k], middle[k], MPFR_RNDN);
        mpfr_sub(apart[1], y[0], y[1], MPFR_RNDN); /* stays, and is not rounding: above 2^-40 of the value */
        jumps = !mpfr_zero_p(apart[1]) && mpfr_get_exp(apart[1]) > first - 4 &&
                (mpfr_zero_p(y[0]) || mpfr_get_exp(apart[1]) > mpfr_get_exp(y[0]) - 40);
        if (jumps && i == times / 2) half = mpfr_get_exp(apart[1]);
        if (jumps && i == times - 1) jumps = mpfr_get_exp(apart[1]) > half - 4;
    }
    for (int k = 0; k < INPUTS; k++) mpfr_clears(end[0][k], end[1][k], middle[k], NULL);
    mpfr_clears(y[0], y[1], apart[0], apart[1], NULL);
    return jumps;
}

static inline void tree_print(const tree *t, const double *low, const double *high, const double *x) {
    static const char *const names[] = {[LG_S_INPUT] = "input", [LG_S_CONSTANT] = "constant"};
    const lg_scalars *s = &t->expansion.s;
    for (uint32_t i = 0; i < s->count; i++)
        print_message("  %u = %s %u %u %u (n %u, p %.17g)\n", i,
                      s->code[i].op < LG_S_ADD ? names[s->code[i].op] : exact_rows[s->code[i].op].name,
                      s->code[i].in[0], s->code[i].in[1], s->code[i].in[2], s->code[i].n, s->code[i].p);
    for (int k = 0; k < INPUTS; k++) print_message("  input %d in [%a, %a]: %a\n", k, low[k], high[k], x[k]);
}

typedef struct tree_sum {
    size_t trees, points, undefined, unknown, outside, high, levels[LG_INTERVAL_DIFFERENTIABLE + 1];
} tree_sum;

static inline void check_tree(lg_rng *r, const tree *t, tree_sum *sum) {
    static walk coarse, fine;
    static mpfr_t x[INPUTS];
    double low[BOXES * INPUTS], high[BOXES * INPUTS], out[2][BOXES], at[INPUTS], last[INPUTS] = {0};
    uint8_t flags[BOXES];
    void *work = lg_test_memory(lg_interval_work_size(&t->f));
    if (coarse.bits == 0) mpfr_inits2(BITS, x[0], x[1], x[2], NULL);
    walk_init(&coarse, BITS);
    walk_init(&fine, 6000);
    for (int i = 0; i < BOXES * INPUTS; i++) {
        exact_box(r, &low[i], &high[i]);
        if (lg_rng_below(r, 2)) { /* moderate numbers, so that all is defined more often */
            low[i] = lg_rng_uniform_in(r, -3, 3);
            high[i] = low[i] + ldexp(lg_rng_uniform(r), 1 - (int)lg_rng_below(r, 8));
        }
    }
    assert_ok(lg_interval_eval(&t->f, BOXES, low, high, out[0], out[1], flags, work, NULL));
    for (int b = 0; b < BOXES; b++) {
        const double *l = low + (ptrdiff_t)b * INPUTS, *h = high + (ptrdiff_t)b * INPUTS;
        sum->levels[flags[b]]++;
        for (int p = 0; p < 8; p++) {
            for (int k = 0; k < INPUTS; k++) {
                const uint64_t which = lg_rng_below(r, 5);
                at[k] = which == 0                           ? l[k]
                        : which == 1                         ? h[k]
                        : which == 2 && l[k] < 0 && h[k] > 0 ? 0
                                                             : exact_point(r, l[k], h[k]);
                mpfr_set_d(x[k], at[k], MPFR_RNDN);
            }
            mpfr_ptr y = tree_value(t, &coarse, x);
            sum->points++;
            if (y == NULL) {
                sum->unknown++;
            } else if (mpfr_nan_p(y)) {
                sum->undefined++;
                if (flags[b] > LG_INTERVAL_UNDEFINED && sum->high++ < 3) {
                    print_message("not defined, but has the flag %d:\n", flags[b]);
                    tree_print(t, l, h, at);
                }
            } else if (!exact_is_within(out[0][b], out[1][b], y, 0) && sum->outside++ < 3) {
                mpfr_printf("%.25RNg is outside of [%.17g, %.17g]:\n", y, out[0][b], out[1][b]);
                tree_print(t, l, h, at);
            }
            mpfr_exp_t size[2];
            if (p % 2 == 1 && !t->coarse && flags[b] >= LG_INTERVAL_CONTINUOUS &&
                tree_jumps(t, &coarse, last, at, 100, &size[0]) &&
                tree_jumps(t, &fine, last, at, 4000, &size[1]) && size[1] > size[0] - 2 && sum->high++ < 3) {
                print_message("jumps, but has the flag %d:\n", flags[b]);
                tree_print(t, l, h, at);
            }
            memcpy(last, at, sizeof last);
        }
    }
}

static inline void check_exact_trees(size_t trees, uint64_t seed) {
    lg_rng r = test_rng(seed, 0);
    tree_sum sum = {0};
    exact_begin();
    for (; sum.trees < trees; sum.trees++) {
        const size_t mark = lg_test_owned();
        tree t;
        tree_begin(&r, &t);
        check_tree(&r, &t, &sum);
        tree_end(&t);
        lg_test_give_back(mark);
    }
    print_message("%zu trees, %zu points: %zu not defined, %zu not known, %zu outside; boxes of levels %zu "
                  "%zu %zu %zu %zu, %zu of "
                  "them too high\n",
                  sum.trees, sum.points, sum.undefined, sum.unknown, sum.outside, sum.levels[0],
                  sum.levels[1], sum.levels[2], sum.levels[3], sum.levels[4], sum.high);
    assert_int_equal(sum.outside + sum.high, 0);
}

#else

static inline void check_exact_bounds(size_t points, uint64_t seed) {
    print_message("libmpfr is missing, scripts/deps --test installs it\n");
    skip();
}
static inline void check_exact_flags(size_t boxes, uint64_t seed) {
    check_exact_bounds(boxes, seed);
}
static inline void check_exact_trees(size_t trees, uint64_t seed) {
    check_exact_bounds(trees, seed);
}

#endif

#endif
