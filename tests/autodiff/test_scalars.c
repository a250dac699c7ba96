/* Scalar code of operations: every operation that has some, on every node that the registry of the gradient
 * check puts on a tape, is the same function as the operation's tensors, on every instruction set, in both
 * types. Elementwise operations may work over an input. ctest-labels: isa */
#include "row_support.h"

#include "autodiff/op_rows.h"
#include "autodiff/op_table.h"
#include "autodiff/scalars.h"

/* ---- nodes ---- */

typedef void (*visit_fn)(const lg_tape *tape, const lg_node *node, const char *row);

/* All nodes of all rows: of values, of both derivatives and of the derivatives' derivatives. */
static void each_node(visit_fn visit) {
    const lg_gradcheck_case *row;
    lg_rng rng;
    lg_rng_seed(&rng, 5, 1);
    for (size_t r = 0; (row = lg_gradcheck_operation(r)) != NULL; r++) {
        const lg_gradcheck_function *f = &row->function;
        lg_var back[LG_GRADCHECK_MAX_INPUTS], forward;
        lg_tape *tape = test_tape(LG_F64);
        const row_on_tape on = record_row(tape, &rng, f);
        assert_ok(lg_jvp(tape, &on.y, 1, on.x, on.d, f->inputs, &forward));
        assert_ok(lg_vjp(tape, &on.y, &forward, 1, on.x, f->inputs, back));
        if (!f->first_order_only) assert_ok(lg_vjp(tape, back, on.d, f->inputs, on.x, f->inputs, back));
        for (uint32_t i = 0; i < tape->count; i++) {
            const size_t mark = lg_test_owned();
            visit(tape, &tape->nodes[i], f->name);
            lg_test_give_back(mark);
        }
    }
}

/* ---- one node, evaluated in all ways ---- */

enum { MOST = 4096 };

/* Inputs in the table's type; NULL where they are not read. */
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

/* The numbers of the inputs, one after another, as INPUT instructions have them. */
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

/* ---- the kernel, an instruction at a time ---- */

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
    /* Registers: instructions, then the exponents of powers. */
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

/* ---- equal to the tensors ---- */

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
            double size = 1e-30; /* of inputs: differences cancel */
            for (size_t i = 0; i < inputs_of(&v, NULL); i++) size = fmax(size, fabs(inputs[i]));
            compare(row, op->name, y, r, forward, node->count, size, dtype == 0 ? 1e-13 : 2e-5);
            lg_scalars_destroy(&s);
        }
    seen[lg_op_place(node->op)] = true;
}

TEST("scalar code equals the operation") {
    memset(seen, 0, sizeof seen);
    each_node(check_scalars);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if ((lg_ops[i]->element != NULL || lg_ops[i]->expand != NULL) && !seen[i])
            fail_msg("%s was on no tape", lg_ops[i]->name);
}

/* ---- over an input: what plans do with elementwise operations ---- */

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

TEST("elementwise operations work over an input") {
    memset(seen, 0, sizeof seen);
    each_node(check_over);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (lg_ops[i]->element != NULL && !seen[i]) fail_msg("%s was on no tape", lg_ops[i]->name);
}

/* ---- numbers that are not finite ---- */

static bool alike(double a, double b) {
    return a == b ? signbit(a) == signbit(b) || a == 0.0 : isnan(a) && isnan(b);
}

TEST("not finite numbers are treated alike") {
    static const lg_op *const ops[] = {&lg_op_max, &lg_op_ge, &lg_op_select, &lg_op_sign, &lg_op_abs};
    const double special[] = {NAN, INFINITY, -INFINITY, 0.0, -0.0, 1.0, -1.0, 2.5};
    enum { N = LG_COUNT(special) };
    for (int isa = 0; isa < LG_ISA_COUNT; isa++)
        for (int dtype = 0; dtype < 2; dtype++)
            for (size_t o = 0; o < LG_COUNT(ops); o++)
                for (size_t n = 0; n < 2 * (size_t)N * N * N; n++) {
                    const bool constant = n >= (size_t)N * N * N; /* known beforehand: carried out, or left */
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

TEST("a matrix that is not positive makes all of its row NaN, whatever zeros are known") {
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

/* Every pair of x, -x, y, -y, 0, 1, -1, 2 under every instruction of two operands, simplified or not. */
TEST("simplified code is the same") {
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
