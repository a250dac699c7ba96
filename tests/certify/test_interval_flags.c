/* What the table of interval forms says of each operation: where it is defined, continuous, Lipschitz
 * continuous and differentiable. Points of random boxes about every cut, kink and edge of a domain are
 * compared with the operation itself, in long double: a row that promises too much is found.
 * ctest-labels: src/certify src/autodiff */
#include "interval_support.h"

enum { IB = LG_INTERVAL_BLOCK, OPS = LG_INTERVAL_SHIFT + 1, OPERANDS = 3 };

typedef struct instruction {
    lg_interval_code code;
    lg_scalar_code exact;
    uint32_t operands;
} instruction;

/* A number by which it multiplies, or which it adds, stands in a second operand of the exact operation. */
static long double value_of(const instruction *f, const long double *x) {
    const uint32_t op = f->code.op;
    const long double with[OPERANDS] = {x[0], op >= LG_SCALAR_OPS ? f->code.p : x[1], x[2]};
    return exact_value(&f->exact, with);
}

/* The domains of the functions of real numbers. */
static bool is_defined(const instruction *f, const long double *x) {
    const double p = f->code.p;
    const bool whole = p == floor(p);
    switch (f->code.op) {
    case LG_S_DIV:
        return x[1] != 0;
    case LG_S_SQRT:
        return x[0] >= 0;
    case LG_S_LOG:
        return x[0] > 0;
    case LG_S_POW:
        return p >= 0 ? whole || x[0] >= 0 : x[0] != 0 && (whole || x[0] > 0);
    case LG_S_ATAN2:
        return x[0] != 0 || x[1] != 0;
    case LG_S_DEXPINV:
        return x[0] < 39.478417604357434475L;
    default:
        return true;
    }
}

static instruction draw(lg_rng *r, uint32_t op) {
    static const double powers[] = {-33, -3, -2, -1.5, -1, -0.5, 0, 0.25, 0.5, 1.5, 2, 2.5, 3, 33};
    static const double factors[] = {-2, 0, 1e-300, 0.1, 1e300};
    instruction f = {.code = {.op = op, .x = {0, 1, 2}, .y = 3}, .operands = 1};
    f.code.p = op == LG_S_POW ? powers[lg_rng_below(r, LG_COUNT(powers))]
                              : factors[lg_rng_below(r, LG_COUNT(factors))];
    if (op == LG_S_STUMPFF) f.code.n = (uint32_t)(lg_rng_below(r, 9) + 16 * lg_rng_below(r, 9));
    if (op == LG_S_DEXPINV) f.code.n = (uint32_t)lg_rng_below(r, 9);
    f.exact = (lg_scalar_code){.op = op == LG_INTERVAL_SCALE   ? LG_S_MUL
                                     : op == LG_INTERVAL_SHIFT ? LG_S_ADD
                                                               : (lg_scalar_op)op,
                               .n = f.code.n,
                               .p = f.code.p};
    if (op < LG_SCALAR_OPS) f.operands = lg_scalar_instructions((lg_scalar_op)op);
    return f;
}

/* Ends of boxes: often 0, its neighbours, ends that another operand has, and numbers of all sizes. */
static double draw_end(lg_rng *r) {
    static const double about[] = {0,    0,    0,   5e-324, 1e-308, 1e-300, 1e-9,
                                   0.5,  1,    1,   2,      3.25,   15,     38,
                                   39.4, 39.5, 100, 1e6,    1e9,    1e300,  1.7976931348623157e308};
    const double x = about[lg_rng_below(r, LG_COUNT(about))];
    const double y = lg_rng_below(r, 4) == 0 ? x * (1 + lg_rng_uniform_in(r, -0.5, 0)) : x;
    return lg_rng_below(r, 2) == 0 ? y : -y;
}

static void draw_ends(lg_rng *r, double *low, double *high) {
    const double a = draw_end(r), b = lg_rng_below(r, 4) == 0 ? nextafter(a, draw_end(r)) : draw_end(r);
    *low = fmin(a, b);
    *high = lg_rng_below(r, 8) == 0 ? *low : fmax(a, b);
}

typedef struct box {
    double low[OPERANDS], high[OPERANDS];
} box;

static bool is_in(const box *b, size_t k, long double x) {
    return b->low[k] <= x && x <= b->high[k];
}

/* A point of a box: ends, 0, its neighbours, a number of another operand, or anything between. */
static void draw_point(lg_rng *r, const box *b, long double *x) {
    for (size_t k = 0; k < OPERANDS; k++) {
        const long double special[] = {0, 5e-324L, -5e-324L, x[0], x[0], x[0]};
        const long double try = special[lg_rng_below(r, LG_COUNT(special))];
        const uint64_t which = lg_rng_below(r, 6);
        x[k] = which == 0   ? b->low[k]
               : which == 1 ? b->high[k]
               : which < 4 && is_in(b, k, try) && (k > 0 || fabsl(try) < 1e-300L)
                   ? try
                   : draw_in(r, b->low[k], b->high[k])
            ;
    }
}

static long double largest_of(long double a, long double b) {
    return fabsl(a) > fabsl(b) ? fabsl(a) : fabsl(b);
}

/* Whether the values at p and q differ by a jump: it stays when the segment is halved again and again. */
static bool jumps(const instruction *f, const long double *p, const long double *q, long double *at) {
    long double a[OPERANDS], b[OPERANDS], m[OPERANDS];
    memcpy(a, p, sizeof a);
    memcpy(b, q, sizeof b);
    long double fa = value_of(f, a), fb = value_of(f, b);
    const bool sum = f->exact.op == LG_S_ADD || f->exact.op == LG_S_SUB;
    const long double first = fabsl(fa - fb);
    long double size = sum ? fabsl(a[0]) + fabsl(b[0]) : largest_of(fa, fb);
    if (!(first > 1e-12L * size) || !isfinite(first)) return false;
    for (int step = 0; step < 20000; step++) {
        bool same = true;
        for (size_t k = 0; k < OPERANDS; k++) {
            m[k] = 0.5L * a[k] + 0.5L * b[k];
            same = same && (m[k] == a[k] || m[k] == b[k]);
        }
        if (same) break;
        const long double fm = value_of(f, m);
        if (!isfinite(fm)) return false;
        size = largest_of(size, fm);
        const bool left = fabsl(fa - fm) > fabsl(fm - fb);
        memcpy(left ? b : a, m, sizeof m);
        *(left ? &fb : &fa) = fm;
    }
    memcpy(at, a, sizeof a);
    return fabsl(fa - fb) > 0.2L * first && fabsl(fa - fb) > 1e-12L * size;
}

/* The slope between x and x + step in the direction k */
static long double slope(const instruction *f, const long double *x, size_t k, long double step) {
    long double to[OPERANDS];
    memcpy(to, x, sizeof to);
    to[k] += step;
    return (value_of(f, to) - value_of(f, x)) / step;
}

/* Whether slopes at x grow without bound: by more than 2^20 between steps below all numbers of double. */
static bool is_steep(const instruction *f, const box *b, const long double *x, size_t k, long double side) {
    const long double near = side * 0x1p-6000L, far = side * 0x1p-3000L;
    if (x[k] != 0 || !is_in(b, k, side)) return false;
    const long double small = fabsl(slope(f, x, k, near)), large = fabsl(slope(f, x, k, far));
    return isfinite(small) && small > 0x1p20L * (large + 1e-4900L);
}

/* Whether slopes to both sides of x stay different as the step shrinks. */
static bool is_kink(const instruction *f, const box *b, const long double *x, size_t k) {
    const long double reach = fminl(x[k] - b->low[k], b->high[k] - x[k]);
    const long double step = 0x1p-20L * (x[k] == 0 ? fminl(reach, 1) : fminl(reach, fabsl(x[k])));
    const long double noise = 0x1p-60L * (fabsl(value_of(f, x)) + fabsl(x[1])) / (step * 0x1p-10L);
    long double apart[2], size = 0;
    if (!(step > 0)) return false;
    for (int i = 0; i < 2; i++) {
        const long double by = i == 0 ? step : step * 0x1p-10L;
        const long double right = slope(f, x, k, by), left = slope(f, x, k, -by);
        apart[i] = fabsl(right - left);
        size = fabsl(right) + fabsl(left);
    }
    return isfinite(apart[0]) && apart[1] > 0.5L * apart[0] && apart[1] > 1e-4L * size + noise;
}

static size_t checks, seen[OPS][LG_INTERVAL_DIFFERENTIABLE + 1], inside;

static void lie(const instruction *f, const box *b, const long double *x, const char *what) {
    fail_msg("operation %u (n %u, p %g) on [%a, %a] x [%a, %a]: %s at (%.20Lg, %.20Lg, %.20Lg)", f->code.op,
             f->code.n, f->code.p, b->low[0], b->high[0], b->low[1], b->high[1], what, x[0], x[1], x[2]);
}

static void check_box(lg_rng *r, const instruction *f, const box *b, uint8_t flag, double low, double high) {
    long double p[OPERANDS] = {0}, q[OPERANDS] = {0}, at[OPERANDS];
    const uint32_t op = f->code.op;
    seen[op][flag]++;
    for (int i = 0; i < 6; i++, checks++) {
        draw_point(r, b, p);
        draw_point(r, b, q);
        if (flag >= LG_INTERVAL_DEFINED && !is_defined(f, p)) lie(f, b, p, "it is not defined");
        const long double value = is_defined(f, p) ? value_of(f, p) : NAN;
        if (isfinite(value)) {
            inside++;
            if (!is_within(low, high, value)) lie(f, b, p, "the value is outside of the bounds");
        }
        const bool wave = op == LG_S_SIN || op == LG_S_COS; /* far away, numbers are too far apart for them */
        if (flag < LG_INTERVAL_CONTINUOUS || (wave && largest_of(p[0], q[0]) > 1e3L)) continue;
        if (jumps(f, p, q, at)) lie(f, b, at, "it jumps");
        for (uint32_t k = 0; k < f->operands; k++) {
            if (flag < LG_INTERVAL_LIPSCHITZ) continue;
            if (is_steep(f, b, p, k, b->high[k]) || is_steep(f, b, p, k, b->low[k]))
                lie(f, b, p, "slopes have no bound");
            if (flag >= LG_INTERVAL_DIFFERENTIABLE && is_kink(f, b, p, k)) lie(f, b, p, "there is a kink");
        }
    }
}

static void put(double *registers, size_t lane, const box *b) {
    for (size_t k = 0; k < OPERANDS; k++) {
        registers[k * 2 * IB + lane] = b->low[k];
        registers[k * 2 * IB + IB + lane] = b->high[k];
    }
}

/* Evaluates 32 boxes; every operand has all levels. */
static void evaluate(lg_interval_run *run, const instruction *f, const box *boxes, double *registers,
                     uint8_t *flags) {
    memset(flags, LG_INTERVAL_DIFFERENTIABLE, 3 * IB);
    for (size_t i = 0; i < IB; i++) put(registers, i, &boxes[i]);
    run(1, &f->code, registers, flags);
}

static void check_operation(lg_interval_run *run, lg_rng *r, uint32_t op) {
    double *registers = TEST_ARRAY(double, 8 * IB);
    uint8_t *flags = TEST_ARRAY(uint8_t, 4 * IB);
    const instruction f = draw(r, op);
    box boxes[IB];
    for (size_t i = 0; i < IB; i++)
        for (size_t j = 0; j < OPERANDS; j++) {
            draw_ends(r, &boxes[i].low[j], &boxes[i].high[j]);
            if (j > 0 && lg_rng_below(r, 3) == 0) /* operands that meet at an end */
                boxes[i].low[j] = fmin(boxes[i].high[0], boxes[i].high[j]);
        }
    evaluate(run, &f, boxes, registers, flags);
    for (size_t i = 0; i < IB; i++)
        check_box(r, &f, &boxes[i], flags[3 * IB + i], registers[6 * IB + i], registers[7 * IB + i]);
}

TEST("no row of the table promises too much: every operation, about every cut, kink and edge of a domain") {
    lg_rng r = test_rng(64, 1);
    checks = inside = 0;
    memset(seen, 0, sizeof seen);
    for (int isa = 0; isa < LG_ISA_COUNT; isa++)
        for (uint32_t op = LG_S_ADD; op < OPS; op++)
            for (int round = 0; round < 100; round++) {
                const size_t mark = lg_test_owned();
                lg_interval_run *run = lg_interval_kernel((lg_isa)isa);
                if (run != NULL) check_operation(run, &r, op);
                lg_test_give_back(mark);
            }
    for (uint32_t op = LG_S_ADD; op < OPS; op++) assert_true(seen[op][LG_INTERVAL_DIFFERENTIABLE] > 0);
    print_message("%zu points, %zu values\n", checks, inside);
    assert_true(inside > 100000);
}

/* Two boxes that meet where an operation jumps or is not defined: at least one of them does not pass. */
TEST("of two boxes that meet at a jump, one has no continuity") {
    static const uint32_t ops[] = {LG_S_SIGN, LG_S_GE, LG_S_SELECT, LG_S_ATAN2, LG_S_DIV, LG_S_LOG};
    lg_rng r = test_rng(64, 2);
    lg_interval_run *run = lg_interval_kernel(lg_isa_in_use());
    double *registers = TEST_ARRAY(double, 8 * IB);
    uint8_t *flags = TEST_ARRAY(uint8_t, 4 * IB);
    for (size_t o = 0; o < LG_COUNT(ops); o++)
        for (int round = 0; round < 200; round++) {
            const instruction f = draw(&r, ops[o]);
            const size_t side = f.code.op == LG_S_DIV ? 1 : 0; /* the operand that crosses 0 */
            box boxes[IB] = {{{0}, {0}}};
            for (size_t i = 0; i < IB; i += 2) {
                const double wide = fabs(draw_end(&r)) + 5e-324;
                const double other = f.code.op == LG_S_GE ? 0 : f.code.op == LG_S_ATAN2 ? -1 : 2;
                for (size_t j = 0; j < OPERANDS; j++) boxes[i].low[j] = boxes[i].high[j] = j == 2 ? 5 : other;
                boxes[i + 1] = boxes[i];
                boxes[i].low[side] = -wide, boxes[i].high[side] = 0;
                boxes[i + 1].low[side] = 0, boxes[i + 1].high[side] = wide;
            }
            evaluate(run, &f, boxes, registers, flags);
            for (size_t i = 0; i < IB; i += 2)
                if (flags[3 * IB + i] >= LG_INTERVAL_CONTINUOUS &&
                    flags[3 * IB + i + 1] >= LG_INTERVAL_CONTINUOUS)
                    fail_msg("operation %u: both sides of 0 pass, up to %g", f.code.op,
                             boxes[i + 1].high[side]);
        }
}

TEST("a result has at most the levels of its operands, and operands that are not read do not matter") {
    lg_interval_run *run = lg_interval_kernel(lg_isa_in_use());
    lg_rng r = test_rng(64, 3);
    double *registers = TEST_ARRAY(double, 8 * IB);
    uint8_t *flags = TEST_ARRAY(uint8_t, 4 * IB);
    for (uint32_t op = LG_S_ADD; op < OPS; op++)
        for (int from = 0; from < OPERANDS; from++) {
            const instruction f = draw(&r, op);
            box boxes[IB];
            for (size_t i = 0; i < IB; i++) boxes[i] = (box){{2, 1, 3}, {2.5, 1.5, 4}};
            evaluate(run, &f, boxes, registers, flags);
            const uint8_t own = flags[3 * IB];
            for (size_t i = 0; i < IB; i++) flags[(size_t)from * IB + i] = i % 5;
            run(1, &f.code, registers, flags);
            for (size_t i = 0; i < IB; i++) {
                /* The condition of a choice matters only where it is undefined, what is not chosen never. */
                const bool reads = (uint32_t)from < f.operands && !(op == LG_S_SELECT && from == 2) &&
                                   !(op == LG_S_SELECT && from == 0 && i % 5 != 0);
                const uint8_t wanted = reads && i % 5 < own ? i % 5 : own;
                if (flags[3 * IB + i] != wanted)
                    fail_msg("operation %u: operand %d of level %zu gives %d, not %d", op, from, i % 5,
                             flags[3 * IB + i], wanted);
            }
        }
}
