/* The scalar code of each operation must compute the same function as the operation on tensors. Checked for
 * every operation that has scalar code, on every node that the cases of the gradient check put on a tape,
 * with every instruction set and in both types. Elementwise operations may overwrite an input.
 * ctest-labels: src/autodiff src/kernels */
#include "gradcheck/cases.h"
#include "compiled.h"
#include "row_support.h"

#include <float.h>

#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/op_table.h"
#include "autodiff/program/scalars.h"

/* ---- one node, evaluated in every way ---- */

enum { MOST = 4096 };

/* The inputs in the type of the kernels; NULL where the operation does not read them. */
typedef struct node_values {
    lg_evaluation e;
    const lg_shape *shapes[LG_MAX_INPUTS];
    const void *x[LG_MAX_INPUTS];
    void *y;
} node_values;

static bool reads(const lg_node *node, uint32_t k) {
    const lg_op *op = node->op;
    const uint32_t unread = op->unread != NULL ? op->unread(&node->attr, node->inputs) : 0;
    return k >= 32 || !(unread >> k & 1u);
}

static void *own(size_t count, size_t size) {
    return memset(lg_test_memory(count * size + 64), 0xff, count * size + 64);
}

static void open_node(node_values *v, const lg_tape *tape, const lg_node *node, const lg_kernels *k) {
    *v = (node_values){.e = {.k = k,
                             .attr = &node->attr,
                             .inputs = node->inputs,
                             .shape = &node->shape,
                             .count = node->count}};
    for (uint32_t i = 0; i < node->inputs; i++) {
        const lg_node *from = &tape->nodes[tape->parents[node->parents + i]];
        v->shapes[i] = &from->shape;
        if (!reads(node, i)) continue;
        void *values = own(from->count, k->size);
        k->convert_in(from->count, from->value, values);
        v->x[i] = values;
    }
    v->y = own(node->count, k->size);
    v->e.in = v->shapes;
    v->e.x = v->x;
    v->e.y = v->y;
    const lg_op *op = node->op;
    if (op->scratch != NULL) v->e.scratch = own(op->scratch(&v->e), 1);
    assert_ok(op->forward(&v->e));
}

static void expand(lg_scalars *s, const node_values *v, const lg_op *op, lg_scalar *y) {
    lg_scalar *x[LG_MAX_INPUTS];
    const lg_scalar *in[LG_MAX_INPUTS];
    uint32_t number = 0;
    lg_scalars_init(s, NULL);
    for (uint32_t i = 0; i < v->e.inputs; i++) {
        const size_t count = lg_shape_count(*v->shapes[i]);
        x[i] = v->x[i] == NULL ? NULL : TEST_ARRAY(lg_scalar, count);
        for (size_t j = 0; x[i] != NULL && j < count; j++) x[i][j] = lg_s_input(s, number++);
        in[i] = x[i];
    }
    assert_true(lg_scalars_expand(s, op, &v->e, in, y));
}

/* The numbers of all inputs, one after another, in the order of the INPUT instructions. */
static size_t inputs_of(const node_values *v, double *out) {
    size_t used = 0;
    for (uint32_t i = 0; i < v->e.inputs; i++) {
        const size_t count = lg_shape_count(*v->shapes[i]);
        if (v->x[i] == NULL) continue;
        if (out != NULL) v->e.k->convert_out(count, v->x[i], out + used);
        used += count;
    }
    return used;
}

/* ---- scalar code run by the kernels, one instruction at a time ---- */

static void walk_by_kernel(const lg_scalars *s, const lg_kernels *k, const double *inputs, double *out) {
    static const uint8_t operands[LG_SCALAR_OPS] = {
#define X(name, instructions, all) [LG_S_##name] = instructions,
        LG_SCALAR_LIST(X)
#undef X
    };
    static const uint8_t all[LG_SCALAR_OPS] = {
#define X(name, instructions, all) [LG_S_##name] = all,
        LG_SCALAR_LIST(X)
#undef X
    };
    /* Registers: the results of the instructions, then the exponents of powers. */
    unsigned char *r = own(2 * (size_t)s->count, k->size);
    for (uint32_t i = 0; i < s->count; i++) {
        const lg_scalar_code *c = &s->code[i];
        unsigned char *at = r + i * k->size;
        if (c->op == LG_S_INPUT) k->convert_in(1, &inputs[c->n], at);
        if (c->op == LG_S_CONSTANT) k->convert_in(1, &c->p, at);
        if (c->op == LG_S_INPUT || c->op == LG_S_CONSTANT) continue;
        uint32_t x[4] = {c->in[0], c->in[1], c->in[2], 0};
        if (all[c->op] > operands[c->op]) x[operands[c->op]] = c->op == LG_S_POW ? s->count + i : c->n;
        k->convert_in(1, &c->p, r + (s->count + i) * k->size);
        const lg_scalar_group group = {.op = (uint32_t)c->op, .count = 1, .result = i, .operands = 0};
        k->scalars(1, &group, x, r);
    }
    k->convert_out(s->count, r, out);
}

/* ---- scalar code equals the tensor operation ---- */

static bool seen[LG_OPS_MOST];

static void compare(const char *row, const char *op, const lg_scalar *y, const double *r,
                    const double *forward, size_t count, double size, double tolerance) {
    for (size_t i = 0; i < count; i++) size = fmax(size, fabs(forward[i]));
    for (size_t i = 0; i < count; i++)
        if (!(fabs(r[y[i]] - forward[i]) <= tolerance * size))
            fail_msg("%s: %s: element %zu is %.17g, not %.17g", row, op, i, r[y[i]], forward[i]);
}

static void check_scalars(const lg_tape *tape, const lg_node *node, const char *row) {
    const lg_op *op = node->op;
    if ((op->element == NULL && op->expand == NULL) || node->count > MOST) return;
    for (int isa = 0; isa < LG_ISA_COUNT; isa++)
        for (int dtype = 0; dtype < 2; dtype++) {
            const lg_kernels *k = lg_kernels_of(dtype == 0 ? LG_F64 : LG_F32, (lg_isa)isa);
            if (k == NULL) continue;
            node_values v;
            lg_scalars s;
            open_node(&v, tape, node, k);
            lg_scalar *y = TEST_ARRAY(lg_scalar, node->count);
            expand(&s, &v, op, y);
            double *inputs = TEST_ARRAY(double, inputs_of(&v, NULL)), *r = TEST_ARRAY(double, s.count),
                   *forward = TEST_ARRAY(double, node->count);
            (void)inputs_of(&v, inputs);
            k->convert_out(node->count, v.y, forward);
            walk_by_kernel(&s, k, inputs, r);
            double size = 1e-30; /* size of the inputs, as differences may cancel */
            for (size_t i = 0; i < inputs_of(&v, NULL); i++) size = fmax(size, fabs(inputs[i]));
            compare(row, op->name, y, r, forward, node->count, size, dtype == 0 ? 1e-13 : 2e-5);
            lg_scalars_destroy(&s);
        }
    seen[lg_op_place(node->op)] = true;
}

TEST("scalar code computes the same as the operation") {
    memset(seen, 0, sizeof seen);
    each_node(check_scalars);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if ((lg_ops[i]->element != NULL || lg_ops[i]->expand != NULL) && !seen[i])
            fail_msg("%s was on no tape", lg_ops[i]->name);
}

/* ---- results that overwrite an input, as plans do for elementwise operations ---- */

static void check_over(const lg_tape *tape, const lg_node *node, const char *row) {
    const lg_op *op = node->op;
    if (op->element == NULL) return;
    for (uint32_t i = 0; i < node->inputs; i++)
        if (reads(node, i) &&
            !lg_same_shape(&tape->nodes[tape->parents[node->parents + i]].shape, &node->shape))
            return;
    for (int isa = 0; isa < LG_ISA_COUNT; isa++)
        for (int dtype = 0; dtype < 2; dtype++)
            for (uint32_t i = 0; i < node->inputs; i++) {
                const lg_kernels *k = lg_kernels_of(dtype == 0 ? LG_F64 : LG_F32, (lg_isa)isa);
                if (k == NULL || !reads(node, i) || (node->op == &lg_op_combine && i > 0)) continue;
                node_values v;
                open_node(&v, tape, node, k);
                void *over = own(node->count, k->size);
                memcpy(over, v.x[i], node->count * k->size);
                const void *x[LG_MAX_INPUTS];
                for (uint32_t j = 0; j < node->inputs; j++) x[j] = j == i ? over : v.x[j];
                v.e.x = x;
                v.e.y = over;
                assert_ok(op->forward(&v.e));
                if (memcmp(over, v.y, node->count * k->size) != 0)
                    fail_msg("%s: %s over its input %u has other bits", row, op->name, i);
            }
    seen[lg_op_place(node->op)] = true;
}

TEST("elementwise operations may overwrite an input") {
    memset(seen, 0, sizeof seen);
    each_node(check_over);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (lg_ops[i]->element != NULL && !seen[i]) fail_msg("%s was on no tape", lg_ops[i]->name);
}

/* ---- numbers that are not finite ---- */

static bool alike(double a, double b) {
    return a == b ? signbit(a) == signbit(b) || a == 0.0 : isnan(a) && isnan(b);
}

TEST("tensors and scalar code treat numbers that are not finite in the same way") {
    static const lg_op *const ops[] = {&lg_op_max, &lg_op_ge, &lg_op_select, &lg_op_sign, &lg_op_abs};
    const double special[] = {NAN, INFINITY, -INFINITY, 0.0, -0.0, 1.0, -1.0, 2.5};
    enum { N = LG_COUNT(special) };
    for (int isa = 0; isa < LG_ISA_COUNT; isa++)
        for (int dtype = 0; dtype < 2; dtype++)
            for (size_t o = 0; o < LG_COUNT(ops); o++)
                for (size_t n = 0; n < 2 * (size_t)N * N * N; n++) {
                    /* known in advance: folded into constants, or not */
                    const bool constant = n >= (size_t)N * N * N;
                    const lg_kernels *k = lg_kernels_of(dtype == 0 ? LG_F64 : LG_F32, (lg_isa)isa);
                    if (k == NULL) continue;
                    const double in[3] = {special[n % N], special[n / N % N], special[n / N / N % N]};
                    double numbers[3], forward, found[16];
                    unsigned char x[3][64], y[64];
                    const lg_attr attr = {.c = 0.0};
                    const lg_op *op = ops[o];
                    const lg_shape shape = lg_shape1(1);
                    const lg_shape *shapes[3] = {&shape, &shape, &shape};
                    const void *values[3] = {x[0], x[1], x[2]};
                    lg_evaluation e = {.k = k,
                                       .attr = &attr,
                                       .inputs = op->most,
                                       .in = shapes,
                                       .x = values,
                                       .shape = &shape,
                                       .count = 1,
                                       .y = y};
                    for (int i = 0; i < 3; i++) {
                        k->convert_in(1, &in[i], x[i]);
                        k->convert_out(1, x[i], &numbers[i]);
                    }
                    assert_ok(op->forward(&e));
                    k->convert_out(1, y, &forward);
                    lg_scalars s;
                    lg_scalars_init(&s, NULL);
                    lg_scalar inputs[3], result;
                    const lg_scalar *places[3] = {&inputs[0], &inputs[1], &inputs[2]};
                    for (uint32_t i = 0; i < op->most; i++)
                        inputs[i] = constant ? lg_s_constant(&s, numbers[i]) : lg_s_input(&s, i);
                    assert_true(lg_scalars_expand(&s, op, &e, places, &result));
                    walk_by_kernel(&s, k, numbers, found);
                    if (!alike(found[result], forward))
                        fail_msg("%s(%g, %g, %g): tensor %g, kernel %g", op->name, in[0], in[1], in[2],
                                 forward, found[result]);
                    lg_scalars_destroy(&s);
                }
}

TEST("a matrix that is not positive definite makes its whole row NaN, whichever zeros are known in "
     "advance") {
    const double matrices[][4] = {{2, 0, 0, -1}, {-2, 0, 0, 1},  {0, 0, 0, 1},  {2, 0, 0, 3},
                                  {1, 2, 2, 1},  {NAN, 0, 0, 1}, {1, 0, 0, NAN}};
    for (size_t m = 0; m < LG_COUNT(matrices); m++)
        for (int diagonal = 0; diagonal < 2; diagonal++) {
            lg_scalars s;
            lg_scalars_init(&s, NULL);
            const double *a = matrices[m], b[2] = {1.0, 2.0};
            const double numbers[6] = {a[0], a[1], a[2], a[3], b[0], b[1]};
            double r[256], y[2], factor[4];
            const lg_shape square = lg_shape3(1, 2, 2), column = lg_shape3(1, 2, 1);
            const lg_shape *shapes[3] = {&square, &column, &square};
            lg_scalar in[6], l[4], x[2];
            if (diagonal && a[1] != 0.0) {
                lg_scalars_destroy(&s);
                continue;
            }
            for (uint32_t i = 0; i < 6; i++)
                in[i] = diagonal && (i == 1 || i == 2) ? lg_s_constant(&s, 0.0) : lg_s_input(&s, i);
            const lg_scalar *places[3] = {in, in + 4, l};
            lg_evaluation e = {
                .k = lg_kernels_for(LG_F64), .inputs = 1, .in = shapes, .shape = &square, .count = 4};
            assert_true(lg_scalars_expand(&s, &lg_op_spd_factor, &e, places, l));
            e.inputs = 3;
            e.shape = &column;
            e.count = 2;
            assert_true(lg_scalars_expand(&s, &lg_op_spd_solve, &e, places, x));
            assert_true(s.count < 256);
            walk_by_kernel(&s, e.k, numbers, r);
            const size_t failures = e.k->spd_factor(1, 2, a, factor);
            e.k->spd_solve(1, 2, 1, factor, b, y);
            for (int i = 0; i < 2; i++) {
                assert_int_equal(isnan(y[i]), failures > 0);
                if (!alike(r[x[i]], y[i])) assert_close(r[x[i]], y[i], 1e-14, 0.0);
            }
            lg_scalars_destroy(&s);
        }
}

/* All pairs of x, -x, y, -y, 0, 1, -1, 2 for every instruction with two operands, with and without
 * simplification. */
static uint8_t nothing_known(const lg_scalars *s, const lg_scalar_code *c) {
    return 0;
}

/* Operations on numbers are carried out when the code is made. */
TEST("operations on constants have the values of the kernels; results that are not finite are left to them") {
    static const double numbers[] = {0, 1, -1, 0.3, 2.5, -7, 1e-5, 800};
    size_t folded = 0, left = 0;
    for (int op = LG_S_ADD; op < LG_SCALAR_OPS; op++)
        for (size_t i = 0; op != LG_S_SELECT && i < LG_COUNT(numbers) * LG_COUNT(numbers); i++) {
            const double a = numbers[i % LG_COUNT(numbers)], b = numbers[i / LG_COUNT(numbers)];
            lg_scalars s, plain;
            double out[8], value;
            lg_scalars_init(&s, NULL);
            lg_scalars_init(&plain, NULL);
            plain.level_of = nothing_known; /* exact code: nothing is carried out */
            const bool power = op == LG_S_POW, numbered = op == LG_S_STUMPFF || op == LG_S_DEXPINV;
            const lg_scalar made =
                power      ? lg_s_pow(&s, lg_s_constant(&s, a), b)
                : numbered ? lg_s_numbered(&s, (lg_scalar_op)op, lg_s_constant(&s, a), 1)
                           : lg_s(&s, (lg_scalar_op)op, lg_s_constant(&s, a), lg_s_constant(&s, b));
            const lg_scalar x = lg_s_constant(&plain, a), y = lg_s_constant(&plain, b);
            const lg_scalar kept = power      ? lg_s_pow(&plain, x, b)
                                   : numbered ? lg_s_numbered(&plain, (lg_scalar_op)op, x, 1)
                                              : lg_s(&plain, (lg_scalar_op)op, x, y);
            walk_by_kernel(&plain, lg_kernels_for(LG_F64), NULL, out);
            if (lg_s_is_constant(&s, made, &value)) {
                /* 0/x is 0 for every x, but exact code keeps 0/0, which is undefined. */
                if (op == LG_S_DIV && a == 0.0 && b == 0.0) out[kept] = isnan(out[kept]) ? 0.0 : 1.0;
                assert_close(value, out[kept], 1e-14, 1e-300);
                folded++;
            } else {
                assert_false(isfinite(out[kept]));
                left++;
            }
            lg_scalars_destroy(&s);
            lg_scalars_destroy(&plain);
        }
    assert_true(folded > 500 && left > 10);
}

TEST("simplified code computes the same numbers") {
    static const lg_scalar_op two[] = {LG_S_ADD, LG_S_SUB, LG_S_MUL, LG_S_DIV};
    static const double constants[] = {0.0, 1.0, -1.0, 2.0}, inputs[2] = {0.75, -1.5};
    enum { OPERANDS = 8 };
    lg_scalars s;
    lg_scalar operand[OPERANDS];
    double value[OPERANDS], r[1024];
    lg_scalars_init(&s, NULL);
    for (uint32_t i = 0; i < 2; i++) {
        operand[2 * i] = lg_s_input(&s, i);
        operand[2 * i + 1] = lg_s_neg(&s, operand[2 * i]);
        value[2 * i] = inputs[i];
        value[2 * i + 1] = -inputs[i];
    }
    for (uint32_t i = 0; i < 4; i++) {
        operand[4 + i] = lg_s_constant(&s, constants[i]);
        value[4 + i] = constants[i];
    }
    for (size_t o = 0; o < LG_COUNT(two); o++)
        for (size_t i = 0; i < OPERANDS; i++)
            for (size_t j = 0; j < OPERANDS; j++) {
                if (two[o] == LG_S_DIV && value[j] == 0.0) continue;
                const lg_scalar made = lg_s(&s, two[o], operand[i], operand[j]);
                const double a = value[i], b = value[j];
                const double want = o == 0 ? a + b : o == 1 ? a - b : o == 2 ? a * b : a / b;
                assert_false(s.failed);
                assert_true(s.count <= LG_COUNT(r));
                walk_by_kernel(&s, lg_kernels_for(LG_F64), inputs, r);
                assert_close(r[made], want, 0, 0);
            }
    lg_scalars_destroy(&s);
}

/* ---- extreme arguments ----
 *
 * An elementwise operation, computed by its tensors, its scalar code or its C in either type, must agree with
 * its scalar code in long double at arguments that differ by a few units of rounding. This finds formulas
 * that overflow or cancel in between, where long double still has digits. The reference derivative is the
 * derivative of the scalar code. Results below the smallest normal number may be 0; so may derivatives that
 * need the reciprocal of such an argument. */

enum { UNITS = 4, TRIPLES = 3000 };

typedef struct dual {
    long double v, d;
} dual;

/* Product in which a derivative of zero stays zero, even if the factor is infinite. */
static long double times(long double d, long double factor) {
    return d == 0 ? 0 : d * factor;
}

/* Runs all instructions at `in` with derivatives by input `by`. Returns false if one of them is
 * STUMPFF or DEXPINV, which test_program_c and test_kernels compare with their own references. */
static bool in_long_double(const lg_scalars *s, lg_dtype dtype, const long double *in, uint32_t by, dual *r) {
    for (uint32_t i = 0; i < s->count; i++) {
        const lg_scalar_code *c = &s->code[i];
        const dual a = r[c->in[0]], b = r[c->in[1]];
        const long double p = dtype == LG_F32 ? (long double)(float)c->p : (long double)c->p;
        dual y = {0, 0};
        switch (c->op) {
        case LG_S_INPUT:
            y = (dual){in[c->n], c->n == by};
            break;
        case LG_S_CONSTANT:
            y.v = p;
            break;
        case LG_S_ADD:
            y = (dual){a.v + b.v, a.d + b.d};
            break;
        case LG_S_SUB:
            y = (dual){a.v - b.v, a.d - b.d};
            break;
        case LG_S_MUL:
            y = (dual){a.v * b.v, times(a.d, b.v) + times(b.d, a.v)};
            break;
        case LG_S_DIV:
            y.v = a.v / b.v, y.d = times(a.d, 1 / b.v) - times(b.d, y.v / b.v);
            break;
        case LG_S_NEG:
            y = (dual){-a.v, -a.d};
            break;
        case LG_S_MAX:
            y = a.v >= b.v ? a : b;
            break;
        case LG_S_GE:
            y.v = a.v >= b.v;
            break;
        case LG_S_SELECT:
            y = a.v != 0 ? b : r[c->in[2]];
            break;
        case LG_S_SQRT:
            y.v = sqrtl(a.v), y.d = times(a.d, 0.5L / y.v);
            break;
        case LG_S_ABS:
            y = (dual){fabsl(a.v), a.v >= 0 ? a.d : -a.d};
            break;
        case LG_S_SIGN:
            y.v = a.v >= 0 ? 1 : -1;
            break;
        case LG_S_POW:
            y = (dual){powl(a.v, p), p == 0 ? 0 : times(a.d, p * powl(a.v, p - 1))};
            break;
        case LG_S_EXP:
            y.v = expl(a.v), y.d = times(a.d, y.v);
            break;
        case LG_S_LOG:
            y = (dual){logl(a.v), times(a.d, 1 / a.v)};
            break;
        case LG_S_SIN:
            y = (dual){sinl(a.v), times(a.d, cosl(a.v))};
            break;
        case LG_S_COS:
            y = (dual){cosl(a.v), times(a.d, -sinl(a.v))};
            break;
        case LG_S_TANH:
            y = (dual){tanhl(a.v), times(a.d, 1 / (coshl(a.v) * coshl(a.v)))};
            break;
        case LG_S_SIGMOID:
            y = (dual){1 / (1 + expl(-a.v)), times(a.d, 1 / ((1 + expl(-a.v)) * (1 + expl(a.v))))};
            break;
        case LG_S_ATAN2: {
            const long double square = a.v * a.v + b.v * b.v;
            y = (dual){atan2l(a.v, b.v), times(a.d, b.v / square) - times(b.d, a.v / square)};
            break;
        }
        default:
            return false;
        }
        r[i] = y;
    }
    return true;
}

/* An operation with attributes. */
typedef struct element_case {
    const lg_op *op;
    lg_attr attr;
    uint32_t inputs;
    double payload[LG_MAX_INPUTS];
} element_case;

/* The first error that was found. */
typedef struct finding {
    bool found;
    char words[256];
} finding;

typedef struct element_run {
    const element_case *of;
    lg_dtype dtype;
    lg_scalars s;
    lg_scalar y;
    size_t points;
    double *x[LG_MAX_INPUTS]; /* (points), numbers that the type can hold */
    dual *r;
    long double *wanted, *room; /* (points), the values and by how much they may differ */
} element_run;

/* The value (if `by` is no input) or the derivative at point i. If input k exists, it is moved by `units`
 * units of rounding. */
static long double reference(const element_run *e, size_t i, uint32_t by, uint32_t k, double units) {
    long double in[LG_MAX_INPUTS] = {0};
    const long double eps = e->dtype == LG_F64 ? (long double)DBL_EPSILON : (long double)FLT_EPSILON;
    for (uint32_t j = 0; j < e->of->inputs; j++)
        in[j] = (long double)e->x[j][i] * (j == k ? 1 + units * eps : 1);
    (void)in_long_double(&e->s, e->dtype, in, by, e->r);
    return by < e->of->inputs ? e->r[e->y].d : e->r[e->y].v;
}

static void find_room(const element_run *e, size_t i, uint32_t by, long double *wanted, long double *room) {
    const bool f64 = e->dtype == LG_F64;
    const long double eps = f64 ? (long double)DBL_EPSILON : (long double)FLT_EPSILON;
    const long double y = *wanted = reference(e, i, by, UINT32_MAX, 0);
    const long double size = by < e->of->inputs && e->of->op->saturates ? 1 : fabsl(y);
    *room = UNITS * eps * size + UNITS * (f64 ? (long double)DBL_MIN : (long double)FLT_MIN);
    for (uint32_t k = 0; k < e->of->inputs && isfinite(y); k++)
        for (int side = -1; side <= 1; side += 2) {
            const long double moved = reference(e, i, by, k, side * UNITS);
            if (!isnan(moved)) *room += fabsl(moved - y);
        }
}

static bool is_right(const element_run *e, size_t i, uint32_t by, double got, long double *wanted) {
    const long double most = e->dtype == LG_F64 ? (long double)DBL_MAX : (long double)FLT_MAX;
    long double room = e->room[i];
    *wanted = e->wanted[i];
    if (by < e->of->inputs) find_room(e, i, by, wanted, &room);
    const long double y = *wanted;
    if (isnan(y) || isnan(got)) return isnan(y) && isnan(got);
    if (isinf(y)) return (long double)got == y;
    if (isinf(got)) return fabsl(y) + room > most && (got > 0) == (y > 0);
    return fabsl((long double)got - y) <= room;
}

static bool has_subnormal(const element_run *e, size_t i) {
    const double least = e->dtype == LG_F64 ? DBL_MIN : (double)FLT_MIN;
    bool has = false;
    for (uint32_t k = 0; k < e->of->inputs; k++) has = has || (e->x[k][i] != 0 && fabs(e->x[k][i]) < least);
    return has;
}

static void compare_way(const element_run *e, const char *way, uint32_t by, const double *got, finding *f) {
    for (size_t i = 0; i < e->points && !f->found; i++) {
        long double wanted;
        if (by < e->of->inputs && has_subnormal(e, i)) continue;
        if (is_right(e, i, by, got[i], &wanted)) continue;
        f->found = true;
        (void)snprintf(f->words, sizeof f->words,
                       "%s (%u %u, c %g), %s, %s by %d at (%.9g, %.9g, %.9g): %.17g, not %.17Lg",
                       e->of->op->name, e->of->attr.i[0], e->of->attr.i[1], e->of->attr.c,
                       e->dtype == LG_F64 ? "f64" : "f32", way, by < e->of->inputs ? (int)by : -1, e->x[0][i],
                       e->of->inputs > 1 ? e->x[1][i] : 0.0, e->of->inputs > 2 ? e->x[2][i] : 0.0, got[i],
                       wanted);
    }
}

/* ---- drawing points ---- */

static const double sizes[] = {0,
                               0x1p-1074,
                               1e-310,
                               1e-300,
                               1e-200,
                               1e-160,
                               1e-100,
                               1e-50,
                               1e-38,
                               1e-30,
                               1e-20,
                               1e-16,
                               1e-12,
                               1e-10,
                               1e-8,
                               1e-7,
                               1e-5,
                               1e-4,
                               1e-3,
                               0.01,
                               0.05,
                               0.1,
                               0.2,
                               0.3,
                               0.4,
                               0.5,
                               0.6,
                               0.7,
                               0.8,
                               0.9,
                               0.96,
                               0.99,
                               0.9999,
                               1 - 1e-12,
                               1,
                               1.0001,
                               1.5707963267948966,
                               2,
                               3,
                               3.1415926535897931,
                               5,
                               9,
                               16,
                               17,
                               20,
                               30,
                               37,
                               40,
                               88,
                               89,
                               103,
                               500,
                               708,
                               709.5,
                               710,
                               745,
                               746,
                               1e3,
                               1e5,
                               1e8,
                               1e10,
                               1e16,
                               1e30,
                               1e38,
                               1e100,
                               1e154,
                               1e160,
                               1e200,
                               1e300};

/* Whether a number of this size may be used as input k. An input that the derivative treats as constant (a
 * helper) is an activation's value, at most 1. Products of three numbers must stay in the range of the
 * type. */
static bool belongs(const element_run *e, uint32_t k, double size) {
    const bool f64 = e->dtype == LG_F64, helper = e->of->op->frozen != ~0u && (e->of->op->frozen >> k & 1u);
    const double most = f64 ? 1e100 : 1e10;
    if (helper && size > 1) return false;
    if (e->of->inputs > 2 && size != 0 && (size > most || size < 1 / most)) return false;
    return f64 || (size <= (double)FLT_MAX && (size == 0 || (float)size != 0));
}

/* All pairs of signed sizes, or for three inputs a sample of triples. */
static void draw_points(element_run *e) {
    const size_t n = 2 * LG_COUNT(sizes);
    const uint32_t inputs = e->of->inputs;
    const size_t all = inputs == 1 ? n : inputs == 2 ? n * n : TRIPLES;
    lg_rng rng = test_rng(17, inputs);
    for (uint32_t k = 0; k < inputs; k++) e->x[k] = TEST_ARRAY(double, all);
    for (size_t p = 0; p < all; p++) {
        bool held = true;
        for (uint32_t k = 0; k < inputs; k++) {
            const size_t at = inputs == 1   ? p
                              : inputs == 2 ? (k == 0 ? p % n : p / n)
                                            : (size_t)lg_rng_below(&rng, n);
            const double size = sizes[at / 2], x = at % 2 == 0 ? size : -size;
            e->x[k][e->points] = e->dtype == LG_F32 ? (double)(float)x : x;
            held = held && belongs(e, k, size);
        }
        e->points += held;
    }
}

/* ---- tensors, scalar code and derivatives against the reference ---- */

static void by_scalars(const element_run *e, finding *f) {
    double in[LG_MAX_INPUTS], *got = TEST_ARRAY(double, e->points), *r = TEST_ARRAY(double, e->s.count);
    for (size_t i = 0; i < e->points; i++) {
        const size_t mark = lg_test_owned();
        for (uint32_t k = 0; k < e->of->inputs; k++) in[k] = e->x[k][i];
        walk_by_kernel(&e->s, lg_kernels_for(e->dtype), in, r);
        got[i] = r[e->y];
        lg_test_give_back(mark);
    }
    compare_way(e, "scalar code", UINT32_MAX, got, f);
}

static void by_tape(const element_run *e, bool derivatives, finding *f) {
    lg_tape *tape = test_tape(e->dtype);
    lg_var x[LG_MAX_INPUTS], d[LG_MAX_INPUTS];
    double *got = TEST_ARRAY(double, e->points);
    for (uint32_t k = 0; k < e->of->inputs; k++)
        x[k] = lg_input_f64(tape, lg_shape1((uint32_t)e->points), e->x[k]);
    const lg_var y = lg_record(tape, e->of->op, x, e->of->inputs, &e->of->attr);
    assert_ok(lg_read(tape, y, e->points, got));
    compare_way(e, "tensors", UINT32_MAX, got, f);
    if (!derivatives) return;
    assert_ok(lg_grad(tape, y, x, e->of->inputs, d));
    for (uint32_t k = 0; k < e->of->inputs; k++) {
        assert_ok(lg_read(tape, d[k], e->points, got));
        compare_way(e, "derivative", k, got, f);
    }
}

static void by_c(const element_run *e, shim run, finding *f) {
    double *got = TEST_ARRAY(double, e->points), work[4096];
    for (size_t i = 0; i < e->points; i++) {
        unsigned char x[3][8], y[8];
        for (uint32_t k = 0; k < e->of->inputs; k++)
            lg_kernels_for(e->dtype)->convert_in(1, &e->x[k][i], x[k]);
        run((const void *[]){x[0], x[1], x[2]}, (void *[]){y}, work);
        lg_kernels_for(e->dtype)->convert_out(1, y, &got[i]);
    }
    compare_way(e, "C", UINT32_MAX, got, f);
}

/* Makes the scalar code. Returns false if it contains a function of an angle. */
static bool open_run(element_run *e, const element_case *of, lg_dtype dtype) {
    lg_scalar x[LG_MAX_INPUTS];
    const long double nowhere[LG_MAX_INPUTS] = {0};
    *e = (element_run){.of = of, .dtype = dtype};
    lg_scalars_init(&e->s, NULL);
    for (uint32_t k = 0; k < of->inputs; k++) x[k] = lg_s_input(&e->s, k);
    e->y = of->op->element(&e->s, &of->attr, x, of->inputs);
    e->r = TEST_ARRAY(dual, e->s.count);
    return in_long_double(&e->s, dtype, nowhere, 0, e->r);
}

/* `made`: C that computes it, two ways in f64, then two in f32; or NULL. */
static void check_element(const element_case *of, const compiled made[4], const char *name, finding *f) {
    for (int dtype = 0; dtype < 2 && !f->found; dtype++) {
        element_run e;
        const size_t mark = lg_test_owned();
        assert_true(open_run(&e, of, (lg_dtype)dtype));
        draw_points(&e);
        e.wanted = TEST_ARRAY(long double, e.points), e.room = TEST_ARRAY(long double, e.points);
        for (size_t i = 0; i < e.points; i++) find_room(&e, i, UINT32_MAX, &e.wanted[i], &e.room[i]);
        by_scalars(&e, f);
        by_tape(&e, of->op->frozen == 0, f);
        for (int way = 0; made != NULL && way < 2; way++) by_c(&e, shim_of(&made[2 * dtype + way], name), f);
        lg_scalars_destroy(&e.s);
        lg_test_give_back(mark);
    }
}

/* ---- all operations ---- */

enum { CASES = 256 };
static element_case element_cases[CASES];
static size_t element_count;

static void add_case(const element_case *c) {
    for (size_t i = 0; i < element_count; i++)
        if (memcmp(&element_cases[i], c, sizeof *c) == 0) return;
    assert_true(element_count < CASES);
    element_cases[element_count++] = *c;
}

static void note_case(const lg_tape *tape, const lg_node *node, const char *row) {
    if (node->op->element == NULL || node->inputs > 3) return;
    element_case c = {.op = node->op, .attr = node->attr, .inputs = node->inputs};
    for (uint32_t k = 0; node->op->payload == LG_PAYLOAD_REALS && k < node->inputs; k++)
        c.payload[k] = ((const double *)node->attr.pointer)[k];
    c.attr.pointer = NULL;
    add_case(&c);
}

/* Adds the derivatives of activations computed from a stored value, of all orders, with and without a
 * factor. */
static void note_derivatives(void) {
    for (uint32_t kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
        for (uint32_t order = 0; order <= LG_K_ACT_ORDERS; order++)
            for (uint32_t factor = 0; factor < 2; factor++) {
                const element_case c = {.op = &lg_op_act_derivative,
                                        .attr = {.i = {kind, order, 1, factor}},
                                        .inputs = 2 + factor};
                add_case(&c);
            }
}

/* Adds all cases except the functions of an angle. Returns the number of those. */
static size_t note_cases(void) {
    element_count = 0;
    each_node(note_case);
    note_derivatives();
    size_t kept = 0;
    for (size_t i = 0; i < element_count; i++) {
        element_case c = element_cases[i];
        element_run e;
        const size_t mark = lg_test_owned();
        if (c.op->payload == LG_PAYLOAD_REALS) c.attr.pointer = c.payload;
        seen[lg_op_place(c.op)] = true;
        if (open_run(&e, &c, LG_F64)) element_cases[kept++] = c;
        lg_scalars_destroy(&e.s);
        lg_test_give_back(mark);
    }
    const size_t angles = element_count - kept;
    element_count = kept;
    for (size_t i = 0; i < kept; i++)
        if (element_cases[i].attr.pointer != NULL) element_cases[i].attr.pointer = element_cases[i].payload;
    return angles;
}

static lg_status record_case(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const element_case *c = user;
    y[0] = lg_record(tape, c->op, x, c->inputs, &c->attr);
    return lg_tape_status(tape);
}

static lg_program *program_of_cases(void) {
    static const lg_port in[3] = {{.name = "a", .low = 0.1, .high = 0.9},
                                  {.name = "b", .low = 0.1, .high = 0.9},
                                  {.name = "c", .low = 0.1, .high = 0.9}};
    static const lg_port out = {.name = "y"};
    static lg_function_spec functions[CASES];
    static char names[CASES][24];
    lg_program_spec spec;
    lg_program *program = NULL;
    for (size_t i = 0; i < element_count; i++) {
        (void)snprintf(names[i], sizeof names[i], "f%zu", i);
        functions[i] = (lg_function_spec){names[i], in,          element_cases[i].inputs, &out,
                                          1,        record_case, &element_cases[i]};
    }
    lg_program_spec_init(&spec);
    spec.functions = functions, spec.function_count = element_count;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    return program;
}

TEST("elementwise operations and their derivatives keep their digits at extreme arguments, in C too") {
    memset(seen, 0, sizeof seen);
    const size_t angles = note_cases();
    const bool compiles = has_compiler();
    compiled made[4];
    lg_program *program = program_of_cases();
    for (int way = 0; compiles && way < 4; way++) {
        if (!compile_program(&made[way], program, "gcc", "-O1", way / 2 == 0 ? LG_F64 : LG_F32, way % 2 == 1))
            fail_msg("%s", made[way].why);
        assert_true(made[way].source->work_size <= 4096);
    }
    for (size_t i = 0; i < element_count; i++) {
        finding f = {.found = false};
        check_element(&element_cases[i], compiles ? made : NULL, lg_program_function_name(program, i), &f);
        if (f.found) fail_msg("%s", f.words);
    }
    for (int way = 0; compiles && way < 4; way++) assert_true(discard_compiled(&made[way]));
    lg_program_destroy(program);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (lg_ops[i]->element != NULL && !seen[i]) fail_msg("%s was on no tape", lg_ops[i]->name);
    print_message("%zu rows with their attributes; %zu functions of an angle are held elsewhere\n",
                  element_count, angles);
}

/* ---- formulas that lose digits, and good ones ---- */

/* log(1 + u) for u >= 0 with a small relative error (W. Kahan). */
static lg_scalar log_one_more(lg_scalars *s, lg_scalar u) {
    const lg_scalar one = lg_s_constant(s, 1.0), w = lg_s_add(s, one, u), rest = lg_s_sub(s, w, one);
    const lg_scalar same = lg_s(s, LG_S_GE, lg_s_constant(s, 0.0), rest);
    const lg_scalar divisor = lg_s_select(s, same, one, rest);
    return lg_s_select(s, same, u, lg_s_mul(s, u, lg_s_div(s, lg_s(s, LG_S_LOG, w, w), divisor)));
}

static lg_scalar square_of(lg_scalars *s, lg_scalar x) {
    return lg_s_mul(s, x, x);
}

/* asinh x = log(x + sqrt(x^2 + 1)): overflows, and cancels for x < 0. */
static lg_scalar plain_asinh(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const lg_scalar more = lg_s_add(s, square_of(s, x[0]), lg_s_constant(s, 1.0));
    const lg_scalar sum = lg_s_add(s, x[0], lg_s(s, LG_S_SQRT, more, more));
    return lg_s(s, LG_S_LOG, sum, sum);
}

/* sign x log(|x| + sqrt(x^2 + 1)): overflows, and loses digits near 0. */
static lg_scalar odd_asinh(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const lg_scalar size = lg_s(s, LG_S_ABS, x[0], x[0]);
    return lg_s_mul(s, lg_s(s, LG_S_SIGN, x[0], x[0]), plain_asinh(s, attr, &size, 1));
}

/* As odd_asinh, without overflow: log 2 |x| from 1e9 on. */
static lg_scalar large_asinh(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const lg_scalar size = lg_s(s, LG_S_ABS, x[0], x[0]), limit = lg_s_constant(s, 1e9);
    const lg_scalar large = lg_s(s, LG_S_GE, size, limit), inner = lg_s_select(s, large, limit, size);
    const lg_scalar far = lg_s_add(s, lg_s(s, LG_S_LOG, size, size), lg_s_constant(s, 0.69314718055994531));
    const lg_scalar y = lg_s_select(s, large, far, plain_asinh(s, attr, &inner, 1));
    return lg_s_mul(s, lg_s(s, LG_S_SIGN, x[0], x[0]), y);
}

/* As large_asinh, and with full digits near 0: log(1 + |x| + x^2/(1 + sqrt(x^2 + 1))). */
static lg_scalar good_asinh(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const lg_scalar size = lg_s(s, LG_S_ABS, x[0], x[0]), limit = lg_s_constant(s, 1e9);
    const lg_scalar large = lg_s(s, LG_S_GE, size, limit), inner = lg_s_select(s, large, limit, size);
    const lg_scalar one = lg_s_constant(s, 1.0), square = square_of(s, inner),
                    more = lg_s_add(s, square, one);
    const lg_scalar below = lg_s_add(s, one, lg_s(s, LG_S_SQRT, more, more));
    const lg_scalar near = log_one_more(s, lg_s_add(s, inner, lg_s_div(s, square, below)));
    const lg_scalar far = lg_s_add(s, lg_s(s, LG_S_LOG, size, size), lg_s_constant(s, 0.69314718055994531));
    return lg_s_mul(s, lg_s(s, LG_S_SIGN, x[0], x[0]), lg_s_select(s, large, far, near));
}

/* |x| + log((1 + exp(-2 |x|))/2): cancels near 0. */
static lg_scalar plain_logcosh(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const lg_scalar size = lg_s(s, LG_S_ABS, x[0], x[0]), twice = lg_s_scale(s, -2.0, size);
    const lg_scalar sum = lg_s_add(s, lg_s_constant(s, 1.0), lg_s(s, LG_S_EXP, twice, twice));
    const lg_scalar half = lg_s_scale(s, 0.5, sum);
    return lg_s_add(s, size, lg_s(s, LG_S_LOG, half, half));
}

/* The formula of docs/adding.md: log(1 + 2 t^2/(1 - t^2)), t = tanh(x/2), for |x| < 1. */
static lg_scalar good_logcosh(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const lg_scalar size = lg_s(s, LG_S_ABS, x[0], x[0]), one = lg_s_constant(s, 1.0);
    const lg_scalar large = lg_s(s, LG_S_GE, size, one), half = lg_s_scale(s, 0.5, x[0]);
    const lg_scalar t = lg_s(s, LG_S_TANH, half, half), square = square_of(s, t);
    const lg_scalar u =
        lg_s_select(s, large, one, lg_s_div(s, lg_s_scale(s, 2.0, square), lg_s_sub(s, one, square)));
    return lg_s_select(s, large, plain_logcosh(s, attr, x, inputs), log_one_more(s, u));
}

/* The tensor operation by a function of the C library. */
#define PLANTED_FORWARD(name, function)                                                                      \
    static lg_status name(lg_evaluation *e) {                                                                \
        for (size_t i = 0; i < e->count; i++) {                                                              \
            double x, y;                                                                                     \
            e->k->convert_out(1, (const char *)e->x[0] + i * e->k->size, &x);                                \
            y = function;                                                                                    \
            e->k->convert_in(1, &y, (char *)e->y + i * e->k->size);                                          \
        }                                                                                                    \
        return LG_OK;                                                                                        \
    }
PLANTED_FORWARD(asinh_forward, asinh(x))
PLANTED_FORWARD(logcosh_forward, fabs(x) < 1 ? log1p(2 * sinh(x / 2) * sinh(x / 2))
                                             : fabs(x) + log1p(exp(-2 * fabs(x))) - 0.69314718055994531)

TEST("a formula that overflows in between or cancels is found, and a good one passes") {
    static const struct {
        const char *name;
        lg_status (*forward)(lg_evaluation *e);
        lg_scalar (*element)(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs);
        bool sound;
    } rows[] = {{"plain asinh", asinh_forward, plain_asinh, false},
                {"odd asinh", asinh_forward, odd_asinh, false},
                {"large asinh", asinh_forward, large_asinh, false},
                {"asinh", asinh_forward, good_asinh, true},
                {"plain log cosh", logcosh_forward, plain_logcosh, false},
                {"log cosh", logcosh_forward, good_logcosh, true}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_op op = lg_op_sin;
        op.name = rows[i].name;
        op.forward = rows[i].forward;
        op.element = rows[i].element;
        op.frozen = ~0u; /* its derivative is not checked */
        const element_case c = {.op = &op, .inputs = 1};
        finding f = {.found = false};
        check_element(&c, NULL, NULL, &f);
        if (f.found != !rows[i].sound) fail_msg("%s: %s", rows[i].name, f.found ? f.words : "not found");
        if (f.found) print_message("found: %s\n", f.words);
    }
}
