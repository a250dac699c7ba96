/* Gradients by a vector of parameters in plans: sums of padded adjoints are concatenations, whose parts are
 * computed where they belong, and products are added in place. The tape is the reference.
 * ctest-labels: isa */
#include "support/malloc_count.h"
#include "autodiff/plan_ways.h"

#include "autodiff/ops/op_rows.h"
#include "autodiff/program/plan.h"

enum { IN = 30, WIDTH = 40, GAP = 60, ALL = IN * WIDTH + WIDTH + GAP + WIDTH * WIDTH + GAP };

/* What a case adds to the loss. */
typedef enum reading {
    PLAIN,
    OVERLAPPING, /* a slice that overlaps two others */
    WITHIN,      /* a slice is a slice of a slice */
    AGAIN,       /* the same slice is recorded twice */
    KEPT,        /* a part of the gradient is an output, and is read again */
    TWICE,       /* two slices have the same adjoint */
    INNER        /* the gradient is no output */
} reading;

static lg_var matrix(lg_tape *tape, lg_var all, uint32_t first, uint32_t rows, uint32_t columns) {
    return lg_reshape(tape, lg_slice(tape, all, 0, first, rows * columns), lg_shape2(rows, columns));
}

/* The gradients by the parameters x[0] and by x[1] (batched) of a network of two layers, the second used
 * twice. Its parameters lie apart. */
RECORDING(record_gradient) {
    const reading *how = user;
    const lg_var whole = *how == WITHIN ? lg_slice(tape, x[0], 0, 10, ALL - 20) : x[0];
    const lg_var first = matrix(tape, x[0], 0, IN, WIDTH);
    const lg_var bias = lg_slice(tape, x[0], 0, IN * WIDTH, WIDTH);
    const lg_var second = matrix(tape, whole, IN * WIDTH + WIDTH + GAP, WIDTH, WIDTH);
    const lg_var h = lg_act(tape, lg_add(tape, lg_matmul(tape, x[1], first), bias), LG_TANH);
    const lg_var g = lg_act(tape, lg_matmul(tape, h, second), LG_TANH);
    const lg_var third = *how == AGAIN ? matrix(tape, whole, IN * WIDTH + WIDTH + GAP, WIDTH, WIDTH) : second;
    lg_var loss = lg_sum(tape, lg_square(tape, lg_matmul(tape, g, third)));
    if (*how == OVERLAPPING)
        loss = lg_add(tape, loss,
                      lg_sum(tape, lg_square(tape, lg_slice(tape, whole, 0, IN * WIDTH - 5, WIDTH))));
    if (*how == TWICE) {
        const lg_var ends =
            lg_add(tape, lg_slice(tape, whole, 0, ALL - 20, 10), lg_slice(tape, whole, 0, ALL - 10, 10));
        loss = lg_add(tape, loss, lg_sum(tape, lg_sin(tape, ends)));
    }
    const lg_var halves[] = {lg_slice(tape, x[1], 1, 0, IN / 2), lg_slice(tape, x[1], 1, IN / 2, IN / 2)};
    loss = lg_add(tape, loss, lg_sum(tape, lg_mul(tape, lg_sin(tape, halves[0]), halves[1])));
    assert_ok(lg_grad(tape, loss, x, 2, y));
    y[2] = lg_slice(tape, y[0], 0, ALL - 1, 1);
    if (*how == INNER) {
        /* The gradient's part is read after the gradient's only reader and after a tensor as large. */
        lg_var part;
        assert_ok(lg_grad(tape, loss, &second, 1, &part));
        y[0] = lg_scale(tape, y[0], 0.5);
        const lg_var large = lg_matmul(tape, x[2], lg_reshape(tape, x[0], lg_shape2(1, ALL)));
        y[2] = lg_add(tape, lg_sum(tape, lg_square(tape, large)), lg_sum(tape, lg_scale(tape, part, 0.001)));
    }
    if (*how != KEPT) return;
    assert_ok(lg_grad(tape, loss, &second, 1, &y[2]));
    y[0] = lg_add(tape, y[0],
                  lg_scale(tape, lg_pad(tape, lg_sum_axis(tape, y[2], 0, false), 0, 0, ALL - WIDTH), 0.5));
}

static lg_program *gradient(reading *how) {
    static const lg_port in[] = {{.name = "theta", .shape = {1, {ALL}}, .shared = true},
                                 {.name = "x", .shape = {1, {IN}}},
                                 {.name = "u", .shape = {2, {1, 1}}, .shared = true}},
                         out[] = {{.name = "g"}, {.name = "d"}, {.name = "s"}};
    const lg_function_spec function = {"gradient", in, 3, out, 3, record_gradient, how};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    return test_program(&spec);
}

TEST("gradients by slices of parameters agree with the tape") {
    for (reading how = PLAIN; how <= INNER; how++) check_all("gradient", gradient(&how));
}

/* Sums with products, which may have other readers. */
RECORDING(record_sums) {
    const lg_var ab = lg_matmul(tape, x[0], x[1]), ba = lg_matmul(tape, x[1], x[0]);
    const lg_var term = lg_act(tape, x[0], LG_TANH);
    y[0] = lg_add(tape, ab, ba);
    y[1] = lg_add(tape, lg_sin(tape, ab), lg_cos(tape, ba));
    y[2] = lg_add(tape, lg_matmul(tape, x[0], x[0]), term);
    y[3] = lg_scale(tape, term, 2.0);
    y[4] = lg_add(tape, lg_sin(tape, x[1]), lg_matmul(tape, x[1], x[1]));
}

TEST("sums with products agree with the tape") {
    static const lg_port in[] = {{.name = "A", .shape = {2, {WIDTH, WIDTH}}, .shared = true},
                                 {.name = "B", .shape = {2, {WIDTH, WIDTH}}, .shared = true}},
                         out[] = {{.name = "p"}, {.name = "q"}, {.name = "r"}, {.name = "s"}, {.name = "t"}};
    const lg_function_spec function = {"sums", in, 2, out, 5, record_sums, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    check_all("sums", test_program(&spec));
}

/* Elements that steps of this operation compute. */
static size_t computed(const lg_plan *plan, const lg_op *op) {
    size_t count = 0;
    for (size_t s = 0; s < plan->steps; s++)
        if (plan->step[s].kind == LG_STEP_TENSOR && plan->step[s].tensor.op == op)
            count += plan->step[s].tensor.count;
    return count;
}

static size_t copied(const lg_plan *plan) {
    size_t count = 0;
    for (size_t s = 0; s < plan->steps; s++)
        if (plan->step[s].kind == LG_STEP_COPY) count += plan->step[s].copy.count;
    return count;
}

TEST("the parts of a gradient are computed in its memory") {
    reading how = PLAIN;
    const lg_plan_options options = plan_options(64, LG_F64);
    const lg_plan *plan = test_plan(gradient(&how), 0, &options);
    assert_int_equal(computed(plan, &lg_op_pad), 0);
    assert_int_equal(computed(plan, &lg_op_add), 64 * WIDTH); /* the bias; products are added in place */
    assert_int_equal(copied(plan), 1 + GAP); /* s, which is a part of g, and the zeros of the second gap */
    how = TWICE;
    plan = test_plan(gradient(&how), 0, &options);
    assert_int_equal(copied(plan), 1 + 10);
}
